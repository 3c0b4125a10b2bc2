//! Standby process: waits to take the role of the next service that dies.
//!
//! It has already loaded, joined the run and built all services, which is most of a start-up. A run does not depend on
//! it: without one, dead services get new processes, and one that hangs is replaced by the next (`starting.rs`).

use std::time::{Duration, Instant};

use runtime::activity::Activity;
use runtime::control::{Role, ToOrchestrator, ToService};
use runtime::process::SPARE;

use super::process::Process;
use super::restart_policy::{BEAT_LIMIT, BEAT_PERIOD, PREPARATION_LIMIT, RestartPolicy};
use super::starting::AFTER_CLOSING;
use super::{Exit, MAX_MESSAGES, ServiceEvent, Supervisor};

/// A standby process that ran this long does not count as a failed start.
const SETTLED: Duration = Duration::from_secs(1);

/// Standby process, if there is one.
#[derive(Default)]
pub(super) struct Standby {
    pub(super) process: Option<Process>,
    /// Time of its last answer; `None` before it is prepared.
    answered_at: Option<Instant>,
    /// Time of a heartbeat that it has not answered yet.
    asked_at: Option<Instant>,
    /// Number of consecutive failed starts.
    fruitless: u32,
    /// Earliest time of the next start; `None` if at once.
    again_at: Option<Instant>,
    policy: RestartPolicy,
}

impl Standby {
    fn is_due(&self) -> bool {
        self.process.is_none()
            && self.policy.pause(self.fruitless).is_some()
            && self.again_at.is_none_or(|again_at| again_at <= Instant::now())
    }

    /// Handles a failure: the next start is delayed, or the last.
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

    /// Sends a heartbeat when due. Returns the missed deadline, as a sentence.
    fn beat(&mut self, now: Instant) -> Option<&'static str> {
        let process = self.process.as_ref()?;
        let is_past = |since: Instant, limit| now.saturating_duration_since(since) > limit;
        match (self.answered_at, self.asked_at) {
            (None, _) => is_past(process.asked_at, PREPARATION_LIMIT).then_some("it did not become prepared"),
            (Some(_), Some(asked_at)) => is_past(asked_at, BEAT_LIMIT).then_some("it did not answer"),
            (Some(answered_at), None) => {
                // A closed channel is detected when it is read.
                if is_past(answered_at, BEAT_PERIOD) && process.channel.try_send(&ToService::Beat).is_ok() {
                    self.asked_at = Some(now);
                }
                None
            }
        }
    }

    /// Ends the process. It has created nothing that others use.
    pub(super) fn end(&mut self) {
        if let Some(mut process) = self.take() {
            process.end();
        }
    }
}

impl Supervisor<'_> {
    /// Starts a standby process if there is none, and replaces one that does not answer. To be called while no service
    /// needs a restart, which has precedence, or while one takes too long to start.
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
        if !self.standby.is_due() {
            return;
        }
        // The run does not depend on it: a failure only delays the next start.
        let Ok(process) = self.spawn(SPARE) else {
            return self.standby.note_failure(false);
        };
        if self.send_start(&process, None).is_ok() {
            self.standby.process = Some(process);
        } else {
            self.reap_standby(process, None);
        }
    }

    /// Gives the role to the standby process, if one is alive, even if it is not fully prepared: it is ahead of a new
    /// process. Returns whether it was prepared.
    pub(super) fn take_standby(&mut self, role: Role) -> Option<(Process, bool)> {
        let died = self.receive_from_standby();
        self.pending.extend(died);
        let was_prepared = self.standby.is_prepared();
        let mut process = self.standby.take()?;
        // A process whose channel is full has not read for long.
        if !matches!(process.channel.try_send(&ToService::Become(role)), Ok(true)) {
            self.reap_standby(process, None);
            self.pending.push(ServiceEvent::Died);
            return None;
        }
        process.asked_at = Instant::now();
        process.delayed_before_ns = Activity::read(process.id()).map_or(0, |activity| activity.run_delay_ns);
        self.standby.fruitless = 0;
        Some((process, was_prepared))
    }

    /// Receives the messages of the standby process, on its preparation or its failure, and detects its death.
    pub(super) fn receive_from_standby(&mut self) -> Option<ServiceEvent> {
        for _ in 0..MAX_MESSAGES {
            let process = self.standby.process.as_ref()?;
            // Checked before the receive: all messages of a process that has ended by now are already in the channel.
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

    /// Ends a failed standby process, and records its own report, or else its exit.
    fn reap_standby(&mut self, mut process: Process, said: Option<String>) {
        // A process that has reported a failure may still be alive.
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
        self.node.clean_up_after_the_dead();
    }
}
