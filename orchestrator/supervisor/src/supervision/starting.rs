//! Time limits of starting, waiting and ending processes.

use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

use runtime::control::Host;

use super::managed_service::Phase;
use super::restart_policy::{READY_LIMIT, Situation, StartingProcess, Verdict};
use runtime::activity::Activity;

use super::{Exit, STOP_LIMIT, Supervisor};
use crate::RunFailure;

/// Time for which a process may live after it has closed its channel: an ending process closes it shortly before.
pub(super) const AFTER_CLOSING: Duration = Duration::from_millis(100);

/// A process that has not run for this long and does not wait for a processor is asleep or stopped.
const ASLEEP_AFTER: Duration = Duration::from_millis(10);

/// Observations of a process that takes long to become ready.
#[derive(Clone, Copy, Debug)]
pub(super) struct SlowStart {
    seen_at: Instant,
    activity: Activity,
    /// Time since which it has neither run nor waited for a processor.
    idle_since: Instant,
    /// Observed time in which it waited for a processor.
    waited: Duration,
}

impl SlowStart {
    fn observe(&mut self, now: Instant, activity: Activity) {
        let passed = now.saturating_duration_since(self.seen_at);
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

impl Supervisor<'_> {
    /// Applies the start-up limits of a process: a standby process is prepared, and replaces it if it does not become
    /// ready.
    ///
    /// # Errors
    /// [`RunFailure::NotReady`], while the run is set up.
    pub(super) fn limit_start(&mut self, at: usize, now: Instant) -> Result<(), RunFailure> {
        let starting = self.starting_process(at, now);
        match starting.verdict() {
            Verdict::Wait => {}
            Verdict::Hedge => self.keep_standby(),
            Verdict::Replace => {
                let seconds = starting.elapsed.as_secs_f64();
                self.replace(at, format!("was not ready after {seconds:.3} s"));
            }
            Verdict::Fail => {
                self.members[at].process.kill_group();
                return Err(RunFailure::NotReady {
                    services: vec![self.members[at].name.to_owned()],
                    limit: READY_LIMIT,
                });
            }
        }
        Ok(())
    }

    pub(super) fn starting_process(&mut self, at: usize, now: Instant) -> StartingProcess {
        // Of two starting services, only one gets the prepared process; a dead one has precedence.
        let is_claimed = self
            .members
            .iter()
            .any(|member| matches!(member.phase, Phase::Dead(_)));
        let situation = match (self.is_in_flight, self.start.host) {
            (false, _) => Situation::SetUp,
            (true, Host::RealTime) => Situation::RealTime,
            (true, Host::LockStep | Host::Replay) => Situation::LockStep,
        };
        let mut starting = StartingProcess {
            situation,
            elapsed: now.saturating_duration_since(self.members[at].process.asked_at),
            was_prepared: self.members[at].was_prepared,
            is_other_prepared: self.standby.is_prepared() && !is_claimed,
            waited: Duration::ZERO,
            is_asleep: false,
            longest: self.members[at].longest_start,
            missed: self.members[at].fruitless,
        };
        let member = &mut self.members[at];
        if starting.is_slow()
            && let Some(activity) = Activity::read(member.process.id())
        {
            let first = SlowStart {
                seen_at: now,
                activity,
                idle_since: now,
                waited: Duration::ZERO,
            };
            let seen = member.slow_start.get_or_insert(first);
            seen.observe(now, activity);
            let delayed_ns = activity
                .run_delay_ns
                .saturating_sub(member.process.delayed_before_ns);
            // Both cover the same time: the kernel adds a delay only once it is over.
            starting.waited = seen.waited.max(Duration::from_nanos(delayed_ns));
            starting.is_asleep = now.saturating_duration_since(seen.idle_since) >= ASLEEP_AFTER;
        }
        starting
    }

    /// Kills the process of a service for the reason `what`, and handles it like a death in flight.
    pub(super) fn replace(&mut self, at: usize, what: String) {
        self.members[at].blamed.get_or_insert(what);
        let died = self.reap(at);
        self.pending.extend(died);
    }

    /// Ends the rest of a process that has died, closed its channel or violated a limit; a process that lived on is
    /// blamed for it.
    pub(super) fn end_process(&mut self, at: usize) -> Exit {
        let is_to_stop = self.page.control_block().stopping.load(Ordering::Relaxed) != 0;
        let member = &mut self.members[at];
        let grace = match &member.blamed {
            Some(_) => Duration::ZERO,
            None if is_to_stop => STOP_LIMIT,
            None => AFTER_CLOSING,
        };
        if !member.process.ends_within(grace) && !is_to_stop {
            let what = "has closed its control channel and did not end".to_owned();
            member.blamed.get_or_insert(what);
        }
        member.process.end()
    }
}
