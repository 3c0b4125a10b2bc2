//! Flight outdoors in a scenario.

use super::assert_only;
use crate::tests_support::rig;
use crate::{
    Cameras, Datum, EdgeName, Fault, FaultKind, FixChange, Fixes, Flight, InputSafety, Navigation, Problem,
    Scenario, Sensors, Spoofing,
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
    refused(
        |scenario| scenario.sensors = None,
        "navigation",
        "needs sensors",
        "add `[sensors]`",
    );
    let mut indoors = rig();
    indoors.datum = Some(Datum::default());
    assert_only(
        &indoors.problems(),
        "datum",
        "only a satellite receiver needs a place",
        "add `[sensors]`",
    );
    refused(
        |scenario| scenario.flight = None,
        "navigation",
        "begins in the air",
        "add `[flight]`",
    );
    refused(
        |scenario| scenario.cameras = Some(Cameras::default()),
        "cameras",
        "it uses no cameras",
        "leave `[cameras]` or `[navigation]` out",
    );
}

#[test]
fn a_vehicle_that_would_never_be_armed_is_refused() {
    let single = |scenario: &mut Scenario, sigma| {
        scenario.sensors.as_mut().unwrap().gnss.kind = Fixes::SinglePoint;
        scenario.flight.as_mut().unwrap().position_sigma_max = sigma;
    };
    refused(
        |scenario| single(scenario, 1.5),
        "flight.position_sigma_max",
        "stays at 1.5 m",
        "raise it above 3.0",
    );
    assert_eq!(problems(|scenario| single(scenario, 3.1)), []);
}

#[test]
fn arming_before_the_position_is_known_is_refused() {
    let arm_at = |scenario: &mut Scenario, time| scenario.flight.as_mut().unwrap().arm_at = Some(time);
    refused(
        |scenario| arm_at(scenario, 5.0),
        "flight.arm_at",
        "at 5.0 s the position is not yet known",
        "raise it to 12.0",
    );
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
    refused(
        |scenario| period(scenario, "imu/sample", 0.02),
        "schedule.period.\"imu/sample\"",
        "cannot use samples every 0.02 s",
        "0.01",
    );
    refused(
        |scenario| {
            period(scenario, "estimator", 0.008);
            period(scenario, "vehicle/state", 0.008);
        },
        "schedule.period.estimator",
        "would miss samples",
        "a period of 0.004 or less",
    );
    refused(
        |scenario| period(scenario, "mag/field", 0.001),
        "schedule.period.\"mag/field\"",
        "would wait for the filter's horizon",
        "fields one of 0.02",
    );
    let late = |scenario: &mut Scenario, by| {
        let name = "gnss/fix -> estimator".to_owned();
        scenario.schedule.latency.insert(name, by);
    };
    refused(
        |scenario| late(scenario, 0.12),
        "navigation.horizon",
        "samples of `gnss/fix` are late by 0.12 s",
        "raise it to 0.128",
    );
    refused(
        |scenario| late(scenario, 0.248),
        "navigation.horizon",
        "late by 0.248 s",
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
    refused(
        |scenario| gnss(scenario, &[], &[(3.0, 2.0), (4.0, 1.0)]),
        "sensors.gnss.spoofing.1.at",
        "begins before",
        "merge them",
    );
}

#[test]
fn a_fault_of_an_input_that_the_flight_does_not_have_is_refused() {
    let fault = |edge: &str| Fault {
        edge: Some(edge.to_owned()),
        ..Fault::new(FaultKind::Stuck, 5.0)
    };
    refused(
        |scenario| scenario.fault = vec![fault("mocap/pose -> estimator")],
        "fault.0.edge",
        "no camera captures",
        "such as `gnss/fix`",
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
