//! What is special about guests: programs of one's own that fly in place of services.
//!
//! A guest does not see the words that services share, so that the orchestrator writes there what it says of itself. What
//! it knows is kept nowhere: in simulated time its death ends the flight, because nobody could go on as if nothing had
//! happened, and in real time the next one begins anew.

use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

use runtime::control::{ControlError, Host, ToOrchestrator, ToService};
use runtime::shared_page::Cell;
use rustix::process::Signal;
use shared_types::ServiceId;

use super::member::Phase;
use super::presentable::presentable;
use super::{Crew, CrewEvent, Exit, STOP_LIMIT};
use crate::FlightFailure;

/// How long a guest may take to make its ports, and to connect to those of a service that was started again.
pub(super) const PATIENCE: Duration = Duration::from_secs(10);

/// How long a guest may live after it has closed its line: a program that ends closes it a little before.
const AFTER_CLOSING: Duration = Duration::from_millis(100);

impl Crew<'_> {
    pub(super) fn is_guest(&self, at: usize) -> bool {
        let service = self.members[at].service;
        self.start.scenario.program_of(service).is_some()
    }

    /// The services in whose place guests fly.
    pub(crate) fn guests(&self) -> impl Iterator<Item = ServiceId> {
        let at = 0..self.members.len();
        at.filter(|&at| self.is_guest(at))
            .map(|at| self.members[at].service)
    }

    /// Writes for a guest what services write themselves; what it did wrong, in words.
    pub(super) fn hear_guest(&self, at: usize, message: &ToOrchestrator) -> Result<(), String> {
        let service = self.members[at].service;
        let cell = &self.page.words().cells[service.index()];
        match (message, self.members[at].phase) {
            (ToOrchestrator::Ready { receivers, .. }, Phase::Starting) => {
                self.know_receivers(service, cell, receivers)
            }
            (ToOrchestrator::Connected { birth }, Phase::Flying) => {
                cell.births_seen.store(*birth, Ordering::Release);
                Ok(())
            }
            (ToOrchestrator::Deployed { .. }, Phase::Starting)
            | (ToOrchestrator::Finished, Phase::Flying)
            | (ToOrchestrator::Failed { .. }, _) => Ok(()),
            (message, _) => {
                let message = presentable(&serde_json::to_string(message).unwrap_or_default());
                Err(format!("says {message}, which it is not its turn to say"))
            }
        }
    }

    /// In simulated time publishers wait for these receivers when their buffers are full.
    fn know_receivers(&self, service: ServiceId, cell: &Cell, receivers: &[String]) -> Result<(), String> {
        let inputs = service.inputs().len();
        if receivers.len() != inputs {
            let named = receivers.len();
            return Err(format!(
                "is ready with {named} receivers, and has {inputs} inputs"
            ));
        }
        if self.start.host == Host::LockStep {
            for (known, receiver) in cell.receivers.iter().zip(receivers) {
                let id = u128::from_str_radix(receiver, 16);
                known.store(id.map_err(|_| {
                    let receiver = presentable(receiver);
                    format!("calls a receiver `{receiver}`, which is no hexadecimal number")
                })?);
            }
        }
        Ok(())
    }

    /// Ends a guest that has said or done what it must not. Before the flight and in simulated time that ends the flight;
    /// in real time another one takes its place, as after any death.
    pub(super) fn blame_guest(&mut self, at: usize, what: String) -> Option<CrewEvent> {
        self.members[at].process.kill_group();
        if self.can_be_followed() {
            self.members[at].blamed.get_or_insert(what);
            return None;
        }
        self.members[at].phase = Phase::GivenUp;
        Some(CrewEvent::Lost(self.guest_failure(at, what)))
    }

    /// Ends what is left of a guest that has died or closed its line; says so if it lived on.
    pub(super) fn end_guest(&mut self, at: usize) {
        let is_to_stop = self.page.words().stopping.load(Ordering::Relaxed) != 0;
        let grace = if is_to_stop { STOP_LIMIT } else { AFTER_CLOSING };
        let has_ended = self.members[at].process.ends_within(grace);
        self.members[at].process.kill_group();
        if !has_ended && !is_to_stop {
            let what = "has closed its control channel and did not end".to_owned();
            self.members[at].blamed.get_or_insert(what);
        }
    }

    /// Why the flight cannot go on after the end of a process, if it was that of a guest that none can follow.
    pub(super) fn guests_last_end(&self, at: usize, exit: &Exit) -> Option<FlightFailure> {
        if !self.is_guest(at) || self.can_be_followed() {
            return None;
        }
        let how = &exit.description;
        let what = match self.members[at].phase {
            Phase::Starting => format!("ended before it was ready: {how}"),
            Phase::Ready => format!("ended before the flight began: {how}"),
            _ => format!(
                "ended: {how}; an external service has no checkpoint, so that it cannot be restarted in lock-step"
            ),
        };
        Some(self.guest_failure(at, what))
    }

    /// Whether another process may take the place of a guest.
    fn can_be_followed(&self) -> bool {
        let is_in_flight = self.page.words().start_ns.load(Ordering::Acquire) != 0;
        self.start.host == Host::RealTime && is_in_flight
    }

    /// # Errors
    /// [`FlightFailure::Guest`] if a guest in flight has not connected to the birth of this number for too long.
    pub(super) fn limit_guests_silence(
        &self,
        birth: u32,
        announced_at: Instant,
    ) -> Result<(), FlightFailure> {
        let is_deaf = |&at: &usize| {
            let member = &self.members[at];
            let seen = &self.page.words().cells[member.service.index()].births_seen;
            self.is_guest(at) && member.phase == Phase::Flying && seen.load(Ordering::Acquire) < birth
        };
        let deaf = (0..self.members.len()).find(is_deaf);
        let Some(at) = deaf.filter(|_| announced_at.elapsed() > PATIENCE) else {
            return Ok(());
        };
        let what = format!(
            "has not answered `Connect` within {} s, and nobody can fly on before",
            PATIENCE.as_secs()
        );
        Err(self.guest_failure(at, what))
    }

    /// # Errors
    /// [`FlightFailure::Guest`] if a guest has taken too long to make its ports.
    pub(super) fn limit_guests_patience(&self, at: usize, now: Instant) -> Result<(), FlightFailure> {
        if now.saturating_duration_since(self.members[at].process.asked_at) <= PATIENCE {
            return Ok(());
        }
        self.members[at].process.signal(Signal::KILL);
        let what = format!("has not said that it is ready within {} s", PATIENCE.as_secs());
        Err(self.guest_failure(at, what))
    }

    /// Lets guests in flight connect to a service that was born again.
    ///
    /// # Errors
    /// [`FlightFailure`] if the system refuses.
    pub(super) fn connect_guests(&self, birth: u32) -> Result<(), FlightFailure> {
        let mut guests = self.guests();
        guests.try_for_each(|guest| self.say(guest, &ToService::Connect { birth }))
    }

    /// What a guest did wrong that says to have flown its last step, and of which samples are missing.
    pub(crate) fn blame_for_missing(&self, guest: ServiceId) -> FlightFailure {
        let what = "says that it has finished, and has not published all its samples";
        self.guest_failure(guest.index(), what.to_owned())
    }

    /// Whether a service has flown its last step, as it says.
    pub(crate) fn is_finished(&self, service: ServiceId) -> bool {
        self.members[service.index()].phase == Phase::Finished
    }

    /// Takes note of how far guests have come, as far as their samples tell: `newest` says the tick of the newest of a
    /// guest's, and how many have come.
    pub(crate) fn note_guests_steps(&self, newest: impl Fn(ServiceId) -> Option<(u64, u64)>) {
        for guest in self.guests() {
            if let Some((tick, samples)) = newest(guest) {
                let cell = &self.page.words().cells[guest.index()];
                cell.steps_until.store(tick + 1, Ordering::Relaxed);
                cell.steps.store(samples, Ordering::Relaxed);
            }
        }
    }

    fn guest_failure(&self, at: usize, what: String) -> FlightFailure {
        FlightFailure::Guest {
            service: self.members[at].name.to_owned(),
            pid: self.members[at].process.id(),
            what,
        }
    }
}

/// Why a message is none, without what is said of services of another build.
pub(super) fn reason(error: &ControlError) -> String {
    match error {
        ControlError::Message(problem) => problem.to_string(),
        other => other.to_string(),
    }
}
