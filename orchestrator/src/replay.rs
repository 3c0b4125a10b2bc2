//! Does the steps of a flight again, on what its log has recorded, and compares what comes of them byte for byte.
//!
//! Every service is fed the recorded samples, not what the replayed ones publish: so a difference names the service
//! that made it, and with a changed scenario the answer is what the service would have published on these inputs.
//! In a log of simulated time the schedule says what each step saw; in one of real time the records of the steps do.

mod compare;
mod history;
mod judge;
mod recorded_steps;
mod service_process;
mod station;
mod stepper;
mod workshop;

use std::path::Path;

use shared_types::scenario::Scenario;
use shared_types::{Schedule, ServiceId};

pub use compare::{Comparison, Difference};
use history::History;
use recorded_steps::RecordedSteps;
pub use service_process::ProcessFailure;
use station::Station;
use stepper::{InThisProcess, Stepper};
use workshop::Workshop;

use crate::interrupt::Interrupt;
use crate::log::{HostStepsError, LogReadError, LogReader, Recovery};
use crate::progress::Progress;
use crate::services;

/// How far beyond a tick the log is read before the tick is replayed: in real time a sample may come that much late.
const READ_AHEAD_TICKS: u64 = 512;

/// Why a log cannot be replayed.
#[derive(Debug, thiserror::Error)]
pub enum ReplayError {
    /// The log cannot be read.
    #[error(transparent)]
    Read(#[from] LogReadError),
    /// The records of a flight's steps cannot be read: a log of real time cannot be replayed without them.
    #[error(transparent)]
    Steps(#[from] HostStepsError),
    /// The scenario does not make services.
    #[error("the log's scenario cannot be flown: {0}")]
    Scenario(String),
    /// The changed scenario has another schedule.
    #[error(
        "the change gives the flight another schedule, and the log has not the samples of that; change nothing that says when services step"
    )]
    OtherSchedule,
    /// A service process did not do its steps to the end.
    #[error(transparent)]
    Process(#[from] ProcessFailure),
}

/// What is to be replayed.
#[derive(Clone, Debug, Default)]
pub struct Options {
    /// Which services; all of them if none is named.
    pub services: Vec<ServiceId>,
    /// The scenario in place of the log's own.
    pub changed: Option<Scenario>,
    /// Replay every service in a process of its own, until somebody raises this; else all in this process.
    pub in_processes: Option<Interrupt>,
}

/// What came of a replay.
#[derive(Clone, Debug, PartialEq)]
pub struct Replayed {
    /// Whether the log is one of real time.
    pub in_real_time: bool,
    /// Steps that were done again.
    pub steps: u64,
    /// Steps that could not be, because samples that they had seen were not recorded; nor could those after them.
    pub steps_without_inputs: u64,
    /// Of each topic that was published in the replay.
    pub comparisons: Vec<Comparison>,
    /// Why the log ends early, if it does.
    pub log_ends: Option<String>,
}

impl Replayed {
    /// Samples that were compared.
    #[must_use]
    pub fn compared(&self) -> u64 {
        self.comparisons
            .iter()
            .map(|comparison| comparison.compared)
            .sum()
    }

    /// Samples that were made and not recorded, so that nothing can be said of them.
    #[must_use]
    pub fn unrecorded(&self) -> u64 {
        self.comparisons
            .iter()
            .map(|comparison| comparison.unrecorded)
            .sum()
    }

    /// Whether all that could be compared is the same, and all could.
    #[must_use]
    pub fn is_identical(&self) -> bool {
        self.first_difference().is_none() && self.steps_without_inputs == 0 && self.compared() > 0
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
    let scenario = options.changed.as_ref().unwrap_or(&recorded);
    if schedule_of(scenario)? != schedule {
        return Err(ReplayError::OtherSchedule);
    }
    let steps = RecordedSteps::beside(log)?;
    let wanted = |service: &ServiceId| options.services.is_empty() || options.services.contains(service);
    // Dropped after the stations, whose processes are in it.
    let workshop = options
        .in_processes
        .as_ref()
        .map(|interrupt| Workshop::open(scenario, &schedule, interrupt))
        .transpose()?;
    let station = |service| -> Result<Station, ReplayError> {
        let stepper: Box<dyn Stepper> = match &workshop {
            Some(workshop) => Box::new(workshop.start(service)?),
            None => {
                let service = services::build(service, scenario).map_err(ReplayError::Scenario)?;
                Box::new(InThisProcess::new(service, &schedule))
            }
        };
        Ok(Station::new(service, &schedule, stepper))
    };
    let stations = schedule.order().iter().copied().filter(wanted);
    let mut flight = Replay {
        stations: stations.map(station).collect::<Result<_, _>>()?,
        source: Source {
            gap_after: reader.recovery().and_then(Recovery::samples_before_first_gap),
            reader,
            history: History::default(),
            samples: 0,
            read_until: 0,
            ends: None,
            breaks_off: false,
        },
        steps,
        schedule: &schedule,
    };
    flight.run(progress)?;
    Ok(flight.finish())
}

fn schedule_of(scenario: &Scenario) -> Result<Schedule, ReplayError> {
    scenario
        .schedule()
        .map_err(|problems| ReplayError::Scenario(format!("{problems:?}")))
}

struct Replay<'a> {
    schedule: &'a Schedule,
    stations: Vec<Station>,
    source: Source,
    /// Of a log of real time.
    steps: Option<RecordedSteps>,
}

impl Replay<'_> {
    fn run(&mut self, mut progress: Option<&mut Progress>) -> Result<(), ReplayError> {
        for tick in 0..=self.schedule.last_tick() {
            self.source.read_to(tick + READ_AHEAD_TICKS)?;
            if self.source.is_exhausted_before(tick) {
                break;
            }
            for station in &mut self.stations {
                match &mut self.steps {
                    None => station.step_as_scheduled(tick, &self.source.history)?,
                    Some(steps) => {
                        let steps = steps.take_to(station.service(), tick)?;
                        station.step_as_recorded(tick, &steps, &self.source.history)?;
                    }
                }
            }
            self.source.history.forget_old();
            if let Some(progress) = progress.as_deref_mut() {
                progress.tick(tick);
            }
        }
        for station in &mut self.stations {
            station.settle(&self.source.history)?;
        }
        Ok(())
    }

    fn finish(self) -> Replayed {
        Replayed {
            in_real_time: self.steps.is_some(),
            steps: self.stations.iter().map(|station| station.steps).sum(),
            steps_without_inputs: self
                .stations
                .iter()
                .map(|station| station.steps_without_inputs)
                .sum(),
            comparisons: self.stations.into_iter().flat_map(Station::finish).collect(),
            log_ends: self.source.ends,
        }
    }
}

/// The recorded samples, read as far as they are needed.
struct Source {
    reader: LogReader,
    history: History,
    /// Samples read so far.
    samples: u64,
    /// In a recovered log, the samples before the first place where some are missing. What the services knew after it
    /// is not known, so that nothing behind it can be done again.
    gap_after: Option<u64>,
    /// All samples of ticks before this one have been read.
    read_until: u64,
    /// Why the log ends early.
    ends: Option<String>,
    /// Whether it ends anywhere, and not with a whole tick.
    breaks_off: bool,
}

impl Source {
    fn read_to(&mut self, tick: u64) -> Result<(), ReplayError> {
        while self.read_until <= tick {
            if self.gap_after == Some(self.samples) {
                let samples = self.samples;
                self.ends = Some(format!(
                    "samples are missing in the recovered log after the first {samples}"
                ));
                self.read_until = u64::MAX;
                break;
            }
            match self.reader.next_sample() {
                Ok(Some(sample)) => {
                    self.samples += 1;
                    self.read_until = self.read_until.max(sample.header.tick);
                    self.history.keep(sample.topic, sample.bytes);
                }
                Ok(None) => {
                    self.breaks_off |= self.reader.recovery().is_some();
                    self.read_until = u64::MAX;
                }
                // What was read before it is whole.
                Err(error @ (LogReadError::Unclosed { .. } | LogReadError::Damaged { .. })) => {
                    self.ends = Some(error.to_string());
                    self.breaks_off = true;
                    self.read_until = u64::MAX;
                }
                Err(error) => return Err(error.into()),
            }
        }
        Ok(())
    }

    /// Whether the log ends before a tick is whole. Of one that breaks off, the last tick may be broken, too.
    fn is_exhausted_before(&self, tick: u64) -> bool {
        let whole_until = self
            .history
            .last_tick()
            .map(|last| last + u64::from(!self.breaks_off));
        self.read_until == u64::MAX && whole_until <= Some(tick)
    }
}
