//! Flies a cell of the matrix and looks on: in this process, or as processes that really die.

use std::convert::Infallible;
use std::ops::ControlFlow;

use runtime::in_process::TickSink;
use shared_types::samples::VehicleTruth;
use shared_types::scenario::Scenario;
use shared_types::service::header_of;
use shared_types::{Schedule, Topic};

use super::plan::Cell;
use crate::flight::crew::Crew;
use crate::flight::lock_step::{CrewObserver, Deployment};
use crate::flight::{Ending, FlightFailure, Outcome, in_process, lock_step};
use crate::interrupt::Interrupt;
use crate::log::LogDigest;
use crate::summary::faults::{FaultReport, FaultWatch};
use crate::summary::read;

/// What a flight came to.
#[derive(Clone, Debug, PartialEq)]
pub struct Flown {
    /// What the fault did; nothing if it was not reached.
    pub report: Option<FaultReport>,
    /// Whether the vehicle's thrust pointed below the horizon after the fault had begun.
    pub has_tipped: bool,
    /// Why the flight ended early, if a number that is not finite ended it.
    pub not_finite: Option<String>,
    /// Digest of all samples, if it was asked for.
    pub digest: Option<String>,
}

/// How a cell is flown.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Way {
    /// In this process.
    InProcess {
        /// Whether to take the digest of all samples, which takes its time.
        with_digest: bool,
    },
    /// As one process a service, with the digest.
    Processes,
}

/// Flies a cell.
///
/// # Errors
/// Why it could not be flown. What a fault does to the vehicle is no error, but an interrupt is one.
pub fn fly(cell: &Cell, way: Way, interrupt: &Interrupt) -> Result<Flown, String> {
    let scenario = &cell.scenario;
    let schedule = scenario.schedule().map_err(|problems| format!("{problems:?}"))?;
    let with_digest = matches!(way, Way::Processes | Way::InProcess { with_digest: true });
    let mut onlooker = Onlooker {
        watch: FaultWatch::new(vec![cell.watched.clone()], &schedule),
        from: cell.watched.from,
        has_tipped: false,
        digest: with_digest.then(LogDigest::default),
    };
    let ending = match way {
        Way::InProcess { .. } => in_process::fly(scenario, &mut onlooker, interrupt),
        Way::Processes => as_processes(scenario, &mut onlooker, interrupt),
    };
    let not_finite = match ending.map_err(|failure| failure.to_string())?.outcome {
        Outcome::Completed => None,
        Outcome::Failed(FlightFailure::NonFinite(found)) => Some(found.to_string()),
        Outcome::Failed(failure) => return Err(failure.to_string()),
        Outcome::Interrupted { signal } => return Err(format!("ended by signal {signal}")),
    };
    Ok(onlooker.finish(&schedule, not_finite))
}

fn as_processes(
    scenario: &Scenario,
    onlooker: &mut Onlooker,
    interrupt: &Interrupt,
) -> Result<Ending, FlightFailure> {
    let deployment = Deployment::default();
    lock_step::fly(scenario, &deployment, onlooker, interrupt, &mut Unrecorded)
}

/// Looks at the samples of a flight; none is kept.
struct Onlooker {
    watch: FaultWatch,
    /// First tick of the fault.
    from: u64,
    has_tipped: bool,
    digest: Option<LogDigest>,
}

impl Onlooker {
    fn finish(self, schedule: &Schedule, not_finite: Option<String>) -> Flown {
        Flown {
            report: self.watch.finish(schedule).pop(),
            has_tipped: self.has_tipped,
            not_finite,
            digest: self.digest.map(LogDigest::finish),
        }
    }
}

impl TickSink for Onlooker {
    type Error = Infallible;

    #[inline]
    fn sample(&mut self, topic: Topic, bytes: &[u8]) -> Result<(), Infallible> {
        self.watch.observe(topic, bytes);
        if topic == Topic::VehicleTruth && header_of(bytes).tick >= self.from {
            // The last of R: cosine of the angle between the body's axis and the vertical.
            self.has_tipped |= read::<VehicleTruth>(bytes).world_from_body[8] < 0.0;
        }
        if let Some(digest) = &mut self.digest {
            digest.update(topic, bytes);
        }
        Ok(())
    }

    #[inline]
    fn end_tick(&mut self, _tick: u64) -> Result<ControlFlow<()>, Infallible> {
        Ok(ControlFlow::Continue(()))
    }
}

/// Keeps no record of the machine.
struct Unrecorded;

impl CrewObserver for Unrecorded {
    fn ready(&mut self, _crew: &Crew<'_>, _core: Option<usize>) {}
    fn changed(&mut self, _crew: &Crew<'_>) {}
    fn health(&mut self, _crew: &Crew<'_>) {}
    fn ended(&mut self, _crew: &Crew<'_>, _outcome: &Outcome) {}
}
