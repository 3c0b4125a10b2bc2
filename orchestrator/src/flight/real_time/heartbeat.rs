//! Notices services that hang: those that fly, should have stepped, and have not for too long.

use std::sync::atomic::Ordering;

use runtime::shared_page::Words;
use shared_types::schedule::Presence;
use shared_types::{Schedule, ServiceId};

/// When each service was last seen to step.
pub struct Heartbeats {
    pulses: [Pulse; ServiceId::ALL.len()],
    limit_ticks: u64,
}

struct Pulse {
    steps: Presence,
    /// 1 + the last tick that it had stepped when it was looked at last.
    steps_until: u64,
    /// The tick at which that was new, or since which the service flies.
    since: u64,
}

impl Heartbeats {
    /// Services hang that have not stepped for `limit_ticks` although they should have.
    #[must_use]
    pub fn new(schedule: &Schedule, limit_ticks: u64) -> Self {
        let pulse = |service| Pulse {
            steps: schedule.steps(service),
            steps_until: 0,
            since: 0,
        };
        Self {
            pulses: ServiceId::ALL.map(pulse),
            limit_ticks,
        }
    }

    /// Looks at the services at the beginning of tick `now`; `flies` says which are in flight. Which ones hang.
    pub fn hanging(&mut self, now: u64, words: &Words, flies: impl Fn(ServiceId) -> bool) -> Vec<ServiceId> {
        let limit = self.limit_ticks;
        let hangs = |&service: &ServiceId| {
            let steps_until = words.cells[service.index()].steps_until.load(Ordering::Relaxed);
            self.pulses[service.index()].hangs(now, steps_until, flies(service), limit)
        };
        ServiceId::ALL.into_iter().filter(hangs).collect()
    }
}

impl Pulse {
    fn hangs(&mut self, now: u64, steps_until: u64, flies: bool, limit: u64) -> bool {
        if steps_until != self.steps_until || !flies {
            self.steps_until = steps_until;
            self.since = now;
            return false;
        }
        let due = self.steps.first_at_or_after(self.since.max(steps_until));
        let hangs = due.is_some_and(|due| now > due + limit);
        if hangs {
            // It is told once, and again only if nothing has come of it.
            self.since = now;
        }
        hangs
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use shared_types::schedule::{Fate, Outage, Rate};

    const LIMIT: u64 = 250;

    fn pulse(outages: Vec<Outage>) -> Pulse {
        let rate = Rate { period: 22, phase: 0 };
        Pulse {
            steps: Presence::new(rate, Arc::from(outages)),
            steps_until: 0,
            since: 0,
        }
    }

    #[test]
    fn who_steps_as_it_should_does_not_hang() {
        let mut pulse = pulse(Vec::new());
        assert!((0..5000).all(|now| !pulse.hangs(now, now / 22 * 22 + 1, true, LIMIT)));
    }

    #[test]
    fn who_stops_stepping_hangs_once_the_limit_after_its_next_step_has_passed() {
        let mut pulse = pulse(Vec::new());
        assert!(!pulse.hangs(1000, 991, true, LIMIT));
        let first = (1000..).find(|&now| pulse.hangs(now, 991, true, LIMIT));
        assert_eq!(first, Some(1012 + LIMIT + 1));
    }

    #[test]
    fn who_is_out_as_planned_does_not_hang_until_it_should_be_back() {
        let outage = Outage {
            from: 1000,
            until: 5000,
            fate: Fate::Frozen,
        };
        let mut pulse = pulse(vec![outage]);
        assert!(!pulse.hangs(999, 991, true, LIMIT));
        let first = (1000..).find(|&now| pulse.hangs(now, 991, true, LIMIT));
        assert_eq!(first, Some(5016 + LIMIT + 1));
    }

    #[test]
    fn who_is_being_born_does_not_hang() {
        let mut pulse = pulse(Vec::new());
        assert!((0..5000).all(|now| !pulse.hangs(now, 0, false, LIMIT)));
        assert!(!pulse.hangs(5000 + LIMIT, 0, true, LIMIT));
    }
}
