//! Does the steps of a flight again, on what its log has recorded, and compares what comes of them byte for byte.
//!
//! Every service is fed the recorded samples, not what the replayed ones publish: so a difference names the service
//! that made it, and with a changed scenario the answer is what the service would have published on these inputs.
//! In a log of simulated time the schedule says what each step saw; in one of real time the records of the steps do.
//!
//! What services are recorded to have known before some steps serves three ends: a replay of a part of the flight begins
//! with it, a service goes on with it behind a gap in the log, and otherwise it must be what the replayed service knows.

mod checkpoints;
mod comparator;
mod compare;
pub mod diff;
mod environment;
mod history;
mod log_source;
mod recorded_steps;
mod scope;
mod service_process;
mod service_replay;
mod stepper;
mod tuning;

use std::error::Error;
use std::path::Path;

use scenario::{Recorded, Scenario};
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

/// Reason why a log cannot be replayed.
#[derive(Debug, thiserror::Error)]
pub enum ReplayError {
    /// The log cannot be read.
    #[error("{0}")]
    Read(#[from] LogReadError),
    /// The records of a flight's steps cannot be read: a log of real time cannot be replayed without them.
    #[error(transparent)]
    Machine(#[from] HostReadError),
    /// The scenario does not make services.
    #[error("the log's scenario cannot be flown: {0}")]
    Scenario(#[source] Box<dyn Error + Send + Sync>),
    /// A change of gains that was recorded cannot be made again.
    #[error("a recorded change of a gain cannot be made again: {0}")]
    Tuning(#[source] Box<dyn Error + Send + Sync>),
    /// The changed scenario has another schedule.
    #[error(
        "the change gives the flight another schedule, and the log has not the samples of that; change nothing that says when services step"
    )]
    OtherSchedule,
    /// The flight has no tick in the part that is asked for.
    #[error("the flight has no tick between --from {from} s and --to {to} s; let the second be later")]
    NothingBetween {
        /// Place where the part begins, s.
        from: f64,
        /// Place where it ends, s.
        to: f64,
    },
    /// The requested time is not in the log.
    #[error("the log ends at {ends} s, and {option} {stated} s is beyond it; ask for less")]
    BeyondTheEnd {
        /// Which end of the part.
        option: &'static str,
        /// Place where it is, s.
        stated: f64,
        /// Time of the log's last tick, s.
        ends: f64,
    },
    /// A service process did not do its steps to the end.
    #[error(transparent)]
    Process(#[from] ProcessFailure),
    /// A plug-in did what it may not.
    #[error("{0}")]
    Plugin(String),
}

/// The extent of a replay.
#[derive(Clone, Debug, Default)]
pub struct Options {
    /// Which services; all of them if none is named.
    pub services: Vec<ServiceId>,
    /// The scenario in place of the log's own.
    pub changed: Option<Scenario>,
    /// From which time of the flight on is compared, s; from its beginning if none is stated.
    pub from: Option<f64>,
    /// Up to which time of the flight, s; to the end of the log if none is stated.
    pub to: Option<f64>,
    /// Replay every service in a separate process, until this is raised; else all in this process.
    pub in_processes: Option<Interrupt>,
}

/// The result of a replay.
#[derive(Clone, Debug, PartialEq)]
pub struct Replayed {
    /// `true` if the log is one of real time.
    pub in_real_time: bool,
    /// Place where the services began, if not with the flight.
    pub starts: Vec<Start>,
    /// Steps that were done again, of the part that was asked for.
    pub steps: u64,
    /// Steps that could not be, because samples that they had seen were not recorded; nor could those after them, up to
    /// the next recorded checkpoint of the service.
    pub steps_without_inputs: u64,
    /// Number of times that services went on from a checkpoint, not having been able to do the steps before.
    pub resumptions: u64,
    /// Recorded checkpoints that were compared with what the replayed services knew.
    pub checkpoints: u64,
    /// Those that differ.
    pub checkpoints_different: u64,
    /// The first of them.
    pub first_checkpoint: Option<CheckpointDifference>,
    /// Replayed services whose checkpoints another build has written: they were not looked at.
    pub strange_checkpoints: Vec<ServiceId>,
    /// `true` if samples are missing in the recovered log, of the part that was replayed.
    pub lacks_samples: bool,
    /// The service whose steps cannot be done again, if it is to be: in a laboratory the world's are what cameras saw.
    pub not_again: Option<&'static str>,
    /// Services to be replayed in whose place external services flew: their steps cannot be repeated.
    pub external_services: Vec<ServiceId>,
    /// Services to be replayed of whose inputs not every sample belongs into the log, each with the first such input.
    pub without_inputs: Vec<(ServiceId, Topic)>,
    /// Of each topic that was published in the replay.
    pub comparisons: Vec<Comparison>,
    /// Why the log has no more than was replayed, as a sentence, if it is incomplete or was recovered.
    pub log_ends: Option<String>,
}

/// Place where a service began that did not begin with the flight.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Start {
    /// The service.
    pub service: ServiceId,
    /// Time of the first tick whose step it did, s.
    pub time: f64,
}

/// A service that did not know after a step what it is recorded to have known.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CheckpointDifference {
    /// The service.
    pub service: ServiceId,
    /// Tick of the step.
    pub tick: u64,
    /// Time of the tick, s.
    pub time: f64,
}

impl Replayed {
    /// Samples that were compared.
    #[must_use]
    pub fn compared(&self) -> u64 {
        self.sum(|comparison| comparison.compared)
    }

    /// Samples that were made and not recorded, so that nothing can be said of them.
    #[must_use]
    pub fn unrecorded(&self) -> u64 {
        self.sum(|comparison| comparison.unrecorded)
    }

    /// Samples that were made and that do not belong into the log, which has parts of some topics only.
    #[must_use]
    pub fn left_out(&self) -> u64 {
        self.sum(|comparison| comparison.left_out)
    }

    fn sum(&self, count: impl Fn(&Comparison) -> u64) -> u64 {
        self.comparisons.iter().map(count).sum()
    }

    /// Returns whether all that could be compared is the same, and all could as far as the log goes.
    #[must_use]
    pub fn is_identical(&self) -> bool {
        let is_whole = self.steps_without_inputs == 0 && self.resumptions == 0 && !self.lacks_samples;
        let is_same = self.first_difference().is_none() && self.checkpoints_different == 0;
        is_whole && is_same && self.compared() > 0
    }

    /// The first difference in the order of the log.
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
        // A run keeps its plug-ins beside its log.
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
    // Dropped after the replays, whose processes are in it.
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
        Ok(ServiceReplay::new(service, &schedule, stepper, scope, &topics))
    };
    let mut replayed: Vec<_> = schedule.order().iter().copied().filter(wanted).collect();
    let seen = |service: &ServiceId| service.is_the_world() && !schedule.simulates_the_world();
    let not_again = replayed.iter().copied().find(seen);
    let not_again = not_again.map(|service| recorded.process_name(service));
    let is_external_service = |service: &ServiceId| recorded.program_of(*service).is_some();
    let external_services = replayed.iter().copied().filter(is_external_service).collect();
    replayed.retain(|service| !seen(service) && !is_external_service(service));
    let without_inputs: Vec<_> = replayed
        .iter()
        .filter_map(|&service| unknown_input(service, &topics))
        .collect();
    replayed.retain(|service| !without_inputs.iter().any(|(without, _)| without == service));
    let replays: Vec<_> = replayed.into_iter().map(replay).collect::<Result<_, _>>()?;
    let is_asked_for = |topic| replays.iter().any(|replay| replay.is_about(topic));
    let recorded_steps = RecordedSteps::beside(log, scenario, scope.first)?;
    let lateness = match recorded_steps.is_of_real_time() {
        true => log_source::largest_lateness(log)?,
        // Whole ticks are recorded, in their order.
        false => 0,
    };
    let mut flight = Replay {
        not_again,
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

/// Returns the first input of a service of which not every sample belongs into the log, if there is one.
fn unknown_input(service: ServiceId, recorded: &[Recorded; Topic::ALL.len()]) -> Option<(ServiceId, Topic)> {
    let mut inputs = service.inputs().iter().map(|input| input.topic);
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
    not_again: Option<&'static str>,
    external_services: Vec<ServiceId>,
    without_inputs: Vec<(ServiceId, Topic)>,
    source: LogSource,
    recorded_steps: RecordedSteps,
    starts: Vec<Start>,
    /// The first tick that the log has no more.
    ends_before: u64,
}

impl Replay<'_> {
    /// Lets the services begin with the newest that they are recorded to have known by the first tick that is compared.
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
            self.source.history.forget_old();
            if let Some(progress) = progress.as_deref_mut() {
                progress.tick(tick);
            }
        }
        for replay in &mut self.replays {
            replay.settle(&self.source.history)?;
        }
        Ok(())
    }

    /// Returns whether the log has all that was asked for.
    fn check_end(&self, options: &Options) -> Result<(), ReplayError> {
        let last_tick = self.ends_before.saturating_sub(1);
        self.scope.check_end(options, last_tick, self.schedule.tick_ns())
    }

    /// Returns whether samples are missing between others that the replayed steps may have seen or published.
    fn lacks_samples(&self) -> bool {
        let begins = self.replays.iter().map(ServiceReplay::begins_at).min();
        let replayed = begins.unwrap_or_default()..=self.scope.last;
        let mut recoveries = self.source.reader.recoveries().iter();
        recoveries.any(|recovery| recovery.lacks_samples_in(&replayed))
    }

    /// Returns why the log has no more, if it is not a whole one and was replayed to its end.
    fn log_ends(&self) -> Option<String> {
        if let Some(reason) = &self.source.ends {
            return Some(format!("The log ends early: {reason}"));
        }
        let is_at_end = self.ends_before <= self.scope.last;
        let recovery = self.source.reader.recoveries().last().filter(|_| is_at_end)?;
        Some(format!("The log was recovered: {}", recovery.ending()))
    }

    /// The first service and step after which it did not know what is recorded.
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
        let mut strange_checkpoints = self.recorded_steps.strange_checkpoints();
        strange_checkpoints.retain(|&service| self.replays.iter().any(|replay| replay.service() == service));
        Replayed {
            in_real_time: self.recorded_steps.is_of_real_time(),
            steps: sum(|replay| replay.steps),
            steps_without_inputs: sum(|replay| replay.steps_without_inputs),
            resumptions: sum(|replay| replay.resumptions),
            checkpoints: sum(|replay| replay.comparator().checkpoints),
            checkpoints_different: sum(|replay| replay.comparator().checkpoints_different),
            first_checkpoint: self.first_checkpoint(),
            strange_checkpoints,
            lacks_samples: self.lacks_samples(),
            log_ends: self.log_ends(),
            starts: self.starts,
            not_again: self.not_again,
            external_services: self.external_services,
            without_inputs: self.without_inputs,
            comparisons: self.replays.into_iter().flat_map(ServiceReplay::finish).collect(),
        }
    }
}
