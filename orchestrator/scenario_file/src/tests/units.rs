//! A value in another unit is refused, or is a warning at its key.

use std::collections::BTreeSet;
use std::f64::consts::PI;

use scenario::{Key, Problem};
use serde_json::Value;

use super::*;
use crate::keys::unit_of_key;
use crate::{units, warnings};

/// Scenarios of a laboratory, each with usual values of keys that it does not state.
const LABORATORIES: [(&str, &[&str]); 3] = [
    ("laboratory", &STATED),
    ("laboratory_crazyflie", &STATED),
    (
        "laboratory_outdoor",
        &["flight.yaw_test=0.2", "flight.ground=0.1"],
    ),
];

const STATED: [&str; 11] = [
    "flight.ground=0.03",
    "flight.ground_tolerance=0.05",
    "motion_capture.latency=0.005",
    "motion_capture.world_from_capture={position=[1.5,-2.0,0.0],roll_pitch_yaw=[3.14,0.0,1.57]}",
    "motion_capture.body_from_markers={position=[0.05,0.0,0.03],roll_pitch_yaw=[0.0,0.0,1.57]}",
    "model.marker_offset=[0.03,0.0,-0.02]",
    "model.capture_latency=0.008",
    "envelope.thrust={max=4.0,action='warn'}",
    "envelope.rates={max=[10.0,10.0,5.0],action='warn'}",
    "rc_output.transmitter.frame_rate=50.0",
    "cameras.jitter=0.001",
];

/// Sections that a laboratory states.
const SECTIONS: [&str; 10] = [
    "flight",
    "envelope",
    "motion_capture",
    "model",
    "rc_output",
    "controller.initial",
    "safety",
    "cameras",
    "receivers",
    "schedule",
];

/// Slip by which a number becomes larger or smaller.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Slip {
    Larger,
    Smaller,
}

/// Ends of keys for which no check is possible in a direction, each with the reason.
const UNCHECKED: [(&str, Slip, &str); 25] = [
    ("flight.spool_up", Slip::Smaller, "0 is sensible"),
    ("envelope.after", Slip::Smaller, "0 is sensible"),
    ("box.margin", Slip::Smaller, "0 is sensible"),
    ("motion_capture.latency", Slip::Smaller, "0 is sensible"),
    ("motion_capture.settle", Slip::Smaller, "0 is sensible"),
    ("model.thrust_lag", Slip::Smaller, "0 is sensible"),
    ("model.rate_lag", Slip::Smaller, "0 is sensible"),
    ("receivers.latency", Slip::Smaller, "0 is sensible"),
    ("cameras.jitter", Slip::Smaller, "0 is sensible"),
    ("cameras.position_deviation", Slip::Smaller, "0 is sensible"),
    ("cameras.attitude_deviation", Slip::Smaller, "0 is sensible"),
    ("model.marker_offset", Slip::Smaller, "0 is sensible"),
    ("body_from_markers.position", Slip::Smaller, "0 is sensible"),
    ("body_from_markers.roll_pitch_yaw", Slip::Smaller, "0 is sensible"),
    ("world_from_capture.position", Slip::Smaller, "0 is sensible"),
    (
        "world_from_capture.roll_pitch_yaw",
        Slip::Smaller,
        "0 is sensible",
    ),
    ("flight.ground", Slip::Smaller, "0 is sensible"),
    (
        "flight.ground",
        Slip::Larger,
        "outdoors the ground may be metres away from the origin",
    ),
    (
        "flight.position_sigma_max",
        Slip::Larger,
        "a single-point receiver attains metres",
    ),
    (
        "estimate.position_sigma",
        Slip::Smaller,
        "an RTK receiver attains millimetres",
    ),
    ("box.max", Slip::Smaller, "the box may end at its origin"),
    (
        "rc_output.rate_range",
        Slip::Smaller,
        "a share of the travel has no unit",
    ),
    ("transmitter.arming", Slip::Smaller, "a travel has no unit"),
    ("transmitter.rate_ends", Slip::Smaller, "a travel has no unit"),
    ("transmitter.thrust_ends", Slip::Smaller, "a travel has no unit"),
];

/// Returns the numbers of a part of a scenario with their keys; an array of numbers is in one unit.
fn numbers(part: &Value, at: &Key, found: &mut Vec<(Key, Vec<f64>)>) {
    match part {
        Value::Number(number) => found.push((at.clone(), number.as_f64().into_iter().collect())),
        Value::Array(elements) if elements.iter().all(Value::is_number) => {
            found.push((at.clone(), elements.iter().filter_map(Value::as_f64).collect()));
        }
        Value::Array(elements) => {
            for (index, element) in elements.iter().enumerate() {
                numbers(element, &at.then(index), found);
            }
        }
        Value::Object(keys) => keys
            .iter()
            .for_each(|(name, part)| numbers(part, &at.then(name), found)),
        _ => {}
    }
}

/// Returns the factors of the units that people take for a unit: mm, cm, g, ms, degrees, grams that a force carries.
fn factors(unit: Option<&str>) -> Vec<f64> {
    let degrees = 180.0 / PI;
    match unit {
        Some("m" | "m/s") => vec![1000.0, 100.0],
        Some("N") => vec![1000.0, 102.0],
        Some("s" | "kg" | "Hz" | "1/s" | "kg m²") => vec![1000.0],
        _ => vec![1000.0, degrees],
    }
}

/// Returns all warnings about a scenario.
fn warned(scenario: &Scenario) -> Vec<Problem> {
    warnings::all(scenario, &[[0.0, 0.0, -1.2]])
}

#[test]
fn a_value_in_another_unit_is_refused_or_warned_about_at_its_key() {
    let mut silent = BTreeSet::new();
    let mut count = 0;
    for (name, stated) in LABORATORIES {
        let file = repository(&format!("scenarios/{name}.toml"));
        let stated: Vec<_> = stated.iter().map(ToString::to_string).collect();
        let scenario = load(&file, &stated, None).unwrap_or_else(|error| panic!("{error:#}"));
        let usual = warned(&scenario);
        let whole = serde_json::to_value(&scenario).unwrap();
        let mut found = Vec::new();
        for section in SECTIONS {
            let part = section.split('.').fold(&whole, |part, name| &part[name]);
            numbers(part, &section.split('.').collect(), &mut found);
        }
        for (key, values) in found {
            if values.iter().all(|value| *value == 0.0) {
                continue;
            }
            let unit = unit_of_key(&key.to_string());
            let slips = factors(unit)
                .into_iter()
                .flat_map(|factor| [(Slip::Larger, factor), (Slip::Smaller, 1.0 / factor)]);
            for (slip, factor) in slips {
                count += 1;
                let wrong: Vec<_> = values.iter().map(|value| value * factor).collect();
                let is_array = whole.pointer(&pointer(&key)).is_some_and(Value::is_array);
                let written = if is_array {
                    format!("{wrong:?}")
                } else {
                    format!("{:?}", wrong[0])
                };
                let sets = [stated.clone(), vec![format!("{key}={written}")]].concat();
                let is_silent = load(&file, &sets, None).is_ok_and(|scenario| {
                    let told = warned(&scenario);
                    let mut new = told.iter().filter(|warning| !usual.contains(warning));
                    !new.any(|warning| is_at(&warning.key, &key))
                });
                if is_silent {
                    println!("{name}: {key}={written}");
                    silent.insert((end_of(&key), slip));
                }
            }
        }
    }
    assert!(count > 500, "only {count} slips");
    let unchecked: BTreeSet<_> = UNCHECKED
        .into_iter()
        .map(|(key, slip, _)| (key.to_owned(), slip))
        .collect();
    assert_eq!(silent, unchecked);
}

/// Returns whether a warning is at a key, or at the table or array around it.
fn is_at(warned: &Key, key: &Key) -> bool {
    let (warned, key) = (warned.segments(), key.segments());
    key.starts_with(warned) || warned.starts_with(key)
}

/// Returns the last two names of a key.
fn end_of(key: &Key) -> String {
    let segments = key.segments();
    segments[segments.len().saturating_sub(2)..].join(".")
}

/// Returns the JSON pointer of a key.
fn pointer(key: &Key) -> String {
    let escaped = |segment: &String| format!("/{}", segment.replace('~', "~0").replace('/', "~1"));
    key.segments().iter().map(escaped).collect()
}

/// Slips of a user with the pages alone: each was accepted, and flown or lost.
#[test]
fn a_slip_is_told_first_with_the_unit() {
    let file = repository("scenarios/laboratory.toml");
    for (set, key, unit) in [
        ("model.mass=200.0", "model.mass", "masses are in kg: give 0.2"),
        (
            "model.size=[176.0,176.0,55.0]",
            "model.size.0",
            "in m: 176 mm are 0.176",
        ),
        ("flight.landing_speed=30.0", "flight.landing_speed", "in m/s"),
        ("flight.takeoff_speed=40.0", "flight.takeoff_speed", "in m/s"),
        ("flight.takeoff_height=80.0", "flight.takeoff_height", "in m"),
        ("flight.spool_up=1000.0", "flight.spool_up", "in s"),
        ("flight.ground=-40.0", "flight.ground", "in m"),
        ("flight.ground_tolerance=50.0", "flight.ground_tolerance", "in m"),
        (
            "flight.position_sigma_max=10.0",
            "flight.position_sigma_max",
            "in m",
        ),
        ("flight.yaw_test=0.01", "flight.yaw_test", "in rad"),
        ("envelope.speed.max=250.0", "envelope.speed.max", "in m/s"),
        ("envelope.tilt.max=0.014", "envelope.tilt.max", "in rad"),
        (
            "motion_capture.max_speed=6000.0",
            "motion_capture.max_speed",
            "in m/s",
        ),
        (
            "estimator.kalman.attitude_deviation=0.115",
            "estimator.kalman.attitude_deviation",
            "in rad",
        ),
        (
            "estimator.kalman.attitude_deviation=0.115",
            "estimator.kalman.attitude_deviation",
            "in rad",
        ),
        (
            "controller.initial.inertia=[6.5,6.5,13.0]",
            "controller.initial.inertia",
            "kg m²",
        ),
        ("rc_output.thrust_slope=320.0", "rc_output.thrust_slope", "in N"),
        (
            "rc_output.rate_slope=[-0.3,-0.3,-0.1]",
            "rc_output.rate_slope",
            "in rad/s",
        ),
    ] {
        let told = match load(&file, &[set.to_owned()], None) {
            Ok(scenario) => warned(&scenario)[0].to_string(),
            Err(error) => format!("{error:#}"),
        };
        assert!(
            told.contains(&format!("`{key}`")) && told.contains(unit),
            "{set}: {told}"
        );
    }
}

#[test]
fn no_committed_scenario_is_warned_of_a_unit() {
    for entry in std::fs::read_dir(repository("scenarios")).unwrap() {
        let file = entry.unwrap().path();
        if file.extension().is_some_and(|extension| extension == "toml") {
            let scenario = load(&file, &[], None).unwrap();
            assert_eq!(units::warnings(&scenario), [], "{}", file.display());
        }
    }
}
