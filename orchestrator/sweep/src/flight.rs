//! One flight of a sweep: flown in this process and judged.

use std::collections::VecDeque;
use std::ops::ControlFlow;
use std::path::Path;

use ::flight::failure::FlightFailure;
use ::flight::interrupt::Interrupt;
use ::flight::recording_sink::planned_events;
use ::flight::{Outcome as HostOutcome, in_process};
use host::in_process::TickSink;
use metrics::summary::FlightSummary;
use metrics::view;
use run_log::{Compression, LogError, Manifest, RunLogWriter};
use scenario::{GRAVITY, Programs, Scenario};
use sha2::{Digest, Sha256};
use shared_types::sample::hex;
use shared_types::samples::{RunEvent, VehicleTruth};
use shared_types::service::{ErasedService, nanoseconds};
use shared_types::{Schedule, ServiceId, Topic};
use zerocopy::IntoBytes;

use crate::definition::Entry;
use crate::error::SweepError;
use crate::plan::{Plan, Sample};
use crate::row::{Flown, Outcome};

/// Topics from which a flight is judged.
const JUDGED: [Topic; 4] = [
    Topic::VehicleTruth,
    Topic::PathReference,
    Topic::ControlAdaptation,
    Topic::RcFrame,
];

/// Judges a flight while it is flown, and ends it when the vehicle is lost.
pub struct Judge {
    summary: FlightSummary,
    digest: Sha256,
    ticks_a_second: u64,
    /// Next tick whose samples are hashed into the digest: the first tick of a second.
    digest_tick: u64,
    tick: u64,
    energy: Energy,
    log: Option<RunLogWriter>,
    /// Events that the scenario schedules, for the log.
    events: VecDeque<RunEvent>,
    /// Returns whether the caller's controller has failed.
    has_failed: Option<Box<dyn Fn() -> bool>>,
}

/// Mean of (T/(m g))^1.5: the rotors' induced power relative to hover.
#[derive(Clone, Copy, Debug, Default)]
struct Energy {
    sum: f64,
    samples: u64,
}

impl Judge {
    /// Makes the judge of a flight.
    #[must_use]
    pub fn new(scenario: &Scenario, schedule: &Schedule) -> Self {
        Self {
            summary: FlightSummary::new(scenario, schedule),
            digest: Sha256::new(),
            ticks_a_second: (nanoseconds(1.0) / schedule.tick_ns()).max(1),
            digest_tick: 0,
            tick: 0,
            energy: Energy::default(),
            log: None,
            events: VecDeque::new(),
            has_failed: None,
        }
    }

    #[inline]
    fn judge(&mut self, topic: Topic, bytes: &[u8]) {
        self.summary.observe(topic, bytes);
        if self.tick == self.digest_tick {
            self.digest.update(bytes);
        }
        if topic == Topic::VehicleTruth {
            view(bytes, |truth: &VehicleTruth| {
                self.energy.add(truth.thrust / (truth.mass * GRAVITY));
            });
        }
    }

    /// Adds a log to which the flight is recorded.
    fn recorded(mut self, scenario: &Scenario, schedule: &Schedule, path: &Path) -> Result<Self, LogError> {
        self.events = planned_events(scenario, schedule).into();
        let manifest = Manifest::new(scenario);
        self.log = Some(RunLogWriter::create_result(
            path,
            &manifest,
            Compression::default(),
        )?);
        Ok(self)
    }
}

impl TickSink for Judge {
    type Error = LogError;

    fn wants(&self, topic: Topic) -> bool {
        self.log.is_some() || JUDGED.contains(&topic)
    }

    #[inline]
    fn sample(&mut self, topic: Topic, bytes: &[u8]) -> Result<(), LogError> {
        match &mut self.log {
            None => self.judge(topic, bytes),
            Some(log) => {
                log.write(topic, bytes)?;
                if JUDGED.contains(&topic) {
                    self.judge(topic, bytes);
                }
            }
        }
        Ok(())
    }

    #[inline]
    fn end_tick(&mut self, tick: u64) -> Result<ControlFlow<()>, LogError> {
        if tick == self.digest_tick {
            self.digest_tick += self.ticks_a_second;
        }
        self.tick = tick + 1;
        if let Some(log) = &mut self.log {
            // Events are the last topic of a tick.
            while let Some(event) = self.events.pop_front_if(|event| event.header.tick <= tick) {
                log.write(Topic::RunEvent, event.as_bytes())?;
            }
            log.end_tick(tick)?;
        }
        let has_failed = self.has_failed.as_ref().is_some_and(|has_failed| has_failed());
        Ok(if has_failed || self.summary.loss().is_some() {
            ControlFlow::Break(())
        } else {
            ControlFlow::Continue(())
        })
    }
}

impl Energy {
    #[inline]
    fn add(&mut self, share: f64) {
        let share = share.max(0.0);
        self.sum += share * share.sqrt();
        self.samples += 1;
    }

    #[expect(clippy::cast_precision_loss, reason = "no flight has 2^53 samples")]
    fn mean(self) -> Option<f64> {
        (self.samples > 0).then(|| self.sum / self.samples as f64)
    }
}

/// The caller's controller, which replaces the scenario's.
pub struct OwnController {
    /// Name in the judged scenario.
    pub name: String,
    pub service: Box<dyn ErasedService>,
    /// Returns whether the controller has failed, which ends the flight.
    pub has_failed: Box<dyn Fn() -> bool>,
}

/// Flies a sample with an entry's settings. Returns `None` if the flight was interrupted.
///
/// # Errors
/// [`SweepError`] if the sweep is invalid.
pub fn fly(
    plan: &Plan,
    sample: &Sample,
    entry: &Entry,
    interrupt: &Interrupt,
) -> Result<Option<Flown>, SweepError> {
    fly_as(plan, sample, entry, None, None, interrupt)
}

/// As [`fly`], and records the flight in a log.
///
/// # Errors
/// [`SweepError`] if the sweep is invalid, or the log cannot be written.
pub fn fly_recorded(
    plan: &Plan,
    sample: &Sample,
    entry: &Entry,
    log: &Path,
    interrupt: &Interrupt,
) -> Result<Option<Flown>, SweepError> {
    fly_as(plan, sample, entry, Some(log), None, interrupt)
}

/// As [`fly`], with the caller's controller if the entry has one. Returns `None` also if that controller failed.
///
/// # Errors
/// [`SweepError`] if the sweep is invalid.
pub fn fly_own(
    plan: &Plan,
    sample: &Sample,
    entry: &Entry,
    own: Option<OwnController>,
    interrupt: &Interrupt,
) -> Result<Option<Flown>, SweepError> {
    fly_as(plan, sample, entry, None, own, interrupt)
}

fn fly_as(
    plan: &Plan,
    sample: &Sample,
    entry: &Entry,
    log: Option<&Path>,
    own: Option<OwnController>,
    interrupt: &Interrupt,
) -> Result<Option<Flown>, SweepError> {
    if let Some(identity) = entry.own.as_ref().filter(|_| own.is_none()) {
        return Err(SweepError::bad_input(format!(
            "`{}` is a controller of another program, {identity}: fly it from that program, such as by `gerono.sweep` in Python",
            entry.name
        )));
    }
    if let Some(unmet) = &sample.unmet {
        return Ok(Some(refused(format!("it does not meet `{unmet}`"))));
    }
    let mut scenario = match plan.scenario(sample, entry) {
        Ok(scenario) => scenario,
        Err(error) if error.is_of_values() => return Ok(Some(refused(one_line(&format!("{error:#}"))))),
        Err(error) => return Err(error.into()),
    };
    plan.check_files(&scenario, entry)?;
    if let Some(own) = &own {
        if scenario.has_plugin(ServiceId::Controller) {
            return Err(SweepError::bad_input(format!(
                "the plug-in of sample {} and `{}` cannot both fly: remove `plugins.controller`",
                sample.index, own.name
            )));
        }
        scenario.programs = Some(Programs::own_controller(own.name.clone()));
    }
    let schedule = match ::flight::schedule_of(&scenario) {
        Ok(schedule) => schedule,
        Err(error) => return Ok(Some(refused(one_line(&error.to_string())))),
    };
    let mut judge = Judge::new(&scenario, &schedule);
    if let Some(log) = log {
        judge = judge
            .recorded(&scenario, &schedule, log)
            .map_err(SweepError::not_written)?;
    }
    let ending = match own {
        None => in_process::fly(&scenario, &mut judge, interrupt),
        Some(own) => {
            judge.has_failed = Some(own.has_failed);
            in_process::fly_with(&scenario, Some(own.service), &mut judge, interrupt)
        }
    };
    let outcome = match ending {
        Ok(ending) => ending.outcome,
        // A plug-in may refuse a sample as the checks of the scenario do.
        Err(FlightFailure::Refused(reason)) => return Ok(Some(refused(one_line(&reason.to_string())))),
        Err(failure) => return Err(failure.into()),
    };
    if judge.has_failed.as_ref().is_some_and(|has_failed| has_failed()) {
        return Ok(None);
    }
    if let Some(log) = judge.log.take() {
        log.finish().map_err(SweepError::not_written)?;
    }
    flown(judge, outcome)
}

fn flown(judge: Judge, ending: HostOutcome<FlightFailure>) -> Result<Option<Flown>, SweepError> {
    let facts = match ending {
        HostOutcome::Interrupted { .. } => return Ok(None),
        HostOutcome::Failed(FlightFailure::Log(error)) => return Err(SweepError::not_written(error)),
        ending => ending.facts(FlightFailure::not_finite_at),
    };
    let summary = judge.summary.finish(facts);
    let outcome = Outcome::from(summary.run.outcome);
    let mut reason = summary.run.reason.clone();
    if outcome == Outcome::Failed {
        reason = one_line(&reason);
    }
    Ok(Some(Flown {
        outcome,
        reason,
        energy: judge.energy.mean(),
        steps: judge.energy.samples,
        digest: hex(&judge.digest.finalize()),
        summary: Some(summary),
    }))
}

fn refused(reason: String) -> Flown {
    Flown {
        outcome: Outcome::Refused,
        reason,
        summary: None,
        energy: None,
        digest: String::new(),
        steps: 0,
    }
}

/// Returns a message on one line, without the marks that point into the text.
fn one_line(text: &str) -> String {
    let words = text
        .split_whitespace()
        .filter(|word| word.chars().any(char::is_alphanumeric));
    words.collect::<Vec<_>>().join(" ")
}
