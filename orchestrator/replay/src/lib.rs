//! Replay: executes the steps of a flight again on its recorded samples, and compares the results byte for byte.
//!
//! Every service consumes the recorded samples, not those of the replay. So a difference identifies the service that
//! caused it, and with a changed scenario the result is what the service would have published for these inputs. In
//! simulated time the schedule determines the inputs of each step; in real time they are in the records of the steps.
//!
//! Recorded checkpoints have three uses: a replay of a part of the flight starts from one, a service resumes from one
//! after a gap in the log, and all others are compared with the state of the replayed service.

mod checkpoints;
mod comparator;
mod compare;
pub mod diff;
mod environment;
mod history;
pub mod in_words;
mod log_source;
mod recorded_steps;
mod scope;
mod service_process;
mod service_replay;
mod stepper;
mod tuning;

use std::error::Error;
use std::path::Path;

use scenario::{Key, Recorded, Scenario};
use shared_types::service::seconds;
use shared_types::{Schedule, ServiceId, Topic};

pub use compare::{Comparison, Difference};
use environment::ReplayEnvironment;
use history::History;
use log_source::LogSource;
use recorded_steps::RecordedSteps;
use scope::Scope;
pub use service_process::ProcessFailure;
use service_replay::ServiceReplay;
use stepper::{InThisProcess, Stepper};
use tuning::RecordedTuning;

use command_line::progress::Progress;
use flight::in_process::with_plugins;
use flight::interrupt::Interrupt;
use run_log::{HostReadError, LogReadError, LogReader};

#[derive(Debug, thiserror::Error)]
pub enum ReplayError {
    #[error("{0}")]
    Read(#[from] LogReadError),
    /// The records of steps cannot be read: a log of real time cannot be replayed without them.
    #[error(transparent)]
    Machine(#[from] HostReadError),
    /// The scenario does not build its services.
    #[error("the log's scenario cannot be flown: {0}")]
    Scenario(#[source] Box<dyn Error + Send + Sync>),
    /// A recorded change of gains cannot be applied.
    #[error("a recorded change of a gain cannot be repeated: {0}")]
    Tuning(#[source] Box<dyn Error + Send + Sync>),
    /// The changed scenario has another schedule.
    #[error(
        "the change gives the flight another schedule, for which the log has no samples; change nothing that determines when services step"
    )]
    OtherSchedule,
    /// The requested part of the flight contains no tick.
    #[error("the flight has no tick between --from {from} s and --to {to} s; let the second be later")]
    NothingBetween {
        /// Begin of the part, s.
        from: f64,
        /// End of the part, s.
        to: f64,
    },
    /// The requested part extends beyond the log.
    #[error("the log ends at {ends} s, and {option} {stated} s is beyond it; ask for less")]
    BeyondTheEnd {
        /// Option that states the bound.
        option: &'static str,
        /// Stated time, s.
        stated: f64,
        /// Time of the log's last tick, s.
        ends: f64,
    },
    /// A service process did not complete its steps.
    #[error(transparent)]
    Process(#[from] ProcessFailure),
    /// A plug-in violated its contract.
    #[error("{0}")]
    Plugin(String),
}

/// Scope of a replay.
#[derive(Clone, Debug, Default)]
pub struct Options {
    /// Services to replay; all if empty.
    pub services: Vec<ServiceId>,
    /// Scenario in place of the recorded one.
    pub changed: Option<Scenario>,
    /// Begin of the compared part, s; the begin of the flight if `None`.
    pub from: Option<f64>,
    /// End of the compared part, s; the end of the log if `None`.
    pub to: Option<f64>,
    /// Replays every service in a separate process, with an interrupt that ends the replay; otherwise in this process.
    pub in_processes: Option<Interrupt>,
}

#[derive(Clone, Debug, PartialEq)]
pub struct Replayed {
    pub in_real_time: bool,
    /// Services that started from a checkpoint, not with the flight.
    pub starts: Vec<Start>,
    /// Steps that were repeated, of the requested part.
    pub steps: u64,
    /// Steps that could not be repeated because their inputs, or those of steps since the last usable checkpoint, were
    /// not recorded.
    pub steps_without_inputs: u64,
    /// Number of times that a service resumed from a checkpoint because earlier steps could not be repeated.
    pub resumptions: u64,
    /// Number of checkpoints compared.
    pub checkpoints: u64,
    /// Number of checkpoints that differ.
    pub checkpoints_different: u64,
    /// First checkpoint that differs.
    pub first_checkpoint: Option<CheckpointDifference>,
    /// Replayed services with checkpoints of another build, which are ignored.
    pub foreign_checkpoints: Vec<ServiceId>,
    /// `true` if the recovered log lacks samples of the replayed part.
    pub lacks_samples: bool,
    /// Process name of a service that cannot be replayed, if it was requested: in a laboratory the plant's samples come
    /// from cameras.
    pub not_replayable: Option<&'static str>,
    /// Requested services that external programs replaced: their steps cannot be repeated.
    pub external_services: Vec<ServiceId>,
    /// Requested services with an input that the log records only in part, each with the first such input.
    pub without_inputs: Vec<(ServiceId, Topic)>,
    /// Keys that were set in flight, each with the time of the first change, s: from there on the replay has the values of
    /// the flight.
    pub set_in_flight: Vec<(Key, f64)>,
    /// Comparisons of all published topics.
    pub comparisons: Vec<Comparison>,
    /// Reason why the log ends before the flight, as a sentence, if it is incomplete or was recovered.
    pub log_ends: Option<String>,
}

/// Start of a service from a checkpoint.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Start {
    pub service: ServiceId,
    /// Time of the first repeated step, s.
    pub time: f64,
}

/// Step after which the state of a service differs from its checkpoint.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CheckpointDifference {
    pub service: ServiceId,
    pub tick: u64,
    pub time: f64,
}

impl Replayed {
    /// Returns the number of compared samples.
    #[must_use]
    pub fn compared(&self) -> u64 {
        self.sum(|comparison| comparison.compared)
    }

    /// Returns the number of samples without a recorded counterpart.
    #[must_use]
    pub fn unrecorded(&self) -> u64 {
        self.sum(|comparison| comparison.unrecorded)
    }

    /// Returns the number of samples outside of the recorded parts of their topics.
    #[must_use]
    pub fn left_out(&self) -> u64 {
        self.sum(|comparison| comparison.left_out)
    }

    fn sum(&self, count: impl Fn(&Comparison) -> u64) -> u64 {
        self.comparisons.iter().map(count).sum()
    }

    /// Returns whether everything in the log could be compared and is equal.
    #[must_use]
    pub fn is_identical(&self) -> bool {
        let is_whole = self.steps_without_inputs == 0 && self.resumptions == 0 && !self.lacks_samples;
        let is_same = self.first_difference().is_none() && self.checkpoints_different == 0;
        is_whole && is_same && self.compared() > 0
    }

    /// Returns the first difference in the order of the log.
    #[must_use]
    pub fn first_difference(&self) -> Option<&Difference> {
        let differences = self
            .comparisons
            .iter()
            .filter_map(|comparison| comparison.first.as_ref());
        differences.min_by_key(|difference| (difference.tick, difference.topic))
    }
}

/// Replays the log of a run.
///
/// # Errors
/// [`ReplayError`].
pub fn replay(
    log: &Path,
    options: &Options,
    progress: Option<&mut Progress>,
) -> Result<Replayed, ReplayError> {
    let reader = LogReader::open(log)?;
    let recorded = reader.manifest().scenario.clone();
    let schedule = schedule_of(&recorded)?;
    let mut scenario = options.changed.clone().unwrap_or_else(|| recorded.clone());
    if let Some(plugins) = &mut scenario.plugins {
        // Relative paths of plug-ins refer to the log's folder, where a run stores them.
        let log = std::path::absolute(log).unwrap_or_else(|_| log.to_owned());
        plugins.anchor(log.parent().unwrap_or(Path::new("/")));
    }
    let scenario = &scenario;
    if schedule_of(scenario)? != schedule {
        return Err(ReplayError::OtherSchedule);
    }
    let scope = Scope::of(options, &schedule)?;
    let topics = Recorded::of_topics(&recorded);
    let wanted = |service: &ServiceId| options.services.is_empty() || options.services.contains(service);
    // Dropped after the replays, whose processes use it.
    let environment = options
        .in_processes
        .as_ref()
        .map(|interrupt| ReplayEnvironment::open(scenario, &schedule, interrupt))
        .transpose()?;
    let replay = |service| -> Result<ServiceReplay, ReplayError> {
        let stepper: Box<dyn Stepper> = match &environment {
            Some(environment) => Box::new(environment.start(service)?),
            None => {
                let service = registry::build(service, scenario).map_err(ReplayError::Scenario)?;
                Box::new(InThisProcess::new(service, &schedule))
            }
        };
        let manifest = reader.manifest();
        Ok(ServiceReplay::new(
            service, &schedule, stepper, scope, &topics, manifest,
        ))
    };
    let mut replayed: Vec<_> = schedule.order().iter().copied().filter(wanted).collect();
    let seen = |service: &ServiceId| service.is_the_world() && !schedule.simulates_the_world();
    let not_replayable = replayed.iter().copied().find(seen);
    let not_replayable = not_replayable.map(|service| recorded.process_name(service));
    let is_external_service = |service: &ServiceId| recorded.program_of(*service).is_some();
    let external_services = replayed.iter().copied().filter(is_external_service).collect();
    replayed.retain(|service| !seen(service) && !is_external_service(service));
    let without_inputs: Vec<_> = replayed
        .iter()
        .filter_map(|&service| unknown_input(service, &schedule, &topics))
        .collect();
    replayed.retain(|service| !without_inputs.iter().any(|(without, _)| without == service));
    let replays: Vec<_> = replayed.into_iter().map(replay).collect::<Result<_, _>>()?;
    let is_asked_for = |topic| replays.iter().any(|replay| replay.uses(topic));
    let recorded_steps = RecordedSteps::beside(log, scenario, scope.first)?;
    let lateness = match recorded_steps.is_of_real_time() {
        true => log_source::largest_lateness(log)?,
        // In simulated time the log contains whole ticks in their order.
        false => 0,
    };
    let mut flight = Replay {
        not_replayable,
        external_services,
        without_inputs,
        source: LogSource::new(
            reader,
            lateness,
            History::of(is_asked_for),
            RecordedTuning::of(scenario),
        ),
        replays,
        recorded_steps,
        starts: Vec::new(),
        ends_before: 0,
        scope,
        schedule: &schedule,
    };
    let fly = || {
        flight.begin()?;
        flight.run(progress)?;
        flight.check_end(options)
    };
    if scenario.has_plugins() {
        with_plugins(fly).map_err(ReplayError::Plugin)??;
    } else {
        fly()?;
    }
    Ok(flight.finish())
}

/// Returns the first input of a service that the log records only in part, if there is one.
fn unknown_input(
    service: ServiceId,
    schedule: &Schedule,
    recorded: &[Recorded; Topic::ALL.len()],
) -> Option<(ServiceId, Topic)> {
    let mut inputs = schedule.inputs(service).map(|(_, input)| input.topic);
    let unknown = inputs.find(|topic| recorded[topic.index()] != Recorded::All)?;
    Some((service, unknown))
}

fn schedule_of(scenario: &Scenario) -> Result<Schedule, ReplayError> {
    flight::schedule_of(scenario).map_err(|error| ReplayError::Scenario(error.into()))
}

struct Replay<'a> {
    schedule: &'a Schedule,
    scope: Scope,
    replays: Vec<ServiceReplay>,
    not_replayable: Option<&'static str>,
    external_services: Vec<ServiceId>,
    without_inputs: Vec<(ServiceId, Topic)>,
    source: LogSource,
    recorded_steps: RecordedSteps,
    starts: Vec<Start>,
    /// First tick that is not in the log.
    ends_before: u64,
}

impl Replay<'_> {
    /// Starts each service from its newest checkpoint before the first compared tick, if there is one.
    fn begin(&mut self) -> Result<(), ReplayError> {
        for replay in &mut self.replays {
            let service = replay.service();
            if let Some((next_tick, state)) = self.recorded_steps.start_of(service)? {
                replay.begin_with(next_tick, state, &self.source.history)?;
                let time = seconds(self.schedule.time_ns(next_tick));
                self.starts.push(Start { service, time });
            }
        }
        Ok(())
    }

    fn run(&mut self, mut progress: Option<&mut Progress>) -> Result<(), ReplayError> {
        for tick in 0..=self.scope.last {
            self.source.read_to(tick)?;
            if self.source.is_exhausted_before(tick) {
                break;
            }
            for replay in &mut self.replays {
                let service = replay.service();
                let history = &self.source.history;
                if self.recorded_steps.is_of_real_time() {
                    let steps = self.recorded_steps.take_to(service, tick)?;
                    let checkpoints = self.recorded_steps.checkpoints(service, tick);
                    replay.step_as_recorded(tick, &steps, &self.source.tuning, history, checkpoints)?;
                } else {
                    let checkpoints = self.recorded_steps.checkpoints(service, tick);
                    replay.step_as_scheduled(tick, history, checkpoints)?;
                }
            }
            self.ends_before = tick + 1;
            self.source.history.remove_old();
            if let Some(progress) = progress.as_deref_mut() {
                progress.tick(tick);
            }
        }
        for replay in &mut self.replays {
            replay.settle(&self.source.history)?;
        }
        Ok(())
    }

    /// Checks that the log covers the requested part.
    fn check_end(&self, options: &Options) -> Result<(), ReplayError> {
        let last_tick = self.ends_before.saturating_sub(1);
        self.scope.check_end(options, last_tick, self.schedule.tick_ns())
    }

    /// Returns whether the log lacks samples that the replayed steps may have consumed or published.
    fn lacks_samples(&self) -> bool {
        let begins = self.replays.iter().map(ServiceReplay::begins_at).min();
        let replayed = begins.unwrap_or_default()..=self.scope.last;
        let mut recoveries = self.source.reader.recoveries().iter();
        recoveries.any(|recovery| recovery.lacks_samples_in(&replayed))
    }

    /// Returns why the log ends early, if it does and was replayed to its end.
    fn log_ends(&self) -> Option<String> {
        if let Some(reason) = &self.source.ends {
            return Some(format!("The log ends early: {reason}"));
        }
        let is_at_end = self.ends_before <= self.scope.last;
        let recovery = self.source.reader.recoveries().last().filter(|_| is_at_end)?;
        Some(format!("The log was recovered: {}", recovery.ending()))
    }

    /// Returns the first checkpoint that differs, over all services.
    fn first_checkpoint(&self) -> Option<CheckpointDifference> {
        let different = self.replays.iter().filter_map(|replay| {
            let tick = replay.comparator().first_different_after?;
            Some(CheckpointDifference {
                service: replay.service(),
                tick,
                time: seconds(self.schedule.time_ns(tick)),
            })
        });
        different.min_by_key(|difference| difference.tick)
    }

    fn finish(self) -> Replayed {
        let sum = |count: fn(&ServiceReplay) -> u64| self.replays.iter().map(count).sum();
        let mut foreign_checkpoints = self.recorded_steps.foreign_checkpoints();
        foreign_checkpoints.retain(|&service| self.replays.iter().any(|replay| replay.service() == service));
        Replayed {
            in_real_time: self.recorded_steps.is_of_real_time(),
            steps: sum(|replay| replay.steps),
            steps_without_inputs: sum(|replay| replay.steps_without_inputs),
            resumptions: sum(|replay| replay.resumptions),
            checkpoints: sum(|replay| replay.comparator().checkpoints),
            checkpoints_different: sum(|replay| replay.comparator().checkpoints_different),
            first_checkpoint: self.first_checkpoint(),
            foreign_checkpoints,
            lacks_samples: self.lacks_samples(),
            log_ends: self.log_ends(),
            starts: self.starts,
            not_replayable: self.not_replayable,
            external_services: self.external_services,
            without_inputs: self.without_inputs,
            set_in_flight: self.source.tuning.keys,
            comparisons: self.replays.into_iter().flat_map(ServiceReplay::finish).collect(),
        }
    }
}
