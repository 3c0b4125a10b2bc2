//! Report on a planned fault: the detecting service, the maximum error, the time of recovery, and the reactions of the
//! services.
//!
//! All of it follows from the samples: the services have no information on planned faults.

mod receiver;
mod record;
mod signs;
mod table;

use std::borrow::Cow;

use scenario::Scenario;
use serde::{Deserialize, Serialize};
use shared_types::samples::PathReference;
use shared_types::service::header_of;
use shared_types::{FlightPhase, Schedule, ServiceId, Topic};

use crate::loss::Loss;
use crate::tracker::Moment;
use crate::view;
pub use receiver::ReceiverFault;
use record::FaultRecord;
use signs::Observers;
pub use signs::Reactions;
pub(super) use table::faults_in_words;

/// Time before a fault whose maximum error is the bound for the recovery, s.
pub const BEFORE: f64 = 5.0;

/// A fault as planned.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PlannedFault {
    /// Target and effect, in words.
    pub words: String,
    /// First tick.
    pub from: u64,
    /// First tick after the fault; `None` if permanent.
    pub until: Option<u64>,
}

/// The effect of a planned fault.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct FaultReport {
    /// Target and effect, in words.
    pub fault: String,
    /// Time at which it began, s.
    pub begins: f64,
    /// End, s; `None` if permanent.
    pub ends: Option<f64>,
    /// Duration, s, at most to the end of the flight.
    pub outage: f64,
    /// End of the observation, s: the next planned event, a landing, or the end of the flight.
    pub watched_until: f64,
    /// `true` if the vehicle was made to land by something else than a request, such as a limit of the envelope.
    #[serde(default)]
    pub lands: bool,
    /// First sign of a detection by a service, if any.
    pub detection: Option<Detection>,
    /// Bound of the error for the recovery, m: the maximum within [`BEFORE`] of the fault, at least
    /// [`SETTLED`](crate::SETTLED).
    pub bound: f64,
    /// Maximum distance from the path since the beginning of the fault, before a landing, m; `None` if unknown.
    pub peak_error: Option<f64>,
    /// Maximum ratio of the distance to its bound. The bound is larger where the undisturbed flight is farther from the path.
    pub largest_share: Option<f64>,
    /// Recovery time from the end of the fault, s: the error stayed within the bound from then on. `None` without recovery,
    /// or if the end was not observed.
    pub back_after: Option<f64>,
    /// The reactions of the services.
    pub reactions: Reactions,
    /// The same in words.
    pub others: String,
}

/// First sign of the detection of a fault by a service.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Detection {
    /// Time since the beginning of the fault, s.
    pub after: f64,
    /// Name of the service.
    pub by: Cow<'static, str>,
    /// The sign.
    pub sign: Cow<'static, str>,
}

impl FaultReport {
    /// Returns whether the end of the fault was observed.
    #[must_use]
    pub fn is_over(&self) -> bool {
        self.ends.is_some_and(|ends| ends < self.watched_until)
    }
}

impl PlannedFault {
    /// Returns the planned faults of a scenario, in the order of time.
    #[must_use]
    pub fn all(scenario: &Scenario) -> Vec<Self> {
        let of_edges_and_services = scenario.fault.iter().map(|fault| Self {
            words: fault.to_string(),
            from: scenario.tick_of(fault.at),
            until: fault.lasts.map(|lasts| scenario.tick_of(fault.at + lasts)),
        });
        let of_receiver = ReceiverFault::all(scenario).into_iter().map(|fault| Self {
            from: scenario.tick_of(fault.at),
            until: fault.until.map(|until| scenario.tick_of(until)),
            words: fault.words,
        });
        let mut faults: Vec<_> = of_edges_and_services.chain(of_receiver).collect();
        faults.sort_by_key(|fault| fault.from);
        faults
    }
}

/// Running observation of the faults of a flight, in constant memory.
#[derive(Clone, Debug)]
pub struct FaultWatch {
    records: Vec<FaultRecord>,
    observers: Observers,
    phase: Option<FlightPhase>,
    last_tick: Option<u64>,
}

impl FaultWatch {
    /// Makes the observation of these faults, in the order of time. `changes` are the ticks of other changes, which end the
    /// observation of a fault.
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
            phase: None,
            last_tick: None,
        }
    }

    /// Adds a sample; call in the order of the log.
    #[inline]
    pub fn observe(&mut self, topic: Topic, bytes: &[u8]) {
        let tick = header_of(bytes).tick;
        self.last_tick = self.last_tick.max(Some(tick));
        if topic == Topic::PathReference {
            view(bytes, |reference| self.observe_phase(reference));
        }
        if let Some(look) = self.observers.look(topic, bytes) {
            for record in &mut self.records {
                record.observe_look(tick, &look);
            }
        }
    }

    /// Ends the figures of the faults before a landing that begins.
    fn observe_phase(&mut self, reference: &PathReference) {
        let phase = FlightPhase::from_code(reference.phase);
        let before = self.phase.replace(phase);
        if phase == FlightPhase::Land && before.is_some_and(|before| before != phase) {
            let is_requested = matches!(
                reference.cause,
                PathReference::CAUSE_NONE | PathReference::CAUSE_OPERATOR_LANDS
            );
            for record in &mut self.records {
                record.observe_landing(reference.header.tick, is_requested);
            }
        }
    }

    /// Returns the reports on the flown faults. A lost vehicle does not recover.
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

    /// Adds the distance at a moment, and that near the moment in the undisturbed flight (m), if known.
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
        Self {
            after,
            by: by.name().into(),
            sign: sign.into(),
        }
    }
}

#[cfg(test)]
mod tests;
