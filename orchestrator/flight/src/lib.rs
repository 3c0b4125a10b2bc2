//! Flights of a scenario in this process: no other process, no shared memory, no terminal.
//!
//! * [`in_process`]: flies the services of a scenario in the thread of the caller;
//! * [`recording_sink`]: the log, the summary and the progress of a flight;
//! * [`interrupt`]: the request to end a flight;
//! * [`many`]: many flights on all cores, their results in order;
//! * [`campaign`], [`journal`]: many flights whose results survive a kill;
//! * [`identity`]: the program that flies;
//! * [`failure`]: why a flight could not go on.

pub mod campaign;
pub mod failure;
pub mod identity;
pub mod in_process;
pub mod interrupt;
pub mod journal;
pub mod many;
pub mod recording_sink;

use std::fmt::{Display, Formatter};
use std::time::Duration;

use metrics::summary::{self, RunFacts};
use scenario::{Scenario, Unflyable};
use shared_types::{Schedule, ServiceId};

use failure::FlightFailure;

/// The end of a flight.
#[derive(Debug)]
pub struct Ending {
    /// Why.
    pub outcome: Outcome<FlightFailure>,
    /// Ticks that are whole in the log, from tick 0.
    pub ticks: u64,
    /// Wall time from the first tick to the last.
    pub wall_time: Duration,
    /// Warnings, once.
    pub warnings: Vec<String>,
}

/// Reason why a flight ended.
#[derive(Debug)]
pub enum Outcome<F> {
    /// The last tick was flown.
    Completed,
    /// The user asked for the end, by this signal.
    Interrupted {
        /// Number of the signal.
        signal: i32,
    },
    /// It could not go on.
    Failed(F),
}

impl<F: Display> Outcome<F> {
    /// Returns the facts of a run with this outcome. Every command and the Python package classify a flight by them.
    #[must_use]
    pub fn facts(&self, not_finite_at: fn(&F) -> Option<u64>) -> RunFacts {
        let mut facts = RunFacts::default();
        match self {
            Self::Completed => facts.is_over = true,
            Self::Interrupted { signal } => {
                (facts.outcome, facts.reason) = (summary::Outcome::Interrupted, format!("signal {signal}"));
            }
            Self::Failed(failure) => {
                (facts.outcome, facts.reason) = (summary::Outcome::Failed, failure.to_string());
                facts.not_finite_at = not_finite_at(failure);
            }
        }
        facts
    }
}

impl<F: Display> Display for Outcome<F> {
    fn fmt(&self, formatter: &mut Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Completed => formatter.write_str("completed"),
            Self::Interrupted { signal } => write!(formatter, "interrupted by signal {signal}"),
            Self::Failed(failure) => failure.fmt(formatter),
        }
    }
}

/// Returns the steps of all services in a flight of `scenario`.
///
/// # Errors
/// [`Unflyable`]; never for a checked scenario.
pub fn schedule_of(scenario: &Scenario) -> Result<Schedule, Unflyable> {
    scenario.schedule().map_err(Unflyable)
}

/// Returns why a scenario cannot be flown in simulated time, if what measures the vehicle is real: never silently with others.
#[must_use]
pub fn unsimulated_poses(scenario: &Scenario) -> Option<String> {
    if scenario.recorded_captures().is_some() {
        return Some(
            "recorded captures come in real time only; fly with --host realtime, or with --set \
             motion_capture.source=simulated; in simulated time `gerono replay` does a recorded flight's steps again"
                .to_owned(),
        );
    }
    if scenario.real_receivers().is_some() {
        let cameras = scenario.capture_system();
        let and = cameras.map_or("", |_| " --set motion_capture.source=simulated");
        return Some(format!(
            "receivers measure a real vehicle, in real time only; fly with --host realtime, or with --set receivers.sources=[]{and}, or \
             look at what comes with `gerono gnss probe`"
        ));
    }
    let name = scenario.capture_system()?.0.name();
    Some(format!(
        "poses are to come from `{name}`, which sends them in real time only; fly with --host realtime, or with --set \
         motion_capture.source=simulated, or look at what comes with `gerono mocap probe`"
    ))
}

/// Returns why a scenario with external services cannot be flown in one process.
#[must_use]
pub fn programs_of_its_own(scenario: &Scenario) -> Option<String> {
    let is_external = scenario.external_services();
    let external = ServiceId::ALL
        .into_iter()
        .find(|service| is_external[service.index()])?;
    Some(format!(
        "a program of its own is to fly in place of `{external}` (`programs.{external}`), and here all fly in one process; fly \
         with --host lockstep or --host realtime, or with --set 'programs={{}}'"
    ))
}
