//! Flight outdoors: its times, and the receivers of a real vehicle.

use scenario::{Fault, FaultKind};
use shared_types::{ServiceId, Topic};

use super::*;

fn shipped(name: &str) -> String {
    std::fs::read_to_string(repository(&format!("scenarios/{name}.toml"))).unwrap()
}

/// The scenario with these settings is refused for one reason, at a key, and the report has these pieces.
#[track_caller]
fn refused(name: &str, sets: &[&str], pieces: &[&str]) {
    let error = load_text(&shipped(name), sets).expect_err(&format!("{sets:?} is wrong"));
    let shown = narrated(&error);
    for piece in pieces {
        assert!(shown.contains(piece), "no `{piece}` in:\n{shown}");
    }
    let ScenarioError::Refused { findings, .. } = error else {
        panic!("{shown}")
    };
    assert_eq!(findings.len(), 1, "{shown}");
}

/// Flight by the packets of receivers.
const RECEIVERS: &str = "laboratory_outdoor";

/// Flight by the poses of cameras and the packets of receivers.
const HALL: &str = "laboratory_indoor_outdoor";

#[test]
fn times_of_a_topic_on_which_nothing_is_published_are_refused() {
    for (table, name) in [
        ("period", "mocap/pose"),
        ("phase", "mocap/pose"),
        ("latency", "mocap/pose -> estimator"),
    ] {
        let set = format!("schedule.{table}.\"{name}\"=0.01");
        let place = format!("schedule.{table}");
        let pieces = [
            "no camera captures a vehicle with inertial navigation",
            "leave it out",
        ];
        refused("outdoor_rtk", &[&set], &[&[place.as_str()], &pieces[..]].concat());
    }
    for (set, pieces) in [
        (
            "schedule.period.\"gnss/fix\"=0.1",
            ["has no `gnss/fix`", "add `[sensors]`"],
        ),
        (
            "schedule.latency.\"imu/sample -> estimator\"=0.1",
            ["has no `imu/sample`", "add `[sensors]`"],
        ),
        (
            "schedule.period.\"control/telemetry\"=0.1",
            ["has no `control/telemetry`", "add `controller.telemetry`"],
        ),
    ] {
        refused("fig1", &[set], &pieces);
    }
    assert!(load_text(&shipped("fig1"), &["schedule.period.\"mocap/pose\"=0.001"]).is_ok());
}

#[test]
fn sources_of_receivers_are_addresses_or_paths() {
    let with = |source: &str| format!("receivers.sources=[{source}]");
    let real = load_text(
        &shipped(RECEIVERS),
        &[&with("'/dev/ttyACM0','udp:0.0.0.0:14550'")],
    );
    assert_eq!(
        real.unwrap()
            .schedule()
            .unwrap()
            .sample_count(Topic::VehicleTruth),
        0
    );
    let simulated = load_text(&shipped(RECEIVERS), &[&with("")]).unwrap();
    assert!(simulated.schedule().unwrap().simulates_the_world());
    for misspelt in [
        "udp:14550",
        "upd:0.0.0.0:14550",
        "UDP:0.0.0.0:14550",
        "127.0.0.1:14550",
        "udp:0.0.0.0:0",
    ] {
        let pieces = [
            "receivers.sources",
            &format!("`{misspelt}` is not the address of a receiver"),
            "give tcp:",
        ];
        refused(RECEIVERS, &[&with(&format!("'{misspelt}'"))], &pieces);
    }
    refused(
        RECEIVERS,
        &[&with("'tty','tty'")],
        &["receivers.sources", "stated twice", "leave one out"],
    );
    refused(
        "fig1",
        &["receivers={}"],
        &["only inertial navigation uses", "add `[navigation]`"],
    );
}

#[test]
fn real_samples_are_in_time_for_the_filter_or_refused() {
    refused(
        RECEIVERS,
        &["schedule.period.\"imu/sample\"=0.006"],
        &[
            "schedule.period.\"imu/sample\"",
            "every 0.006 s that jitter",
            "and 0.005",
        ],
    );
    refused(
        RECEIVERS,
        &["schedule.latency.\"gnss/fix -> estimator\"=0.1"],
        &["are late by themselves", "leave it out"],
    );
    // A fix waits for the next tick of its topic.
    let late = "samples of `gnss/fix` are late by 0.1 s and wait for up to 0.1 s";
    refused(
        RECEIVERS,
        &["navigation.horizon=0.15"],
        &["navigation.horizon", late, "raise it to 0.204"],
    );
    assert!(load_text(&shipped(RECEIVERS), &["navigation.horizon=0.204"]).is_ok());
    let fix = "it is 0.25 at most: let the sender send sooner (`receivers.fix_latency`), or more often (`schedule.period.\"gnss/fix\"`)";
    refused(
        RECEIVERS,
        &["receivers.fix_latency=0.2"],
        &["navigation.horizon", "late by 0.2 s", fix],
    );
}

#[test]
fn cameras_and_receivers_of_a_flight_are_both_real_or_both_simulated() {
    let [no_receivers, no_cameras] = ["receivers.sources=[]", "motion_capture.source=simulated"];
    let real = load_text(&shipped(HALL), &[]).unwrap();
    assert_eq!(real.process_name(ServiceId::Plant), "receivers");
    assert_eq!(real.schedule().unwrap().sample_count(Topic::VehicleTruth), 0);
    let simulated = load_text(&shipped(HALL), &[no_receivers, no_cameras]).unwrap();
    assert!(simulated.schedule().unwrap().simulates_the_world());
    let pieces = [
        "motion_capture.source",
        "other sensors are simulated",
        "state `receivers.sources`",
    ];
    refused(HALL, &[no_receivers], &pieces);
    let pieces = [
        "navigation.poses",
        "no real cameras send poses",
        "state `motion_capture.source`",
    ];
    refused(HALL, &[no_cameras], &pieces);
    let cameras = "motion_capture={source='vrpn', server='127.0.0.1', object='quad'}";
    let pieces = [
        "motion_capture",
        "it uses no cameras without `[navigation.poses]`",
    ];
    refused(RECEIVERS, &[cameras], &pieces);
}

#[test]
fn real_poses_are_in_time_for_the_filter_or_refused() {
    refused(
        HALL,
        &["schedule.latency.\"mocap/pose -> estimator\"=0.008"],
        &["are late by themselves", "state `motion_capture.latency`"],
    );
    let late = "samples of `mocap/pose` are late by 0.21 s and wait for up to 0.02 s";
    refused(
        HALL,
        &["motion_capture.latency=0.21"],
        &["navigation.horizon", late, "raise it to 0.234"],
    );
    // Between two captures the newest sample has none.
    let fast = [
        "schedule.period.\"mocap/pose\"=0.003",
        "schedule.period.\"gnss/fix\"=0.02",
        "receivers.fix_latency=0.0",
        "navigation.horizon=0.045",
    ];
    refused(
        HALL,
        &fast,
        &[
            "would miss samples of `mocap/pose`",
            "or `mocap/pose` one of 0.004",
        ],
    );
}

#[test]
fn the_stated_time_of_arming_is_one_that_is_accepted() {
    let unarmed = load_text(&shipped(RECEIVERS), &["receivers.sources=[]"]).unwrap();
    let fix = unarmed.missing_arm_request().unwrap().fix;
    assert!(fix.contains("`arm_at = 12.0`"), "{fix}");
    assert!(load_text(&shipped("outdoor_rtk"), &["flight.arm_at=12.0"]).is_ok());
}

#[test]
fn a_fault_that_loses_samples_states_their_share() {
    for (fraction, words) in [(1.0, "100.0 %"), (0.3, "30.0 %"), (0.07, "7.0 %")] {
        let fault = Fault {
            edge: Some("gnss/fix -> estimator".to_owned()),
            fraction: Some(fraction),
            ..Fault::new(FaultKind::Intermittent, 5.0)
        };
        assert_eq!(
            fault.to_string(),
            format!("`gnss/fix -> estimator` loses {words} of its samples")
        );
    }
}
