//! Standby process: waits to take the role of the next service that dies.
//!
//! It has loaded, joined the run and built all services by then, which is most of what a new process has to do. A run never depends on it: without one the dead are followed by processes that are started then, and one that
//! hangs is overtaken by the next (`starting.rs`).

use std::time::{Duration, Instant};

use runtime::activity::Activity;
use runtime::control::{Role, ToOrchestrator, ToService};
use runtime::process::SPARE;

use super::process::Process;
use super::restart_policy::{BEAT_LIMIT, BEAT_PERIOD, PREPARATION_LIMIT, RestartPolicy};
use super::starting::AFTER_CLOSING;
use super::{Exit, MESSAGES_AT_A_LOOK, ServiceEvent, Supervisor};

/// One that has lived for so long was well: what it died of was no fault of its own.
const SETTLED: Duration = Duration::from_secs(1);

/// The standby process, if there is one.
#[derive(Default)]
pub(super) struct Standby {
    pub(super) process: Option<Process>,
    /// Time at which it last said that it is prepared; `None` until it does.
    answered_at: Option<Instant>,
    /// Time at which it was asked again and has not answered yet.
    asked_at: Option<Instant>,
    /// The number in a row that have died young.
    fruitless: u32,
    /// Time at which the next one may be started, if not at once.
    again_at: Option<Instant>,
    policy: RestartPolicy,
}

impl Standby {
    fn is_wanted(&self) -> bool {
        self.process.is_none()
            && self.policy.pause(self.fruitless).is_some()
            && self.again_at.is_none_or(|again_at| again_at <= Instant::now())
    }

    /// Takes note that one has failed: the next one comes later, or never.
    fn note_failure(&mut self, has_settled: bool) {
        self.fruitless = if has_settled { 0 } else { self.fruitless + 1 };
        let pause = self.policy.pause(self.fruitless);
        self.again_at = pause.map(|pause| Instant::now() + pause);
    }

    /// Returns whether there is one that is prepared for a role.
    pub(super) fn is_prepared(&self) -> bool {
        self.process.is_some() && self.answered_at.is_some()
    }

    fn take(&mut self) -> Option<Process> {
        (self.answered_at, self.asked_at) = (None, None);
        self.process.take()
    }

    /// Asks it for a sign of life now and then. Returns what it has missed, in words.
    fn beat(&mut self, now: Instant) -> Option<&'static str> {
        let process = self.process.as_ref()?;
        let is_past = |since: Instant, limit| now.saturating_duration_since(since) > limit;
        match (self.answered_at, self.asked_at) {
            (None, _) => is_past(process.asked_at, PREPARATION_LIMIT).then_some("it did not become prepared"),
            (Some(_), Some(asked_at)) => is_past(asked_at, BEAT_LIMIT).then_some("it did not answer"),
            (Some(answered_at), None) => {
                // A closed line is found when it is listened to.
                if is_past(answered_at, BEAT_PERIOD) && process.channel.try_send(&ToService::Beat).is_ok() {
                    self.asked_at = Some(now);
                }
                None
            }
        }
    }

    /// Ends it; nobody misses anything that it has made.
    pub(super) fn end(&mut self) {
        if let Some(mut process) = self.take() {
            process.end();
        }
    }
}

impl Supervisor<'_> {
    /// Starts a standby process if there is none, and replaces one that does not answer. Call it while no service needs a
    /// restart, those come first, or while one takes too long to start.
    pub fn keep_standby(&mut self) {
        if let Some(reserve) = &mut self.reserve {
            reserve.refill();
        }
        if let Some(missed) = self.standby.beat(Instant::now())
            && let Some(process) = self.standby.take()
        {
            self.reap_standby(process, Some(missed.to_owned()));
            self.pending.push(ServiceEvent::Died);
        }
        if !self.standby.is_wanted() {
            return;
        }
        // Nothing depends on it: what goes wrong with it is the next one's matter.
        let Ok(process) = self.spawn(SPARE) else {
            return self.standby.note_failure(false);
        };
        if self.instruct(&process, None).is_ok() {
            self.standby.process = Some(process);
        } else {
            self.reap_standby(process, None);
        }
    }

    /// Gives the role to the standby process, if there is one that lives, also if it is not done preparing: it is
    /// further than one that begins now. Returns also whether it is.
    pub(super) fn take_standby(&mut self, role: Role) -> Option<(Process, bool)> {
        let died = self.listen_to_standby();
        self.pending.extend(died);
        let was_prepared = self.standby.is_prepared();
        let mut process = self.standby.take()?;
        // One whose line is full has not read for long.
        if !matches!(process.channel.try_send(&ToService::Become(role)), Ok(true)) {
            self.reap_standby(process, None);
            self.pending.push(ServiceEvent::Died);
            return None;
        }
        process.asked_at = Instant::now();
        process.delayed_before_ns = Activity::of(process.id()).map_or(0, |activity| activity.run_delay_ns);
        self.standby.fruitless = 0;
        Some((process, was_prepared))
    }

    /// Takes the messages of the standby process: that it is prepared, or that it cannot do its work. Notices its death.
    pub(super) fn listen_to_standby(&mut self) -> Option<ServiceEvent> {
        for _ in 0..MESSAGES_AT_A_LOOK {
            let process = self.standby.process.as_ref()?;
            // Before the look: the last words of a process that has ended by now have all been sent.
            let has_ended = process.has_ended();
            let said = match process.channel.try_receive() {
                Ok(None) if !has_ended => return None,
                Ok(Some(ToOrchestrator::Prepared)) => {
                    (self.standby.answered_at, self.standby.asked_at) = (Some(Instant::now()), None);
                    continue;
                }
                Ok(Some(
                    ToOrchestrator::Failed { reason }
                    | ToOrchestrator::Refused { reason }
                    | ToOrchestrator::Dying { reason },
                )) => Some(reason),
                Ok(_) => None,
                Err(_) => {
                    process.ends_within(AFTER_CLOSING);
                    None
                }
            };
            let process = self.standby.take()?;
            self.reap_standby(process, said);
            return Some(ServiceEvent::Died);
        }
        None
    }

    /// Ends a standby process that cannot serve, and keeps what it `said` of that, or else how it ended.
    fn reap_standby(&mut self, mut process: Process, said: Option<String>) {
        // One that has only failed still lives.
        let exit = process.end();
        self.standby.note_failure(process.asked_at.elapsed() > SETTLED);
        let description = format!("a standby process: {}", said.unwrap_or(exit.description));
        self.exits.push((
            None,
            process.id(),
            Exit {
                description,
                killed: exit.killed,
            },
        ));
        self.member.clean_up_after_the_dead();
    }
}
