//! Standby process: waits to take the role of the next service that dies.
//!
//! It has already loaded, joined the run and built all services, which is most of a start-up. A run does not depend on
//! it: without one, dead services get new processes, and one that hangs is replaced by the next (`starting.rs`).

use std::time::Duration;

use crate::event::{Action, Event, News};
use crate::moment::Moment;
use crate::process::{Exit, Process, ProcessNumber, Role, Said};
use crate::restart_policy::{
    AFTER_CLOSING, BEAT_LIMIT, BEAT_PERIOD, END_LIMIT, PREPARATION_LIMIT, RestartPolicy,
};
use crate::supervision::Supervision;

/// A standby process that ran this long does not count as a failed start.
const SETTLED: Duration = Duration::from_secs(1);

/// Pause after many failed starts in a row: what prevents them, such as a full system, may pass.
const RARELY: Duration = Duration::from_secs(10);

/// Standby process, if there is one.
#[derive(Clone, Debug, Default)]
pub(crate) struct Standby {
    process: Option<Process>,
    /// Time of its last answer; `None` before it is prepared.
    answered_at: Option<Moment>,
    /// Time of a beat that it has not answered yet.
    asked_at: Option<Moment>,
    /// Standby processes that were killed and have not ended yet, with the reasons.
    dying: Vec<(Process, Option<String>)>,
    /// Number of consecutive failed starts.
    fruitless: u32,
    /// Earliest time of the next start; `None` if at once.
    again_at: Option<Moment>,
    policy: RestartPolicy,
}

impl Standby {
    fn is_due(&self, now: Moment) -> bool {
        self.process.is_none() && self.again_at.is_none_or(|again_at| again_at <= now)
    }

    /// Handles a failure: the next start is delayed.
    fn note_failure(&mut self, now: Moment, has_settled: bool) {
        self.fruitless = if has_settled { 0 } else { self.fruitless + 1 };
        let pause = self.policy.pause(self.fruitless).unwrap_or(RARELY);
        self.again_at = Some(now + pause);
    }

    /// Returns whether there is one that is prepared for a role.
    pub(crate) fn is_prepared(&self) -> bool {
        let can_take_a_role = |process: &Process| process.hung_up_at.is_none();
        self.process.as_ref().is_some_and(can_take_a_role) && self.answered_at.is_some()
    }

    fn take(&mut self) -> Option<Process> {
        (self.answered_at, self.asked_at) = (None, None);
        self.process.take()
    }

    /// Returns the processes that have not ended.
    pub(crate) fn living(&self) -> impl Iterator<Item = ProcessNumber> {
        let dying = self.dying.iter().map(|(process, _)| process);
        self.process.iter().chain(dying).map(|process| process.number)
    }

    /// Removes a process that has ended. Returns it with the reason for which it was killed, if it was.
    fn remove(&mut self, number: ProcessNumber) -> Option<(Process, Option<String>)> {
        if self.is(number) {
            return self.take().map(|process| (process, None));
        }
        let mut dying = self.dying.iter();
        let at = dying.position(|(process, _)| process.number == number)?;
        Some(self.dying.swap_remove(at))
    }

    /// Returns whether a process is or was a standby process, and has not ended.
    pub(crate) fn knows(&self, number: ProcessNumber) -> bool {
        self.living().any(|other| other == number)
    }

    /// Returns whether a process is the standby process, and was not killed.
    fn is(&self, number: ProcessNumber) -> bool {
        self.process
            .as_ref()
            .is_some_and(|process| process.number == number)
    }

    /// Returns the missed deadline, as a sentence, and whether a beat is due.
    fn check(&self, now: Moment) -> (Option<&'static str>, bool) {
        let Some(process) = &self.process else {
            return (None, false);
        };
        let is_past = |since: Moment, limit| now.since(since) > limit;
        if process.hung_up_at.is_some_and(|at| is_past(at, AFTER_CLOSING)) {
            return (Some("it has closed its control channel and did not end"), false);
        }
        match (self.answered_at, self.asked_at) {
            (None, _) => {
                let is_late = is_past(process.asked_at, PREPARATION_LIMIT);
                (is_late.then_some("it did not become prepared"), false)
            }
            (Some(_), Some(asked_at)) => {
                let is_late = is_past(asked_at, BEAT_LIMIT);
                (is_late.then_some("it did not answer"), false)
            }
            (Some(answered_at), None) => (None, is_past(answered_at, BEAT_PERIOD)),
        }
    }
}

impl Supervision {
    /// Starts a standby process if there is none, and replaces one that does not answer: while no service needs a
    /// restart, which has precedence, or while one takes too long to start.
    pub(crate) fn keep_standby(&mut self, now: Moment) {
        match self.standby.check(now) {
            (Some(missed), _) => self.kill_standby(now, Some(missed.to_owned())),
            (None, true) => {
                if let Some(process) = &self.standby.process {
                    let process = process.number;
                    self.standby.asked_at = Some(now);
                    self.act(Action::Beat { process });
                }
            }
            (None, false) => {}
        }
        if self.standby.is_due(now) {
            let process = self.start_process(now, None);
            self.standby.process = Some(process);
        }
    }

    /// Takes the standby process for a role, if there is one, even if it is not fully prepared: it is ahead of a new
    /// process. Returns whether it was prepared.
    pub(crate) fn take_standby(&mut self, role: Role) -> Option<(Process, bool)> {
        let was_prepared = self.standby.is_prepared();
        let has_hung_up = self.standby.process.as_ref()?.hung_up_at.is_some();
        if has_hung_up {
            return None;
        }
        let process = self.standby.take()?;
        self.standby.fruitless = 0;
        self.act(Action::Become {
            process: process.number,
            role,
        });
        Some((process, was_prepared))
    }

    /// Kills the standby process.
    fn kill_standby(&mut self, now: Moment, reason: Option<String>) {
        if let Some(mut process) = self.standby.take() {
            process.killed_at = Some(now);
            self.act(Action::Kill {
                process: process.number,
            });
            self.standby.dying.push((process, reason));
        }
    }

    /// Ends the standby process: the run ends, or does not need it any more.
    pub(crate) fn end_standby(&mut self, now: Moment) {
        self.kill_standby(now, None);
    }

    /// Handles an event of a standby process.
    pub(crate) fn handle_standby(&mut self, now: Moment, number: ProcessNumber, event: Event) {
        let is_current = self.standby.is(number);
        match event {
            Event::Ended(exit) => self.reap_standby(now, number, exit),
            _ if !is_current => {}
            // Sent to services only: a standby process with a role is one.
            Event::Asked => {}
            Event::Started { pid } => {
                if let Some(process) = &mut self.standby.process {
                    (process.pid, process.asked_at) = (pid, now);
                }
            }
            // The run does not depend on it: a failure only delays the next start.
            Event::NotStarted(_) => {
                self.standby.take();
                self.standby.note_failure(now, false);
            }
            Event::Said(Said::Prepared) => {
                (self.standby.answered_at, self.standby.asked_at) = (Some(now), None);
            }
            Event::Said(Said::Failed { reason } | Said::Refused { reason } | Said::Dying { reason }) => {
                self.kill_standby(now, Some(reason));
            }
            Event::HungUp => {
                if let Some(process) = &mut self.standby.process {
                    process.hung_up_at.get_or_insert(now);
                }
            }
            Event::Said(_) | Event::Unreadable(_) | Event::Violated(_) | Event::Deaf | Event::MissedSent => {
                self.kill_standby(now, None);
            }
        }
    }

    /// Records the end of a standby process, with its own report or else its exit, unless the run ends.
    fn reap_standby(&mut self, now: Moment, number: ProcessNumber, exit: Exit) {
        let Some((process, said)) = self.standby.remove(number).filter(|_| !self.is_stopping) else {
            return;
        };
        self.standby
            .note_failure(now, now.since(process.asked_at) > SETTLED);
        let description = format!("a standby process: {}", said.unwrap_or(exit.description));
        let killed = exit.killed;
        self.exits.push((None, process.pid, Exit { killed, description }));
        self.act(Action::CleanUp);
        self.news.push(News::Died { pid: process.pid });
    }

    /// Gives up waiting for the ends of standby processes that were killed long ago.
    pub(crate) fn forget_stuck_standbys(&mut self, now: Moment) {
        let dying = self.standby.dying.iter();
        let stuck = dying.filter(|(process, _)| process.outlives(now, END_LIMIT));
        let stuck: Vec<_> = stuck.map(|(process, _)| process.number).collect();
        for number in stuck {
            self.reap_standby(now, number, Exit::stuck());
        }
    }
}
