//! Another body in the room, its name or its values never take the vehicle's poses away: in each format, whatever the
//! stranger is, the vehicle is in the frame with its pose, and the stranger's refusal is named.

use motion_capture::natnet::{Received, RigidBody, ServerInfo, Times, Version};
use motion_capture::vicon_udp::{NAME_LENGTH, Object};
use motion_capture::vrpn::{COOKIE, PoseReport};
use motion_capture::wire::{Frame, PoseError, WireError};
use motion_capture::{natnet, vicon_udp, vrpn};
use nalgebra::Vector3;
use proptest::prelude::*;

const VERSIONS: [Version; 5] = [
    Version { major: 3, minor: 0 },
    Version { major: 3, minor: 1 },
    Version { major: 4, minor: 0 },
    Version { major: 4, minor: 1 },
    Version { major: 4, minor: 2 },
];

const TIMES: Times = Times {
    timestamp: 12.0,
    exposed: 12_000_000,
    received: 12_003_000,
    sent: 12_004_000,
};

/// Any number of a float's bits, and the odd ones often.
fn odd() -> impl Strategy<Value = f64> {
    prop_oneof![
        any::<u64>().prop_map(f64::from_bits),
        Just(f64::NAN),
        Just(f64::INFINITY),
        Just(0.0),
        Just(1500.0),
        Just(12.0),
        -2.0..2.0f64,
    ]
}

fn odd_name() -> impl Strategy<Value = Vec<u8>> {
    prop_oneof![
        Just(b"box".to_vec()),
        Just(b"quad ".to_vec()),
        Just(vec![b'x'; 300]),
        Just(b"Drohne-\xc4rger".to_vec()),
        Just(Vec::new()),
        prop::collection::vec(1u8.., 0..40),
    ]
    .prop_filter("a stranger is not the vehicle", |name| name != b"quad")
}

/// Strangers: name, id, coordinates and attitude.
fn strangers() -> impl Strategy<Value = Vec<(Vec<u8>, i32, [f64; 7], bool)>> {
    let numbers = [odd(), odd(), odd(), odd(), odd(), odd(), odd()];
    prop::collection::vec((odd_name(), 1i32..6, numbers, any::<bool>()), 0..6)
}

fn quad() -> ([f64; 3], [f64; 4]) {
    ([0.5, -1.0, 1.25], [0.0, 0.6, 0.0, 0.8])
}

fn pose_of(frame: &Frame) -> Option<Vector3<f64>> {
    let quad = frame.bodies().iter().find(|body| body.name.as_bytes() == b"quad");
    quad?.pose.map(|pose| pose.position)
}

proptest! {
    #[test]
    fn of_natnet(strangers in strangers(), version in prop::sample::select(&VERSIONS[..]), at in 0usize..6) {
        let mut described: Vec<(i32, Vec<u8>)> = strangers.iter().map(|(name, id, ..)| (*id, name.clone())).collect();
        // A name ends at its zero, so that a description cannot hold another.
        described.insert(at.min(described.len()), (7, b"quad".to_vec()));
        let single = |number: f64| number as f32;
        let mut bodies: Vec<RigidBody> = strangers
            .iter()
            .map(|(_, id, [x, y, z, quaternion @ ..], tracked)| RigidBody {
                id: *id,
                position: [*x, *y, *z].map(single),
                quaternion: quaternion.map(single),
                error: 0.0,
                tracked: *tracked,
            })
            .collect();
        let (position, quaternion) = quad();
        bodies.insert(at.min(bodies.len()), RigidBody {
            id: 7,
            position: position.map(single),
            quaternion: quaternion.map(single),
            error: 0.0,
            tracked: true,
        });
        let mut decoder = decoder(version);
        let mut frame = Frame::new();
        let names: Vec<(i32, &[u8])> = described.iter().map(|(id, name)| (*id, name.as_slice())).collect();
        prop_assert_eq!(
            decoder.decode(&natnet::sender::names(version, &names), &mut frame),
            Ok(Received::Names { unreadable: None })
        );
        let received = decoder.decode(&natnet::sender::frame(version, 5, &bodies, &TIMES), &mut frame);
        prop_assert_eq!(received, Ok(Received::Frame { needs_names: false }));
        prop_assert_eq!(frame.bodies().len(), bodies.len());
        prop_assert_eq!(pose_of(&frame), Some(Vector3::from(position)));
    }

    #[test]
    fn of_vicon(strangers in strangers(), at in 0usize..6) {
        let mut objects: Vec<Object> = strangers
            .iter()
            .map(|(name, _, [x, y, z, a, b, c, _], _)| Object {
                name: cut(name),
                translation_mm: [*x, *y, *z].map(|coordinate| 1e3 * coordinate),
                rotation: [*a, *b, *c],
            })
            .collect();
        let (position, _) = quad();
        objects.insert(at.min(objects.len()), Object {
            name: cut(b"quad"),
            translation_mm: position.map(|coordinate| 1e3 * coordinate),
            rotation: [0.1, 0.2, 0.3],
        });
        let mut datagram = Vec::new();
        vicon_udp::sender::frame(5, &objects, &mut datagram);
        let mut frame = Frame::new();
        prop_assert_eq!(vicon_udp::decode(&datagram, &mut frame), Ok(()));
        prop_assert_eq!(frame.bodies().len(), objects.len());
        prop_assert_eq!(pose_of(&frame), Some(Vector3::from(position)));
    }

    #[test]
    fn of_vrpn(strangers in strangers(), short in 0usize..64) {
        let mut bytes = COOKIE.to_vec();
        for (index, (name, ..)) in strangers.iter().enumerate() {
            vrpn::sender::sender(1 + index as i32, name, &mut bytes);
        }
        vrpn::sender::sender(0, b"quad", &mut bytes);
        vrpn::sender::types(&mut bytes);
        for (index, (_, _, [x, y, z, quaternion @ ..], _)) in strangers.iter().enumerate() {
            let report = PoseReport { sensor: 0, position: [*x, *y, *z], quaternion: *quaternion };
            vrpn::sender::report([5, 6], 1 + index as i32, &report, &mut bytes);
            // And a report that is too short for a pose.
            vrpn::sender::message([5, 6], 1 + index as i32, 4, &vec![0; short], &mut bytes);
        }
        let (position, quaternion) = quad();
        vrpn::sender::report([5, 6], 0, &PoseReport { sensor: 0, position, quaternion }, &mut bytes);
        let mut decoder = vrpn::Decoder::new();
        let mut seen = Vec::new();
        decoder.push(&bytes, |frame| seen.extend(pose_of(frame))).unwrap();
        prop_assert_eq!(seen, vec![Vector3::from(position)]);
    }
}

fn cut(name: &[u8]) -> [u8; NAME_LENGTH] {
    let mut bytes = [0; NAME_LENGTH];
    let length = name.len().min(NAME_LENGTH);
    bytes[..length].copy_from_slice(&name[..length]);
    bytes
}

fn decoder(version: Version) -> natnet::Decoder {
    let info = ServerInfo {
        version,
        clock_frequency: 1_000_000,
        data_port: 1511,
        multicast: None,
    };
    let mut decoder = natnet::Decoder::new();
    let received = decoder.decode(&natnet::sender::server_info(&info), &mut Frame::new());
    assert_eq!(received, Ok(Received::ServerInfo(info)));
    decoder
}

fn body(id: i32) -> RigidBody {
    RigidBody {
        id,
        position: [0.5, -1.0, 1.25],
        quaternion: [0.0, 0.6, 0.0, 0.8],
        error: 0.0,
        tracked: true,
    }
}

/// Returns each body's name, and whether it has a pose.
fn seen(frame: &Frame) -> Vec<(String, bool)> {
    let bodies = frame.bodies().iter();
    bodies
        .map(|body| (body.name.to_string(), body.pose.is_some()))
        .collect()
}

fn reasons(frame: &Frame) -> Vec<PoseError> {
    frame.refused().map(|(_, reason)| reason).collect()
}

#[test]
fn bodies_that_share_a_name_are_without_it_and_others_keep_theirs() {
    let version = Version { major: 4, minor: 2 };
    let mut decoder = decoder(version);
    let mut frame = Frame::new();
    let names = [(1, "quad"), (2, "box"), (3, "box"), (4, "wand")];
    let named = natnet::sender::names(version, &names);
    decoder.decode(&named, &mut frame).unwrap();
    let bodies = [body(1), body(2), body(3), body(4)];
    let datagram = natnet::sender::frame(version, 1, &bodies, &TIMES);
    let received = decoder.decode(&datagram, &mut frame);
    // They need not be asked for again and again.
    assert_eq!(received, Ok(Received::Frame { needs_names: false }));
    let with_pose = |name: &str| (name.to_owned(), true);
    assert_eq!(
        seen(&frame),
        [with_pose("quad"), with_pose(""), with_pose(""), with_pose("wand")]
    );
    assert!(decoder.bodies().iter().filter(|body| body.is_shared).count() == 2);
}

#[test]
fn bodies_that_share_an_id_or_a_name_on_the_wire_are_not_seen() {
    let version = Version { major: 4, minor: 1 };
    let mut decoder = decoder(version);
    let mut frame = Frame::new();
    let bodies = [body(1), body(2), body(2), body(2)];
    let datagram = natnet::sender::frame(version, 1, &bodies, &TIMES);
    decoder.decode(&datagram, &mut frame).unwrap();
    let poses: Vec<bool> = frame.bodies().iter().map(|body| body.pose.is_some()).collect();
    assert_eq!(poses, [true, false, false, false]);
    assert_eq!(reasons(&frame), [PoseError::SharedId; 3]);

    let object = |name: &[u8]| Object {
        name: cut(name),
        translation_mm: [1.0, 2.0, 3.0],
        rotation: [0.0; 3],
    };
    let names: [&[u8]; 3] = [
        b"quadcopter_experiment_number_01",
        b"quad",
        b"quadcopter_experiment_number_02",
    ];
    let mut datagram = Vec::new();
    vicon_udp::sender::frame(1, &names.map(object), &mut datagram);
    vicon_udp::decode(&datagram, &mut frame).unwrap();
    let poses: Vec<bool> = frame.bodies().iter().map(|body| body.pose.is_some()).collect();
    assert_eq!(poses, [false, true, false]);
    assert_eq!(reasons(&frame), [PoseError::SharedName; 2]);
}

#[test]
fn values_of_a_stranger_are_refused_with_their_numbers() {
    let object = |name: &[u8], x: f64, angle: f64| Object {
        name: cut(name),
        translation_mm: [x, 2.0, 3.0],
        rotation: [0.1, angle, 0.0],
    };
    let objects = [
        object(b"quad", 1.0, 0.0),
        object(b"degrees", 1.0, 12.0),
        object(b"metres", 1.5e6, 0.0),
        object(b"nan", f64::NAN, 0.0),
    ];
    let (mut datagram, mut frame) = (Vec::new(), Frame::new());
    vicon_udp::sender::frame(1, &objects, &mut datagram);
    vicon_udp::decode(&datagram, &mut frame).unwrap();
    assert_eq!(
        reasons(&frame),
        [
            PoseError::Angle(12.0),
            PoseError::Far(1500.0),
            PoseError::NotFinite
        ]
    );
}

/// What stands behind a body's name and id in a description of a version to come.
#[test]
fn a_description_whose_rest_is_not_understood_gives_its_name_and_id() {
    let version = Version { major: 4, minor: 9 };
    let mut payload = 2_u32.to_le_bytes().to_vec();
    for (id, name, rest) in [(7_i32, &b"quad\0"[..], &[0xff; 3][..]), (8, b"wand\0", &[])] {
        let description = [name, &id.to_le_bytes(), rest].concat();
        payload.extend(1_i32.to_le_bytes());
        payload.extend((description.len() as u32).to_le_bytes());
        payload.extend(description);
    }
    let mut decoder = decoder(version);
    let received = decoder.decode(&natnet::sender::datagram(5, &payload), &mut Frame::new());
    assert_eq!(received, Ok(Received::Names { unreadable: None }));
    let known: Vec<(i32, &[u8])> = decoder
        .bodies()
        .iter()
        .map(|body| (body.id, body.name.as_bytes()))
        .collect();
    assert_eq!(known, [(7, &b"quad"[..]), (8, b"wand")]);
}

#[test]
fn an_error_of_the_descriptions_leaves_the_names_that_are_known() {
    for version in VERSIONS {
        let mut decoder = decoder(version);
        let mut frame = Frame::new();
        let names = natnet::sender::names(version, &[(7, "quad"), (9, "wand")]);
        decoder.decode(&names, &mut frame).unwrap();
        for length in 4..names.len() {
            let mut cut = names[..length].to_vec();
            cut[2..4].copy_from_slice(&(length as u16 - 4).to_le_bytes());
            let _ = decoder.decode(&cut, &mut frame);
            decoder
                .decode(&natnet::sender::frame(version, 1, &[body(7)], &TIMES), &mut frame)
                .unwrap();
            assert_eq!(seen(&frame), [("quad".to_owned(), true)], "{version} {length}");
        }
    }
}

/// Motive's stream of a version can be set apart from what it answers.
#[test]
fn frames_of_another_version_than_the_stated_one_are_named() {
    for (said, sent) in [((3, 1), (4, 1)), ((4, 1), (3, 1)), ((4, 2), (3, 0))] {
        let version = |(major, minor)| Version { major, minor };
        for bodies in [&[][..], &[body(7)], &[body(7), body(9)]] {
            let datagram = natnet::sender::frame(version(sent), 1, bodies, &TIMES);
            let error = decoder(version(said)).decode(&datagram, &mut Frame::new());
            let layout = if said.0 == 3 { [4, 1] } else { [3, 1] };
            assert_eq!(
                error,
                Err(WireError::OtherVersion {
                    stated: [said.0, said.1],
                    sent: layout
                })
            );
        }
    }
}

#[test]
fn versions_that_are_not_understood_are_refused_by_name() {
    for (major, minor) in [(2, 8), (5, 0), (0, 0)] {
        let info = ServerInfo {
            version: Version { major, minor },
            clock_frequency: 1_000_000,
            data_port: 1511,
            multicast: None,
        };
        let mut decoder = natnet::Decoder::new();
        let error = decoder.decode(&natnet::sender::server_info(&info), &mut Frame::new());
        assert_eq!(error, Err(WireError::Version(major, minor)));
    }
}
