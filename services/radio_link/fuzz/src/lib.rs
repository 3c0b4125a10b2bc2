//! Invariants of the decoders of radio links for arbitrary bytes.

use radio_link::crazyflie::log::LogServer;
use radio_link::frame::Frame;
use radio_link::receiver::{Command, Receiver};
use radio_link::telemetry::Telemetry;
use radio_link::{crazyflie, crsf, format, mavlink, msp, multi, sbus};
use scenario::{Mavlink, MavlinkMessage, RadioProtocol, RcLink, Transmitter};

/// Returns every link, `MAVLink` with each of its two messages.
fn links() -> impl Iterator<Item = (RadioProtocol, MavlinkMessage)> {
    let with_channels = RadioProtocol::ALL.map(|link| (link, MavlinkMessage::RcOverride));
    let without = (RadioProtocol::Mavlink, MavlinkMessage::AttitudeTarget);
    with_channels.into_iter().chain([without])
}

fn receiver((link, message): (RadioProtocol, MavlinkMessage)) -> Receiver {
    let transmitter = Transmitter {
        arming_channel: Some(6),
        mavlink: Some(Mavlink {
            message,
            ..Mavlink::default()
        }),
        ..Transmitter::default()
    };
    let link = RcLink {
        link,
        ..RcLink::default()
    };
    Receiver::new(&link, &transmitter).expect("the link is not simulated")
}

/// Decodes bytes that arrive in pieces of `piece` bytes. Returns the commands and the number of bytes outside of frames.
fn decoded(link: (RadioProtocol, MavlinkMessage), bytes: &[u8], piece: usize) -> (Vec<Command>, u64) {
    let mut receiver = receiver(link);
    let mut commands = Vec::new();
    for piece in bytes.chunks(piece) {
        receiver.push(piece, &mut |command| commands.push(*command));
    }
    assert_eq!(receiver.received().frames, commands.len() as u64);
    (commands, receiver.received().skipped)
}

/// Returns the voltages that a link reads in what a vehicle sends back, in pieces of `piece` bytes.
fn voltages((link, message): (RadioProtocol, MavlinkMessage), bytes: &[u8], piece: usize) -> Vec<f64> {
    let transmitter = Transmitter {
        mavlink: Some(Mavlink {
            message,
            ..Mavlink::default()
        }),
        ..Transmitter::default()
    };
    let link = RcLink {
        link,
        ..RcLink::default()
    };
    let mut format = format::for_link(&link, &transmitter).expect("the link is not simulated");
    let mut telemetry = Telemetry::default();
    let mut request = Frame::default();
    let read = bytes.chunks(piece).filter_map(|piece| {
        request.clear();
        format.request_voltage(0, true, &mut request);
        telemetry.push(&mut *format, piece)
    });
    read.collect()
}

/// Asserts that every decoder gives the same result for the bytes at once and in pieces.
///
/// # Panics
/// If the results differ.
pub fn check(bytes: &[u8]) {
    let _ = (crsf::decode(bytes), sbus::decode(bytes), multi::decode(bytes));
    let _ = (msp::decode(bytes), mavlink::decode(bytes), crazyflie::decode(bytes));
    let mut answers = msp::Receiver::default();
    for byte in bytes {
        let _ = answers.push(*byte);
    }
    let mut answer = Frame::default();
    let _ = LogServer::default().answer(&bytes[..bytes.len().min(64)], &mut answer);
    for link in links() {
        for piece in [7, 64] {
            let read = voltages(link, bytes, piece);
            assert!(read.iter().all(|voltage| (1.0..=100.0).contains(voltage)), "{read:?}");
        }
        // The newest voltage of all bytes is that of the last piece with one.
        let is_stream = link.0 != RadioProtocol::Crazyflie;
        let (at_once, in_pieces) = (voltages(link, bytes, usize::MAX), voltages(link, bytes, 11));
        assert!(!is_stream || at_once.last() == in_pieces.last(), "{link:?}");
        let (at_once, skipped) = decoded(link, bytes, usize::MAX);
        // A packet is decoded whole, and so are its pieces: each for itself.
        let in_pieces = decoded(link, bytes, 7);
        if link.0 != RadioProtocol::Crazyflie {
            assert_eq!((at_once.clone(), skipped), in_pieces, "{link:?}");
        }
        assert!(skipped <= bytes.len() as u64);
        for Command { codes, travels, .. } in &at_once {
            let is_small = |travel: &f64| travel.abs() <= 1e3;
            let has_channels = codes.iter().any(|code| *code != 0);
            assert!(!has_channels || travels.iter().all(is_small), "{travels:?}");
        }
    }
}
