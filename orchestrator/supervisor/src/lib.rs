//! Flying a scenario: the hosts, what they have in common, and how a flight ends.

pub mod archive;
mod control_server;
pub mod deployment;
pub mod host_kind;
pub mod host_record;
pub mod in_process;
pub mod lock_step;
pub mod real_time;
pub mod recorder;
pub mod recording_sink;
pub mod reserve;
mod run_context;
pub mod subscription;
pub mod supervision;

use std::error::Error;
use std::fmt::{Display, Formatter};
use std::path::PathBuf;
use std::time::Duration;

use command_line::exit::Exit;
use command_line::failure::Failure;
use host::step::NonFinite;
use scenario::{Scenario, Unflyable};
use shared_types::{Header, Schedule, ServiceId};
use system_limits::resource_limits;

use metrics::summary::laboratory::LaboratoryReport;
use metrics::summary::timing::TimingReport;

/// The end of a flight.
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
    /// The ending of a flight whose record of the machine was closed so. What failed before counts.
    #[must_use]
    pub fn with_record(mut self, closed: Result<(), run_log::LogError>) -> Self {
        if let (Err(error), Outcome::Completed | Outcome::Interrupted { .. }) = (closed, &self.outcome) {
            self.outcome = Outcome::Failed(error.into());
        }
        self
    }
}

/// Reason why a flight ended.
#[derive(Debug)]
pub enum Outcome {
    /// The last tick was flown.
    Completed,
    /// The user asked for the end, by this signal.
    Interrupted {
        /// Number of the signal.
        signal: i32,
    },
    /// It could not go on.
    Failed(FlightFailure),
}

impl Display for Outcome {
    fn fmt(&self, formatter: &mut Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Completed => formatter.write_str("completed"),
            Self::Interrupted { signal } => write!(formatter, "interrupted by signal {signal}"),
            Self::Failed(failure) => failure.fmt(formatter),
        }
    }
}

/// Reason why a flight could not go on.
#[derive(Debug, thiserror::Error)]
pub enum FlightFailure {
    /// A service computed a number that is not finite.
    #[error(transparent)]
    NonFinite(#[from] NonFinite),
    /// It failed at Gerono's own code, in a flight in which other code publishes, too.
    #[error(
        "{failure}; other code than Gerono's flies in place of {suspects}: look first at what it published"
    )]
    Suspected {
        /// The failure.
        failure: Box<Self>,
        /// The services in whose place other code flies.
        suspects: String,
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
    /// A plug-in failed in its step.
    #[error("{0}; the log ends with the last whole tick")]
    Plugin(String),
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
    /// The log cannot be written.
    #[error(transparent)]
    Log(#[from] run_log::LogError),
    /// The record of the machine, `host.mcap`, cannot be written.
    #[error("the record of the machine cannot be kept: {0}")]
    Record(#[source] run_log::LogError),
    /// No services are made of the scenario: it names a plug-in that cannot fly, for example.
    #[error("{0}")]
    Refused(#[source] Box<dyn Error + Send + Sync>),
    /// The machine refused something that every run needs.
    #[error("cannot set the run up: {0}")]
    Setup(#[source] Box<dyn Error + Send + Sync>),
}

impl FlightFailure {
    /// Returns whether nothing was flown: the scenario or the machine is at fault, and not the flight.
    #[must_use]
    pub fn is_of_setup(&self) -> bool {
        matches!(
            self,
            Self::Refused(_) | Self::Setup(_) | Self::NotReady { .. } | Self::NotPermitted { .. }
        )
    }

    /// Names the services in whose place other code flies, if the flight has failed at another service and the failure
    /// names none of them: what they publish reaches every service, and an absurd number ends in one that is not finite.
    #[must_use]
    pub fn suspecting(self, foreign: impl IntoIterator<Item = ServiceId>) -> Self {
        let suspects: Vec<_> = foreign
            .into_iter()
            .map(|service| format!("`{service}`"))
            .collect();
        let is_by_samples = matches!(
            self,
            Self::NonFinite(_)
                | Self::Died { .. }
                | Self::Diverged { .. }
                | Self::GaveUp { .. }
                | Self::Lost { .. }
        );
        let told = self.to_string();
        if !is_by_samples || suspects.is_empty() || suspects.iter().any(|name| told.contains(name)) {
            return self;
        }
        Self::Suspected {
            failure: Box::new(self),
            suspects: suspects.join(", "),
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
            Self::NonFinite(found) => Some(found.tick),
            _ => None,
        }
    }

    /// A flight that cannot begin, and the error or the sentence that says why.
    pub fn setup(error: impl Into<Box<dyn Error + Send + Sync>>) -> Self {
        let error = error.into();
        match resource_limits::advice(&*error) {
            Some(_) => Self::Setup(resource_limits::in_words(&*error).into()),
            None => Self::Setup(error),
        }
    }
}

impl From<FlightFailure> for Failure {
    fn from(failure: FlightFailure) -> Self {
        let exit = match failure {
            FlightFailure::Refused(_) => Exit::BadInput,
            _ => Exit::Trouble,
        };
        Self::new(exit, failure)
    }
}

/// Returns when everybody steps in a flight of `scenario`.
///
/// # Errors
/// [`Unflyable`]; never for a checked scenario.
pub fn schedule_of(scenario: &Scenario) -> Result<Schedule, Unflyable> {
    scenario.schedule().map_err(Unflyable)
}

impl From<Unflyable> for FlightFailure {
    fn from(scenario: Unflyable) -> Self {
        Self::setup(scenario)
    }
}

/// Returns why a scenario cannot be flown in simulated time, if its poses come from elsewhere: never silently with others.
#[must_use]
pub fn unsimulated_poses(scenario: &Scenario) -> Option<String> {
    if scenario.recorded_captures().is_some() {
        return Some(
            "recorded captures come in real time only; fly with --host realtime, or with --set \
             motion_capture.source=simulated; in simulated time `gerono replay` does a recorded flight's steps again"
                .to_owned(),
        );
    }
    let name = scenario.capture_system()?.0.name();
    Some(format!(
        "poses are to come from `{name}`, which sends them in real time only; fly with --host realtime, or with --set \
         motion_capture.source=simulated, or look at what comes with `gerono mocap probe`"
    ))
}

/// Reason why a scenario with external services cannot be flown in one process.
#[must_use]
pub fn programs_of_its_own(scenario: &Scenario) -> Option<String> {
    let external_services = scenario.external_services();
    let external_service = ServiceId::ALL
        .into_iter()
        .find(|service| external_services[service.index()])?;
    Some(format!(
        "a program of its own is to fly in place of `{external_service}` (`programs.{external_service}`), and here all fly in one process; fly \
         with --host lockstep or --host realtime, or with --set 'programs={{}}'"
    ))
}

fn refuse_programs(scenario: &Scenario) -> Result<(), FlightFailure> {
    programs_of_its_own(scenario).map_or(Ok(()), |reason| Err(FlightFailure::setup(reason)))
}

fn refuse_unsimulated_poses(scenario: &Scenario) -> Result<(), FlightFailure> {
    unsimulated_poses(scenario).map_or(Ok(()), |reason| Err(FlightFailure::setup(reason)))
}

impl From<std::convert::Infallible> for FlightFailure {
    fn from(never: std::convert::Infallible) -> Self {
        match never {}
    }
}
