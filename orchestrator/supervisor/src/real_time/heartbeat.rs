//! Notices services that hang: those that fly, should have stepped, and have not for too long.
//!
//! What the machine owes a service does not count against it: time in which the orchestrator itself was not looking, and
//! time in which the service could have run and was given no processor. On an overloaded machine all services are late
//! together, and a restart would only add to the load.

use std::sync::atomic::Ordering;

use runtime::shared_page::ControlBlock;
use shared_types::schedule::OutageSchedule;
use shared_types::{Schedule, ServiceId};

use crate::supervision::Activity;

/// Time at which each service was last seen to step.
pub struct Heartbeats {
    pulses: [Pulse; ServiceId::ALL.len()],
    tick_ns: u64,
    limit_ticks: u64,
    /// The tick of the last look.
    looked_at: u64,
}

struct Pulse {
    steps: OutageSchedule,
    /// 1 + the last tick that it had stepped when it was looked at last.
    steps_until: u64,
    /// The tick at which that was new, or since which the service flies.
    since: u64,
    /// The number of ticks since then that the machine owes to the service.
    owed: u64,
    /// Time on a processor at the last look, ns, while it is late.
    cpu_time_ns: Option<u64>,
}

impl Heartbeats {
    /// Services hang that have not stepped for `limit_ticks` although they should have.
    #[must_use]
    pub fn new(schedule: &Schedule, limit_ticks: u64) -> Self {
        let pulse = |service| Pulse::new(schedule.steps(service));
        Self {
            pulses: ServiceId::ALL.map(pulse),
            tick_ns: schedule.tick_ns(),
            limit_ticks,
            looked_at: 0,
        }
    }

    /// Looks at the services at the beginning of tick `now`. `flies` says which are in flight, `activity` what the
    /// process of one does. Which ones hang.
    pub fn hanging(
        &mut self,
        now: u64,
        block: &ControlBlock,
        flies: impl Fn(ServiceId) -> bool,
        activity: impl Fn(ServiceId) -> Option<Activity>,
    ) -> Vec<ServiceId> {
        let passed = now.saturating_sub(self.looked_at);
        self.looked_at = now;
        let (limit, tick_ns) = (self.limit_ticks, self.tick_ns);
        let hangs = |&service: &ServiceId| {
            // Relaxed: only progress counts here, and a value that is a little old makes the service no later than it was.
            let steps_until = block.cells[service.index()].steps_until.load(Ordering::Relaxed);
            let pulse = &mut self.pulses[service.index()];
            pulse.observe(now, steps_until, flies(service));
            if !pulse.is_late(now, limit / 2) {
                return false;
            }
            pulse.excuse(passed, limit, tick_ns, activity(service));
            pulse.hangs(now, limit)
        };
        ServiceId::ALL.into_iter().filter(hangs).collect()
    }
}

impl Pulse {
    fn new(steps: OutageSchedule) -> Self {
        Self {
            steps,
            steps_until: 0,
            since: 0,
            owed: 0,
            cpu_time_ns: None,
        }
    }

    fn observe(&mut self, now: u64, steps_until: u64, flies: bool) {
        if steps_until != self.steps_until || !flies {
            self.steps_until = steps_until;
            self.begin_anew(now);
        }
    }

    fn begin_anew(&mut self, now: u64) {
        (self.since, self.owed, self.cpu_time_ns) = (now, 0, None);
    }

    /// Returns whether it has not stepped for so many ticks although it should have.
    fn is_late(&self, now: u64, ticks: u64) -> bool {
        let due = self.steps.first_at_or_after(self.since.max(self.steps_until));
        due.is_some_and(|due| now > due + ticks)
    }

    /// Counts what the machine owes the service of the ticks that have passed since the last look.
    fn excuse(&mut self, passed: u64, limit: u64, tick_ns: u64, activity: Option<Activity>) {
        // An orchestrator that was not there cannot tell what a service did meanwhile.
        let unseen = passed.saturating_sub(limit / 4);
        let seen = passed - unseen;
        let before = self.cpu_time_ns;
        self.cpu_time_ns = activity.map(|activity| activity.cpu_time_ns);
        let waited = match (activity, before) {
            (Some(activity), Some(before)) if activity.is_runnable => {
                let ran_ns = activity.cpu_time_ns.saturating_sub(before);
                seen.saturating_sub(ran_ns / tick_ns)
            }
            _ => 0,
        };
        self.owed += unseen + waited;
    }

    fn hangs(&mut self, now: u64, limit: u64) -> bool {
        let hangs = self.is_late(now, limit + self.owed);
        if hangs {
            // It is told once, and again only if nothing has come of it.
            self.begin_anew(now);
        }
        hangs
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use shared_types::schedule::{Outage, OutageKind, Rate};

    const LIMIT: u64 = 250;

    const TICK_NS: u64 = 1_000_000;

    fn pulse(outages: Vec<Outage>) -> Pulse {
        let rate = Rate { period: 22, phase: 0 };
        Pulse::new(OutageSchedule::new(rate, Arc::from(outages)))
    }

    impl Pulse {
        /// A look one tick after the last one, at a service that sleeps or is stopped.
        fn hangs_asleep(&mut self, now: u64, steps_until: u64, flies: bool) -> bool {
            self.observe(now, steps_until, flies);
            self.is_late(now, LIMIT / 2) && {
                self.excuse(1, LIMIT, TICK_NS, Some(asleep()));
                self.hangs(now, LIMIT)
            }
        }
    }

    fn asleep() -> Activity {
        Activity {
            is_runnable: false,
            cpu_time_ns: 7,
        }
    }

    #[test]
    fn a_service_that_steps_as_it_should_does_not_hang() {
        let mut pulse = pulse(Vec::new());
        assert!((0..5000).all(|now| !pulse.hangs_asleep(now, now / 22 * 22 + 1, true)));
    }

    #[test]
    fn a_service_that_stops_stepping_hangs_once_the_limit_after_its_next_step_has_passed() {
        let mut pulse = pulse(Vec::new());
        assert!(!pulse.hangs_asleep(1000, 991, true));
        let first = (1000..).find(|&now| pulse.hangs_asleep(now, 991, true));
        assert_eq!(first, Some(1012 + LIMIT + 1));
    }

    #[test]
    fn a_service_that_is_out_as_planned_does_not_hang_until_it_should_be_back() {
        let outage = Outage {
            from: 1000,
            until: 5000,
            fate: OutageKind::Frozen,
        };
        let mut pulse = pulse(vec![outage]);
        assert!(!pulse.hangs_asleep(999, 991, true));
        let first = (1000..).find(|&now| pulse.hangs_asleep(now, 991, true));
        assert_eq!(first, Some(5016 + LIMIT + 1));
    }

    #[test]
    fn a_service_that_is_being_started_does_not_hang() {
        let mut pulse = pulse(Vec::new());
        assert!((0..5000).all(|now| !pulse.hangs_asleep(now, 0, false)));
        assert!(!pulse.hangs_asleep(5000 + LIMIT, 0, true));
    }

    /// The first tick at which services hang that do not step after tick 0, looked at every `period` ticks; a share of the
    /// time they are on a processor.
    fn first_hang(period: usize, is_runnable: bool, cpu_share: f64) -> Option<u64> {
        let mut pulse = pulse(Vec::new());
        (0..20 * LIMIT).step_by(period).find(|&now| {
            pulse.observe(now, 1, true);
            let activity = Activity {
                is_runnable,
                cpu_time_ns: (cpu_share * (now * TICK_NS) as f64) as u64,
            };
            pulse.is_late(now, LIMIT / 2) && {
                pulse.excuse(period as u64, LIMIT, TICK_NS, Some(activity));
                pulse.hangs(now, LIMIT)
            }
        })
    }

    #[test]
    fn a_service_that_is_given_no_processor_does_not_hang_and_one_that_uses_it_in_vain_does() {
        assert_eq!(first_hang(10, true, 0.0), None);
        let busy = first_hang(10, true, 1.0).unwrap();
        assert!((LIMIT..=LIMIT + 40).contains(&busy), "{busy}");
        // Half of the time that it was looked at was its own.
        let hampered = first_hang(10, true, 0.5).unwrap();
        assert!(
            (LIMIT + LIMIT / 2 - 20..=2 * LIMIT).contains(&hampered),
            "{hampered}"
        );
    }

    #[test]
    fn what_happened_while_nobody_looked_is_not_held_against_a_service() {
        let asleep = first_hang(10, false, 0.0).unwrap();
        assert!((LIMIT..=LIMIT + 40).contains(&asleep), "{asleep}");
        let mut pulse = pulse(Vec::new());
        pulse.observe(0, 1, true);
        // The orchestrator was stopped for a second.
        let now = 1000;
        pulse.observe(now, 1, true);
        assert!(pulse.is_late(now, LIMIT / 2));
        pulse.excuse(1000, LIMIT, TICK_NS, Some(self::asleep()));
        assert!(!pulse.hangs(now, LIMIT));
    }
}
