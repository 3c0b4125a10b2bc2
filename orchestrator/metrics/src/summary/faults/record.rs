//! A planned fault while it is flown.

use shared_types::service::{nanoseconds, seconds};
use shared_types::{FlightPhase, Schedule};

use super::signs::{Look, Tally};
use super::{BEFORE, Detection, FaultReport, PlannedFault};
use crate::SETTLED;

/// The record of a fault.
#[derive(Clone, Debug)]
pub(super) struct FaultRecord {
    fault: PlannedFault,
    /// First tick at which the error counts as that before the fault.
    before_tick: u64,
    /// End of the observation, first tick after it.
    watched_until: u64,
    tick_ns: u64,
    detection: Option<Detection>,
    largest_before: f64,
    peak: Option<f64>,
    /// Maximum ratio of the distance to its bound.
    largest_share: f64,
    /// Tick since which the error has been within the bound after the fault.
    inside_since: Option<u64>,
    /// First tick of a landing that was not requested, after the fault's begin.
    landing_from: Option<u64>,
    /// The newest landing of which no request is known.
    unasked: Option<Unasked>,
    tally: Tally,
}

/// A landing that nothing has requested so far, with what was known before it.
#[derive(Clone, Debug)]
struct Unasked {
    tick: u64,
    landing_from: Option<u64>,
    detection: Option<Detection>,
    tally: Tally,
}

impl FaultRecord {
    pub(super) fn new(fault: PlannedFault, watched_until: u64, schedule: &Schedule) -> Self {
        let before_ticks = nanoseconds(BEFORE) / schedule.tick_ns();
        Self {
            before_tick: fault.from.saturating_sub(before_ticks),
            watched_until,
            tick_ns: schedule.tick_ns(),
            detection: None,
            largest_before: 0.0,
            peak: None,
            largest_share: 0.0,
            inside_since: None,
            landing_from: None,
            unasked: None,
            tally: Tally::default(),
            fault,
        }
    }

    pub(super) fn begins_by(&self, tick: u64) -> bool {
        self.fault.from <= tick
    }

    /// Takes the distance from the path (m) at a tick into account, and what it comes to there without the fault, if that
    /// is known. Only on the path the vehicle can be back. From a landing on distances do not count: it leaves the path by
    /// intent, and on the ground the reference sinks below the vehicle.
    #[inline]
    pub(super) fn observe_error(
        &mut self,
        tick: u64,
        phase: FlightPhase,
        error: f64,
        undisturbed: Option<f64>,
    ) {
        if tick < self.fault.from {
            if tick >= self.before_tick {
                self.largest_before = self.largest_before.max(error);
            }
        } else if tick < self.watched_until.min(self.landing_from.unwrap_or(u64::MAX)) {
            self.peak = Some(self.peak.unwrap_or(0.0).max(error));
            let is_over = self.fault.until.is_some_and(|until| tick >= until);
            let bound = self.bound().max(undisturbed.unwrap_or(0.0));
            self.largest_share = self.largest_share.max(error / bound);
            let is_inside = is_over && error <= bound && phase == FlightPhase::Fly;
            self.inside_since = is_inside.then(|| self.inside_since.unwrap_or(tick));
        }
    }

    /// Adds the begin of a landing. A requested one ends the observation; one that the fault may have caused is part of what
    /// the services did.
    pub(super) fn observe_landing(&mut self, tick: u64, is_requested: bool) {
        if (self.fault.from + 1..self.watched_until).contains(&tick) {
            if is_requested {
                self.watched_until = tick;
            } else {
                self.unasked = Some(Unasked {
                    tick,
                    landing_from: self.landing_from,
                    detection: self.detection.clone(),
                    tally: self.tally,
                });
                self.landing_from.get_or_insert(tick);
            }
        }
    }

    /// Ends the observation at a landing whose request is recorded after it.
    pub(super) fn observe_late_request(&mut self, landing: u64) {
        if let Some(before) = self.unasked.take_if(|unasked| unasked.tick == landing) {
            self.watched_until = landing;
            self.landing_from = before.landing_from;
            self.detection = before.detection;
            self.tally = before.tally;
        }
    }

    /// Returns whether a landing that was not requested has begun since the fault.
    pub(super) fn lands(&self) -> bool {
        self.landing_from.is_some()
    }

    /// Adds the sign of a sample.
    #[inline]
    pub(super) fn observe_look(&mut self, tick: u64, look: &Look) {
        if (self.fault.from..self.watched_until).contains(&tick) {
            self.tally.add(look);
            if let (None, Some((service, sign))) = (&self.detection, look.sign) {
                self.detection = Some(Detection::new(self.time_since_begin(tick), service, sign));
            }
        }
    }

    /// Returns the report for a flight up to `last_tick`.
    pub(super) fn finish(&self, last_tick: u64, schedule: &Schedule) -> FaultReport {
        let time = |tick| seconds(schedule.time_ns(tick));
        let PlannedFault { words, from, until } = &self.fault;
        let reactions = self.tally.finish(schedule);
        FaultReport {
            fault: words.clone(),
            begins: time(*from),
            ends: until.map(time),
            outage: self.time_since_begin(until.unwrap_or(last_tick).min(last_tick)),
            watched_until: time(
                self.watched_until
                    .min(last_tick)
                    .min(self.landing_from.unwrap_or(u64::MAX)),
            ),
            lands: self.lands(),
            detection: self.detection.clone(),
            bound: self.bound(),
            peak_error: self.peak,
            largest_share: self.peak.map(|_| self.largest_share),
            back_after: self
                .inside_since
                .zip(*until)
                .map(|(since, until)| seconds((since - until) * self.tick_ns)),
            others: reactions.to_string(),
            reactions,
        }
    }

    fn bound(&self) -> f64 {
        self.largest_before.max(SETTLED)
    }

    fn time_since_begin(&self, tick: u64) -> f64 {
        seconds((tick - self.fault.from) * self.tick_ns)
    }
}
