//! Policies for old and impossible samples.

use proptest::prelude::*;

use super::assert_only;
use crate::tests_support::{fig1, rig};
use crate::{EdgeName, InputSafety, Problem, Scenario};
use shared_types::schedule::{MAX_PORTS, Rate, Schedule};
use shared_types::wiring::{ServiceId, Topic};

const STATE: &str = "vehicle/state -> controller";

fn with(mut scenario: Scenario, edge: &str, safety: InputSafety) -> Vec<Problem> {
    scenario.safety.insert(edge.to_owned(), safety);
    scenario.problems()
}

#[track_caller]
fn refused(edge: &str, safety: InputSafety, key: &str, reason: &str, fix: &str) {
    assert_only(
        &with(rig(), edge, safety),
        &format!("safety.{edge:?}{key}"),
        reason,
        fix,
    );
}

#[test]
fn a_policy_for_every_input_that_has_a_use_for_it_is_accepted() {
    let all = InputSafety {
        level: Some(0.2),
        descend: Some(1.0),
        failsafe: Some(5.0),
        jump: Some(0.2),
        recover: Some(0.0),
        ..InputSafety::new(0.066)
    };
    assert_eq!(with(rig(), STATE, all.clone()), []);
    assert_eq!(with(fig1(), STATE, all), []);
    for edge in [
        STATE,
        "path/reference -> controller",
        "vehicle/state -> path_generator",
        "control/command -> rc_output",
    ] {
        assert_eq!(with(rig(), edge, InputSafety::new(0.05)), []);
    }
    assert_eq!(
        with(fig1(), "mocap/pose -> estimator", InputSafety::new(0.05)),
        []
    );
}

#[test]
fn policies_of_inputs_that_there_are_not_or_that_no_policy_is_for_are_refused() {
    let policy = InputSafety::new(0.1);
    refused(
        "vehicle/state -> controler",
        policy.clone(),
        "",
        "there is no edge",
        "did you mean",
    );
    refused(
        "rc/frame -> plant",
        policy.clone(),
        "",
        "does not depend on the age",
        "leave",
    );
    refused(
        "mocap/pose -> estimator",
        policy,
        "",
        "the filter has its own limit",
        "coast",
    );
}

#[test]
fn values_that_an_input_has_no_use_for_are_refused() {
    let level = InputSafety {
        level: Some(0.5),
        ..InputSafety::new(0.1)
    };
    refused(
        "control/command -> rc_output",
        level,
        ".level",
        "does not use it",
        "`max_age`, `failsafe`",
    );
    let recover = InputSafety {
        recover: Some(0.1),
        ..InputSafety::new(0.1)
    };
    refused(
        "path/reference -> controller",
        recover,
        ".recover",
        "does not use it",
        "state only `max_age`",
    );
}

#[test]
fn stages_that_do_not_follow_each_other_are_refused_at_the_later() {
    let safety = InputSafety {
        level: Some(0.1),
        ..InputSafety::new(0.1)
    };
    refused(
        STATE,
        safety,
        ".level",
        "`level` = 0.1 s is not above `max_age` = 0.1 s",
        "leave `level` out",
    );
    let safety = InputSafety {
        level: Some(0.5),
        failsafe: Some(0.4),
        ..InputSafety::new(0.1)
    };
    refused(
        STATE,
        safety,
        ".failsafe",
        "is not above `level` = 0.5 s",
        "raise it above 0.5 s",
    );
}

#[test]
fn ages_that_are_no_whole_ticks_are_refused() {
    refused(
        STATE,
        InputSafety::new(0.0505),
        ".max_age",
        "not a whole number of base ticks",
        "0.05",
    );
}

/// A state of ideal cameras repeats a capture until the next, and says nothing new.
#[test]
fn an_age_at_which_nothing_has_failed_is_refused() {
    let mut scenario = fig1();
    for name in ["mocap/pose", "vehicle/state"] {
        scenario.schedule.period.insert(name.to_owned(), 0.01);
    }
    assert_only(
        &with(
            scenario.clone(),
            "mocap/pose -> estimator",
            InputSafety::new(0.008),
        ),
        "safety.\"mocap/pose -> estimator\".max_age",
        "is up to 0.009 s old without faults",
        "give 0.009 s or more",
    );
    assert_eq!(
        with(
            scenario.clone(),
            "mocap/pose -> estimator",
            InputSafety::new(0.009)
        ),
        []
    );
    scenario.schedule.period.remove("vehicle/state");
    let problems = with(scenario, STATE, InputSafety::new(0.009));
    assert_only(
        &problems,
        &format!("safety.{STATE:?}.max_age"),
        "is up to 0.01 s old",
        "0.01 s or more",
    );
}

proptest! {
    /// Compares with a check at every step.
    #[test]
    fn the_ordinary_age_is_the_largest_at_any_step(
        periods in [1..12u64, 1..12u64], phases in [0..15u64, 0..15u64], latency in 0..20u64,
    ) {
        let (edge, every) = (EdgeName::find("mocap/pose -> estimator").unwrap(), Rate::EVERY_TICK);
        let mut services = [every; ServiceId::ALL.len()];
        let mut topics = [every; Topic::ALL.len()];
        let mut latencies: [[u64; MAX_PORTS]; ServiceId::ALL.len()] = shared_types::schedule::default_latencies();
        services[ServiceId::Estimator.index()] = Rate { period: periods[0], phase: phases[0] };
        topics[Topic::VehicleState.index()] = services[ServiceId::Estimator.index()];
        for topic in [Topic::NavigationInnovations, Topic::PoseInnovations, Topic::BaselineInnovations] {
            topics[topic.index()] = topics[Topic::VehicleState.index()];
        }
        topics[Topic::MocapPose.index()] = Rate { period: periods[1], phase: phases[1] };
        latencies[edge.service.index()][edge.input] = latency;
        let schedule = Schedule::new(1, 1000, services, topics, latencies);
        prop_assume!(schedule.is_ok());
        let schedule = schedule.unwrap();
        let input = schedule.edge(edge.service, edge.input);
        let steps = (100..600).filter(|&tick| schedule.service_rate(edge.service).occurs_at(tick));
        let oldest = steps.map(|tick| tick - input.due_sample(tick).unwrap()).max().unwrap();
        prop_assert_eq!(schedule.ordinary_age(edge.service, edge.input), oldest);
    }
}
