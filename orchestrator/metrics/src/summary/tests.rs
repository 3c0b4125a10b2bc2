//! Summaries of flights whose errors are known.

use proptest::prelude::*;
use scenario::Scenario;
use shared_types::FlightPhase;
use zerocopy::{FromBytes, FromZeros, IntoBytes};

use super::*;
use crate::SETTLED;
use run_log::test_flight::{away, sample, scenario};

/// 20 s at 10 ms, the mass changing at 10 s.
fn flight() -> (Scenario, Schedule) {
    let scenario = scenario(0.01, 20.0);
    let schedule = scenario.schedule().unwrap();
    (scenario, schedule)
}

pub(super) fn facts() -> RunFacts {
    RunFacts {
        scenario: "test".to_owned(),
        host: "inprocess".to_owned(),
        outcome: Outcome::Completed,
        reason: String::new(),
        is_over: true,
        not_finite_at: None,
        in_log: None,
        wall_seconds: 0.5,
        restarts: Vec::new(),
        timing: None,
        laboratory: None,
    }
}

/// The summary of a flight that is so far (m) from its path over time (s), up to a tick.
fn summary_of(distance: impl Fn(f64) -> f64, last_tick: u64) -> Summary {
    let (scenario, schedule) = flight();
    let mut summary = FlightSummary::new(&scenario, &schedule);
    for tick in 0..=last_tick {
        let distance = distance(seconds(schedule.time_ns(tick)));
        for (topic, bytes) in away(&schedule, tick, distance) {
            summary.observe(topic, &bytes);
        }
    }
    summary.finish(facts())
}

fn assert_close(value: f64, expected: f64) {
    assert!((value - expected).abs() < 1e-12, "{value} is not {expected}");
}

#[test]
fn phases_meet_at_the_change_of_the_vehicle() {
    let summary = summary_of(|_| 0.0, 2000);
    let spans: Vec<_> = summary
        .phases
        .iter()
        .map(|phase| (phase.begins, phase.ends, phase.is_complete))
        .collect();
    assert_eq!(spans, [(0.0, 10.0, true), (10.0, 20.0, true)]);
}

#[test]
fn the_ultimate_error_is_the_largest_of_the_last_five_seconds_of_a_phase() {
    // One spike just outside of each window, one just inside.
    let spikes = [
        (4.99, 0.9),
        (5.0, 0.3),
        (10.0, 0.8),
        (15.0, 0.7),
        (15.02, 0.2),
        (20.0, 0.25),
    ];
    let distance = |time: f64| {
        spikes
            .iter()
            .find(|(at, _)| (time - at).abs() < 1e-9)
            .map_or(0.01, |spike| spike.1)
    };
    let phases = summary_of(distance, 2000).phases;
    assert_close(phases[0].ultimate.unwrap(), 0.3);
    assert_close(phases[0].metrics.unwrap().max, 0.9);
    // The last phase ends after its last tick, at 20.01 s.
    assert_close(phases[1].ultimate.unwrap(), 0.25);
    assert_close(phases[1].metrics.unwrap().max, 0.8);
}

#[test]
fn the_end_of_a_phase_is_compared_with_the_bound_of_the_theorem() {
    let bound = flight().0.theorem_bound().unwrap();
    assert_close(bound, libm::atanh(0.1 / 6.0));
    for (factor, verdict) in [
        (0.999, AgainstBound::Within),
        (1.001, AgainstBound::Near),
        (1.099, AgainstBound::Near),
        (1.101, AgainstBound::Exceeded),
    ] {
        let phases = summary_of(|_| factor * bound, 2000).phases;
        assert_eq!(phases[1].against_bound, Some(verdict), "{factor}");
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(32))]

    #[test]
    fn settling_is_when_the_error_falls_below_two_centimetres_for_good(
        decay in 0.5..4.0f64, peak in 0.1..2.0f64, relapse in 0.0..5.0f64,
    ) {
        let relapse = (relapse * 100.0).round() / 100.0;
        let distance = |time: f64| {
            let since = if time < 10.0 { time } else { time - 10.0 };
            if (since - relapse).abs() < 1e-6 { 0.5 } else { peak * libm::exp(-decay * since) }
        };
        let expected = (libm::log(peak / SETTLED) / decay).max(relapse);
        for phase in summary_of(distance, 2000).phases {
            let settling_time = phase.metrics.unwrap().settling_time;
            match settling_time {
                Some(time) => prop_assert!(time >= expected && time <= expected + 0.01 + 1e-9, "{time} {expected}"),
                None => prop_assert!(expected > 9.98, "{expected}"),
            }
        }
    }
}

#[test]
fn a_phase_that_was_not_flown_to_its_end_has_no_ultimate_error() {
    let summary = summary_of(|_| 0.001, 1499);
    assert_eq!(summary.simulated_seconds, 14.99);
    let last = &summary.phases[1];
    assert!(!last.is_complete);
    assert_eq!((last.ultimate, last.against_bound), (None, None));
    assert_eq!(last.ends, 14.99);
    assert!(summary.to_string().contains("not flown to end"));
    assert_eq!(summary_of(|_| 0.0, 999).phases.len(), 1);
}

#[test]
fn an_unsettled_phase_says_so() {
    let summary = summary_of(|time| if time > 19.99 { 0.021 } else { 0.001 }, 2000);
    assert_eq!(summary.phases[0].metrics.unwrap().settling_time, Some(0.0));
    assert_eq!(summary.phases[1].metrics.unwrap().settling_time, None);
}

#[test]
fn parameters_and_estimates_are_those_of_the_end_of_each_phase() {
    let (scenario, schedule) = flight();
    let mut summary = FlightSummary::new(&scenario, &schedule);
    for tick in 0..=2000_u64 {
        let time = seconds(schedule.time_ns(tick));
        let mut truth = VehicleTruth::new_zeroed();
        truth.header = schedule.header(Topic::VehicleTruth, tick);
        truth.mass = if time < 10.0 { 0.2 } else { 0.3 };
        truth.disturbance_world = [time, 0.0, 0.0];
        summary.observe(Topic::VehicleTruth, truth.as_bytes());
        let mut reference = PathReference::new_zeroed();
        reference.header = schedule.header(Topic::PathReference, tick);
        reference.gamma = 2.0 * time;
        summary.observe(Topic::PathReference, reference.as_bytes());
        let mut adaptation = ControlAdaptation::new_zeroed();
        adaptation.header = schedule.header(Topic::ControlAdaptation, tick);
        adaptation.mass_estimate = time;
        adaptation.disturbance_projected_world = [0.0, time, 0.0];
        summary.observe(Topic::ControlAdaptation, adaptation.as_bytes());
    }
    let phases = summary.finish(facts()).phases;
    for (phase, mass, end) in [(&phases[0], 0.2, 9.99), (&phases[1], 0.3, 20.0)] {
        let expected = Parameters {
            mass: Some(mass),
            mass_estimate: Some(end),
            disturbance: Some([end, 0.0, 0.0]),
            disturbance_estimate: Some([0.0, end, 0.0]),
        };
        assert_eq!(phase.parameters, expected);
        assert_eq!(phase.gamma, Some(2.0 * end));
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(32))]

    #[test]
    fn every_sample_that_the_schedule_had_due_is_either_recorded_or_lost(
        missing in proptest::collection::btree_set((0..60u64, 0..Topic::ALL.len()), 0..40),
        slow_period in 1..7u64,
    ) {
        let mut scenario = scenario(0.01, 20.0);
        scenario.schedule.period.insert("mocap/pose".to_owned(), seconds(slow_period * 10_000_000));
        let schedule = scenario.schedule().unwrap();
        let mut summary = FlightSummary::new(&scenario, &schedule);
        let mut expected = [(0, 0); Topic::ALL.len()];
        for tick in 0..60 {
            for topic in Topic::ALL {
                let is_due = schedule.topic_rate(topic).occurs_at(tick);
                // The orchestrator's own events have no schedule; the truth tells the last tick.
                let can_be_missing = topic.publisher().is_some() && topic != Topic::VehicleTruth;
                if is_due && can_be_missing && missing.contains(&(tick, topic.index())) {
                    expected[topic.index()].1 += 1;
                } else if is_due {
                    expected[topic.index()].0 += 1;
                    summary.observe(topic, &sample(topic, schedule.header(topic, tick)));
                }
            }
        }
        for (count, expected) in summary.finish(facts()).topics.iter().zip(expected) {
            prop_assert_eq!((count.recorded, count.not_recorded), expected, "{}", count.topic);
        }
    }
}

#[test]
fn the_summary_says_for_programs_and_for_people_what_is_lost() {
    let summary = summary_of(|_| 0.0123, 2000);
    let json: serde_json::Value = serde_json::to_value(&summary).unwrap();
    assert_eq!(json["scenario"], "test");
    assert_eq!(json["outcome"], "completed");
    assert_eq!(json["seed"], 1);
    assert_eq!(json["simulated_seconds"], 20.0);
    assert_eq!(json["real_time_factor"], 40.0);
    assert_eq!(json["phases"][1]["against_bound"], "within");
    let missing = json["topics"]
        .as_array()
        .unwrap()
        .iter()
        .find(|topic| topic["topic"] == "rc/frame");
    assert_eq!(missing.unwrap()["not_recorded"], 2001);
    assert_eq!(json["lost"], serde_json::Value::Null);
    let text = summary.to_string();
    for part in [
        "1.230 cm",
        "within the bound",
        "2001 of rc/frame",
        "40 times real time",
    ] {
        assert!(text.contains(part), "{part} is not in\n{text}");
    }
}

#[test]
fn the_phases_of_a_flight_from_the_ground_are_told_with_their_begins() {
    let (mut scenario, schedule) = flight();
    let phases = [(0, 0), (100, 1), (200, 2), (700, 3), (1500, 4), (1900, 0)];
    let summary_of = |scenario: &Scenario| {
        let mut summary = FlightSummary::new(scenario, &schedule);
        for tick in 0..=2000 {
            let mut reference = PathReference::new_zeroed();
            reference.header = schedule.header(Topic::PathReference, tick);
            let phase = phases.iter().rfind(|(from, _)| *from <= tick);
            reference.phase = phase.map_or(0, |(_, phase)| *phase);
            summary.observe(Topic::PathReference, reference.as_bytes());
        }
        summary.finish(facts())
    };
    assert_eq!(summary_of(&scenario).flight, []);
    scenario.flight = Some(scenario::Flight::default());
    let summary = summary_of(&scenario);
    let told: Vec<_> = summary
        .flight
        .iter()
        .map(|begin| (begin.phase, begin.begins))
        .collect();
    let names = ["disarmed", "armed", "take-off", "fly", "land", "disarmed"];
    let begins = phases.map(|(tick, _)| seconds(schedule.time_ns(tick)));
    assert_eq!(told, names.into_iter().zip(begins).collect::<Vec<_>>());
    let shown = summary.to_string();
    assert!(
        shown.contains("flight: disarmed at 0 s, armed at 1 s, take-off at 2 s"),
        "{shown}"
    );
}

#[test]
fn a_flight_that_never_left_the_ground_says_so_in_its_headline() {
    let (mut scenario, schedule) = flight();
    scenario.flight = Some(scenario::Flight::default());
    let mut summary = FlightSummary::new(&scenario, &schedule);
    for tick in 0..=2000 {
        let mut reference = PathReference::new_zeroed();
        reference.header = schedule.header(Topic::PathReference, tick);
        let (phase, cause) = match tick {
            ..100 => (FlightPhase::Disarmed, PathReference::CAUSE_NONE),
            100..200 => (FlightPhase::Armed, PathReference::CAUSE_NONE),
            200..1100 => (FlightPhase::TakeOff, PathReference::CAUSE_NONE),
            _ => (FlightPhase::Disarmed, PathReference::CAUSE_OVERDUE),
        };
        (reference.phase, reference.cause) = (phase.code(), cause);
        summary.observe(Topic::PathReference, reference.as_bytes());
    }
    let completed = summary.clone().finish(facts());
    let shown = completed.to_string();
    let (_, verdict) = shown.split_once('\n').unwrap();
    assert!(
        verdict.starts_with("the vehicle did not take off: the take-off took too long: do the motors turn,"),
        "{shown}"
    );
    assert_eq!(shown.matches("did not take off").count(), 1, "{shown}");
    assert!(completed.failed_take_off.is_some());
    let interrupted = summary.finish(RunFacts {
        outcome: Outcome::Interrupted,
        reason: "Ctrl-C".to_owned(),
        ..facts()
    });
    let shown = interrupted.to_string();
    assert!(
        shown.contains("interrupted: Ctrl-C\nthe vehicle did not take off: the take-off took"),
        "{shown}"
    );
}

/// The summary of a flight of 20 s that is killed on the ground at 15 s, after its last phase began with this cause.
fn killed_after(cause: u8, limit: u8) -> Summary {
    let (scenario, schedule) = flight();
    let mut summary = FlightSummary::new(&scenario, &schedule);
    for tick in 0..=2000 {
        let mut reference = PathReference::new_zeroed();
        reference.header = schedule.header(Topic::PathReference, tick);
        reference.cause = cause;
        summary.observe(Topic::PathReference, reference.as_bytes());
        let mut frame = RcFrame::new_zeroed();
        frame.header = schedule.header(Topic::RcFrame, tick);
        if tick >= 1500 {
            (frame.failsafe, frame.action, frame.limit) = (true.into(), RcFrame::ACTION_KILL, limit);
        }
        summary.observe(Topic::RcFrame, frame.as_bytes());
    }
    summary.finish(facts())
}

#[test]
fn a_flight_that_was_killed_before_it_had_landed_is_not_completed() {
    let by_operator = killed_after(PathReference::CAUSE_NONE, RcFrame::LIMIT_NONE);
    assert_eq!(
        (by_operator.run.outcome, &by_operator.lost),
        (Outcome::Killed, &None)
    );
    assert_eq!(by_operator.run.reason, "killed at 15 s: the operator killed");
    let text = by_operator.to_string();
    let first = "\nthe flight was killed\nKILLED at 15 s: the operator killed\n";
    assert!(text.contains(first), "{text}");

    let by_envelope = killed_after(PathReference::CAUSE_NONE, RcFrame::LIMIT_TILT);
    assert_eq!(
        by_envelope.run.reason,
        "killed at 15 s: `envelope.tilt` was exceeded"
    );

    let landed = killed_after(PathReference::CAUSE_TOUCHED_DOWN, RcFrame::LIMIT_NONE);
    assert_eq!(landed.run.outcome, Outcome::Completed);
    assert!(
        landed
            .to_string()
            .contains("\nKILLED at 15 s, after the landing: the operator killed\n")
    );

    let json = serde_json::to_value(&landed).unwrap();
    assert_eq!(json["killed"]["after_landing"], true);
    let flown = summary_of(|_| 0.01, 2000);
    assert!(serde_json::to_value(&flown).unwrap().get("killed").is_none());
}

/// A flight in real time with such steps left out and inputs late, of which the recorder has missed frames.
fn late_timing(missed_steps: u64, late_inputs: u64) -> TimingReport {
    let mut wake = timing::histogram();
    wake.saturating_record(48_300_000);
    TimingReport {
        services: vec![timing::ServiceTiming {
            service: "controller",
            steps: 100,
            missed_steps,
            late_inputs,
            stale_inputs: 0,
            records_overwritten: 0,
            wake: timing::Distribution::of(&wake),
            step: None,
        }],
        capture_to_frame: None,
        unrecorded: vec![timing::Unrecorded {
            topic: "rc/frame",
            samples: 5,
        }],
    }
}

fn lost_flight(run: RunFacts) -> Summary {
    lost_flight_to(2000, run)
}

/// One that ends after this tick.
fn lost_flight_to(last: u64, run: RunFacts) -> Summary {
    let (scenario, schedule) = flight();
    let mut summary = FlightSummary::new(&scenario, &schedule);
    for tick in 0..=last {
        let distance = if tick < 1200 { 0.01 } else { 168.0 };
        for (topic, bytes) in away(&schedule, tick, distance) {
            summary.observe(topic, &bytes);
        }
    }
    summary.finish(run)
}

#[test]
fn a_vehicle_that_diverges_is_lost_whatever_its_controller_says() {
    let summary = lost_flight(facts());
    let json = serde_json::to_value(&summary).unwrap();
    assert_eq!(json["lost"]["reason"], "left_path");
    assert_eq!(json["lost"]["time"], 12.0);
    assert_eq!(json["lost"]["limit"], 5.0);
    let text = summary.to_string();
    assert!(
        text.contains("LOST at 12 s: 168.00 m from the path, more than 5.00 m"),
        "{text}"
    );
    assert!(!text.contains("machine"), "{text}");
    for (last, words, is_flown_on) in [
        (1200, "\nended when the vehicle was lost\n", false),
        (1300, "\nended 1.0 s after the vehicle was lost\n", true),
    ] {
        let text = lost_flight_to(last, facts()).to_string();
        assert!(text.contains(words), "{text}");
        let after = "The numbers include what was flown after the loss.";
        assert_eq!(text.contains(after), is_flown_on, "{text}");
    }
}

#[test]
fn a_flight_whose_services_died_does_not_blame_the_machine_alone() {
    let restart = Restart {
        service: ServiceId::Controller,
        name: "controller",
        pid: 7,
        tick: Some(900),
        lost_seconds: 0.1,
    };
    let run = RunFacts {
        timing: Some(late_timing(45, 0)),
        restarts: vec![restart],
        ..facts()
    };
    let told = lost_flight(run).to_string();
    let words = "The machine, or the death of services (1 restarted), was late: 45 steps were left out";
    let joined = told.split_whitespace().collect::<Vec<_>>().join(" ");
    assert!(joined.starts_with(words), "{told}");
}

#[test]
fn a_flight_that_is_lost_while_the_machine_is_late_says_so_first() {
    for (missed, late, words) in [
        (
            131,
            7,
            "The machine was late: 131 steps were left out and 7 inputs came late",
        ),
        (
            131,
            0,
            "The machine was late: 131 steps were left out, the worst step began 48",
        ),
        (0, 7, "The machine was late: 7 inputs came late"),
    ] {
        let text = lost_flight(RunFacts {
            timing: Some(late_timing(missed, late)),
            ..facts()
        })
        .to_string();
        let first_lines: Vec<_> = text.lines().take(3).collect();
        assert!(first_lines.join(" ").starts_with(words), "{text}");
    }
    let punctual = RunFacts {
        timing: Some(late_timing(0, 0)),
        ..facts()
    };
    assert!(lost_flight(punctual).to_string().starts_with("test, seed 1"));
    let not_finite = RunFacts {
        outcome: Outcome::Failed,
        not_finite_at: Some(3),
        timing: Some(late_timing(4, 0)),
        ..facts()
    };
    let (scenario, schedule) = flight();
    let summary = FlightSummary::new(&scenario, &schedule).finish(not_finite);
    assert!(summary.to_string().starts_with("The machine was late: 4 steps"));
    let reason = &summary.run.reason;
    assert!(
        reason.contains("; the machine was late: 4 steps were left out"),
        "{reason}"
    );
    assert_eq!(summary.lost.unwrap().time, 0.03);
}

#[test]
fn what_nobody_published_is_told_from_what_was_not_recorded() {
    let (scenario, schedule) = flight();
    let mut summary = FlightSummary::new(&scenario, &schedule);
    for tick in (0..=2000).filter(|tick| !(100..120).contains(tick)) {
        summary.observe(
            Topic::RcFrame,
            &sample(Topic::RcFrame, schedule.header(Topic::RcFrame, tick)),
        );
    }
    let run = RunFacts {
        timing: Some(late_timing(15, 0)),
        ..facts()
    };
    let summary = summary.finish(run);
    let frames = summary
        .topics
        .iter()
        .find(|count| count.topic == "rc/frame")
        .unwrap();
    assert_eq!(
        (frames.recorded, frames.not_flown, frames.not_recorded),
        (1981, 15, 5)
    );
    let text = summary.to_string().replace('\n', " ");
    assert!(
        text.contains("published and not recorded: 5 of rc/frame"),
        "{text}"
    );
    assert!(text.contains("15 of rc/frame"), "{text}");
}

/// Nothing was left out: it came before the first sample that the new orchestrator received.
#[test]
fn what_came_before_the_first_sample_after_a_take_over_is_not_missing() {
    let (scenario, schedule) = flight();
    let mut summary = FlightSummary::new(&scenario, &schedule);
    summary.begin_at(100);
    for tick in (110..=2000).filter(|tick| !(300..305).contains(tick)) {
        summary.observe(
            Topic::RcFrame,
            &sample(Topic::RcFrame, schedule.header(Topic::RcFrame, tick)),
        );
    }
    let summary = summary.finish(RunFacts {
        timing: Some(late_timing(5, 0)),
        ..facts()
    });
    let missing = |topic: &str| {
        let count = summary.topics.iter().find(|count| count.topic == topic).unwrap();
        count.not_flown + count.not_recorded
    };
    assert_eq!((missing("rc/frame"), missing("vehicle/truth")), (5, 1901));
}

#[test]
fn a_log_that_could_not_be_written_has_what_is_in_it() {
    let text = lost_flight(RunFacts {
        in_log: Some(1234),
        ..facts()
    })
    .to_string()
    .replace('\n', " ");
    assert!(text.contains("of which 1234 are in the log"), "{text}");
    assert!(!text.contains("none lost"), "{text}");
}

#[test]
fn the_theorem_is_not_asked_about_the_law_of_a_program() {
    let (mut scenario, schedule) = flight();
    scenario.programs = Some(scenario::Programs {
        controller: Some(vec!["mine".to_owned()]),
        ..Default::default()
    });
    let mut summary = FlightSummary::new(&scenario, &schedule);
    for tick in 0..=2000 {
        for (topic, bytes) in away(&schedule, tick, 0.01) {
            summary.observe(topic, &bytes);
        }
    }
    let summary = summary.finish(facts());
    assert_eq!(summary.ultimate_bound, None);
    assert!(summary.phases.iter().all(|phase| phase.against_bound.is_none()));
    assert_close(summary.phases[1].ultimate.unwrap(), 0.01);
    assert!(!summary.to_string().contains("theorem"));
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    #[test]
    fn no_line_of_the_summary_is_wider_than_80_columns(
        scale in 1e-4..1e5f64, name in "[a-z_]{1,90}", reason in "[a-z ]{0,200}", missed in 0u64..1_000_000_000,
        changes in 0usize..6,
    ) {
        let (mut scenario, _) = flight();
        scenario.vehicle.change = (1..=changes)
            .map(|place| scenario::VehicleChange {
                at: 3.0 * place as f64,
                mass: Some(0.2),
                inertia: None,
                disturbance: None,
                center_of_mass: None,
            })
            .collect();
        scenario.flight = Some(scenario::Flight::default());
        let mut off = scenario::Fault::new(scenario::FaultKind::Off, 5.0);
        off.service = Some("path_generator".to_owned());
        off.lasts = Some(0.1);
        scenario.fault.push(off);
        let schedule = scenario.schedule().unwrap();
        let mut summary = FlightSummary::new(&scenario, &schedule);
        for tick in 0..=2000 {
            for (topic, bytes) in away(&schedule, tick, scale * (tick % 7) as f64) {
                summary.observe(topic, &bytes);
            }
        }
        let summary = summary.finish(RunFacts {
            scenario: name.clone(),
            reason,
            outcome: Outcome::Interrupted,
            timing: Some(late_timing(missed, missed)),
            ..facts()
        });
        let text = summary.to_string();
        for line in text.lines().filter(|line| !line.contains(&name)) {
            prop_assert!(line.chars().count() <= 80, "{}\n{}", line, text);
        }
    }
}

#[test]
fn what_the_estimates_learn_on_the_ground_is_not_said_of_the_flight() {
    let (mut scenario, schedule) = flight();
    scenario.flight = Some(scenario::Flight::default());
    let mut summary = FlightSummary::new(&scenario, &schedule);
    for tick in 0..=2000 {
        let flies = tick < 1500;
        let [(truth_topic, truth), (_, reference)] = away(&schedule, tick, 0.01);
        let mut reference = PathReference::read_from_bytes(&reference).unwrap();
        let phase = match tick {
            ..1400 => FlightPhase::Fly,
            1400..1500 => FlightPhase::Land,
            _ => FlightPhase::Disarmed,
        };
        reference.phase = phase.code();
        let mut adaptation = ControlAdaptation::new_zeroed();
        adaptation.header = schedule.header(Topic::ControlAdaptation, tick);
        adaptation.mass_estimate = if flies { 0.25 } else { 1e-3 };
        summary.observe(truth_topic, &truth);
        summary.observe(Topic::PathReference, reference.as_bytes());
        summary.observe(Topic::ControlAdaptation, adaptation.as_bytes());
    }
    let summary = summary.finish(facts());
    assert_eq!(
        summary.phases.last().unwrap().parameters.mass_estimate,
        Some(0.25)
    );
    assert_eq!(summary.at_bound, []);
}
