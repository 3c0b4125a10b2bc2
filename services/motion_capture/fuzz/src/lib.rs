//! Invariants of the decoders of all motion-capture systems for arbitrary bytes.

use std::net::{Ipv4Addr, SocketAddrV4};

use motion_capture::natnet::Version;
use motion_capture::protocol::{self, Decode, Plan, Transport};
use motion_capture::wire::{Frame, MAX_BODIES, WireError};
use scenario::CaptureSystem;

/// Versions of the `NatNet` bit stream; other systems ignore them.
const VERSIONS: [(u8, u8); 3] = [(3, 1), (4, 0), (4, 1)];

/// Asserts that every decoder, before and after the introduction, gives only valid frames, and that a stream decodes
/// equally at once and in pieces, up to the same error.
///
/// # Panics
/// If a decoder violates this.
pub fn check(bytes: &[u8]) {
    for system in CaptureSystem::ALL {
        let protocol = protocol::for_system(system);
        check_decoder(system, bytes, || protocol.decoder());
        for (major, minor) in VERSIONS {
            check_decoder(system, bytes, || introduced(system, Version { major, minor }));
        }
    }
}

fn introduced(system: CaptureSystem, version: Version) -> Box<dyn Decode> {
    let protocol = protocol::for_system(system);
    let at = SocketAddrV4::new(Ipv4Addr::LOCALHOST, 1511);
    let plan = Plan {
        system,
        at,
        to: at,
        version,
    };
    let mut decoder = protocol.decoder();
    for packet in protocol.introduction(&plan, &["quad"]) {
        assert_eq!(decoder.decode(&packet, &mut |_| ()), Ok(()), "{system:?}");
    }
    decoder
}

fn check_decoder(system: CaptureSystem, bytes: &[u8], decoder: impl Fn() -> Box<dyn Decode>) {
    let at_once = decoded(&mut *decoder(), [bytes]);
    for frame in &at_once.0 {
        check_frame(frame);
    }
    if protocol::for_system(system).transport() == Transport::Connections {
        assert_eq!(at_once, decoded(&mut *decoder(), bytes.chunks(13)), "{system:?}");
    }
}

/// Returns the decoded frames, and the error that ended the stream, if any.
fn decoded<'a>(
    decoder: &mut dyn Decode,
    pieces: impl IntoIterator<Item = &'a [u8]>,
) -> (Vec<Frame>, Result<(), WireError>) {
    let mut frames = Vec::new();
    let mut pieces = pieces.into_iter();
    let result = pieces.try_for_each(|piece| decoder.decode(piece, &mut |frame| frames.push(frame.clone())));
    (frames, result)
}

fn check_frame(frame: &Frame) {
    assert!(frame.bodies().len() <= MAX_BODIES);
    for pose in frame.bodies().iter().filter_map(|body| body.pose) {
        assert!(pose.position.iter().all(|coordinate| coordinate.abs() <= 1e3));
        assert!((pose.capture_from_markers.determinant() - 1.0).abs() < 1e-9);
    }
}
