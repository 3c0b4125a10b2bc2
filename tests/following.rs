//! Path following beside tracking with the same start of the clock, when something takes the vehicle off its path.

use nalgebra::Vector3;
use run_log::LogReader;
use shared_types::Topic;
use shared_types::samples::{PathReference, VehicleTruth};
use zerocopy::FromBytes;

use crate::common::{Place, fly_to_the_end, scenario};
use crate::documentation::{assert_same, read, section};

/// Events that take the vehicle off its path.
const EVENTS: [(&str, &[&str]); 3] = [
    (
        "push of 10 m/s² for 1.5 s",
        &[
            "controller.bounds.disturbance=12.0",
            "vehicle.change=[{at=20.0, disturbance=[0.0, 10.0, 0.0]}, {at=21.5, disturbance=[0.0, 0.0, 0.0]}]",
        ],
    ),
    (
        "radio silent for 0.5 s",
        &[r#"fault=[{at=20.0, service="rc_output", kind="off", for=0.5}]"#],
    ),
    (
        "radio silent for 1 s",
        &[r#"fault=[{at=20.0, service="rc_output", kind="off", for=1.0}]"#],
    ),
];

/// Ways to follow: a path that never waits is tracking, the others wait from α1 on.
const WAYS: [(&str, [&str; 2]); 4] = [
    ("tracking", ["path.alpha1=20.0", "path.alpha2=30.0"]),
    ("following, α1 = 0.5 m", ["path.alpha1=0.5", "path.alpha2=1.5"]),
    ("following, α1 = 0.2 m", ["path.alpha1=0.2", "path.alpha2=0.6"]),
    ("following, α1 = 0.05 m", ["path.alpha1=0.05", "path.alpha2=0.2"]),
];

/// Largest distance from the curve from 10 s on, m; and γ at the end.
fn fly(place: &Place, out: &str, sets: &[&str]) -> (f64, f64, bool) {
    let path = scenario("trajectory_tracking");
    let mut command = place.gerono(&["run", path.to_str().unwrap(), "--host", "inprocess", "--quiet"]);
    command.args(["--out", out, "--set", "path.mode=following"]);
    command.args(sets.iter().flat_map(|set| ["--set", set]));
    let is_lost = fly_to_the_end(&mut command).status.code() == Some(9);
    let (mut vehicle, mut curve, mut gamma) = (Vec::new(), Vec::new(), 0.0);
    let mut log = LogReader::open(&place.log(out)).unwrap();
    while let Some(sample) = log.next_sample().unwrap() {
        match sample.topic {
            Topic::VehicleTruth if sample.header.tick >= 10_000 && sample.header.tick.is_multiple_of(40) => {
                let truth = VehicleTruth::ref_from_bytes(sample.bytes).unwrap();
                vehicle.push(Vector3::from(truth.position_world));
            }
            Topic::PathReference => {
                let reference = PathReference::ref_from_bytes(sample.bytes).unwrap();
                curve.push(Vector3::from(reference.position_world));
                gamma = reference.gamma;
            }
            _ => {}
        }
    }
    let cross_track = vehicle
        .iter()
        .map(|place| distance(place, &curve))
        .fold(0.0, f64::max);
    (cross_track, gamma, is_lost)
}

/// Distance of a place from a line through points.
fn distance(place: &Vector3<f64>, points: &[Vector3<f64>]) -> f64 {
    let to_piece = |ends: &[Vector3<f64>]| {
        let (along, from) = (ends[1] - ends[0], place - ends[0]);
        let share = (along.dot(&from) / along.norm_squared().max(1e-18)).clamp(0.0, 1.0);
        (from - along * share).norm()
    };
    points.windows(2).map(to_piece).fold(f64::INFINITY, f64::min)
}

#[test]
fn the_page_about_following_shows_what_a_path_that_waits_is_worth() {
    let place = Place::new();
    let mut table = "| event | flown | largest distance from the curve, cm | time lost, s |\n".to_owned();
    table += "| --- | --- | --- | --- |\n";
    for (event, (what, of_event)) in EVENTS.into_iter().enumerate() {
        let mut in_time = None;
        for (way, (how, of_way)) in WAYS.into_iter().enumerate() {
            let sets = [of_event, &of_way].concat();
            let (cross_track, gamma, is_lost) = fly(&place, &format!("flight{event}{way}"), &sets);
            let lost_time = *in_time.get_or_insert(gamma) - gamma;
            let note = if is_lost { ", lost" } else { "" };
            table += &format!(
                "| {what} | {how}{note} | {:.1} | {lost_time:.2} |\n",
                100.0 * cross_track
            );
        }
    }
    let document = read("docs/following.md");
    assert_same("docs/following.md", section(&document, "following"), &table);
}
