//! The content of a copy for viewers, read by other means than it was written with.

#![expect(clippy::disallowed_methods, reason = "tests make their own files")]

use std::collections::BTreeMap;
use std::fs;

use nalgebra::Vector3;
use scenario::Scenario;
use shared_types::Header;
use shared_types::sample::Flag;
use zerocopy::{FromZeros, IntoBytes};

use super::*;
use crate::test_flight::{record, record_samples, sample, scenario};
use crate::{LogReadError, LogReader};

const SECONDS: f64 = 2.0;

/// A message of the copy, with the name of its schema.
struct ViewContent {
    topic: String,
    schema: String,
    time_ns: u64,
    sequence: u32,
    data: Vec<u8>,
}

fn messages_of(path: &Path) -> Vec<ViewContent> {
    let file = fs::read(path).unwrap();
    let messages = mcap::MessageStream::new(&file).unwrap().map(Result::unwrap);
    messages
        .map(|message| ViewContent {
            topic: message.channel.topic.clone(),
            schema: message.channel.schema.as_ref().unwrap().name.clone(),
            time_ns: message.log_time,
            sequence: message.sequence,
            data: message.data.into_owned(),
        })
        .collect()
}

/// The members of a message by number, each as its bytes without tag and length.
fn members(mut bytes: &[u8]) -> BTreeMap<u64, Vec<Vec<u8>>> {
    fn varint(bytes: &mut &[u8]) -> u64 {
        let length = bytes.iter().position(|byte| byte & 0x80 == 0).unwrap() + 1;
        let (varint, rest) = bytes.split_at(length);
        *bytes = rest;
        let parts = varint.iter().rev();
        parts.fold(0, |value, byte| value << 7 | u64::from(byte & 0x7f))
    }
    let mut found: BTreeMap<u64, Vec<Vec<u8>>> = BTreeMap::new();
    while !bytes.is_empty() {
        let tag = varint(&mut bytes);
        let value = match tag & 7 {
            0 => varint(&mut bytes).to_le_bytes().to_vec(),
            kind => {
                let length = match kind {
                    1 => 8,
                    5 => 4,
                    _ => usize::try_from(varint(&mut bytes)).unwrap(),
                };
                let (value, rest) = bytes.split_at(length);
                bytes = rest;
                value.to_vec()
            }
        };
        found.entry(tag >> 3).or_default().push(value);
    }
    found
}

/// The member of a number that a message has once.
fn member(bytes: &[u8], number: u64) -> Vec<u8> {
    let [value] = &members(bytes)[&number][..] else {
        panic!("not one member {number}")
    };
    value.clone()
}

/// The numbers of a vector or a quaternion.
fn numbers(bytes: &[u8]) -> Vec<f64> {
    let members = members(bytes);
    let parts = members
        .values()
        .map(|part| part[0].as_slice().try_into().unwrap());
    parts.map(f64::from_le_bytes).collect()
}

/// A flight along x at 1 m/s, 1 m below the origin, rolled to the right by 30°; nobody sees it in the first half second.
fn fly(path: &Path, with_truth: bool) -> Scenario {
    let scenario = scenario(0.001, SECONDS);
    let schedule = scenario.schedule().unwrap();
    let attitude = from_roll_pitch_yaw([std::f64::consts::FRAC_PI_6, 0.0, 0.0]);
    let samples = (0..=schedule.last_tick()).flat_map(|tick| {
        Topic::ALL
            .into_iter()
            .filter(move |&topic| with_truth || topic != Topic::VehicleTruth)
            .map(|topic| (topic, sample_of(topic, schedule.header(topic, tick), &attitude)))
            .collect::<Vec<_>>()
    });
    record_samples(path, &scenario, Compression::Lz4, samples);
    scenario
}

fn sample_of(topic: Topic, header: Header, attitude: &Matrix3<f64>) -> Vec<u8> {
    let position_world = [header.stamp_ns as f64 / 1e9, 0.0, 1.0];
    let world_from_body = shared_types::rotation::to_row_major(attitude);
    match topic {
        Topic::VehicleTruth => {
            let mut truth = VehicleTruth::new_zeroed();
            (truth.header, truth.position_world, truth.world_from_body) =
                (header, position_world, world_from_body);
            truth.as_bytes().to_vec()
        }
        Topic::VehicleState => {
            let mut state = VehicleState::new_zeroed();
            (state.header, state.position_world, state.world_from_body) =
                (header, position_world, world_from_body);
            state.tracked = Flag::from(header.stamp_ns >= 500_000_000);
            state.as_bytes().to_vec()
        }
        Topic::PathReference => {
            let mut reference = PathReference::new_zeroed();
            (reference.header, reference.position_world) = (header, [0.0, 2.0, -1.0]);
            reference.yaw = std::f64::consts::FRAC_PI_2;
            reference.as_bytes().to_vec()
        }
        other => sample(other, header),
    }
}

/// A log and its copy for viewers.
fn flown(with_truth: bool) -> (tempfile::TempDir, PathBuf, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let log = folder.path().join("run.mcap");
    fly(&log, with_truth);
    let copy = view_path(&log);
    export_view(&log, &copy).unwrap();
    (folder, log, copy)
}

#[test]
fn every_message_of_the_log_is_in_the_copy_byte_for_byte_and_in_its_order() {
    let (_folder, log, copy) = flown(true);
    let all = |path: &Path| -> Vec<_> {
        let found = messages_of(path).into_iter();
        found
            .filter(|found| !found.topic.starts_with("view/"))
            .map(|found| {
                (
                    found.topic,
                    found.schema,
                    found.time_ns,
                    found.sequence,
                    found.data,
                )
            })
            .collect()
    };
    assert!(all(&log) == all(&copy));
    let file = fs::read(&copy).unwrap();
    let summary = mcap::Summary::read(&file).unwrap().unwrap();
    for channel in summary.channels.values() {
        let is_ours = !channel.topic.starts_with("view/");
        let encoding = if is_ours { "cdr" } else { "protobuf" };
        assert_eq!(channel.message_encoding, encoding, "{}", channel.topic);
        assert_eq!(
            channel.metadata.contains_key("layout"),
            is_ours,
            "{}",
            channel.topic
        );
    }
}

#[test]
fn poses_come_thirty_times_a_second_and_what_stands_still_once_before_them() {
    let (_folder, _, copy) = flown(true);
    let found = messages_of(&copy);
    let of = |topic: &str| {
        found
            .iter()
            .filter(|found| found.topic == topic)
            .collect::<Vec<_>>()
    };
    for topic in ["view/upright", "view/scene", "view/points"] {
        assert_eq!(of(topic).len(), 1, "{topic}");
    }
    let begin: Vec<_> = found[..3].iter().map(|found| found.topic.as_str()).collect();
    assert_eq!(begin, ["view/upright", "view/scene", "view/points"]);
    for topic in ["view/body", "view/vehicle", "view/reference"] {
        let poses = of(topic);
        // Of 2 s the last sample begins a new thirtieth.
        assert_eq!(poses.len() as u64, 2 * DISPLAY_RATE + 1, "{topic}");
        for (index, pose) in poses.iter().enumerate() {
            assert_eq!(pose.sequence as usize, index);
            let due_ns = index as u64 * 1_000_000_000 / DISPLAY_RATE;
            assert!(
                (due_ns..=due_ns + 1_000_000).contains(&pose.time_ns),
                "{topic} {index}"
            );
            let stamp = member(&pose.data, 1);
            let [seconds, nanos] =
                [1, 2].map(|number| u64::from_le_bytes(member(&stamp, number).try_into().unwrap()));
            assert_eq!(seconds * 1_000_000_000 + nanos, pose.time_ns);
        }
    }
    assert!(found.iter().map(|found| found.time_ns).is_sorted());
}

#[test]
fn the_vehicle_is_where_the_truth_says_and_what_is_below_in_our_frame_is_below_for_viewers() {
    let (_folder, _, copy) = flown(true);
    let found = messages_of(&copy);
    let last = |topic: &str| found.iter().rfind(|found| found.topic == topic).unwrap();
    let rotation = |bytes: &[u8]| {
        let [x, y, z, w] = numbers(bytes)[..] else {
            panic!("no quaternion")
        };
        nalgebra::UnitQuaternion::new_normalize(nalgebra::Quaternion::new(w, x, y, z))
    };

    let upright = rotation(&member(&last("view/upright").data, 5));
    let body = &last("view/body").data;
    assert_eq!(
        member(body, 2),
        member(&last("view/upright").data, 3),
        "one hangs on the other"
    );
    let position = Vector3::from_vec(numbers(&member(body, 4)));
    assert!((position - Vector3::new(SECONDS, 0.0, 1.0)).norm() < 1e-12);
    assert!((upright * position - Vector3::new(SECONDS, 0.0, -1.0)).norm() < 1e-12);
    // Rolled to the right by 30°, the right arm points down.
    let arm = upright * rotation(&member(body, 5)) * Vector3::y();
    assert!((arm.z + 0.5).abs() < 1e-12 && arm.y < 0.0, "{arm}");

    let reference = member(&last("view/reference").data, 3);
    assert_eq!(numbers(&member(&reference, 1)), [0.0, 2.0, -1.0]);
    let heading = rotation(&member(&reference, 2)) * Vector3::x();
    assert!((heading - Vector3::y()).norm() < 1e-12);
}

#[test]
fn the_scene_has_the_vehicle_in_its_frame_and_both_ways_in_ours() {
    let (_folder, _, copy) = flown(true);
    let found = messages_of(&copy);
    let scene = &found
        .iter()
        .find(|found| found.topic == "view/scene")
        .unwrap()
        .data;
    let entities = &members(scene)[&2];
    let frames: Vec<_> = entities.iter().map(|entity| member(entity, 2)).collect();
    assert_eq!(frames, [b"body".to_vec(), b"world".to_vec(), b"world".to_vec()]);
    let points = |entity: &[u8]| members(&member(entity, 11))[&5].clone();
    let flown = points(&entities[1]);
    assert_eq!(flown.len() as u64, 2 * DISPLAY_RATE + 1);
    assert_eq!(numbers(flown.last().unwrap()), [SECONDS, 0.0, 1.0]);
    assert_eq!(numbers(&points(&entities[2])[0]), [0.0, 2.0, -1.0]);

    let cloud = &found
        .iter()
        .find(|found| found.topic == "view/points")
        .unwrap()
        .data;
    let data = member(cloud, 6);
    let stride = usize::try_from(u32::from_le_bytes(member(cloud, 4).try_into().unwrap())).unwrap();
    assert_eq!(data.len(), 2 * flown.len() * stride);
    let number = |at: usize| f32::from_le_bytes(data[at..at + 4].try_into().unwrap());
    let desired = flown.len() * stride;
    assert_eq!([0, 4, 8].map(|at| number(desired + at)), [0.0, 2.0, -1.0]);
    assert_ne!(data[12..16], data[desired + 12..desired + 16], "two colours");
}

#[test]
fn without_a_truth_the_estimate_is_shown_once_there_is_one() {
    let (_folder, _, copy) = flown(false);
    let found = messages_of(&copy);
    let poses: Vec<_> = found
        .iter()
        .filter(|found| found.topic == "view/vehicle")
        .collect();
    assert_eq!(poses[0].time_ns, 500_000_000);
    assert_eq!(poses.len() as u64, 3 * DISPLAY_RATE / 2 + 1);
}

#[test]
fn a_long_way_is_thinned_from_its_begin_on() {
    let places = (0..=2 * POINTS_MAX).map(|index| [index as f64, 0.0, 0.0]);
    let way = Trajectory {
        places: places.collect(),
        ..Trajectory::default()
    };
    let thinned = way.thinned();
    assert!(thinned.len() <= POINTS_MAX);
    assert_eq!(thinned[..2], [[0.0; 3], [3.0, 0.0, 0.0]]);
}

#[test]
fn a_copy_is_not_taken_for_a_log_nor_written_over_its_log() {
    let (_folder, log, copy) = flown(true);
    let Err(LogReadError::Foreign { reason, .. }) = LogReader::open(&copy) else {
        panic!("a copy for viewers was opened as a log")
    };
    assert!(reason.contains("copy for viewers"), "{reason}");

    let before = fs::read(&log).unwrap();
    let refused = export_view(&log, &log).unwrap_err();
    assert!(matches!(refused, ViewError::Itself(_)), "{refused}");
    assert!(fs::read(&log).unwrap() == before);
}

#[test]
fn a_log_that_nobody_is_seen_in_has_nothing_to_show() {
    let folder = tempfile::tempdir().unwrap();
    let log = folder.path().join("run.mcap");
    let scenario = scenario(0.01, 1.0);
    let header = scenario.schedule().unwrap().header(Topic::RcFrame, 0);
    let sample = (Topic::RcFrame, sample(Topic::RcFrame, header));
    record_samples(&log, &scenario, Compression::None, std::iter::once(sample));
    let refused = export_view(&log, &view_path(&log)).unwrap_err();
    assert!(matches!(refused, ViewError::Nowhere(_)), "{refused}");
    assert!(!view_path(&log).exists());
}

#[test]
fn no_file_of_a_log_is_taken_for_the_copy_or_for_its_temporary_name() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    record(&path("q.mcap"), &scenario(0.01, 1.0), Compression::None);
    fs::rename(path("q.mcap"), path("q.mcap.partial")).unwrap();
    let whole = fs::read(path("q.mcap.partial")).unwrap();
    export_view(&path("q.mcap.partial"), &path("q.mcap")).unwrap();
    assert_eq!(fs::read(path("q.mcap.partial")).unwrap(), whole);

    fs::hard_link(path("q.mcap.partial"), path("other name.mcap")).unwrap();
    let refused = export_view(&path("q.mcap.partial"), &path("other name.mcap")).unwrap_err();
    assert!(matches!(refused, ViewError::Itself(_)), "{refused}");
    assert_eq!(fs::read(path("q.mcap.partial")).unwrap(), whole);
}

#[test]
fn a_later_file_of_a_log_that_was_split_is_not_overwritten() {
    let folder = tempfile::tempdir().unwrap();
    let log = folder.path().join("run.mcap");
    let mut split = scenario(0.01, 3.0);
    let record_section = "split = { after_seconds = 1.0 }";
    split.record = Some(toml::from_str(record_section).unwrap());
    record(&log, &split, Compression::None);
    let later = folder.path().join("run.1.mcap");
    let before = fs::read(&later).unwrap();
    let refused = export_view(&log, &later).unwrap_err();
    assert!(matches!(refused, ViewError::Itself(_)), "{refused}");
    assert_eq!(fs::read(&later).unwrap(), before);
}

#[test]
fn a_log_that_was_cut_is_refused_with_the_way_out_and_leaves_no_copy() {
    let folder = tempfile::tempdir().unwrap();
    let log = folder.path().join("run.mcap");
    record(&log, &scenario(0.01, 1.0), Compression::None);
    let whole = fs::read(&log).unwrap();
    fs::write(&log, &whole[..whole.len() / 2]).unwrap();
    let refused = export_view(&log, &view_path(&log)).unwrap_err().to_string();
    assert!(refused.contains("gerono recover"), "{refused}");
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);
}
