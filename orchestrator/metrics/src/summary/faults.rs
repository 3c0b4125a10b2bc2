//! Report on a planned fault: the detecting service, the maximum error, the time of recovery, and the reactions of the
//! services.
//!
//! All of it follows from the samples: the services have no information on planned faults.

mod receiver;
mod record;
mod signs;
mod table;

use std::borrow::Cow;
use std::sync::Arc;

use scenario::Scenario;
use serde::{Deserialize, Serialize};
use shared_types::samples::{PathReference, RunEvent};
use shared_types::schedule::OperatorPlan;
use shared_types::service::{header_of, nanoseconds};
use shared_types::{FlightPhase, Schedule, ServiceId, Topic};

use crate::loss::Loss;
use crate::tracker::Moment;
use crate::view;
pub use receiver::ReceiverFault;
use record::FaultRecord;
use signs::Observers;
pub use signs::{OrdinarySigns, OrdinaryWatch, Reactions};
pub(super) use table::faults_in_words;

/// Time before a fault whose maximum error is the bound for the recovery, s.
pub const BEFORE: f64 = 5.0;

/// Time by which the event of a request may be apart from the landing that it begins, s.
const APART: f64 = 0.1;

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
    ordinary: Arc<OrdinarySigns>,
    phase: Option<FlightPhase>,
    /// First tick of that phase.
    phase_from: u64,
    /// Tick of the operator's newest request to land.
    request: Option<u64>,
    /// First tick of a landing by the operator's cause of which no request is known.
    unasked: Option<u64>,
    /// The planned requests.
    planned: OperatorPlan,
    /// Ticks by which the event of a request may be apart from its effect.
    apart: u64,
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
            ordinary: Arc::default(),
            phase: None,
            phase_from: 0,
            request: None,
            unasked: None,
            planned: schedule.operator(),
            apart: nanoseconds(APART) / schedule.tick_ns(),
            last_tick: None,
        }
    }

    /// Ignores the signs that the same flight has without a fault.
    #[must_use]
    pub fn beside(self, ordinary: Arc<OrdinarySigns>) -> Self {
        Self { ordinary, ..self }
    }

    /// Adds a sample; call in the order of the log.
    #[inline]
    pub fn observe(&mut self, topic: Topic, bytes: &[u8]) {
        let tick = header_of(bytes).tick;
        self.last_tick = self.last_tick.max(Some(tick));
        match topic {
            Topic::PathReference => view(bytes, |reference| self.observe_phase(reference)),
            Topic::RunEvent => view(bytes, |event| self.observe_event(event)),
            _ => {}
        }
        if let Some(look) = self.observers.look(topic, bytes) {
            let look = self.ordinary.without(tick, look);
            for record in &mut self.records {
                record.observe_look(tick, &look);
            }
        }
    }

    /// Ends the figures of the faults before a landing that begins.
    fn observe_phase(&mut self, reference: &PathReference) {
        let phase = FlightPhase::from_code(reference.phase);
        let before = self.phase.replace(phase);
        if before == Some(phase) {
            return;
        }
        let tick = reference.header.tick;
        let since = std::mem::replace(&mut self.phase_from, tick);
        if phase == FlightPhase::Land && before.is_some() {
            let is_operators = reference.cause == PathReference::CAUSE_OPERATOR_LANDS;
            let is_asked = self.planned.at(tick).land
                || self.request.is_some_and(|request| request + self.apart >= since);
            // The same cause has a landing without an orchestrator, which has no event.
            self.unasked = (is_operators && !is_asked).then_some(tick);
            let is_requested = reference.cause == PathReference::CAUSE_NONE || (is_operators && is_asked);
            for record in &mut self.records {
                record.observe_landing(tick, is_requested);
            }
        }
    }

    /// Adds a request to land, which may be recorded after the landing has begun.
    fn observe_event(&mut self, event: &RunEvent) {
        if event.kind != RunEvent::KIND_OPERATOR_LANDS {
            return;
        }
        let tick = event.header.tick;
        self.request = Some(tick);
        let is_near = |landing: &mut u64| tick <= *landing + self.apart;
        if let Some(landing) = self.unasked.take_if(is_near) {
            for record in &mut self.records {
                record.observe_late_request(landing);
            }
        }
    }

    /// Returns whether a fault has made the vehicle land, without a request.
    #[must_use]
    pub fn lands(&self) -> bool {
        self.records.iter().any(FaultRecord::lands)
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
