//! Limits of the processes that start, of those that wait to, and of those that are to end.

use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

use runtime::control::Host;

use super::managed_service::Phase;
use super::restart_policy::{READY_LIMIT, Situation, StartingProcess, Verdict};
use runtime::activity::Activity;

use super::{Exit, STOP_LIMIT, Supervisor};
use crate::FlightFailure;

/// Time for which a process may live after it has closed its line: one that ends closes it a little before.
pub(super) const AFTER_CLOSING: Duration = Duration::from_millis(100);

/// A process that has not run for so long and does not wait for a processor is asleep or stopped.
const ASLEEP_AFTER: Duration = Duration::from_millis(10);

impl Supervisor<'_> {
    /// Applies the limits of a process that starts: another one is prepared beside it, and takes its place if it does not
    /// become ready.
    ///
    /// # Errors
    /// [`FlightFailure::NotReady`], while the run is set up.
    pub(super) fn limit_start(&mut self, at: usize, now: Instant) -> Result<(), FlightFailure> {
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
                return Err(FlightFailure::NotReady {
                    services: vec![self.members[at].name.to_owned()],
                    limit: READY_LIMIT,
                });
            }
        }
        Ok(())
    }

    pub(super) fn starting_process(&mut self, at: usize, now: Instant) -> StartingProcess {
        // Of two that start, one alone takes the process that is prepared.
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
            is_asleep: false,
            missed: self.members[at].fruitless,
        };
        if starting.is_slow() {
            starting.is_asleep = self.is_asleep(at, now);
        }
        starting
    }

    /// Returns whether the process of a service has neither run nor waited for a processor since it was looked at before.
    fn is_asleep(&mut self, at: usize, now: Instant) -> bool {
        let member = &mut self.members[at];
        let Some(activity) = Activity::of(member.process.id()) else {
            return false;
        };
        let (since, before) = *member.slow_since.get_or_insert((now, activity));
        if activity.is_runnable || activity.cpu_time_ns != before.cpu_time_ns {
            member.slow_since = Some((now, activity));
            return false;
        }
        now.saturating_duration_since(since) >= ASLEEP_AFTER
    }

    /// Kills the process of a service for what it did, and takes its end for a death in flight.
    pub(super) fn replace(&mut self, at: usize, what: String) {
        self.members[at].blamed.get_or_insert(what);
        let died = self.reap(at);
        self.pending.extend(died);
    }

    /// Ends what is left of a process that has died, closed its line or was blamed, and says so if it lived on.
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
