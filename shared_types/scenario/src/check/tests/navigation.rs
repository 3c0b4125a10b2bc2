//! Flight outdoors in a scenario.

use super::assert_only;
use crate::tests_support::rig;
use crate::{
    Cameras, Datum, EdgeName, Fault, FaultKind, FixChange, Fixes, Flight, InputSafety, Navigation, Poses,
    Problem, Scenario, Sensors, Spoofing, Volume,
};
use shared_types::schedule::Schedule;
use shared_types::wiring::{ServiceId, Topic};

/// The laboratory's vehicle outdoors.
fn outdoors() -> Scenario {
    let mut scenario = rig();
    scenario.cameras = None;
    scenario.estimator = None;
    scenario.sensors = Some(Sensors::default());
    scenario.navigation = Some(Navigation::default());
    scenario.datum = Some(Datum::default());
    scenario.flight = Some(Flight {
        arm_at: Some(14.0),
        position_sigma_max: 0.05,
        ..Flight::default()
    });
    scenario.vehicle.initial.position = [0.0; 3];
    scenario.schedule.period.remove("mocap/pose");
    scenario.schedule.latency.remove("mocap/pose -> estimator");
    for (topic, period) in [
        ("imu/sample", 0.004),
        ("gnss/fix", 0.1),
        ("baro/altitude", 0.04),
        ("mag/field", 0.02),
    ] {
        scenario.schedule.period.insert(topic.to_owned(), period);
    }
    scenario
        .schedule
        .latency
        .insert("gnss/fix -> estimator".to_owned(), 0.1);
    scenario
}

fn problems(spoil: impl FnOnce(&mut Scenario)) -> Vec<Problem> {
    let mut scenario = outdoors();
    spoil(&mut scenario);
    scenario.problems()
}

#[track_caller]
fn refused(spoil: impl FnOnce(&mut Scenario), key: &str, reason: &str, fix: &str) {
    assert_only(&problems(spoil), key, reason, fix);
}

fn schedule(spoil: impl FnOnce(&mut Scenario)) -> Schedule {
    let mut scenario = outdoors();
    spoil(&mut scenario);
    scenario.schedule().unwrap()
}

#[test]
fn a_flight_outdoors_has_no_problem() {
    assert_eq!(problems(|_| ()), []);
}

#[test]
fn sensors_are_read_by_inertial_navigation_alone_and_cameras_are_not() {
    let input = |topic: Topic| {
        let inputs = ServiceId::Estimator.inputs();
        inputs.iter().position(|input| input.topic == topic).unwrap()
    };
    let topics = [
        Topic::ImuSample,
        Topic::GnssFix,
        Topic::BaroAltitude,
        Topic::MagField,
    ];
    let whole = schedule(|_| ());
    assert!(!whole.reads(ServiceId::Estimator, input(Topic::MocapPose)));
    assert_eq!(whole.sample_count(Topic::MocapPose), 0);
    let recorded = schedule(|scenario| scenario.navigation = None);
    let without = schedule(|scenario| {
        scenario.navigation = None;
        scenario.sensors = None;
    });
    for topic in topics {
        assert!(whole.reads(ServiceId::Estimator, input(topic)), "{topic}");
        assert!(recorded.has_topic(topic) && !recorded.reads(ServiceId::Estimator, input(topic)));
        assert!(!without.has_topic(topic) && !without.reads(ServiceId::Estimator, input(topic)));
        assert_eq!(without.sample_count(topic), 0);
    }
    assert!(recorded.sample_count(Topic::MocapPose) > 0);
}

#[test]
fn inertial_navigation_needs_sensors_and_the_ground() {
    let mocap = |scenario: &mut Scenario| {
        let name = "mocap/pose -> estimator".to_owned();
        scenario.safety.insert(name, InputSafety::new(0.2));
    };
    let key = "safety.\"mocap/pose -> estimator\"";
    refused(mocap, key, "no camera captures", "state `navigation.coast`");
    let key = "navigation";
    refused(|s| s.sensors = None, key, "needs sensors", "add `[sensors]`");
    let mut indoors = rig();
    indoors.datum = Some(Datum::default());
    assert_only(
        &indoors.problems(),
        "datum",
        "only a satellite receiver needs a place",
        "add `[sensors]`",
    );
    let key = "navigation";
    refused(|s| s.flight = None, key, "begins in the air", "add `[flight]`");
    let see = |scenario: &mut Scenario| scenario.cameras = Some(Cameras::default());
    let reason = "it uses no cameras without `[navigation.poses]`";
    refused(see, "cameras", reason, "leave `[cameras]` or");
}

#[test]
fn poses_are_a_further_source_of_inertial_navigation_or_the_only_one_of_its_position() {
    let seen = |scenario: &mut Scenario| {
        scenario.cameras = Some(Cameras::default());
        scenario.navigation.as_mut().unwrap().poses = Some(Poses::default());
        let period = &mut scenario.schedule.period;
        period.insert("mocap/pose".to_owned(), 0.01);
    };
    let none = |scenario: &mut Scenario| scenario.sensors.as_mut().unwrap().gnss.kind = Fixes::None;
    assert_eq!(problems(seen), []);
    assert_eq!(problems(|scenario| (seen(scenario), none(scenario)).0), []);
    let [with, without] = [schedule(seen), schedule(|_| ())];
    assert!(with.has_topic(Topic::PoseInnovations) && with.sample_count(Topic::MocapPose) > 0);
    assert!(!without.has_topic(Topic::PoseInnovations));
    let kind = "sensors.gnss.kind";
    refused(none, kind, "nothing measures its position", "add `[cameras]`");
    let empty = Volume {
        min: [0.0; 3],
        max: [1.0, 0.0, 1.0],
    };
    for (key, is_of_cameras) in [
        ("cameras.volume.max.1", true),
        ("sensors.gnss.building.max.1", false),
    ] {
        let spoil = |scenario: &mut Scenario| {
            seen(scenario);
            match is_of_cameras {
                true => scenario.cameras.as_mut().unwrap().volume = Some(empty),
                false => scenario.sensors.as_mut().unwrap().gnss.building = Some(empty),
            }
        };
        refused(spoil, key, "the box is empty", "z points down");
    }
    let late = |scenario: &mut Scenario| {
        seen(scenario);
        scenario.cameras.as_mut().unwrap().jitter = 0.008;
        let name = "mocap/pose -> estimator".to_owned();
        scenario.schedule.latency.insert(name, 0.11);
    };
    let reason = "samples of `mocap/pose` are late by 0.118 s";
    refused(late, "navigation.horizon", reason, "raise it to 0.126");
    let policy = |scenario: &mut Scenario| {
        seen(scenario);
        let name = "mocap/pose -> estimator".to_owned();
        scenario.safety.insert(name, InputSafety::new(0.2));
    };
    let key = "safety.\"mocap/pose -> estimator\"";
    refused(policy, key, "has its own limit", "state `navigation.coast`");
}

#[test]
fn two_antennas_are_stated_to_receiver_and_estimator_with_a_baseline_that_shows_the_heading() {
    let state = |scenario: &mut Scenario, sensor, assumed, period| {
        scenario.sensors.as_mut().unwrap().gnss.baseline = sensor;
        scenario.navigation.as_mut().unwrap().baseline = assumed;
        let name = "gnss/baseline".to_owned();
        scenario.schedule.period.insert(name, period);
    };
    let long = Some([0.8, 0.0, 0.1]);
    assert_eq!(problems(|s| state(s, long, long, 0.1)), []);
    let [with, without] = [schedule(|s| state(s, long, long, 0.1)), schedule(|_| ())];
    for topic in [Topic::GnssBaseline, Topic::BaselineInnovations] {
        assert!(with.has_topic(topic) && !without.has_topic(topic));
    }
    let (key, reason) = (
        "navigation.baseline",
        "differ in whether there is a second antenna",
    );
    refused(|s| state(s, None, long, 0.1), key, reason, "state both");
    let short = Some([0.05, 0.0, 0.5]);
    refused(
        |s| state(s, short, short, 0.1),
        key,
        "no heading follows",
        "the unit is m",
    );
    let key = "schedule.period.\"gnss/baseline\"";
    refused(
        |s| state(s, long, long, 0.001),
        key,
        "would wait",
        "baselines a period of 0.1",
    );
    let add = "add `navigation.baseline`";
    refused(|s| state(s, None, None, 0.1), key, "has no `gnss/baseline`", add);
}

#[test]
fn a_vehicle_that_would_never_be_armed_is_refused() {
    let single = |scenario: &mut Scenario, sigma| {
        scenario.sensors.as_mut().unwrap().gnss.kind = Fixes::SinglePoint;
        scenario.flight.as_mut().unwrap().position_sigma_max = sigma;
    };
    let (key, reason) = ("flight.position_sigma_max", "stays at 1.5 m");
    refused(|s| single(s, 1.5), key, reason, "raise it above 3.0");
    assert_eq!(problems(|scenario| single(scenario, 3.1)), []);
}

#[test]
fn arming_before_the_position_is_known_is_refused() {
    let arm_at = |scenario: &mut Scenario, time| scenario.flight.as_mut().unwrap().arm_at = Some(time);
    let (key, reason) = ("flight.arm_at", "at 5.0 s the position is not yet known");
    refused(|s| arm_at(s, 5.0), key, reason, "raise it to 12.0");
    assert_eq!(problems(|scenario| arm_at(scenario, 12.0)), []);
    for (at, is_refused) in [(13.9, true), (14.1, false)] {
        let found = problems(|scenario| {
            let gnss = &mut scenario.sensors.as_mut().unwrap().gnss;
            gnss.change = vec![FixChange {
                at,
                kind: Fixes::SinglePoint,
            }];
        });
        assert_eq!(
            found.len(),
            usize::from(is_refused),
            "single point from {at} s on: {found:?}"
        );
    }
}

#[test]
fn rates_and_latencies_with_which_the_filter_refuses_samples_are_refused() {
    let period = |scenario: &mut Scenario, topic: &str, period| {
        scenario.schedule.period.insert(topic.to_owned(), period);
    };
    let (key, reason) = (
        "schedule.period.\"imu/sample\"",
        "cannot use samples every 0.02 s",
    );
    refused(|s| period(s, "imu/sample", 0.02), key, reason, "0.01");
    refused(
        |scenario| {
            period(scenario, "estimator", 0.008);
            period(scenario, "vehicle/state", 0.008);
        },
        "schedule.period.estimator",
        "would miss samples",
        "a period of 0.004 or less",
    );
    let (key, reason) = (
        "schedule.period.\"mag/field\"",
        "would wait for the filter's horizon",
    );
    refused(
        |s| period(s, "mag/field", 0.001),
        key,
        reason,
        "fields one of 0.02",
    );
    let late = |scenario: &mut Scenario, by| {
        let name = "gnss/fix -> estimator".to_owned();
        scenario.schedule.latency.insert(name, by);
    };
    let (key, reason) = ("navigation.horizon", "samples of `gnss/fix` are late by 0.12 s");
    refused(|s| late(s, 0.12), key, reason, "raise it to 0.128");
    let (key, reason) = ("navigation.horizon", "late by 0.248 s");
    refused(
        |s| late(s, 0.248),
        key,
        reason,
        "it is 0.25 at most: lower `schedule.latency`",
    );
}

#[test]
fn changes_of_the_fixes_and_spoofing_are_in_order_and_change_something() {
    let gnss = |scenario: &mut Scenario, changes: &[(f64, Fixes)], spoofing: &[(f64, f64)]| {
        let gnss = &mut scenario.sensors.as_mut().unwrap().gnss;
        gnss.change = changes.iter().map(|&(at, kind)| FixChange { at, kind }).collect();
        gnss.spoofing = spoofing
            .iter()
            .map(|&(at, lasts)| Spoofing {
                at,
                lasts,
                velocity: [0.5, 0.0, 0.0],
            })
            .collect();
    };
    refused(
        |scenario| gnss(scenario, &[(23.0, Fixes::RtkFloat), (24.0, Fixes::RtkFloat)], &[]),
        "sensors.gnss.change.1.kind",
        "solves this already",
        "state another kind",
    );
    refused(
        |scenario| gnss(scenario, &[(24.0, Fixes::RtkFloat), (23.0, Fixes::RtkFixed)], &[]),
        "sensors.gnss.change.1.at",
        "is listed after",
        "order of their times",
    );
    let (key, reason) = ("sensors.gnss.spoofing.1.at", "begins before");
    refused(
        |s| gnss(s, &[], &[(3.0, 2.0), (4.0, 1.0)]),
        key,
        reason,
        "merge them",
    );
}

#[test]
fn a_fault_of_an_input_that_the_flight_does_not_have_is_refused() {
    let fault = |edge: &str| Fault {
        edge: Some(edge.to_owned()),
        ..Fault::new(FaultKind::Stuck, 5.0)
    };
    let (key, fix) = ("fault.0.edge", "such as `gnss/fix`");
    refused(
        |s| s.fault = vec![fault("mocap/pose -> estimator")],
        key,
        "no camera captures",
        fix,
    );
    assert_eq!(
        problems(|scenario| scenario.fault = vec![fault("gnss/fix -> estimator")]),
        []
    );
    let mut indoors = rig();
    indoors.fault = vec![fault("gnss/fix -> estimator")];
    assert_only(
        &indoors.problems(),
        "fault.0.edge",
        "has no `gnss/fix`",
        "add `[sensors]`",
    );
}

#[test]
fn random_numbers_of_an_edge_are_those_of_earlier_versions() {
    let earlier = [
        (Topic::RcFrame, ServiceId::Plant),
        (Topic::MocapPose, ServiceId::Estimator),
        (Topic::RcFrame, ServiceId::Estimator),
        (Topic::VehicleState, ServiceId::PathGenerator),
        (Topic::RcFrame, ServiceId::PathGenerator),
        (Topic::VehicleState, ServiceId::Controller),
        (Topic::PathReference, ServiceId::Controller),
        (Topic::ControlCommand, ServiceId::RcOutput),
        (Topic::VehicleState, ServiceId::RcOutput),
    ];
    let numbered: Vec<_> = EdgeName::numbered()
        .map(|edge| (edge.topic, edge.service))
        .collect();
    assert_eq!(numbered[..earlier.len()], earlier);
    assert_eq!(numbered.len(), EdgeName::all().count());
}
