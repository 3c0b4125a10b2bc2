//! Runs of a scenario in separate processes: lock step and real time, and what they share.

pub mod archive;
mod battery;
mod control_server;
pub mod deployment;
pub mod host_record;
pub mod kill_switch;
pub mod lock_step;
pub mod real_time;
pub mod recorder;
pub mod reserve;
mod run_context;
pub mod subscription;
pub mod supervision;

use std::error::Error;
use std::path::PathBuf;
use std::time::Duration;

use command_line::failure::Failure;
use decisions::failure::ServiceFailure;
use flight::failure::{FlightFailure, Suspects};
use host::step::NonFinite;
use scenario::{Scenario, Unflyable};
use shared_types::{Header, ServiceId};
use system_limits::resource_limits;

use metrics::summary::laboratory::LaboratoryReport;
use metrics::summary::timing::TimingReport;

/// Result of a run.
#[derive(Debug)]
pub struct Ending {
    pub outcome: Outcome,
    /// Number of complete ticks in the log.
    pub ticks: u64,
    /// Wall time from the first tick to the last.
    pub wall_time: Duration,
    /// Warnings about the machine, without repetitions.
    pub warnings: Vec<String>,
    /// Restarts in flight, in order.
    pub restarts: Vec<supervision::Restart>,
    /// Timing of a flight in real time.
    pub timing: Option<TimingReport>,
    /// Figures of cameras and radio link of a flight in a laboratory.
    pub laboratory: Option<LaboratoryReport>,
}

impl Ending {
    /// Adds the result of closing the record of the machine. An earlier failure has precedence.
    #[must_use]
    pub fn with_record(mut self, closed: Result<(), run_log::LogError>) -> Self {
        if let (Err(error), Outcome::Completed | Outcome::Interrupted { .. }) = (closed, &self.outcome) {
            self.outcome = Outcome::Failed(error.into());
        }
        self
    }
}

impl From<flight::Ending> for Ending {
    fn from(ending: flight::Ending) -> Self {
        Self {
            outcome: match ending.outcome {
                flight::Outcome::Completed => Outcome::Completed,
                flight::Outcome::Interrupted { signal } => Outcome::Interrupted { signal },
                flight::Outcome::Failed(failure) => Outcome::Failed(failure.into()),
            },
            ticks: ending.ticks,
            wall_time: ending.wall_time,
            warnings: ending.warnings,
            restarts: Vec::new(),
            timing: None,
            laboratory: None,
        }
    }
}

pub type Outcome = flight::Outcome<RunFailure>;

/// Reason why a run failed.
#[derive(Debug, thiserror::Error)]
pub enum RunFailure {
    /// A failure that is also possible in a flight in one process.
    #[error(transparent)]
    Flight(#[from] FlightFailure),
    /// A failure of one of Gerono's own services, in a flight in which foreign code publishes as well.
    #[error("{failure}{suspects}")]
    Suspected {
        failure: Box<Self>,
        /// Services that are replaced by foreign code.
        suspects: Suspects,
    },
    /// A service is not started again.
    #[error(transparent)]
    Service(ServiceFailure),
    /// A restarted service published a sample that differs from the one before its death.
    #[error(
        "the service that publishes `{topic}` was restarted and published another sample of tick {tick} than before: \
         its step is not a function of state and inputs, or the machine computes wrongly"
    )]
    Diverged { topic: String, tick: u64 },
    /// The run's folder was removed.
    #[error(
        "the folder of the run, {}, was removed: the run cannot be found any more, and no service could be restarted; \
         one below XDG_RUNTIME_DIR is removed with the user's last session (`loginctl enable-linger`)", .0.display()
    )]
    FolderRemoved(PathBuf),
    /// An external service published another sample than the one that was due.
    #[error(
        "the program in place of `{service}` published a sample of `{topic}` with the tick {}, the number {} and the time \
         {} ns where that of tick {due} was due; docs/process_contract.md says what it must do",
        .got.tick, .got.seq, .got.stamp_ns
    )]
    NotDue {
        service: &'static str,
        topic: &'static str,
        due: u64,
        /// Header of the received sample.
        got: Header,
    },
    /// The system refused a setting although the deployment is strict.
    #[error(
        "the scenario requires its deployment (`deployment.strict`), and this machine does not permit all of it: {}; \
         nothing was flown",
        .refusals.join("; ")
    )]
    NotPermitted {
        /// The refused settings, with the fixes.
        refusals: Vec<String>,
    },
    /// A sample did not reach the recorder.
    #[error("a sample of `{topic}` was lost: tick {due} was due and {got} came")]
    Lost { topic: String, due: u64, got: u64 },
    #[error("the record of the machine cannot be written: {0}")]
    Record(#[source] run_log::LogError),
}

impl RunFailure {
    /// Adds the services with foreign code as suspects, if the failure may result from their samples and does not name
    /// one of them.
    #[must_use]
    pub fn suspecting(self, foreign: impl IntoIterator<Item = ServiceId>) -> Self {
        let is_by_samples = matches!(
            self,
            Self::Flight(FlightFailure::NonFinite(..))
                | Self::Service(ServiceFailure::Died { .. } | ServiceFailure::GaveUp { .. })
                | Self::Diverged { .. }
                | Self::Lost { .. }
        );
        let suspects = Suspects::of(foreign, &self);
        if !is_by_samples || suspects.is_empty() {
            return self;
        }
        Self::Suspected {
            failure: Box::new(self),
            suspects,
        }
    }

    /// Returns the failure without suspects.
    #[must_use]
    pub fn itself(&self) -> &Self {
        match self {
            Self::Suspected { failure, .. } => failure,
            other => other,
        }
    }

    /// Returns whether a service died repeatedly.
    #[must_use]
    pub fn is_death(&self) -> bool {
        matches!(self.itself(), Self::Service(ServiceFailure::Died { .. }))
    }

    /// Returns whether a service reported the failure.
    #[must_use]
    pub fn is_given_up(&self) -> bool {
        matches!(self.itself(), Self::Service(ServiceFailure::GaveUp { .. }))
    }

    /// Returns the tick at which a service computed a number that is not finite, if that is the failure.
    #[must_use]
    pub fn not_finite_at(&self) -> Option<u64> {
        match self.itself() {
            Self::Flight(failure) => failure.not_finite_at(),
            _ => None,
        }
    }

    /// Returns the failure of a flight that cannot begin, from an error or a message.
    pub fn setup(error: impl Into<Box<dyn Error + Send + Sync>>) -> Self {
        let error = error.into();
        Self::Flight(match resource_limits::advice(&*error) {
            Some(_) => FlightFailure::setup(resource_limits::in_words(&*error)),
            None => FlightFailure::Setup(error),
        })
    }
}

impl From<RunFailure> for Failure {
    fn from(failure: RunFailure) -> Self {
        match failure {
            RunFailure::Flight(failure) => failure.into(),
            failure => Self::trouble(failure),
        }
    }
}

impl From<NonFinite> for RunFailure {
    fn from(found: NonFinite) -> Self {
        Self::Flight(FlightFailure::NonFinite(found, Suspects::default()))
    }
}

impl From<ServiceFailure> for RunFailure {
    fn from(failure: ServiceFailure) -> Self {
        match failure {
            ServiceFailure::NonFinite(found) => found.into(),
            ServiceFailure::Refused(reason) => FlightFailure::Refused(reason.into()).into(),
            ServiceFailure::NotStarted(reason) => Self::setup(reason),
            failure => Self::Service(failure),
        }
    }
}

impl From<run_log::LogError> for RunFailure {
    fn from(error: run_log::LogError) -> Self {
        Self::Flight(error.into())
    }
}

impl From<Unflyable> for RunFailure {
    fn from(scenario: Unflyable) -> Self {
        Self::setup(scenario)
    }
}

impl From<std::convert::Infallible> for RunFailure {
    fn from(never: std::convert::Infallible) -> Self {
        match never {}
    }
}

fn refuse_unsimulated_poses(scenario: &Scenario) -> Result<(), RunFailure> {
    flight::unsimulated_poses(scenario).map_or(Ok(()), |reason| Err(RunFailure::setup(reason)))
}
