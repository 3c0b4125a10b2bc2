//! The worth of a policy for old and impossible samples in flight, and its cost while nothing fails.

use crate::common;

use std::convert::Infallible;

use flight::interrupt::Interrupt;
use flight::{Outcome, in_process};
use host::in_process::TickSink;
use shared_types::Topic;
use shared_types::digest::ExperimentDigest;
use shared_types::samples::{ControlAdaptation, ControlCommand, PathReference, RcFrame, VehicleTruth};
use zerocopy::FromBytes;

/// The policy for the vehicle's state, with all of it switched off but one value.
const STATE: &str = "safety.\"vehicle/state -> controller\"";

/// The facts about a flight.
#[derive(Default)]
struct Flight {
    digest: ExperimentDigest,
    /// Time from which on distances count, s.
    counts_from: f64,
    /// Place where the vehicle is.
    position: [f64; 3],
    /// Largest distance from where the path is, m.
    farthest: f64,
    /// Largest distance at the end, in the last second, m.
    lately: f64,
    ends_at: f64,
    /// Speed downwards at each tick, m/s.
    falls: Vec<(u64, f64)>,
    /// Stage of the controller at each of its steps, by time in ms.
    stages: Vec<(u64, u8)>,
    commands: Vec<(u64, ControlCommand)>,
    frames: Vec<(u64, RcFrame)>,
}

impl TickSink for Flight {
    type Error = Infallible;

    fn sample(&mut self, topic: Topic, bytes: &[u8]) -> Result<(), Infallible> {
        self.digest.update(topic, bytes);
        match topic {
            Topic::PathReference => {
                let reference = PathReference::read_from_bytes(bytes).unwrap();
                let time = reference.header.tick as f64 * 1e-3;
                let pairs = self.position.iter().zip(reference.position_world);
                let distance = pairs.map(|(p, pd)| (p - pd) * (p - pd)).sum::<f64>().sqrt();
                if time >= self.counts_from {
                    self.farthest = self.farthest.max(distance);
                }
                if time >= self.ends_at - 1.0 {
                    self.lately = self.lately.max(distance);
                }
            }
            Topic::VehicleTruth => {
                let truth = VehicleTruth::read_from_bytes(bytes).unwrap();
                self.position = truth.position_world;
                if truth.header.tick as f64 * 1e-3 >= self.counts_from {
                    let [vx, vy, vz] = truth.velocity_body;
                    let r = truth.world_from_body;
                    self.falls
                        .push((truth.header.tick, r[6] * vx + r[7] * vy + r[8] * vz));
                }
            }
            Topic::ControlAdaptation => {
                let adaptation = ControlAdaptation::read_from_bytes(bytes).unwrap();
                self.stages.push((adaptation.header.tick, adaptation.stage));
            }
            Topic::ControlCommand => {
                let command = ControlCommand::read_from_bytes(bytes).unwrap();
                self.commands.push((command.header.tick, command));
            }
            Topic::RcFrame => {
                let frame = RcFrame::read_from_bytes(bytes).unwrap();
                self.frames.push((frame.header.tick, frame));
            }
            _ => {}
        }
        Ok(())
    }
}

fn fly(name: &str, settings: &[&str], counts_from: f64) -> Flight {
    let settings: Vec<_> = settings.iter().map(|&setting| setting.to_owned()).collect();
    let scenario = scenario_file::load(&common::scenario(name), &settings, None).unwrap();
    let mut flight = Flight {
        counts_from,
        ends_at: scenario.duration,
        ..Flight::default()
    };
    let ending = in_process::fly(&scenario, &mut flight, &Interrupt::never()).unwrap();
    assert!(
        matches!(ending.outcome, Outcome::Completed),
        "{name} {settings:?}"
    );
    flight
}

fn out(service: &str, lasts: &str) -> String {
    format!("fault=[{{at=12.0, service=\"{service}\", kind=\"off\"{lasts}}}]")
}

/// The stages of a flight, each with the tick of its first step.
fn stages(flight: &Flight) -> Vec<(u64, u8)> {
    let mut stages = flight.stages.clone();
    stages.dedup_by_key(|(_, stage)| *stage);
    stages
}

#[test]
fn while_nothing_fails_a_policy_changes_no_byte() {
    let ideal = "safety={\"vehicle/state -> controller\" = {max_age=0.001, jump=0.1, level=0.1}, \
                 \"path/reference -> controller\" = {max_age=0.001}, \
                 \"vehicle/state -> path_generator\" = {max_age=0.001, jump=0.1}, \
                 \"control/command -> rc_output\" = {max_age=0.001, failsafe=0.1}, \
                 \"mocap/pose -> estimator\" = {max_age=0.001}}";
    for (name, with) in [("fault_isolation", "seed=1"), ("fig1", ideal)] {
        let [with, without] = [with, "safety={}"].map(|setting| {
            fly(name, &["duration=5.0", "vehicle.change=[]", setting], 0.0)
                .digest
                .finish()
        });
        assert_eq!(with, without, "{name}");
    }
}

/// Without a policy the law goes on with the last state and turns the vehicle by an error that is long gone.
#[test]
fn a_policy_makes_the_loss_of_the_estimator_on_the_eight_a_small_matter() {
    let fault = out("estimator", ", for=0.2");
    let without = fly("fault_isolation", &["duration=16.0", "safety={}", &fault], 12.0);
    let with = fly("fault_isolation", &["duration=16.0", &fault], 12.0);
    assert!(without.farthest > 0.18, "{} m", without.farthest);
    assert!(with.farthest < 0.02, "{} m", with.farthest);
    let longer = fly(
        "fault_isolation",
        &["duration=18.0", &out("estimator", ", for=0.5")],
        12.0,
    );
    assert!(longer.farthest < 0.1, "{} m", longer.farthest);
    assert!(
        longer.lately < 0.02,
        "{} m, the vehicle is back on its path",
        longer.lately
    );
}

#[test]
fn a_lost_path_generator_is_not_noticed_while_its_reference_is_carried_on() {
    let fault = out("path_generator", ", for=0.2");
    let without = fly("fault_isolation", &["duration=14.0", "safety={}", &fault], 12.0);
    let with = fly("fault_isolation", &["duration=14.0", &fault], 12.0);
    assert!(without.farthest > 0.03, "{} m", without.farthest);
    assert!(with.farthest < 0.015, "{} m", with.farthest);
}

/// Fig. 1's vehicle and the laboratory's in hover, the estimator lost.
#[test]
fn in_hover_the_vehicle_stays_at_its_place_while_its_state_is_lost() {
    let hover = "path.curve={hover={position=[0.0, 0.0, -1.2]}}";
    let ideal = format!("{STATE}={{max_age=0.02, level=0.05, descend=2.0, failsafe=5.0, jump=0.1}}");
    for (name, policy) in [("fault_isolation", "seed=1"), ("fig1", ideal.as_str())] {
        for (lasts, most) in [("0.1", 0.02), ("0.5", 0.06)] {
            let fault = out("estimator", &format!(", for={lasts}"));
            let flight = fly(
                name,
                &["duration=16.0", "vehicle.change=[]", hover, policy, &fault],
                12.0,
            );
            let undisturbed = fly(name, &["duration=16.0", "vehicle.change=[]", hover, policy], 12.0);
            let cost = flight.farthest - undisturbed.farthest;
            assert!(cost < most, "{name} {lasts} s: {cost} m");
        }
    }
}

#[test]
fn a_state_lost_for_good_leads_through_all_stages_at_their_ages_to_motors_at_rest() {
    let flight = fly("fault_isolation", &["duration=18.0", &out("estimator", "")], 12.0);
    // The last state is that of 11.99 s; the controller steps every 22 ms, and a stage begins above its age.
    let last = 545 * 22;
    let first_above = |age: u64| last + (age / 22 + 1) * 22;
    let expected = [
        (22, ControlAdaptation::STAGE_LAW),
        (first_above(200), ControlAdaptation::STAGE_HOLD),
        (first_above(300), ControlAdaptation::STAGE_LEVEL),
        (first_above(1000), ControlAdaptation::STAGE_DESCEND),
        (first_above(5000), ControlAdaptation::STAGE_FAILSAFE),
    ];
    assert_eq!(stages(&flight), expected);
    for (tick, command) in &flight.commands {
        let is_failsafe = *tick >= first_above(5000);
        assert_eq!(
            command.mode == ControlCommand::MODE_FAILSAFE,
            is_failsafe,
            "{tick}"
        );
    }
    for (tick, frame) in &flight.frames {
        assert_eq!(frame.failsafe.is_set(), *tick >= first_above(5000), "{tick}");
    }
    // It sinks and does not fall before the motors rest: 0.3 m/s² for the 4 s of the descent, beside what it had.
    let falls = flight.falls.iter().filter(|(tick, _)| *tick < first_above(5000));
    let fastest = falls.fold(0.0_f64, |most, (_, fall)| most.max(*fall));
    assert!(fastest < 0.3 + 0.3 * 4.0, "{fastest} m/s");
}

#[test]
fn without_commands_the_radio_holds_and_then_stops_the_motors_at_the_stated_ages() {
    let flight = fly(
        "fault_isolation",
        &["duration=14.0", &out("controller", "")],
        12.0,
    );
    let last = 545 * 22;
    for (tick, frame) in flight.frames.iter().filter(|(tick, _)| *tick >= last) {
        let expected = match tick - last {
            0..=44 => RcFrame::STAGE_COMMAND,
            45..=1000 => RcFrame::STAGE_HOLD,
            _ => RcFrame::STAGE_FAILSAFE,
        };
        assert_eq!(frame.stage, expected, "{tick}");
    }
}

#[test]
#[ignore = "prints the table of docs/old_samples.md, which takes minutes"]
fn what_outages_cost_with_and_without_a_policy() {
    for service in ["estimator", "controller", "path_generator", "rc_output"] {
        for lasts in ["0.02", "0.05", "0.1", "0.2", "0.5"] {
            let fault = format!("fault=[{{at=12.0, service=\"{service}\", kind=\"off\", for={lasts}}}]");
            let costs = [&["safety={}"][..], &[]].map(|more| {
                let mut distances = ["seed=1", "seed=2", "seed=3", "seed=4", "seed=5"].map(|seed| {
                    fly(
                        "fault_isolation",
                        &[&["duration=18.0", seed, &fault], more].concat(),
                        12.0,
                    )
                    .farthest
                });
                distances.sort_by(f64::total_cmp);
                format!("{:.2} ({:.2})", 100.0 * distances[2], 100.0 * distances[4])
            });
            println!(
                "{service} {lasts} s: {} cm without, {} with a policy",
                costs[0], costs[1]
            );
        }
    }
}
