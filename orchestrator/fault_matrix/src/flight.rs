//! Flies a cell of the matrix and looks on: in this process, or as processes that really die.

use std::convert::Infallible;
use std::panic::{AssertUnwindSafe, catch_unwind};

use host::in_process::TickSink;
use scenario::Scenario;
use shared_types::digest::ExperimentDigest;
use shared_types::{Schedule, Topic};

use super::plan::MatrixCell;
use super::undisturbed::{NotFlown, Undisturbed};
use command_line::progress::Messages;
use flight::in_process;
use flight::interrupt::Interrupt;
use metrics::loss::{Loss, LossWatch};
use metrics::summary::faults::{FaultReport, FaultWatch};
use metrics::tracker::{Moment, Tracker};
use supervisor::deployment::Deployment;
use supervisor::supervision::SupervisionObserver;
use supervisor::supervision::Supervisor;
use supervisor::{Ending, Outcome, RunFailure, lock_step};

/// The result of a flight.
#[derive(Clone, Debug, PartialEq)]
pub struct FlightResult {
    /// The effect of the fault; none if it was not reached.
    pub report: Option<FaultReport>,
    /// The loss of the vehicle, if it was lost.
    pub loss: Option<Loss>,
    /// `true` if the vehicle stood disarmed at its end.
    pub stands_disarmed: bool,
    /// Reason why the flight ended early, if the fault ended it.
    pub ended: Option<Ended>,
    /// Digest of all samples, if it was asked for.
    pub digest: Option<String>,
}

/// Effects of a fault on a flight beside losing the vehicle.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Ended {
    /// A service computed a number that is not finite; these are the words for it.
    NotFinite(String),
    /// A service died of what it was given, again and again as a process, once and for all in this one.
    Died,
}

/// The way to fly a cell.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Way {
    /// In this process.
    InProcess {
        /// `true` to take the digest of all samples, which takes its time.
        with_digest: bool,
    },
    /// As one process a service, with the digest.
    Processes,
}

/// Flies a cell and compares it with the undisturbed flight.
///
/// # Errors
/// [`NotFlown`]. What a fault does to the vehicle is no error, but an interrupt is one.
pub fn fly(
    cell: &MatrixCell,
    way: Way,
    undisturbed: &Undisturbed,
    interrupt: &Interrupt,
) -> Result<FlightResult, NotFlown> {
    let scenario = &cell.scenario;
    let schedule = flight::schedule_of(scenario).map_err(RunFailure::from)?;
    let with_digest = matches!(way, Way::Processes | Way::InProcess { with_digest: true });
    let tracker = Tracker::new(&schedule, scenario.flight.is_some());
    let mut observer = Observer {
        loss: LossWatch::new(scenario, tracker.source()),
        tracker,
        watch: FaultWatch::new(vec![cell.watched.clone()], &[], &schedule),
        undisturbed: undisturbed.clone(),
        digest: with_digest.then(ExperimentDigest::default),
    };
    let outcome = match way {
        Way::InProcess { .. } => in_this_process(scenario, &mut observer, interrupt),
        Way::Processes => as_processes(scenario, &mut observer, interrupt),
    };
    let ended = match outcome? {
        Some(Outcome::Completed) => None,
        Some(Outcome::Failed(failure)) if failure.not_finite_at().is_some() => {
            Some(Ended::NotFinite(failure.to_string()))
        }
        Some(Outcome::Failed(failure)) if !matches!(failure.itself(), RunFailure::Died { .. }) => {
            return Err(failure.into());
        }
        None | Some(Outcome::Failed(_)) => Some(Ended::Died),
        Some(Outcome::Interrupted { signal }) => return Err(NotFlown::Interrupted(signal)),
    };
    Ok(observer.finish(&schedule, ended))
}

/// Returns the end of the flight; nothing if a service panicked, which is how it would die as a process.
fn in_this_process(
    scenario: &Scenario,
    observer: &mut Observer,
    interrupt: &Interrupt,
) -> Result<Option<Outcome>, RunFailure> {
    // What it leaves half done is its own; the observer has had whole ticks.
    let flight = AssertUnwindSafe(|| in_process::fly(scenario, observer, interrupt));
    match catch_unwind(flight) {
        Ok(ending) => Ok(Some(Ending::from(ending?).outcome)),
        Err(_) => Ok(None),
    }
}

fn as_processes(
    scenario: &Scenario,
    observer: &mut Observer,
    interrupt: &Interrupt,
) -> Result<Option<Outcome>, RunFailure> {
    let deployment = Deployment::default();
    let quiet = Messages::default();
    let ending = lock_step::fly(
        scenario,
        &deployment,
        observer,
        interrupt,
        &quiet,
        &mut Unrecorded,
    )?;
    Ok(Some(ending.outcome))
}

/// Looks at the samples of a flight; none is kept.
struct Observer {
    tracker: Tracker,
    loss: LossWatch,
    watch: FaultWatch,
    undisturbed: Undisturbed,
    digest: Option<ExperimentDigest>,
}

impl Observer {
    fn observe(&mut self, moment: &Moment) {
        self.loss.observe(moment);
        let undisturbed = self.undisturbed.near(moment.vehicle.tick);
        self.watch.observe_moment(moment, undisturbed);
    }

    fn finish(mut self, schedule: &Schedule, ended: Option<Ended>) -> FlightResult {
        if let Some(moment) = self.tracker.last() {
            self.observe(&moment);
        }
        FlightResult {
            report: self.watch.finish(schedule, self.loss.loss()).pop(),
            loss: self.loss.loss().cloned(),
            stands_disarmed: self.loss.stands_disarmed(),
            ended,
            digest: self.digest.map(ExperimentDigest::finish),
        }
    }
}

impl TickSink for Observer {
    type Error = Infallible;

    #[inline]
    fn sample(&mut self, topic: Topic, bytes: &[u8]) -> Result<(), Infallible> {
        if let Some(moment) = self.tracker.observe(topic, bytes) {
            self.observe(&moment);
        }
        match topic {
            Topic::PathReference => metrics::view(bytes, |reference| self.loss.observe_reference(reference)),
            Topic::RcFrame => metrics::view(bytes, |frame| self.loss.observe_frame(frame)),
            _ => {}
        }
        self.watch.observe(topic, bytes);
        if let Some(digest) = &mut self.digest {
            digest.update(topic, bytes);
        }
        Ok(())
    }
}

/// Keeps no record of the machine.
struct Unrecorded;

impl SupervisionObserver for Unrecorded {
    fn ready(&mut self, _supervisor: &Supervisor<'_>, _core: Option<usize>) {}
    fn changed(&mut self, _supervisor: &Supervisor<'_>) {}
    fn progressed(&mut self, _supervisor: &Supervisor<'_>, _tick: u64) {}
    fn health(&mut self, _supervisor: &Supervisor<'_>) {}
    fn ended(&mut self, _supervisor: &Supervisor<'_>, _outcome: &Outcome) {}
}
