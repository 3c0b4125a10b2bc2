use proptest::prelude::*;

use super::*;
use crate::tests_support::{fig1, rig};
use crate::{EdgeName, Fault, FaultKind, Programs};

fn only_problem(scenario: &Scenario) -> Problem {
    let problems = scenario.schedule().expect_err("the schedule is wrong");
    assert_eq!(problems.len(), 1, "{problems:?}");
    problems.into_iter().next().unwrap()
}

fn with_latency(edge: &str, time: f64) -> Scenario {
    let mut scenario = fig1();
    scenario.schedule.latency.insert(edge.to_owned(), time);
    scenario
}

fn with_period(name: &str, time: f64) -> Scenario {
    let mut scenario = fig1();
    scenario.schedule.period.insert(name.to_owned(), time);
    scenario
}

#[test]
fn a_scenario_without_times_has_the_ideal_schedule() {
    let scenario = fig1();
    let ideal = Schedule::ideal(1_000_000, 60_000).with_unread_inputs(scenario.unread_inputs());
    assert_eq!(scenario.schedule(), Ok(ideal));
}

#[test]
fn stated_times_become_ticks_where_they_belong() {
    let mut scenario = with_period("mocap/pose", 0.01);
    scenario.schedule.period.insert("rc_output".to_owned(), 0.022);
    scenario.schedule.phase.insert("rc_output".to_owned(), 0.003);
    scenario
        .schedule
        .latency
        .insert("rc/frame -> plant".to_owned(), 0.005);
    let schedule = scenario.schedule().unwrap();
    let radio = Rate { period: 22, phase: 3 };
    assert_eq!(schedule.service_rate(ServiceId::RcOutput), radio);
    assert_eq!(
        schedule.topic_rate(Topic::RcFrame),
        radio,
        "a topic inherits its publisher's rate"
    );
    assert_eq!(
        schedule.topic_rate(Topic::MocapPose),
        Rate { period: 10, phase: 0 }
    );
    assert_eq!(schedule.service_rate(ServiceId::Plant), Rate::EVERY_TICK);
    // A step of the vehicle begins one tick before its own: the frame acts 5 ms after it was sent.
    assert_eq!(schedule.latency(ServiceId::Plant, 0), 6);
}

#[test]
fn a_phase_alone_leaves_a_topic_its_publishers_period() {
    let mut scenario = with_period("plant", 0.002);
    scenario.schedule.phase.insert("mocap/pose".to_owned(), 0.004);
    let schedule = scenario.schedule().unwrap();
    assert_eq!(
        schedule.topic_rate(Topic::MocapPose),
        Rate { period: 2, phase: 4 }
    );
}

#[test]
fn a_period_between_ticks_is_refused_with_its_neighbours() {
    let problem = only_problem(&with_period("plant", 0.0015));
    assert_eq!(problem.key.to_string(), "schedule.period.plant");
    assert_eq!(
        problem.reason,
        "0.0015 s is not a whole number of base ticks of 0.001 s"
    );
    assert!(problem.fix.starts_with("use 0.001 or 0.002"), "{}", problem.fix);
}

#[test]
fn a_period_of_less_than_a_tick_is_not_advised_to_be_zero() {
    let problem = only_problem(&with_period("plant", 0.0));
    assert_eq!(problem.fix, "give a time of 0.001 s or more and at most 10.0 s");
}

#[test]
fn times_that_are_no_times_are_refused() {
    for time in [-0.001, f64::NAN, f64::INFINITY, f64::NEG_INFINITY, 1e300, 10.001] {
        let problem = only_problem(&with_latency("rc/frame -> plant", time));
        assert_eq!(
            problem.key.segments(),
            ["schedule", "latency", "rc/frame -> plant"],
            "{time}"
        );
        assert!(problem.reason.contains("is not a time from 0.0 s"), "{problem}");
    }
}

#[test]
fn ticks_that_are_none_are_refused() {
    for tick in [0.0, -0.001, f64::NAN, f64::INFINITY, 1e-7, 1.5, 0.000_333_333_333] {
        let mut scenario = fig1();
        scenario.schedule.tick = tick;
        let problem = only_problem(&scenario);
        assert_eq!(problem.key.to_string(), "schedule.tick", "{tick}");
        assert!(problem.fix.contains("0.001"), "{problem}");
    }
}

#[test]
fn a_flight_without_a_tick_and_one_without_end_are_refused() {
    for duration in [0.0, -1.0, 1e6, f64::NAN] {
        let mut scenario = fig1();
        scenario.vehicle.change.clear();
        scenario.duration = duration;
        assert_eq!(only_problem(&scenario).key.to_string(), "duration", "{duration}");
    }
}

#[test]
fn an_unknown_name_is_refused_with_the_nearest_known_one() {
    let problem = only_problem(&with_period("controler", 0.002));
    assert_eq!(problem.key.to_string(), "schedule.period.controler");
    assert_eq!(problem.reason, "there is no service or topic `controler`");
    assert!(
        problem.fix.starts_with("did you mean `controller`?"),
        "{}",
        problem.fix
    );
}

#[test]
fn topics_of_the_orchestrator_have_no_rate_to_state() {
    let problem = only_problem(&with_period("run/events", 0.002));
    assert_eq!(problem.reason, "there is no service or topic `run/events`");
}

#[test]
fn an_unknown_edge_is_refused_and_its_key_stays_whole() {
    let problem = only_problem(&with_latency("rc.frame -> plant", 0.001));
    assert_eq!(
        problem.key.segments(),
        ["schedule", "latency", "rc.frame -> plant"]
    );
    assert!(
        problem.fix.starts_with("did you mean `rc/frame -> plant`?"),
        "{}",
        problem.fix
    );
}

#[test]
fn a_cycle_without_delay_is_refused_at_the_latency_that_makes_it() {
    let problem = only_problem(&with_latency("rc/frame -> estimator", 0.0));
    assert_eq!(
        problem.key.to_string(),
        "schedule.latency.\"rc/frame -> estimator\""
    );
    assert!(
        problem.reason.contains("wait for each other within one tick"),
        "{problem}"
    );
}

#[test]
fn a_topic_without_step_is_refused_at_the_period_that_makes_it() {
    let mut scenario = with_period("plant", 0.002);
    scenario.schedule.period.insert("mocap/pose".to_owned(), 0.003);
    assert_eq!(
        only_problem(&scenario).key.to_string(),
        "schedule.period.mocap/pose".replace("mocap/pose", "\"mocap/pose\"")
    );
}

#[test]
fn a_join_of_unequal_ticks_is_refused_at_the_time_that_makes_it() {
    let problem = only_problem(&with_period("path_generator", 0.002));
    assert_eq!(problem.key.to_string(), "schedule.period.path_generator");
    let problem = only_problem(&with_latency("path/reference -> controller", 0.002));
    assert_eq!(
        problem.key.to_string(),
        "schedule.latency.\"path/reference -> controller\""
    );
}

/// Returns the edges that no step reads, by name.
fn unread(scenario: &Scenario) -> Vec<String> {
    let schedule = scenario.schedule().unwrap();
    let unread: Vec<_> = EdgeName::all()
        .filter(|edge| schedule.has_topic(edge.topic) && !schedule.reads(edge.service, edge.input))
        .collect();
    for edge in &unread {
        assert_eq!(
            schedule.edge(edge.service, edge.input).due_sample(1000),
            None,
            "{edge}"
        );
    }
    unread.iter().map(ToString::to_string).collect()
}

#[test]
fn samples_that_no_step_reads_are_not_delivered() {
    let ideal = [
        "rc/frame -> estimator",
        "rc/frame -> path_generator",
        "vehicle/state -> rc_output",
    ];
    assert_eq!(unread(&fig1()), ideal);
    // A filter looks at the frames.
    assert_eq!(unread(&rig()), ideal[1..]);
}

#[test]
fn a_program_of_ones_own_and_a_fault_are_given_all_that_there_is() {
    let mut scenario = fig1();
    scenario.programs = Some(Programs {
        estimator: Some(vec!["estimator".to_owned()]),
        ..Programs::default()
    });
    assert_eq!(
        unread(&scenario),
        ["rc/frame -> path_generator", "vehicle/state -> rc_output"]
    );
    let mut scenario = fig1();
    scenario.fault.push(Fault {
        edge: Some("vehicle/state -> rc_output".to_owned()),
        ..Fault::new(FaultKind::Stuck, 1.0)
    });
    assert_eq!(
        unread(&scenario),
        ["rc/frame -> estimator", "rc/frame -> path_generator"]
    );
}

#[test]
fn all_problems_are_reported_at_once() {
    let mut scenario = with_period("nobody", 0.002);
    scenario
        .schedule
        .latency
        .insert("rc/frame -> plant".to_owned(), 0.0015);
    scenario.vehicle.change[0].at = 30.0005;
    let keys: Vec<String> = scenario
        .problems()
        .iter()
        .map(|problem| problem.key.to_string())
        .collect();
    assert_eq!(
        keys,
        [
            "vehicle.change.0.at",
            "schedule.period.nobody",
            "schedule.latency.\"rc/frame -> plant\""
        ]
    );
}

proptest! {
    /// The decimals of a time are what counts, however many seconds stand before the point.
    #[test]
    fn decimals_that_are_whole_ticks_are_read_exactly(ticks in 1..LONGEST_FLIGHT) {
        let mut scenario = fig1();
        scenario.vehicle.change.clear();
        scenario.duration = format!("{}.{:03}", ticks / 1000, ticks % 1000).parse().unwrap();
        prop_assert_eq!(scenario.tick_of(scenario.duration), ticks);
        prop_assert_eq!(scenario.schedule().map(|schedule| schedule.last_tick()), Ok(ticks));
    }

    /// A microsecond too much is never rounded away.
    #[test]
    fn decimals_between_ticks_are_refused(ticks in 0..LONGEST_FLIGHT, microseconds in 1..1000u64) {
        let mut scenario = fig1();
        scenario.vehicle.change.clear();
        scenario.duration = format!("{}.{:03}{microseconds:03}", ticks / 1000, ticks % 1000).parse().unwrap();
        prop_assert!(scenario.schedule().is_err());
        prop_assert_eq!(scenario.tick_of(scenario.duration), u64::MAX);
    }
}
