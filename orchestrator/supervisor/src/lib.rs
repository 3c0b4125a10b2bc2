//! Runs of a scenario in processes of their own: the hosts, what they have in common, and how a run ends.

pub mod archive;
mod control_server;
pub mod deployment;
pub mod host_kind;
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
use flight::failure::{FlightFailure, Suspects};
use host::step::NonFinite;
use scenario::{Scenario, Unflyable};
use shared_types::{Header, ServiceId};
use system_limits::resource_limits;

use metrics::summary::laboratory::LaboratoryReport;
use metrics::summary::timing::TimingReport;

/// The end of a run.
#[derive(Debug)]
pub struct Ending {
    /// Why.
    pub outcome: Outcome,
    /// Ticks that are whole in the log, from tick 0.
    pub ticks: u64,
    /// Wall time from the first tick to the last.
    pub wall_time: Duration,
    /// Warnings about the machine, once.
    pub warnings: Vec<String>,
    /// Restarts in flight, in their order.
    pub restarts: Vec<supervision::Restart>,
    /// Its timing, if it was flown in real time.
    pub timing: Option<TimingReport>,
    /// The performance of cameras and radio link, if it was flown in a laboratory.
    pub laboratory: Option<LaboratoryReport>,
}

impl Ending {
    /// The ending of a run whose record of the machine was closed so. What failed before counts.
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

/// Reason why a run ended.
pub type Outcome = flight::Outcome<RunFailure>;

/// Reason why a run could not go on.
#[derive(Debug, thiserror::Error)]
pub enum RunFailure {
    /// One that a flight in one process may have, too.
    #[error(transparent)]
    Flight(#[from] FlightFailure),
    /// It failed at Gerono's own code, in a flight in which other code publishes, too.
    #[error("{failure}{suspects}")]
    Suspected {
        /// The failure.
        failure: Box<Self>,
        /// The services in whose place other code flies.
        suspects: Suspects,
    },
    /// A service process died again and again without getting any further.
    #[error(
        "the service `{service}` (process {pid}) died after tick {tick}: {how}; \
         it is not started again after {times} deaths in a row without flying a tick more (see --restarts); \
         the log ends with the last whole tick"
    )]
    Died {
        /// Name of the service.
        service: String,
        /// The last of its process ids.
        pid: u32,
        /// The last tick that it had stepped.
        tick: u64,
        /// The outcome of the run.
        how: String,
        /// Number of times that it had died there.
        times: u32,
    },
    /// A restarted service published another sample than before its death.
    #[error(
        "the service that publishes `{topic}` was restarted and published another sample of tick {tick} than before: \
         its step is not a function of state and inputs, or the machine computes wrongly"
    )]
    Diverged {
        /// Name of the topic.
        topic: String,
        /// Tick of the sample.
        tick: u64,
    },
    /// A service could not do its work and said so.
    #[error("the service `{service}` gave up: {reason}")]
    GaveUp {
        /// Name of the service.
        service: String,
        /// The reason that it gave.
        reason: String,
    },
    /// The folder of the run's bookkeeping is gone.
    #[error(
        "the folder of the run, {}, was removed: nothing finds the run any more, and no service could be started again; \
         one below XDG_RUNTIME_DIR goes with the user's last login (`loginctl enable-linger`)", .0.display()
    )]
    PlaceRemoved(PathBuf),
    /// A service did not become ready.
    #[error("the services {} did not become ready within {} s; is the machine overloaded?", .services.join(", "), .limit.as_secs())]
    NotReady {
        /// Their names.
        services: Vec<String>,
        /// Time for which they had.
        limit: Duration,
    },
    /// An external service did not keep the process contract.
    #[error(
        "the program in place of `{service}` (process {pid}) {what}; docs/process_contract.md says what it must do"
    )]
    ExternalService {
        /// Name of the service.
        service: String,
        /// Its process id.
        pid: u32,
        /// Its action, in words.
        what: String,
    },
    /// A program in place of a service published another sample than the one that was due.
    #[error(
        "the program in place of `{service}` published a sample of `{topic}` with the tick {}, the number {} and the time \
         {} ns where that of tick {due} was due; docs/process_contract.md says what it must do",
        .got.tick, .got.seq, .got.stamp_ns
    )]
    NotDue {
        /// Name of the service.
        service: &'static str,
        /// Name of the topic.
        topic: &'static str,
        /// Tick of the sample that was due.
        due: u64,
        /// Header of the sample that came.
        got: Header,
    },
    /// The machine does not permit what the scenario insists on.
    #[error(
        "the scenario insists on its deployment (`deployment.strict`), of which this machine does not permit all: {}; \
         nothing was flown",
        .refusals.join("; ")
    )]
    NotPermitted {
        /// The refused permissions, with the fixes.
        refusals: Vec<String>,
    },
    /// A sample did not reach the recorder.
    #[error("a sample of `{topic}` was lost: tick {due} was due and {got} came")]
    Lost {
        /// Name of the topic.
        topic: String,
        /// Tick that was due.
        due: u64,
        /// Tick that came.
        got: u64,
    },
    /// The record of the machine, `host.mcap`, cannot be written.
    #[error("the record of the machine cannot be kept: {0}")]
    Record(#[source] run_log::LogError),
}

impl RunFailure {
    /// Names the services in whose place other code flies, if the run has failed at another service and the failure
    /// names none of them.
    #[must_use]
    pub fn suspecting(self, foreign: impl IntoIterator<Item = ServiceId>) -> Self {
        let is_by_samples = matches!(
            self,
            Self::Flight(FlightFailure::NonFinite(..))
                | Self::Died { .. }
                | Self::Diverged { .. }
                | Self::GaveUp { .. }
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

    /// Returns the failure without the suspects.
    #[must_use]
    pub fn itself(&self) -> &Self {
        match self {
            Self::Suspected { failure, .. } => failure,
            other => other,
        }
    }

    /// Returns whether a service could not do its work and said so.
    #[must_use]
    pub fn is_given_up(&self) -> bool {
        matches!(self.itself(), Self::GaveUp { .. })
    }

    /// Returns the tick at which a service computed a number that is not finite, if that is the failure.
    #[must_use]
    pub fn not_finite_at(&self) -> Option<u64> {
        match self.itself() {
            Self::Flight(failure) => failure.not_finite_at(),
            _ => None,
        }
    }

    /// A flight that cannot begin, and the error or the sentence that says why.
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
