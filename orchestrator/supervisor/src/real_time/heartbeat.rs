//! Notices services that hang: those that fly, should have stepped, and have not for too long.
//!
//! What the machine owes a service does not count against it:
//!
//! * time in which the orchestrator itself was not looking, because it was late or stopped too;
//! * time in which the service could have run and was given no processor;
//! * time in which all services were late at once. They do not wait for each other for long, so a service that hangs does
//!   not make the others late: the machine does. This is granted up to [`GRANT`] times the limit, because all of them may
//!   hang after all.
//!
//! On an overloaded machine all services are late together, and a restart would only add to the load.

use std::sync::atomic::Ordering;

use runtime::shared_page::ControlBlock;
use shared_types::schedule::OutageSchedule;
use shared_types::{Schedule, ServiceId};

use runtime::activity::Activity;

/// Limits after which services that are all late at once count as hanging nevertheless.
const GRANT: u64 = 3;

/// Share of the limit that counts as seen between two looks: some periods of the orchestrator's loop.
const SEEN_AT_ONCE: u64 = 8;

/// Time at which each service was last seen to step.
pub struct Heartbeats {
    pulses: [Pulse; ServiceId::ALL.len()],
    tick_ns: u64,
    /// The tick of the last look.
    looked_at: u64,
}

struct Pulse {
    /// Ticks without a due step after which it hangs.
    limit_ticks: u64,
    steps: OutageSchedule,
    /// The last tick of the flight: nothing is due after it.
    last_tick: u64,
    /// 1 + the last tick that it had stepped when it was looked at last.
    steps_until: u64,
    /// The tick at which that was new, or since which the service flies.
    since: u64,
    /// `true` if it has stepped since it flies.
    has_stepped: bool,
    /// The number of ticks since then that the machine owes to the service.
    owed: Owed,
    /// Its activity at the last look, while it is late.
    activity: Option<Activity>,
}

/// Ticks that the machine owes a late service.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
struct Owed {
    /// Those in which the orchestrator did not look.
    unseen: u64,
    /// Those in which it was seen to be runnable and did not run.
    runnable: u64,
    /// Time for which the system says that it waited for a processor, ns.
    delayed_ns: u64,
    /// Those in which all services were late.
    granted: u64,
}

/// Punctuality of a service at a look.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Punctuality {
    /// It stepped lately.
    Stepped,
    /// It should have stepped some time ago.
    Late,
    /// It says nothing of the machine: it does not fly, or nothing is due.
    Neither,
}

impl Heartbeats {
    /// A service hangs that has not stepped for as many ticks as `limit_ticks` says although it should have.
    #[must_use]
    pub fn new(schedule: &Schedule, limit_ticks: impl Fn(ServiceId) -> u64) -> Self {
        let pulse = |service| {
            Pulse::new(
                schedule.steps(service),
                schedule.last_tick(),
                limit_ticks(service),
            )
        };
        Self {
            pulses: ServiceId::ALL.map(pulse),
            tick_ns: schedule.tick_ns(),
            looked_at: 0,
        }
    }

    /// Looks at the services at the beginning of tick `now`. `flies` says which are in flight, `activity` what the
    /// process of one does, `first_step` how many ticks its first step may take, if that is more than others may. Which
    /// ones hang.
    pub fn hanging(
        &mut self,
        now: u64,
        block: &ControlBlock,
        flies: impl Fn(ServiceId) -> bool,
        activity: impl Fn(ServiceId) -> Option<Activity>,
        first_step: impl Fn(ServiceId) -> u64,
    ) -> Vec<ServiceId> {
        // Relaxed: only progress counts here, and a value that is a little old makes the service no later than it was.
        let steps_until =
            |service: ServiceId| block.cells[service.index()].steps_until.load(Ordering::Relaxed);
        self.hanging_of(now, steps_until, flies, activity, first_step)
    }

    fn hanging_of(
        &mut self,
        now: u64,
        steps_until: impl Fn(ServiceId) -> u64,
        flies: impl Fn(ServiceId) -> bool,
        activity: impl Fn(ServiceId) -> Option<Activity>,
        first_step: impl Fn(ServiceId) -> u64,
    ) -> Vec<ServiceId> {
        let passed = now.saturating_sub(self.looked_at);
        self.looked_at = now;
        let tick_ns = self.tick_ns;
        let limit_of = |pulse: &Pulse, service| match pulse.has_stepped {
            true => pulse.limit_ticks,
            false => pulse.limit_ticks.max(first_step(service)),
        };
        let punctuality = ServiceId::ALL.map(|service| {
            let pulse = &mut self.pulses[service.index()];
            pulse.observe(now, steps_until(service), flies(service));
            let limit = limit_of(pulse, service);
            pulse.overlook(now, passed, limit);
            pulse.punctuality(now, limit / 2, flies(service))
        });
        let is_machine_late = all_are_late(&punctuality);
        let hangs = |&service: &ServiceId| {
            if punctuality[service.index()] != Punctuality::Late {
                return false;
            }
            let pulse = &mut self.pulses[service.index()];
            let limit = limit_of(pulse, service);
            pulse.excuse(passed, limit, tick_ns, activity(service));
            if is_machine_late {
                pulse.grant(passed, limit);
            }
            pulse.hangs(now, limit, tick_ns)
        };
        ServiceId::ALL.into_iter().filter(hangs).collect()
    }
}

/// Returns whether several services are late and none has stepped lately.
fn all_are_late(punctuality: &[Punctuality]) -> bool {
    let count = |of| punctuality.iter().filter(|&&one| one == of).count();
    count(Punctuality::Late) > 1 && count(Punctuality::Stepped) == 0
}

/// Of the ticks between two looks, those that count as seen.
fn seen_of(passed: u64, limit: u64) -> u64 {
    passed.min(limit.div_ceil(SEEN_AT_ONCE))
}

impl Owed {
    /// What it owes in all. What the system says and what was seen are of the same time: the longer one counts.
    fn ticks(&self, tick_ns: u64) -> u64 {
        self.unseen + self.granted + self.runnable.max(self.delayed_ns / tick_ns)
    }
}

impl Pulse {
    fn new(steps: OutageSchedule, last_tick: u64, limit_ticks: u64) -> Self {
        Self {
            limit_ticks,
            steps,
            last_tick,
            steps_until: 0,
            since: 0,
            has_stepped: false,
            owed: Owed::default(),
            activity: None,
        }
    }

    fn observe(&mut self, now: u64, steps_until: u64, flies: bool) {
        if steps_until != self.steps_until || !flies {
            (self.steps_until, self.has_stepped) = (steps_until, flies);
            self.begin_anew(now);
        }
    }

    fn begin_anew(&mut self, now: u64) {
        (self.since, self.owed, self.activity) = (now, Owed::default(), None);
    }

    /// Returns whether it has not stepped for so many ticks although it should have.
    fn is_late(&self, now: u64, ticks: u64) -> bool {
        let due = self.steps.first_at_or_after(self.since.max(self.steps_until));
        due.is_some_and(|due| due <= self.last_tick && now > due + ticks)
    }

    fn punctuality(&self, now: u64, ticks: u64, flies: bool) -> Punctuality {
        if !flies {
            Punctuality::Neither
        } else if self.is_late(now, ticks) {
            Punctuality::Late
        } else if now <= self.since + ticks {
            Punctuality::Stepped
        } else {
            Punctuality::Neither
        }
    }

    /// Counts the ticks that the orchestrator has overlooked since the last look: it cannot tell what a service did then.
    fn overlook(&mut self, now: u64, passed: u64, limit: u64) {
        if self.since < now {
            self.owed.unseen += passed - seen_of(passed, limit);
        }
    }

    /// Counts what the machine owes the service of the ticks that were seen since the last look.
    fn excuse(&mut self, passed: u64, limit: u64, tick_ns: u64, activity: Option<Activity>) {
        let seen = seen_of(passed, limit);
        if let (Some(activity), Some(before)) = (activity, self.activity) {
            if activity.is_runnable {
                let ran_ns = activity.cpu_time_ns.saturating_sub(before.cpu_time_ns);
                self.owed.runnable += seen.saturating_sub(ran_ns / tick_ns);
            }
            let delayed_ns = activity.run_delay_ns.saturating_sub(before.run_delay_ns);
            self.owed.delayed_ns += delayed_ns.min(seen * tick_ns);
        }
        self.activity = activity;
    }

    /// Grants it the ticks that have passed since the last look, in which all services were late.
    fn grant(&mut self, passed: u64, limit: u64) {
        let granted = self.owed.granted + seen_of(passed, limit);
        self.owed.granted = granted.min(GRANT * limit);
    }

    fn hangs(&mut self, now: u64, limit: u64, tick_ns: u64) -> bool {
        let hangs = self.is_late(now, limit + self.owed.ticks(tick_ns));
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

    use proptest::prelude::*;

    use super::*;
    use shared_types::schedule::{Outage, OutageKind, Rate};

    const LIMIT: u64 = 250;

    const TICK_NS: u64 = 1_000_000;

    fn pulse(outages: Vec<Outage>) -> Pulse {
        let rate = Rate { period: 22, phase: 0 };
        Pulse::new(OutageSchedule::new(rate, Arc::from(outages)), 1_000_000, LIMIT)
    }

    impl Pulse {
        /// A look one tick after the last one, at a service that sleeps or is stopped.
        fn hangs_asleep(&mut self, now: u64, steps_until: u64, flies: bool) -> bool {
            self.observe(now, steps_until, flies);
            self.is_late(now, LIMIT / 2) && {
                self.excuse(1, LIMIT, TICK_NS, Some(asleep()));
                self.hangs(now, LIMIT, TICK_NS)
            }
        }
    }

    fn asleep() -> Activity {
        Activity {
            is_runnable: false,
            is_ready: false,
            cpu_time_ns: 7,
            run_delay_ns: 3,
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
    fn a_service_that_stops_just_before_the_end_hangs_after_it_and_one_that_has_flown_it_does_not() {
        let (last_tick, tick) = (100_000, 99_990);
        let schedule = Schedule::ideal(TICK_NS, last_tick);
        let first_hang = |steps_until: u64| {
            let mut heartbeats = Heartbeats::new(&schedule, |_| LIMIT);
            let is_plant = |service| service == ServiceId::Plant;
            (0..last_tick + 2 * LIMIT).find(|&now| {
                let until = now.min(steps_until);
                let hanging = heartbeats.hanging_of(now, |_| until, is_plant, |_| Some(asleep()), |_| 0);
                hanging == [ServiceId::Plant]
            })
        };
        assert_eq!(first_hang(tick), Some(tick + LIMIT + 1));
        assert_eq!(first_hang(last_tick + 1), None);
    }

    #[test]
    fn the_first_step_of_a_service_has_its_own_limit_and_the_next_ones_that_of_all() {
        let schedule = Schedule::ideal(TICK_NS, 100_000);
        let is_controller = |service| service == ServiceId::Controller;
        let first_hang = |first_step: u64, steps_until: u64| {
            let mut heartbeats = Heartbeats::new(&schedule, |_| LIMIT);
            // It flies from tick 10 on.
            (0..20 * LIMIT).find(|&now| {
                let flies = |service| is_controller(service) && now >= 10;
                let until = now.min(steps_until);
                let activity = |_| Some(asleep());
                !heartbeats
                    .hanging_of(now, |_| until, flies, activity, |_| first_step)
                    .is_empty()
            })
        };
        let last_not_flown = 9;
        assert_eq!(first_hang(4 * LIMIT, 5), Some(last_not_flown + 4 * LIMIT + 1));
        assert_eq!(first_hang(0, 5), Some(last_not_flown + LIMIT + 1));
        assert_eq!(first_hang(4 * LIMIT, 100), Some(100 + LIMIT + 1));
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
            pulse.overlook(now, period as u64, LIMIT);
            let activity = Activity {
                is_runnable,
                is_ready: is_runnable,
                cpu_time_ns: (cpu_share * (now * TICK_NS) as f64) as u64,
                run_delay_ns: 0,
            };
            pulse.is_late(now, LIMIT / 2) && {
                pulse.excuse(period as u64, LIMIT, TICK_NS, Some(activity));
                pulse.hangs(now, LIMIT, TICK_NS)
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
        pulse.overlook(now, 1000, LIMIT);
        assert!(pulse.is_late(now, LIMIT / 2));
        pulse.excuse(1000, LIMIT, TICK_NS, Some(self::asleep()));
        assert!(!pulse.hangs(now, LIMIT, TICK_NS));
    }

    /// Services of the ideal schedule that are looked at every ten ticks, `stopped` of which do not step after tick 100.
    /// Returns when each hangs for the first time, up to `last`.
    fn first_hangs(stopped: &[ServiceId], flying: &[ServiceId], last: u64) -> Vec<(ServiceId, u64)> {
        let schedule = Schedule::ideal(TICK_NS, 100_000);
        let mut heartbeats = Heartbeats::new(&schedule, |_| LIMIT);
        let mut found: Vec<(ServiceId, u64)> = Vec::new();
        for now in (0..=last).step_by(10) {
            let steps_until = |service| {
                if stopped.contains(&service) {
                    now.min(100)
                } else {
                    now + 1
                }
            };
            let flies = |service| flying.contains(&service);
            let hanging = heartbeats.hanging_of(now, steps_until, flies, |_| Some(asleep()), |_| 0);
            for service in hanging {
                if !found.iter().any(|(other, _)| *other == service) {
                    found.push((service, now));
                }
            }
        }
        found
    }

    #[test]
    fn services_that_are_all_late_at_once_are_granted_time_and_hang_in_the_end() {
        let all = ServiceId::ALL;
        let grace = (GRANT + 1) * LIMIT;
        assert_eq!(first_hangs(&all, &all, 100 + grace - LIMIT), []);
        let hung = first_hangs(&all, &all, 10 * LIMIT);
        assert_eq!(hung.len(), all.len());
        assert!(
            hung.iter()
                .all(|&(_, at)| at > 100 + grace && at <= 100 + grace + LIMIT),
            "{hung:?}"
        );
    }

    #[test]
    fn while_one_service_steps_the_others_are_granted_nothing() {
        let [punctual, stopped @ ..] = ServiceId::ALL;
        for stopped in [&stopped[..], &stopped[..1]] {
            let hung = first_hangs(stopped, &ServiceId::ALL, 10 * LIMIT);
            assert_eq!(hung.len(), stopped.len());
            assert!(
                hung.iter()
                    .all(|&(service, at)| service != punctual && at <= 100 + LIMIT + 20),
                "{hung:?}"
            );
        }
        // One that is alone is no witness of the machine, and those that do not fly are none.
        let alone = first_hangs(&[punctual], &[punctual], 10 * LIMIT);
        assert!(
            matches!(alone[..], [(_, at)] if at <= 100 + LIMIT + 20),
            "{alone:?}"
        );
    }

    #[test]
    fn time_that_the_system_says_a_service_waited_for_a_processor_is_owed_to_it() {
        let mut pulse = pulse(Vec::new());
        let first = (0..20 * LIMIT).step_by(10).find(|&now| {
            pulse.observe(now, 1, true);
            // It sleeps at every look, and waited for a processor for half of the time between them.
            let activity = Activity {
                run_delay_ns: now * TICK_NS / 2,
                ..asleep()
            };
            pulse.is_late(now, LIMIT / 2) && {
                pulse.excuse(10, LIMIT, TICK_NS, Some(activity));
                pulse.hangs(now, LIMIT, TICK_NS)
            }
        });
        let first = first.unwrap();
        assert!((LIMIT + LIMIT / 2 - 20..=2 * LIMIT).contains(&first), "{first}");
    }

    proptest! {
        /// However late the orchestrator is at each look: what was punctual before and after is not replaced, and what hangs is.
        #[test]
        fn a_late_orchestrator_replaces_nobody_who_was_not_seen_to_hang(
            gaps in proptest::collection::vec(1u64..2000, 1..200),
        ) {
            let mut pulse = pulse(Vec::new());
            let (mut now, mut seen) = (0, 0);
            for gap in gaps {
                now += gap;
                seen += gap.min(LIMIT.div_ceil(SEEN_AT_ONCE));
                pulse.observe(now, 1, true);
                pulse.overlook(now, gap, LIMIT);
                if pulse.is_late(now, LIMIT / 2) {
                    pulse.excuse(gap, LIMIT, TICK_NS, Some(asleep()));
                    if pulse.hangs(now, LIMIT, TICK_NS) {
                        prop_assert!(seen >= LIMIT, "seen for {} ticks", seen);
                        return Ok(());
                    }
                }
            }
            prop_assert!(seen <= LIMIT + LIMIT / 2 + 50, "not found in {} ticks that were seen", seen);
        }
    }
}
