//! Edge: an input of a service with the due sample at each step, planned faults included.

use std::sync::Arc;

use super::{Corruption, EdgeFault, EdgeFaultKind, OutageSchedule};
use crate::wiring::Topic;

/// Input of a service in the schedule.
#[derive(Clone, Debug, PartialEq)]
pub struct Edge {
    /// Topic of the input.
    pub topic: Topic,
    /// Transport latency, ticks.
    pub latency: u64,
    pub(super) published: OutageSchedule,
    pub(super) consumed: OutageSchedule,
    /// In order of time, without overlap.
    pub(super) faults: Arc<[EdgeFault]>,
}

impl Edge {
    /// Returns the tick of the sample that is due at `tick`; `None` before the first.
    #[must_use]
    #[inline]
    pub fn due_sample(&self, tick: u64) -> Option<u64> {
        if self.has_faults() {
            return self.due_among_faults(tick);
        }
        self.published_by(tick)
    }

    /// Returns the tick of the sample that would be due at `tick` without faults of the edge; `None` before the first.
    #[must_use]
    #[inline]
    pub fn published_by(&self, tick: u64) -> Option<u64> {
        self.published.last_at_or_before(tick.checked_sub(self.latency)?)
    }

    /// Returns the sequence number of the sample that is published at `tick`, or else of the first after it.
    #[must_use]
    #[inline]
    pub fn sequence_number(&self, tick: u64) -> u64 {
        self.published.count_before(tick)
    }

    /// Returns whether the sample `due` at `tick` was not yet due at the consumer's previous step.
    #[must_use]
    #[inline]
    pub fn is_fresh(&self, tick: u64, due: u64) -> bool {
        // With a sample at every tick, every step gets a new one.
        if self.published.is_always() && !self.has_faults() {
            return true;
        }
        let previous = self.step_before(tick);
        previous.is_none_or(|previous| self.due_sample(previous) != Some(due))
    }

    /// Returns whether a fault of the edge is planned.
    #[must_use]
    #[inline]
    pub fn has_faults(&self) -> bool {
        !self.faults.is_empty()
    }

    /// Returns the planned faults.
    #[must_use]
    pub fn faults(&self) -> &[EdgeFault] {
        &self.faults
    }

    /// Returns the corruption of the sample that was published at `due`, if there is one.
    #[must_use]
    pub fn corruption(&self, due: u64) -> Option<&Corruption> {
        match self.fault_at(due + self.latency).map(|fault| &fault.kind) {
            Some(EdgeFaultKind::Altered(corruption)) => Some(corruption),
            _ => None,
        }
    }

    /// Returns the tick of the sample whose content replaces that of the one published at `due`, if a fault does so:
    /// the sample that was due at the consumer's last step before the fault.
    #[must_use]
    pub fn repeated_by(&self, due: u64) -> Option<u64> {
        let fault = self.fault_at(due + self.latency)?;
        let EdgeFaultKind::Altered(Corruption::Repeated) = fault.kind else {
            return None;
        };
        self.due_sample(self.step_before(fault.from)?)
    }

    /// Returns the ticks of samples before `due` whose contents are repeated when `due` is due or later. Some may
    /// precede the first sample that repeats them, if the last one before the fault arrived too late for a step.
    pub fn needed_again(&self, due: u64) -> impl Iterator<Item = u64> {
        let repeating = self.faults.iter().filter(move |fault| {
            matches!(fault.kind, EdgeFaultKind::Altered(Corruption::Repeated))
                && fault.until > due + self.latency
        });
        repeating
            .filter_map(|fault| self.due_sample(self.step_before(fault.from)?))
            .filter(move |&repeated| repeated < due)
    }

    /// Returns the tick of the oldest sample that is needed when the one of tick `due` is due, and later.
    #[must_use]
    pub fn oldest_needed(&self, due: u64) -> u64 {
        self.needed_again(due).fold(due, u64::min)
    }

    /// Returns whether the sample that was published at `tick` never arrives.
    #[must_use]
    pub fn is_lost(&self, tick: u64) -> bool {
        match self.fault_at(tick + self.latency).map(|fault| &fault.kind) {
            Some(EdgeFaultKind::Lost(loss)) => loss.loses(tick),
            _ => false,
        }
    }

    /// Returns the ticks of samples that may be needed long after later ones were published.
    #[must_use]
    pub fn remembered(&self) -> Vec<u64> {
        let faults = self.faults.iter();
        let ticks = faults.filter_map(|fault| match &fault.kind {
            EdgeFaultKind::Late(_) => None,
            EdgeFaultKind::Lost(_) => self.due_sample(fault.from.checked_sub(1)?),
            EdgeFaultKind::Altered(_) => self.due_sample(self.step_before(fault.from)?),
        });
        ticks.collect()
    }

    /// Returns the maximum number of consecutive lost samples in a flight that ends with `last_tick`, except in faults
    /// that lose all.
    #[must_use]
    pub fn longest_loss(&self, last_tick: u64) -> u64 {
        let lossy = self.faults.iter().filter_map(|fault| match &fault.kind {
            EdgeFaultKind::Lost(loss) if !loss.is_total() => Some((fault, loss)),
            _ => None,
        });
        let runs = lossy.map(|(fault, loss)| {
            let arrivals = fault.from..fault.until.min(last_tick + 1);
            let published = arrivals.filter_map(|tick| tick.checked_sub(self.latency));
            let (mut run, mut longest) = (0, 0);
            for tick in published.filter(|&tick| self.published.occurs_at(tick)) {
                run = if loss.loses(tick) { run + 1 } else { 0 };
                longest = run.max(longest);
            }
            longest
        });
        runs.max().unwrap_or_default()
    }

    /// Returns the first tick of a sample that may still become due after `tick`.
    #[must_use]
    pub fn first_to_come(&self, tick: u64) -> u64 {
        let late = self.faults.iter().map(EdgeFault::ticks_late).max();
        tick.saturating_sub(self.latency + late.unwrap_or_default())
    }

    /// Returns the newest sample that has arrived at `tick`, of those that arrive at all.
    fn due_among_faults(&self, tick: u64) -> Option<u64> {
        let mut arrived_by = tick;
        loop {
            let sample = self
                .published
                .last_at_or_before(arrived_by.checked_sub(self.latency)?)?;
            let arrival = sample + self.latency;
            let Some(fault) = self.fault_at(arrival) else {
                return Some(sample);
            };
            // The next candidate.
            arrived_by = match &fault.kind {
                EdgeFaultKind::Altered(_) => return Some(sample),
                EdgeFaultKind::Late(by) if arrival + by <= tick => return Some(sample),
                EdgeFaultKind::Late(by) => match tick.checked_sub(*by) {
                    Some(in_time) if in_time >= fault.from => in_time,
                    _ => fault.from.checked_sub(1)?,
                },
                EdgeFaultKind::Lost(loss) if loss.is_total() => fault.from.checked_sub(1)?,
                EdgeFaultKind::Lost(loss) if loss.loses(sample) => arrival.checked_sub(1)?,
                EdgeFaultKind::Lost(_) => return Some(sample),
            };
        }
    }

    fn fault_at(&self, tick: u64) -> Option<&EdgeFault> {
        self.faults.iter().find(|fault| fault.is_on(tick))
    }

    fn step_before(&self, tick: u64) -> Option<u64> {
        self.consumed.last_at_or_before(tick.checked_sub(1)?)
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::super::{Draws, Loss, Rate};
    use super::*;

    fn fault() -> impl Strategy<Value = EdgeFaultKind> {
        let draws = Draws { seed: 1, edge: 2 };
        prop_oneof![
            (1..30u64).prop_map(EdgeFaultKind::Late),
            prop_oneof![Just(1.0), 0.1..1.0]
                .prop_map(move |fraction| EdgeFaultKind::Lost(Loss { fraction, draws })),
            Just(EdgeFaultKind::Altered(Corruption::Repeated)),
        ]
    }

    prop_compose! {
        fn edge()(
            rates in [(1..7u64, 0..9u64), (1..7, 0..9)],
            latency in 0..9u64,
            ends in proptest::collection::btree_set(0..100u64, 0..6),
            kinds in [fault(), fault(), fault()],
        ) -> Edge {
            let [published, consumed] =
                rates.map(|(period, phase)| OutageSchedule::new(Rate { period, phase }, Arc::default()));
            let ends: Vec<_> = ends.into_iter().collect();
            let faults = ends
                .chunks_exact(2)
                .zip(kinds)
                .map(|(ends, kind)| EdgeFault { from: ends[0], until: ends[1], kind });
            Edge { topic: Topic::VehicleState, latency, published, consumed, faults: faults.collect() }
        }
    }

    /// Returns the arrival of a sample, computed sample by sample.
    fn arrival(edge: &Edge, sample: u64) -> Option<u64> {
        let undisturbed = sample + edge.latency;
        let mut faults = edge.faults().iter();
        match faults.find(|fault| (fault.from..fault.until).contains(&undisturbed)) {
            None => Some(undisturbed),
            Some(fault) => match &fault.kind {
                EdgeFaultKind::Late(by) => Some(undisturbed + by),
                EdgeFaultKind::Lost(loss) => (!loss.loses(sample)).then_some(undisturbed),
                EdgeFaultKind::Altered(_) => Some(undisturbed),
            },
        }
    }

    #[test]
    fn the_first_sample_may_be_late() {
        let every_tick = || {
            let rate = Rate { period: 1, phase: 0 };
            OutageSchedule::new(rate, Arc::default())
        };
        let late = EdgeFault {
            from: 0,
            until: 10,
            kind: EdgeFaultKind::Late(3),
        };
        let edge = Edge {
            topic: Topic::MocapPose,
            latency: 0,
            published: every_tick(),
            consumed: every_tick(),
            faults: Arc::new([late]),
        };
        let due = [0, 2, 3, 4].map(|tick| edge.due_sample(tick));
        assert_eq!(due, [None, None, Some(0), Some(1)]);
    }

    proptest! {
        #[test]
        fn the_newest_sample_that_has_arrived_is_due(edge in edge(), tick in 0..140u64) {
            let published = (0..=tick).rev().filter(|tick| edge.published.occurs_at(*tick));
            let newest = published.into_iter().find(|&sample| arrival(&edge, sample).is_some_and(|at| at <= tick));
            prop_assert_eq!(edge.due_sample(tick), newest);
        }

        #[test]
        fn no_older_sample_is_due_later(edge in edge()) {
            let due: Vec<_> = (0..140).map(|tick| edge.due_sample(tick)).collect();
            prop_assert!(due.is_sorted(), "{:?}", due);
        }

        #[test]
        fn a_sample_that_is_repeated_later_is_not_too_old_now(edge in edge(), early in 0..140u64, later in 0..140u64) {
            let (Some(now), Some(then)) = (edge.due_sample(early), edge.due_sample(early + later)) else {
                return Ok(());
            };
            let needed_then = edge.repeated_by(then).unwrap_or(then).min(then);
            prop_assert!(edge.oldest_needed(now) <= needed_then.min(now));
        }

        #[test]
        fn a_repeated_sample_was_due_before_and_is_remembered(edge in edge(), tick in 0..140u64) {
            let Some(due) = edge.due_sample(tick) else { return Ok(()) };
            prop_assert!(!edge.is_lost(due));
            if let Some(repeated) = edge.repeated_by(due) {
                prop_assert!(repeated < due || edge.latency == 0 && repeated <= due);
                prop_assert!(edge.remembered().contains(&repeated));
            }
        }
    }
}
