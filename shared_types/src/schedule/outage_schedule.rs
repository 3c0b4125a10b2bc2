//! Outage schedule: the ticks of a rate without those of planned outages.

use std::sync::Arc;

use super::Rate;

/// Planned ticks at which a service does not step.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Outage {
    /// First tick of the outage.
    pub from: u64,
    /// First tick after the outage; [`u64::MAX`] if it never ends.
    pub until: u64,
    /// Kind of the outage.
    pub fate: OutageKind,
}

/// Kind of a planned outage of a service.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum OutageKind {
    /// The service does not step, and continues afterwards as if no time had passed.
    Frozen,
    /// Its process dies; another one continues from the last state.
    Dies,
    /// Its process dies; another one makes a cold start.
    DiesAndForgets,
}

/// Ticks of a rate at which a service, or its samples, are present.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct OutageSchedule {
    /// The rate without outages.
    pub rate: Rate,
    /// In order of time, without overlap.
    outages: Arc<[Outage]>,
    /// `true` if every tick is included, as in most schedules: a fast path for queries at every tick.
    is_always: bool,
}

impl OutageSchedule {
    /// Creates the schedule of `rate` without `outages`, which are in order of time and do not overlap.
    #[must_use]
    pub fn new(rate: Rate, outages: Arc<[Outage]>) -> Self {
        Self {
            rate,
            is_always: rate == Rate::EVERY_TICK && outages.is_empty(),
            outages,
        }
    }

    /// Makes the schedule without any tick.
    #[must_use]
    pub fn never() -> Self {
        Self::new(Rate::NEVER, Arc::default())
    }

    /// Returns whether there are no outages.
    #[must_use]
    #[inline]
    pub fn is_unbroken(&self) -> bool {
        self.outages.is_empty()
    }

    /// Returns whether every tick is included.
    #[must_use]
    #[inline]
    pub fn is_always(&self) -> bool {
        self.is_always
    }

    /// Returns the outages.
    #[must_use]
    pub fn outages(&self) -> &[Outage] {
        &self.outages
    }

    /// Returns whether `tick` is one of the ticks.
    #[must_use]
    #[inline]
    pub fn occurs_at(&self, tick: u64) -> bool {
        self.is_always || self.rate.occurs_at(tick) && (self.is_unbroken() || self.outage_at(tick).is_none())
    }

    /// Returns the last of the ticks that is not after `tick`.
    #[must_use]
    #[inline]
    pub fn last_at_or_before(&self, tick: u64) -> Option<u64> {
        if self.is_always {
            return Some(tick);
        }
        let last = self.rate.last_at_or_before(tick)?;
        if self.is_unbroken() {
            Some(last)
        } else {
            self.last_present(last)
        }
    }

    #[cold]
    fn last_present(&self, mut last: u64) -> Option<u64> {
        while let Some(outage) = self.outage_at(last) {
            last = self.rate.last_at_or_before(outage.from.checked_sub(1)?)?;
        }
        Some(last)
    }

    /// Returns the first of the ticks that is not before `tick`; `None` if an outage never ends.
    #[must_use]
    #[inline]
    pub fn first_at_or_after(&self, tick: u64) -> Option<u64> {
        let Rate { period, phase } = self.rate;
        let of_rate = |tick: u64| match period {
            // Most periods are one: this avoids the division.
            1 => tick.max(phase),
            _ => phase + tick.saturating_sub(phase).next_multiple_of(period),
        };
        let mut first = of_rate(tick);
        while let Some(outage) = self.outage_at(first) {
            if outage.until == u64::MAX {
                return None;
            }
            first = of_rate(outage.until);
        }
        Some(first)
    }

    /// Returns the number of ticks before `tick`: the sequence number of an occurrence at `tick`.
    #[must_use]
    #[inline]
    pub fn count_before(&self, tick: u64) -> u64 {
        if self.is_always {
            return tick;
        }
        let count = self.rate.count_before(tick);
        if self.is_unbroken() {
            count
        } else {
            count - self.missed_before(tick)
        }
    }

    #[cold]
    fn missed_before(&self, tick: u64) -> u64 {
        let missed = self.outages.iter().map(|outage| {
            let [from, until] = [outage.from, outage.until].map(|end| self.rate.count_before(end.min(tick)));
            until - from
        });
        missed.sum()
    }

    /// Returns the outages that begin after the tick `from` and not after `until`, in the order of time.
    pub fn outages_between(&self, from: u64, until: u64) -> impl Iterator<Item = &Outage> {
        let outages = self.outages.iter();
        outages.filter(move |outage| (from + 1..=until).contains(&outage.from))
    }

    #[inline]
    fn outage_at(&self, tick: u64) -> Option<&Outage> {
        let mut outages = self.outages.iter();
        outages.find(|outage| (outage.from..outage.until).contains(&tick))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn schedule() -> impl Strategy<Value = OutageSchedule> {
        let outages = proptest::collection::btree_set(0..100u64, 0..6);
        (1..7u64, 0..9u64, outages, any::<bool>()).prop_map(|(period, phase, ends, for_ever)| {
            let ends: Vec<_> = ends.into_iter().collect();
            let mut outages: Vec<_> = ends
                .chunks_exact(2)
                .map(|pair| Outage {
                    from: pair[0],
                    until: pair[1],
                    fate: OutageKind::Frozen,
                })
                .collect();
            if let Some(last) = outages.last_mut().filter(|_| for_ever) {
                last.until = u64::MAX;
            }
            OutageSchedule::new(Rate { period, phase }, outages.into())
        })
    }

    proptest! {
        #[test]
        fn all_questions_agree_with_a_look_at_every_tick(schedule in schedule(), tick in 0..120u64) {
            let is_there = |tick: &u64| {
                let is_out = schedule.outages().iter().any(|outage| (outage.from..outage.until).contains(tick));
                schedule.rate.occurs_at(*tick) && !is_out
            };
            prop_assert_eq!(schedule.occurs_at(tick), is_there(&tick));
            prop_assert_eq!(schedule.last_at_or_before(tick), (0..=tick).rev().find(is_there));
            let first = (tick..200).find(is_there);
            prop_assert_eq!(schedule.first_at_or_after(tick), first);
            prop_assert_eq!(schedule.count_before(tick), (0..tick).filter(is_there).count() as u64);
        }
    }
}
