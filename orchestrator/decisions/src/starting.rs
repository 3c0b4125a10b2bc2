//! Time limits of processes that start.

use std::time::Duration;

use host::activity::Activity;

use crate::event::{Facts, News};
use crate::failure::ServiceFailure;
use crate::member::Phase;
use crate::moment::Moment;
use crate::restart_policy::{EXTERNAL_LIMIT, READY_LIMIT, Situation, StartingProcess, Verdict};
use crate::supervision::Supervision;

/// A process that has not run for this long and does not wait for a processor is asleep or stopped.
const ASLEEP_AFTER: Duration = Duration::from_millis(10);

/// Longest time between two looks at a starting process that counts as observed: the period of the supervisor's loop.
const LONGEST_GAP: Duration = Duration::from_millis(10);

/// Observations of a process that takes long to become ready.
#[derive(Clone, Copy, Debug)]
pub(crate) struct SlowStart {
    seen_at: Moment,
    activity: Activity,
    /// Time since which it has neither run nor waited for a processor.
    idle_since: Moment,
    /// Observed time in which it waited for a processor.
    waited: Duration,
}

impl SlowStart {
    fn new(now: Moment, activity: Activity) -> Self {
        Self {
            seen_at: now,
            activity,
            idle_since: now,
            waited: Duration::ZERO,
        }
    }

    fn observe(&mut self, now: Moment, activity: Activity) {
        let passed = now.since(self.seen_at).min(LONGEST_GAP);
        let ran_ns = activity.cpu_time_ns.saturating_sub(self.activity.cpu_time_ns);
        if activity.is_ready {
            self.waited += passed.saturating_sub(Duration::from_nanos(ran_ns));
        }
        if activity.is_runnable || ran_ns > 0 {
            self.idle_since = now;
        }
        (self.seen_at, self.activity) = (now, activity);
    }
}

impl Supervision {
    /// Applies the start-up limits of a process: a standby process is prepared, and replaces it if it does not become
    /// ready.
    pub(crate) fn limit_start(&mut self, at: usize, now: Moment, facts: &dyn Facts) {
        let starting = self.starting_process(at, now, facts);
        let is_external = self.members[at].is_external;
        let verdict = match is_external {
            true => starting.verdict_on_external_service(),
            false => starting.verdict(),
        };
        match verdict {
            Verdict::Wait => {}
            Verdict::Hedge => self.keep_standby(now),
            Verdict::Replace => {
                let seconds = starting.elapsed.as_secs_f64();
                self.replace(at, now, format!("was not ready after {seconds:.3} s"));
            }
            Verdict::Fail => {
                self.kill(at, now);
                let member = &mut self.members[at];
                let failure = match is_external {
                    true => {
                        let limit = EXTERNAL_LIMIT.as_secs();
                        member.violation(format!("has not said that it is ready within {limit} s"))
                    }
                    false => ServiceFailure::NotReady {
                        service: member.name.to_owned(),
                        limit: READY_LIMIT,
                    },
                };
                let lost: News = member.give_up(failure);
                self.news.push(lost);
            }
        }
    }

    fn starting_process(&mut self, at: usize, now: Moment, facts: &dyn Facts) -> StartingProcess {
        // Of two starting services, only one gets the prepared process; a dead one has precedence.
        let mut members = self.members.iter();
        let is_claimed = members.any(|member| matches!(member.phase, Phase::Dead(_) | Phase::Dying));
        let situation = match (self.is_in_flight, self.is_real_time) {
            (false, _) => Situation::SetUp,
            (true, true) => Situation::RealTime,
            (true, false) => Situation::LockStep,
        };
        let is_other_prepared = self.standby.is_prepared() && !is_claimed;
        let member = &mut self.members[at];
        let looked_at = member.looked_at.replace(now).unwrap_or(member.process.asked_at);
        member.unobserved += now.since(looked_at).saturating_sub(LONGEST_GAP);
        let mut starting = StartingProcess {
            situation,
            elapsed: now.since(member.process.asked_at),
            was_prepared: member.was_prepared,
            is_other_prepared,
            waited: member.unobserved,
            is_asleep: false,
            longest: member.longest_start,
            missed: member.fruitless,
        };
        if !member.is_external
            && starting.is_slow()
            && let Some(activity) = facts.activity(member.process.number)
        {
            let seen = member.slow_start.get_or_insert(SlowStart::new(now, activity));
            seen.observe(now, activity);
            let delayed_ns = activity
                .run_delay_ns
                .saturating_sub(member.process.delayed_before_ns);
            // Both cover the same time: the kernel adds a delay only once it is over.
            let observed = seen.waited + member.unobserved;
            starting.waited = observed.max(Duration::from_nanos(delayed_ns));
            starting.is_asleep = now.since(seen.idle_since) >= ASLEEP_AFTER;
        }
        starting
    }
}
