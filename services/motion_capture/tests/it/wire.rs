//! Decoders give back what was encoded, and nothing that a stranger sends makes them panic, grow, or give half a frame.

#![expect(clippy::disallowed_methods, reason = "tests make their own files")]

use crate::systems;
use std::path::Path;

use motion_capture::natnet::{Received, RigidBody, ServerInfo, Times, Version};
use motion_capture::protocol::{self, Transport};
use motion_capture::vicon_udp::{NAME_LENGTH, Object};
use motion_capture::vrpn::{COOKIE, PoseReport};
use motion_capture::wire::{Frame, MAX_BODIES};
use motion_capture::{natnet, vicon_udp, vrpn};
use nalgebra::{Quaternion, UnitQuaternion};
use proptest::prelude::*;
use scenario::CaptureSystem;

const VERSIONS: [Version; 5] = [
    Version { major: 3, minor: 0 },
    Version { major: 3, minor: 1 },
    Version { major: 4, minor: 0 },
    Version { major: 4, minor: 1 },
    Version { major: 4, minor: 2 },
];

fn name() -> impl Strategy<Value = String> {
    "[a-z][a-z0-9_]{0,22}"
}

fn coordinates() -> impl Strategy<Value = [f64; 3]> {
    [-10.0..10.0f64, -10.0..10.0, 0.01..10.0]
}

fn quaternion() -> impl Strategy<Value = [f64; 4]> {
    [-1.0..1.0f64, -1.0..1.0, -1.0..1.0, -1.0..1.0]
        .prop_filter("a direction", |q| q.iter().map(|c| c * c).sum::<f64>() > 0.01)
        .prop_map(|q| {
            let norm = q.iter().map(|c| c * c).sum::<f64>().sqrt();
            q.map(|c| c / norm)
        })
}

/// The rotation by another library's conventions.
fn rotation([x, y, z, w]: [f64; 4]) -> nalgebra::Matrix3<f64> {
    UnitQuaternion::from_quaternion(Quaternion::new(w, x, y, z))
        .to_rotation_matrix()
        .into_inner()
}

fn padded(name: &str) -> [u8; NAME_LENGTH] {
    let mut bytes = [0; NAME_LENGTH];
    bytes[..name.len()].copy_from_slice(name.as_bytes());
    bytes
}

fn stream(reports: &[(i32, PoseReport)], names: &[String]) -> Vec<u8> {
    let mut bytes = COOKIE.to_vec();
    for (number, name) in names.iter().enumerate() {
        vrpn::sender::sender(number as i32, name, &mut bytes);
    }
    vrpn::sender::types(&mut bytes);
    for (index, (sender, report)) in reports.iter().enumerate() {
        vrpn::sender::report([100 + index as u32, 250_000], *sender, report, &mut bytes);
    }
    bytes
}

fn natnet_decoder(version: Version, names: &[(i32, &str)]) -> natnet::Decoder {
    let mut decoder = natnet::Decoder::new();
    let mut frame = Frame::new();
    let info = ServerInfo {
        version,
        clock_frequency: 1_000_000,
        data_port: 1511,
        multicast: Some([239, 255, 42, 99]),
    };
    let received = decoder.decode(&natnet::sender::server_info(&info), &mut frame);
    assert_eq!(received, Ok(Received::ServerInfo(info)));
    let received = decoder.decode(&natnet::sender::names(version, names), &mut frame);
    assert_eq!(received, Ok(Received::Names { unreadable: None }));
    decoder
}

fn body(id: i32, position: [f64; 3], quaternion: [f64; 4]) -> RigidBody {
    RigidBody {
        id,
        position: position.map(|c| c as f32),
        quaternion: quaternion.map(|c| c as f32),
        error: 1e-4,
        tracked: true,
    }
}

const TIMES: Times = Times {
    timestamp: 12.0,
    exposed: 12_000_000,
    received: 12_003_000,
    sent: 12_004_000,
};

proptest! {
    #[test]
    fn vicon_frames_come_back(
        number: u32, objects in prop::collection::btree_map(name(), (coordinates(), [-3.0..3.0f64, -1.5..1.5, -3.0..3.0]), 0..13),
    ) {
        let sent: Vec<Object> = objects
            .iter()
            .map(|(name, (position, rotation))| Object { name: padded(name), translation_mm: position.map(|c| c * 1e3), rotation: *rotation })
            .collect();
        let mut datagram = Vec::new();
        vicon_udp::sender::frame(number, &sent, &mut datagram);
        prop_assert!([256, 512, 1024].contains(&datagram.len()));
        let mut frame = Frame::new();
        prop_assert_eq!(vicon_udp::decode(&datagram, &mut frame), Ok(()));
        prop_assert_eq!(frame.number, Some(number));
        prop_assert_eq!(frame.bodies().len(), objects.len());
        for (body, (name, (position, angles))) in frame.bodies().iter().zip(&objects) {
            prop_assert_eq!(body.name.as_bytes(), name.as_bytes());
            let pose = body.pose.unwrap();
            prop_assert!((pose.position - nalgebra::Vector3::from(*position)).norm() < 1e-12);
            // R = Rx Ry Rz: the inverse of the turns back in the other order.
            let [x, y, z] = angles.map(|angle| -angle);
            let back = UnitQuaternion::from_axis_angle(&nalgebra::Vector3::z_axis(), z)
                * UnitQuaternion::from_axis_angle(&nalgebra::Vector3::y_axis(), y)
                * UnitQuaternion::from_axis_angle(&nalgebra::Vector3::x_axis(), x);
            let identity = back.to_rotation_matrix().into_inner() * pose.capture_from_markers;
            prop_assert!((identity - nalgebra::Matrix3::identity()).norm() < 1e-12);
        }
    }

    #[test]
    fn vrpn_poses_come_back_from_pieces_of_any_length(
        // Of two trackers of one name neither has a pose.
        names in prop::collection::hash_set(name(), 1..5).prop_map(Vec::from_iter),
        poses in prop::collection::vec((0i32..5, coordinates(), quaternion(), 0i32..4), 0..20),
        cuts in prop::collection::vec(1usize..100, 1..50),
    ) {
        let sent: Vec<(i32, PoseReport)> = poses
            .iter()
            .map(|(sender, position, quaternion, sensor)| (*sender % names.len() as i32, PoseReport { sensor: *sensor, position: *position, quaternion: *quaternion }))
            .collect();
        let bytes = stream(&sent, &names);
        let mut decoder = vrpn::Decoder::new();
        let mut got = Vec::new();
        let (mut rest, mut cut) = (bytes.as_slice(), cuts.iter().cycle());
        while !rest.is_empty() {
            let (piece, later) = rest.split_at((*cut.next().unwrap()).min(rest.len()));
            decoder.push(piece, |frame| got.push(frame.clone())).unwrap();
            rest = later;
        }
        prop_assert_eq!(got.len(), sent.len());
        for (index, (frame, (sender, report))) in got.iter().zip(&sent).enumerate() {
            let body = &frame.bodies()[0];
            prop_assert_eq!(body.name.as_bytes(), names[*sender as usize].as_bytes());
            prop_assert_eq!(body.number, report.sensor);
            let pose = body.pose.unwrap();
            prop_assert_eq!(pose.position, nalgebra::Vector3::from(report.position));
            prop_assert!((pose.capture_from_markers - rotation(report.quaternion)).norm() < 1e-12);
            prop_assert_eq!(frame.stamp.unwrap().exposed_ns, (100 + index as i64) * 1_000_000_000 + 250_000_000);
        }
    }

    #[test]
    fn natnet_frames_of_every_version_come_back(
        version in prop::sample::select(&VERSIONS[..]),
        number in 0u32..1_000_000,
        poses in prop::collection::btree_map(1i32..1000, (name(), coordinates(), quaternion(), any::<bool>()), 0..20),
    ) {
        let names: Vec<(i32, String)> = poses.iter().map(|(id, (name, ..))| (*id, format!("{name}{id}"))).collect();
        let names: Vec<(i32, &str)> = names.iter().map(|(id, name)| (*id, name.as_str())).collect();
        let mut decoder = natnet_decoder(version, &names);
        let sent: Vec<RigidBody> = poses
            .iter()
            .map(|(id, (_, position, quaternion, tracked))| RigidBody { tracked: *tracked, ..body(*id, *position, *quaternion) })
            .collect();
        let mut frame = Frame::new();
        let received = decoder.decode(&natnet::sender::frame(version, number, &sent, &TIMES), &mut frame);
        prop_assert_eq!(received, Ok(Received::Frame { needs_names: false }));
        prop_assert_eq!(frame.number, Some(number));
        prop_assert_eq!(frame.bodies().len(), sent.len());
        let stamp = frame.stamp.unwrap();
        prop_assert_eq!((stamp.exposed_ns, stamp.sent_ns), (12_000_000_000, 12_004_000_000));
        for ((got, sent), (_, name)) in frame.bodies().iter().zip(&sent).zip(&names) {
            prop_assert_eq!(got.number, sent.id);
            prop_assert_eq!(got.name.as_bytes(), name.as_bytes());
            prop_assert_eq!(got.pose.is_some(), sent.tracked);
            if let Some(pose) = got.pose {
                prop_assert_eq!(pose.position, nalgebra::Vector3::from(sent.position.map(f64::from)));
                prop_assert!((pose.capture_from_markers - rotation(sent.quaternion.map(f64::from))).norm() < 1e-6);
            }
        }
    }

    #[test]
    fn any_bytes_are_an_error_or_a_frame(bytes in prop::collection::vec(any::<u8>(), 0..2000)) {
        swallow(&bytes);
    }

    #[test]
    fn good_packets_with_anything_changed_are_an_error_or_a_frame(
        which in 0usize..16, changes in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..8), cut in any::<prop::sample::Index>(), is_cut: bool
    ) {
        let mut packet = seeds()[which % seeds().len()].1.clone();
        for (place, byte) in changes {
            let place = place.index(packet.len());
            packet[place] = byte;
        }
        if is_cut {
            packet.truncate(cut.index(packet.len()));
        }
        swallow(&packet);
    }
}

/// A packet of every kind.
fn seeds() -> Vec<(&'static str, Vec<u8>)> {
    let mut vicon = Vec::new();
    let object = |name| Object {
        name: padded(name),
        translation_mm: [100.0, -200.0, 1500.0],
        rotation: [0.1, -0.2, 3.0],
    };
    vicon_udp::sender::frame(77, &[object("quad"), object("wand")], &mut vicon);
    let report = PoseReport {
        sensor: 0,
        position: [0.1, -0.2, 1.5],
        quaternion: [0.0, 0.6, 0.0, 0.8],
    };
    let names = ["quad".to_owned(), "wand".to_owned()];
    let mut all = vec![
        ("vicon_frame", vicon),
        ("vrpn_stream", stream(&[(0, report), (1, report)], &names)),
    ];
    let info = ServerInfo {
        version: Version { major: 4, minor: 1 },
        clock_frequency: 10_000_000,
        data_port: 1511,
        multicast: None,
    };
    all.push(("natnet_server_info", natnet::sender::server_info(&info)));
    let bodies = [
        body(7, [0.1, -0.2, 1.5], [0.0, 0.6, 0.0, 0.8]),
        body(9, [1.0, 2.0, 3.0], [0.0, 0.0, 0.0, 1.0]),
    ];
    for (names, frame, version) in [
        (
            "natnet_3_1_names",
            "natnet_3_1_frame",
            Version { major: 3, minor: 1 },
        ),
        (
            "natnet_4_1_names",
            "natnet_4_1_frame",
            Version { major: 4, minor: 1 },
        ),
    ] {
        all.push((names, natnet::sender::names(version, &[(7, "quad"), (9, "wand")])));
        all.push((frame, natnet::sender::frame(version, 5, &bodies, &TIMES)));
    }
    all
}

/// Gives bytes to every decoder, in every state; what is not an error is a frame whose poses are poses.
fn swallow(bytes: &[u8]) {
    let mut frame = Frame::new();
    if vicon_udp::decode(bytes, &mut frame).is_err() {
        assert!(frame.bodies().is_empty() && frame.number.is_none());
    }
    for version in VERSIONS {
        let mut decoder = natnet_decoder(version, &[(7, "quad")]);
        for _ in 0..2 {
            if decoder.decode(bytes, &mut frame).is_err() {
                assert!(frame.bodies().is_empty() && frame.stamp.is_none());
            }
            check(&frame);
        }
        assert!(decoder.bodies().len() <= MAX_BODIES);
    }
    for system in CaptureSystem::ALL {
        for is_introduced in [true, false] {
            let mut decoder = systems::decoder(system, is_introduced, &["quad", "wand"]);
            let pieces = match protocol::for_system(system).transport() {
                Transport::Connections => 61,
                Transport::Datagrams | Transport::Requests => usize::MAX,
            };
            let mut pieces = bytes.chunks(pieces);
            let _ = pieces.try_for_each(|piece| decoder.decode(piece, &mut check));
        }
    }
}

fn check(frame: &Frame) {
    assert!(frame.bodies().len() <= MAX_BODIES);
    for pose in frame.bodies().iter().filter_map(|body| body.pose) {
        assert!(pose.position.iter().all(|c| c.abs() <= 1e3));
        let defect = shared_types::rotation::defect(&pose.capture_from_markers);
        assert!(defect < 1e-9, "{defect}");
    }
}

#[test]
fn a_packet_cut_anywhere_is_an_error() {
    let all = seeds();
    for (name, packet) in &all {
        for length in 0..packet.len() {
            swallow(&packet[..length]);
        }
        if let Some(major) = name
            .strip_prefix("natnet_")
            .and_then(|rest| rest[..1].parse().ok())
        {
            let mut decoder = natnet_decoder(Version { major, minor: 1 }, &[(7, "quad")]);
            let mut frame = Frame::new();
            for length in 0..packet.len() {
                assert!(
                    decoder.decode(&packet[..length], &mut frame).is_err(),
                    "{name} {length}"
                );
            }
        }
    }
}

#[test]
fn numbers_that_state_more_than_there_is_are_errors() {
    let mut frame = Frame::new();
    // Vicon: 255 items in a datagram of one.
    let (_, mut datagram) = seeds().swap_remove(0);
    datagram[4] = 255;
    assert!(vicon_udp::decode(&datagram, &mut frame).is_err());
    // NatNet: every u32 of the packet at its largest.
    for (_, packet) in seeds().iter().filter(|(name, _)| name.starts_with("natnet")) {
        for place in 0..packet.len().saturating_sub(4) {
            let mut packet = packet.clone();
            packet[place..place + 4].fill(0xff);
            swallow(&packet);
        }
    }
    // VRPN: a message longer than any.
    let mut decoder = vrpn::Decoder::new();
    decoder.push(&COOKIE, |_| ()).unwrap();
    assert!(decoder.push(&u32::MAX.to_be_bytes(), |_| ()).is_err());
}

#[test]
fn a_server_that_sends_zeros_for_unseen_bodies_stays_connected() {
    let none = PoseReport {
        sensor: 0,
        position: [0.0; 3],
        quaternion: [0.0; 4],
    };
    let seen = PoseReport {
        quaternion: [0.0, 0.0, 0.0, 1.0],
        ..none
    };
    let mut decoder = vrpn::Decoder::new();
    let bytes = stream(&[(0, none), (0, seen)], &["quad".to_owned()]);
    let mut poses = Vec::new();
    decoder
        .push(&bytes, |frame| poses.push(frame.bodies()[0].pose.is_some()))
        .unwrap();
    assert_eq!((poses, decoder.refusals().total()), (vec![false, true], 0));
}

/// Inputs that fuzzing found, and a good packet of every kind. `GERONO_BLESS=1` writes the good ones.
#[test]
fn the_corpus_is_swallowed() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("corpus");
    let is_blessed = std::env::var_os("GERONO_BLESS").is_some();
    let special = seeds()
        .into_iter()
        .map(|(name, packet)| (name.to_owned(), packet));
    for (name, packet) in special.chain(systems::packets()) {
        let path = folder.join(&name);
        if is_blessed {
            std::fs::write(&path, &packet).unwrap();
        }
        let committed = std::fs::read(&path).unwrap_or_default();
        assert!(
            committed == packet,
            "{name} is no longer what is sent; run with GERONO_BLESS=1"
        );
    }
    for entry in std::fs::read_dir(&folder).unwrap() {
        swallow(&std::fs::read(entry.unwrap().path()).unwrap());
    }
}
