#![no_main]

use libfuzzer_sys::fuzz_target;
use motion_capture::vrpn::Decoder;

/// The bytes at once and in pieces are the same frames, up to the error if there is one.
fuzz_target!(|bytes: &[u8]| {
    let [mut whole, mut pieces] = [Vec::new(), Vec::new()];
    let at_once = Decoder::new().push(bytes, |frame| whole.push(frame.clone()));
    let mut decoder = Decoder::new();
    let in_pieces = bytes
        .chunks(13)
        .try_for_each(|piece| decoder.push(piece, |frame| pieces.push(frame.clone())));
    assert_eq!(at_once, in_pieces);
    assert_eq!(whole, pieces);
    whole.iter().for_each(motion_capture_fuzz::check);
});
