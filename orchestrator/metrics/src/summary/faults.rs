//! The report on a planned fault: which service noticed it, how far the vehicle strayed, when it was back, how the
//! services reacted.
//!
//! All of it is seen in the samples alone: nobody tells the services that a fault is planned.

mod record;
mod signs;
mod table;

use scenario::Scenario;
use serde::Serialize;
use shared_types::service::header_of;
use shared_types::{Schedule, ServiceId, Topic};

use crate::loss::Loss;
use crate::tracker::Moment;
use record::FaultRecord;
use signs::Observers;
pub use signs::Reactions;
pub(super) use table::faults_in_words;

/// Time for which before a fault the error is looked at, s: its largest value there is what the vehicle must come back to.
pub const BEFORE: f64 = 5.0;

/// A fault as planned.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PlannedFault {
    /// Target and effect, in words.
    pub words: String,
    /// First tick.
    pub from: u64,
    /// First tick after it; none if it is for good.
    pub until: Option<u64>,
}

/// The effect of a planned fault.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct FaultReport {
    /// Target and effect, in words.
    pub fault: String,
    /// Time at which it began, s.
    pub begins: f64,
    /// Time at which it ended, s; none if it was for good.
    pub ends: Option<f64>,
    /// Its length, s; to the end of what was flown, if it had not ended by then.
    pub outage: f64,
    /// Until when the vehicle could come back: to the begin of the next fault, the next change of the vehicle, the begin of
    /// a landing or the end of what was flown, s.
    pub watched_until: f64,
    /// The first sign that a service had noticed; none if there was none.
    pub detection: Option<Detection>,
    /// The bound that the error must come back to, m: its largest value in the [`BEFORE`] of the fault, or
    /// [`SETTLED`](crate::SETTLED) if that is larger.
    pub bound: f64,
    /// Largest distance from the path from its begin on, m; none if nothing is known of it.
    pub peak_error: Option<f64>,
    /// The largest that the distance was as a share of its bound, which is larger where the undisturbed flight is known to
    /// be farther from the path.
    pub largest_share: Option<f64>,
    /// Time from its end after which the error stayed within the bound, s; none if it did not, or if the end was
    /// not seen.
    pub back_after: Option<f64>,
    /// The reactions of the services.
    pub reactions: Reactions,
    /// The same in words.
    pub others: String,
}

/// The first sign that a service had noticed a fault.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Detection {
    /// Time from the fault's begin, s.
    pub after: f64,
    /// Name of the service.
    pub by: &'static str,
    /// The sign.
    pub sign: &'static str,
}

impl FaultReport {
    /// Returns whether the end of the fault was seen.
    #[must_use]
    pub fn is_over(&self) -> bool {
        self.ends.is_some_and(|ends| ends <= self.watched_until)
    }
}

impl PlannedFault {
    /// The faults that a scenario plans, in the order of time.
    #[must_use]
    pub fn all(scenario: &Scenario) -> Vec<Self> {
        let mut faults: Vec<_> = scenario
            .fault
            .iter()
            .map(|fault| Self {
                words: fault.to_string(),
                from: scenario.tick_of(fault.at),
                until: fault.lasts.map(|lasts| scenario.tick_of(fault.at + lasts)),
            })
            .collect();
        faults.sort_by_key(|fault| fault.from);
        faults
    }
}

/// Watches the faults of a flight while it flies, in constant memory.
#[derive(Clone, Debug)]
pub struct FaultWatch {
    records: Vec<FaultRecord>,
    observers: Observers,
    last_tick: Option<u64>,
}

impl FaultWatch {
    /// For a flight with these faults, in the order of time, and these ticks at which something else changes: what comes
    /// after is not the fault's doing.
    #[must_use]
    pub fn new(faults: Vec<PlannedFault>, changes: &[u64], schedule: &Schedule) -> Self {
        let begins: Vec<u64> = faults.iter().map(|fault| fault.from).collect();
        let next = |from: u64| {
            let happenings = begins.iter().chain(changes).copied();
            happenings.filter(|&begin| begin > from).min()
        };
        let records = faults
            .into_iter()
            .map(|fault| {
                let watched_until = next(fault.from).unwrap_or(u64::MAX);
                FaultRecord::new(fault, watched_until, schedule)
            })
            .collect();
        Self {
            records,
            observers: Observers::default(),
            last_tick: None,
        }
    }

    /// Takes a sample into account; they come in the order of the log.
    #[inline]
    pub fn observe(&mut self, topic: Topic, bytes: &[u8]) {
        let tick = header_of(bytes).tick;
        self.last_tick = self.last_tick.max(Some(tick));
        if let Some(look) = self.observers.look(topic, bytes) {
            for record in &mut self.records {
                record.observe_look(tick, &look);
            }
        }
    }

    /// Returns the effects of the faults, as far as they were flown. A vehicle that was lost does not come back.
    #[must_use]
    pub fn finish(&self, schedule: &Schedule, lost: Option<&Loss>) -> Vec<FaultReport> {
        let Some(last_tick) = self.last_tick else {
            return Vec::new();
        };
        let flown = self.records.iter();
        flown
            .filter(|record| record.begins_by(last_tick))
            .map(|record| record.finish(last_tick, schedule))
            .map(|report| {
                let is_lost = lost.is_some_and(|loss| loss.time <= report.watched_until);
                FaultReport {
                    back_after: report.back_after.filter(|_| !is_lost),
                    ..report
                }
            })
            .collect()
    }

    /// Takes a moment into account: how far the vehicle was from its path, and how far (m) it is near that moment without
    /// the faults, if that is known.
    #[inline]
    pub fn observe_moment(&mut self, moment: &Moment, undisturbed: Option<f64>) {
        if let Some((distance, path)) = moment.distance.zip(moment.path) {
            for record in &mut self.records {
                record.observe_error(moment.vehicle.tick, path.phase, distance, undisturbed);
            }
        }
    }
}

impl Detection {
    fn new(after: f64, by: ServiceId, sign: &'static str) -> Self {
        let by = by.name();
        Self { after, by, sign }
    }
}

#[cfg(test)]
mod tests;
