//! Decoders and packets of every system, by its own encoder.

use std::net::{Ipv4Addr, SocketAddrV4};

use motion_capture::conventions::{Calibration, WorldPose};
use motion_capture::natnet::Version;
use motion_capture::protocol::{self, Decode, Plan, SentFrame};
use motion_capture::wire::CapturePose;
use nalgebra::Vector3;
use scenario::CaptureSystem;
use shared_types::rotation::exp;

/// Time between two frames, ns.
pub const PERIOD_NS: u64 = 10_000_000;

/// Returns the plan of a server on the loopback.
pub fn plan(system: CaptureSystem) -> Plan {
    let at = SocketAddrV4::new(Ipv4Addr::LOCALHOST, 1511);
    Plan {
        system,
        at,
        to: at,
        version: Version { major: 4, minor: 1 },
    }
}

/// Returns a decoder that has taken the introduction of these bodies, or nothing yet.
pub fn decoder(system: CaptureSystem, is_introduced: bool, bodies: &[&str]) -> Box<dyn Decode> {
    let protocol = protocol::for_system(system);
    let mut decoder = protocol.decoder();
    if is_introduced {
        for packet in protocol.introduction(&plan(system), bodies) {
            decoder.decode(&packet, &mut |_| ()).unwrap();
        }
    }
    decoder
}

/// Returns the pose of a body that flies, in the usual axes of a system.
pub fn pose(system: CaptureSystem, number: u32) -> CapturePose {
    let t = f64::from(number) * 0.01;
    Calibration::new(system, None, None).capture_pose(&WorldPose {
        position_world: Vector3::new(libm::cos(t), libm::sin(t), -1.0 + 0.1 * libm::sin(3.0 * t)),
        world_from_body: exp(&(Vector3::new(libm::sin(5.0 * t), libm::cos(5.0 * t), 0.0) * 0.1)),
    })
}

/// Encodes a frame that was exposed, computed and sent at one time.
pub fn frame(system: CaptureSystem, number: u32, bodies: &[(&str, Option<CapturePose>)]) -> Vec<u8> {
    let at_ns = u64::from(number) * PERIOD_NS + 1_000_000;
    let sent = SentFrame {
        number,
        exposed_ns: at_ns,
        computed_ns: at_ns,
        sent_ns: at_ns,
    };
    protocol::for_system(system).frame(&plan(system), &sent, bodies)
}

/// Returns the packets of a system's introduction and a frame of two bodies, with the names of their files.
pub fn packets() -> impl Iterator<Item = (String, Vec<u8>)> {
    CaptureSystem::ALL.into_iter().flat_map(|system| {
        let bodies = ["quad", "wand"];
        let mut packets = protocol::for_system(system).introduction(&plan(system), &bodies);
        packets.push(frame(
            system,
            5,
            &bodies.map(|name| (name, Some(pose(system, 5)))),
        ));
        let named = (1..).zip(packets);
        named.map(move |(number, packet)| (format!("{}_{number}", system.name()), packet))
    })
}
