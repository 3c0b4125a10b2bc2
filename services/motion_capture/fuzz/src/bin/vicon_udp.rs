#![no_main]

use libfuzzer_sys::fuzz_target;
use motion_capture::{vicon_udp, wire::Frame};

fuzz_target!(|bytes: &[u8]| {
    let mut frame = Frame::new();
    let _ = vicon_udp::decode(bytes, &mut frame);
    motion_capture_fuzz::check(&frame);
});
