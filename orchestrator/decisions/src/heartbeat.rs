//! Detection of hung services: those that fly and have not stepped for too long although a step was due.
//!
//! Delays caused by the machine do not count:
//!
//! * time in which the orchestrator itself did not check, because it was late or stopped;
//! * time in which the service was runnable but got no processor;
//! * time in which all services were late at once. They do not wait for each other for long, so a hung service does not
//!   delay the others: the machine does. This is limited to three times the limit, because all of them may have hung.
//!
//! On an overloaded machine all services are late together, and a restart would only add to the load.

use host::activity::Activity;
use shared_types::schedule::OutageSchedule;
use shared_types::{Schedule, ServiceId};

/// Multiple of the limit after which services that are all late at once count as hung nevertheless.
const GRANT: u64 = 3;

/// At most 1 / `OBSERVED_SHARE` of the limit counts between two checks: some periods of the orchestrator's loop.
const OBSERVED_SHARE: u64 = 8;

/// Last step of each service.
#[derive(Clone, Debug)]
pub struct Heartbeats {
    pulses: [Pulse; ServiceId::ALL.len()],
    tick_ns: u64,
    /// Tick of the last check.
    checked_at: u64,
}

#[derive(Clone, Debug)]
struct Pulse {
    /// Number of ticks without a due step after which the service counts as hung.
    limit_ticks: u64,
    steps: OutageSchedule,
    /// Last tick of the flight; no step is due after it.
    last_tick: u64,
    /// 1 + the last stepped tick, at the last check.
    steps_until: u64,
    /// Tick at which that changed, or since which the service flies.
    since: u64,
    /// `true` if it has stepped since it flies.
    has_stepped: bool,
    /// Ticks since then that do not count, because the machine caused the delay.
    excluded: Excluded,
    /// Activity of the process at the last check, while it is late.
    activity: Option<Activity>,
}

/// Ticks of a late service that do not count.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
struct Excluded {
    /// Ticks in which the orchestrator did not check.
    unobserved: u64,
    /// Ticks in which the process was runnable and did not run.
    runnable: u64,
    /// Time for which the process waited for a processor, by the kernel's figures, ns.
    delayed_ns: u64,
    /// Ticks in which all services were late.
    granted: u64,
}

/// Punctuality of a service at a check.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Punctuality {
    /// It has stepped recently.
    Stepped,
    /// A step was due some time ago.
    Late,
    /// It gives no evidence: it does not fly, or no step is due.
    Neither,
}

impl Heartbeats {
    /// Creates the detector; a service counts as hung after `limit_ticks` without a due step.
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
            checked_at: 0,
        }
    }

    /// Checks the services at the start of tick `now` and returns the hung ones. `steps_until` returns 1 + the last tick
    /// that a service has stepped, `flies` whether it is in flight, `activity` the activity of its process, `first_step`
    /// the number of ticks for its first step, if more than for others.
    pub fn hung_services(
        &mut self,
        now: u64,
        steps_until: impl Fn(ServiceId) -> u64,
        flies: impl Fn(ServiceId) -> bool,
        activity: impl Fn(ServiceId) -> Option<Activity>,
        first_step: impl Fn(ServiceId) -> u64,
    ) -> Vec<ServiceId> {
        let passed = now.saturating_sub(self.checked_at);
        self.checked_at = now;
        let tick_ns = self.tick_ns;
        let limit_of = |pulse: &Pulse, service| match pulse.has_stepped {
            true => pulse.limit_ticks,
            false => pulse.limit_ticks.max(first_step(service)),
        };
        let punctuality = ServiceId::ALL.map(|service| {
            let pulse = &mut self.pulses[service.index()];
            pulse.observe(now, steps_until(service), flies(service));
            let limit = limit_of(pulse, service);
            pulse.exclude_unobserved(now, passed, limit);
            pulse.punctuality(now, limit / 2, flies(service))
        });
        let is_machine_late = all_are_late(&punctuality);
        let hangs = |&service: &ServiceId| {
            if punctuality[service.index()] != Punctuality::Late {
                return false;
            }
            let pulse = &mut self.pulses[service.index()];
            let limit = limit_of(pulse, service);
            pulse.exclude_waiting(passed, limit, tick_ns, activity(service));
            if is_machine_late {
                pulse.grant(passed, limit);
            }
            pulse.hangs(now, limit, tick_ns)
        };
        ServiceId::ALL.into_iter().filter(hangs).collect()
    }
}

/// Returns whether several services are late and none has stepped recently.
fn all_are_late(punctuality: &[Punctuality]) -> bool {
    let count = |of| punctuality.iter().filter(|&&one| one == of).count();
    count(Punctuality::Late) > 1 && count(Punctuality::Stepped) == 0
}

/// Returns how many of the ticks between two checks count as observed.
fn observed_of(passed: u64, limit: u64) -> u64 {
    passed.min(limit.div_ceil(OBSERVED_SHARE))
}

impl Excluded {
    /// Returns the total. The kernel's figures and the samples cover the same time: the larger one counts.
    fn ticks(&self, tick_ns: u64) -> u64 {
        self.unobserved + self.granted + self.runnable.max(self.delayed_ns / tick_ns)
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
            excluded: Excluded::default(),
            activity: None,
        }
    }

    fn observe(&mut self, now: u64, steps_until: u64, flies: bool) {
        if steps_until != self.steps_until || !flies {
            (self.steps_until, self.has_stepped) = (steps_until, flies);
            self.reset(now);
        }
    }

    fn reset(&mut self, now: u64) {
        (self.since, self.excluded, self.activity) = (now, Excluded::default(), None);
    }

    /// Returns whether a step is overdue by more than `ticks`.
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

    /// Adds the ticks in which the orchestrator did not check: the service's activity in them is unknown.
    fn exclude_unobserved(&mut self, now: u64, passed: u64, limit: u64) {
        if self.since < now {
            self.excluded.unobserved += passed - observed_of(passed, limit);
        }
    }

    /// Adds the observed ticks since the last check in which the process waited for a processor.
    fn exclude_waiting(&mut self, passed: u64, limit: u64, tick_ns: u64, activity: Option<Activity>) {
        let seen = observed_of(passed, limit);
        if let (Some(activity), Some(before)) = (activity, self.activity) {
            if activity.is_runnable {
                let ran_ns = activity.cpu_time_ns.saturating_sub(before.cpu_time_ns);
                self.excluded.runnable += seen.saturating_sub(ran_ns / tick_ns);
            }
            let delayed_ns = activity.run_delay_ns.saturating_sub(before.run_delay_ns);
            self.excluded.delayed_ns += delayed_ns.min(seen * tick_ns);
        }
        self.activity = activity;
    }

    /// Adds the ticks since the last check, in which all services were late.
    fn grant(&mut self, passed: u64, limit: u64) {
        let granted = self.excluded.granted + observed_of(passed, limit);
        self.excluded.granted = granted.min(GRANT * limit);
    }

    fn hangs(&mut self, now: u64, limit: u64, tick_ns: u64) -> bool {
        let hangs = self.is_late(now, limit + self.excluded.ticks(tick_ns));
        if hangs {
            // Reported once, and again only if the service stays hung.
            self.reset(now);
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
                self.exclude_waiting(1, LIMIT, TICK_NS, Some(asleep()));
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
                let hung_services =
                    heartbeats.hung_services(now, |_| until, is_plant, |_| Some(asleep()), |_| 0);
                hung_services == [ServiceId::Plant]
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
                    .hung_services(now, |_| until, flies, activity, |_| first_step)
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
            pulse.exclude_unobserved(now, period as u64, LIMIT);
            let activity = Activity {
                is_runnable,
                is_ready: is_runnable,
                cpu_time_ns: (cpu_share * (now * TICK_NS) as f64) as u64,
                run_delay_ns: 0,
            };
            pulse.is_late(now, LIMIT / 2) && {
                pulse.exclude_waiting(period as u64, LIMIT, TICK_NS, Some(activity));
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
        pulse.exclude_unobserved(now, 1000, LIMIT);
        assert!(pulse.is_late(now, LIMIT / 2));
        pulse.exclude_waiting(1000, LIMIT, TICK_NS, Some(self::asleep()));
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
            let hung_services = heartbeats.hung_services(now, steps_until, flies, |_| Some(asleep()), |_| 0);
            for service in hung_services {
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
                pulse.exclude_waiting(10, LIMIT, TICK_NS, Some(activity));
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
                seen += gap.min(LIMIT.div_ceil(OBSERVED_SHARE));
                pulse.observe(now, 1, true);
                pulse.exclude_unobserved(now, gap, LIMIT);
                if pulse.is_late(now, LIMIT / 2) {
                    pulse.exclude_waiting(gap, LIMIT, TICK_NS, Some(asleep()));
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
