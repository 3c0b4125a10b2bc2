//! What a policy for old and impossible samples is worth in flight, and what it costs while nothing fails.

mod common;

use std::convert::Infallible;
use std::ops::ControlFlow;

use orchestrator::flight::{Outcome, in_process};
use orchestrator::interrupt::Interrupt;
use orchestrator::log::LogDigest;
use orchestrator::scenario_file;
use runtime::in_process::TickSink;
use shared_types::Topic;
use shared_types::samples::{ControlAdaptation, ControlCommand, PathReference, RcFrame, VehicleTruth};
use zerocopy::FromBytes;

/// What is to be known of a flight.
#[derive(Default)]
struct Flight {
    digest: LogDigest,
    /// Time from which on distances count, s.
    counts_from: f64,
    path: [f64; 3],
    /// Largest distance from where the path is, m.
    farthest: f64,
    /// Largest speed downwards, m/s.
    fastest_fall: f64,
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
                self.path = PathReference::read_from_bytes(bytes).unwrap().position_world;
            }
            Topic::VehicleTruth => {
                let truth = VehicleTruth::read_from_bytes(bytes).unwrap();
                if truth.header.tick as f64 * 1e-3 >= self.counts_from {
                    let squares = truth.position_world.iter().zip(self.path).map(|(p, pd)| (p - pd) * (p - pd));
                    self.farthest = self.farthest.max(squares.sum::<f64>().sqrt());
                    let [vx, vy, vz] = truth.velocity_body;
                    let r = truth.world_from_body;
                    self.fastest_fall = self.fastest_fall.max(r[6] * vx + r[7] * vy + r[8] * vz);
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

    fn end_tick(&mut self, _tick: u64) -> Result<ControlFlow<()>, Infallible> {
        Ok(ControlFlow::Continue(()))
    }
}

fn fly(name: &str, settings: &[&str], counts_from: f64) -> Flight {
    let settings: Vec<_> = settings.iter().map(|&setting| setting.to_owned()).collect();
    let scenario = scenario_file::load(&common::scenario(name), &settings, None).unwrap();
    let mut flight = Flight {
        counts_from,
        ..Flight::default()
    };
    let ending = in_process::fly(&scenario, &mut flight, &Interrupt::never()).unwrap();
    assert!(matches!(ending.outcome, Outcome::Completed), "{name} {settings:?}");
    flight
}

#[test]
fn explore() {
    for service in ["estimator", "controller", "path_generator", "rc_output"] {
        for lasts in ["0.022", "0.05", "0.1", "0.2", "0.5"] {
            let fault = format!("fault=[{{at=12.0, service=\"{service}\", kind=\"off\", for={lasts}}}]");
            let mut line = format!("{service} {lasts}:");
            for more in [&["safety={}"][..], &[],
                &["safety.\"vehicle/state -> controller\".recover=0.0"],
                &["safety.\"vehicle/state -> controller\".max_age=0.15"],
                &["safety.\"vehicle/state -> controller\".max_age=0.001"],
            ] {
                let mut worst = 0.0_f64;
                let mut all = Vec::new();
                for seed in ["seed=1", "seed=2", "seed=3"] {
                    let flight = fly("fault_isolation", &[&["duration=18.0", seed, &fault], more].concat(), 12.0);
                    worst = worst.max(flight.farthest);
                    all.push(flight.farthest);
                }
                all.sort_by(f64::total_cmp);
                line += &format!("  {:.4} ({:.4})", all[1], worst);
            }
            println!("{line}");
        }
    }
}
