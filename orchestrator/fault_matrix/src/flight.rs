//! Flies a cell of the matrix, in this process or as separate processes that really die.

use std::convert::Infallible;
use std::ops::ControlFlow;
use std::panic::{AssertUnwindSafe, catch_unwind};

use host::in_process::TickSink;
use scenario::Scenario;
use serde::{Deserialize, Serialize};
use shared_types::digest::ExperimentDigest;
use shared_types::{Schedule, Topic};

use super::injection_times::on_tick;
use super::plan::MatrixCell;
use super::report::CellReport;
use super::survival::judge;
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

/// Result of a cell's flight.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct FlightResult {
    /// Verdict and effect of the fault.
    pub cell: CellReport,
    /// Digest of all samples, if requested.
    pub digest: Option<String>,
}

/// Effect of a fault, by which its flight is judged.
#[derive(Clone, Debug, PartialEq)]
pub struct FaultEffect {
    /// The report on the fault; `None` if the flight ended before it.
    pub report: Option<FaultReport>,
    /// The loss of the vehicle, if it was lost.
    pub loss: Option<Loss>,
    /// `true` if the vehicle stood disarmed at the end.
    pub stands_disarmed: bool,
    /// Reason why the fault ended the flight early, if it did.
    pub ended: Option<Ended>,
}

/// Failure of the flight other than a loss of the vehicle.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Ended {
    /// A service computed a number that is not finite; the message.
    NotFinite(String),
    /// A service died of its inputs: repeatedly as a process, once in this process.
    Died,
}

/// Execution of a cell's flight.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Way {
    /// In this process.
    InProcess {
        /// `true` to compute the digest of all samples, which takes time.
        with_digest: bool,
    },
    /// As one process for each service, with the digest.
    Processes,
}

/// Flies a cell and compares it with the undisturbed flight.
///
/// # Errors
/// [`NotFlown`]. The fault's effects on the vehicle are no error, but an interrupt is.
pub fn fly(
    cell: &MatrixCell,
    way: Way,
    undisturbed: &Undisturbed,
    interrupt: &Interrupt,
) -> Result<FlightResult, NotFlown> {
    let end = flight::schedule_of(&cell.scenario)
        .map_err(RunFailure::from)?
        .last_tick();
    let scenario = &with_time_to_land(&cell.scenario);
    let schedule = flight::schedule_of(scenario).map_err(RunFailure::from)?;
    let with_digest = matches!(way, Way::Processes | Way::InProcess { with_digest: true });
    let tracker = Tracker::new(&schedule, scenario.flight.is_some());
    let mut observer = Observer {
        loss: LossWatch::new(scenario, tracker.source()),
        tracker,
        watch: FaultWatch::new(vec![cell.watched.clone()], &[], &schedule).beside(undisturbed.signs()),
        undisturbed: undisturbed.clone(),
        digest: with_digest.then(ExperimentDigest::default),
        end,
    };
    let outcome = match way {
        Way::InProcess { .. } => fly_in_process(scenario, &mut observer, interrupt),
        Way::Processes => fly_as_processes(scenario, &mut observer, interrupt),
    };
    let ended = match outcome? {
        Some(Outcome::Completed) => None,
        Some(Outcome::Failed(failure)) if failure.not_finite_at().is_some() => {
            Some(Ended::NotFinite(failure.to_string()))
        }
        Some(Outcome::Failed(failure)) if !failure.is_death() => {
            return Err(failure.into());
        }
        None | Some(Outcome::Failed(_)) => Some(Ended::Died),
        Some(Outcome::Interrupted { signal }) => return Err(NotFlown::Interrupted(signal)),
    };
    Ok(observer.finish(cell.moment, &schedule, ended))
}

/// Returns the scenario with the time that a landing may take after its end.
fn with_time_to_land(scenario: &Scenario) -> Scenario {
    let mut scenario = scenario.clone();
    if scenario.flight.is_some() {
        let land_within = scenario.envelope.clone().unwrap_or_default().land_within;
        scenario.duration = on_tick(&scenario, scenario.duration + land_within);
    }
    scenario
}

/// Returns the outcome; `None` if a service panicked, which would kill its process.
fn fly_in_process(
    scenario: &Scenario,
    observer: &mut Observer,
    interrupt: &Interrupt,
) -> Result<Option<Outcome>, RunFailure> {
    // Unwind safety: the flight's half-finished state is dropped, and the observer has received whole ticks only.
    let flight = AssertUnwindSafe(|| in_process::fly(scenario, observer, interrupt));
    match catch_unwind(flight) {
        Ok(ending) => Ok(Some(Ending::from(ending?).outcome)),
        Err(_) => Ok(None),
    }
}

fn fly_as_processes(
    scenario: &Scenario,
    observer: &mut Observer,
    interrupt: &Interrupt,
) -> Result<Option<Outcome>, RunFailure> {
    let deployment = Deployment::default();
    let quiet = Messages::default();
    let ending = lock_step::fly(scenario, &deployment, observer, interrupt, &quiet, &mut NoRecord)?;
    Ok(Some(ending.outcome))
}

/// Evaluates the samples of a flight without storing them.
struct Observer {
    tracker: Tracker,
    loss: LossWatch,
    watch: FaultWatch,
    undisturbed: Undisturbed,
    digest: Option<ExperimentDigest>,
    /// Last tick of the flight, unless the vehicle is landing then.
    end: u64,
}

impl Observer {
    fn observe(&mut self, moment: &Moment) {
        self.loss.observe(moment);
        let undisturbed = self.undisturbed.near(moment.vehicle.tick);
        self.watch.observe_moment(moment, undisturbed);
    }

    fn finish(mut self, moment: f64, schedule: &Schedule, ended: Option<Ended>) -> FlightResult {
        if let Some(moment) = self.tracker.last() {
            self.observe(&moment);
        }
        let effect = FaultEffect {
            report: self.watch.finish(schedule, self.loss.loss()).pop(),
            loss: self.loss.loss().cloned(),
            stands_disarmed: self.loss.stands_disarmed(),
            ended,
        };
        let (verdict, why) = judge(&effect);
        FlightResult {
            cell: CellReport {
                moment,
                verdict,
                why,
                report: effect.report,
            },
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

    fn end_tick(&mut self, tick: u64) -> Result<ControlFlow<()>, Infallible> {
        // What becomes of a vehicle that lands is known on the ground.
        let is_landing = self.watch.lands() && !self.loss.stands_disarmed() && self.loss.loss().is_none();
        Ok(if tick < self.end || is_landing {
            ControlFlow::Continue(())
        } else {
            ControlFlow::Break(())
        })
    }
}

/// Observer that records nothing about the machine.
struct NoRecord;

impl SupervisionObserver for NoRecord {
    fn ready(&mut self, _supervisor: &Supervisor<'_>, _core: Option<usize>) {}
    fn changed(&mut self, _supervisor: &Supervisor<'_>) {}
    fn progressed(&mut self, _supervisor: &Supervisor<'_>, _tick: u64) {}
    fn health(&mut self, _supervisor: &Supervisor<'_>) {}
    fn ended(&mut self, _supervisor: &Supervisor<'_>, _outcome: &Outcome) {}
}
