//! Supervision of external services.
//!
//! An external service has no access to the control block, so the orchestrator writes its state there. It has no
//! checkpoints: in simulated time its death ends the flight, because no process could continue exactly, and in real
//! time its successor makes a cold start.

use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

use runtime::control::{ControlError, Host, ToOrchestrator, ToService};
use runtime::shared_page::Cell;
use shared_types::ServiceId;

use super::managed_service::Phase;
use super::presentable::presentable;
use super::restart_policy::{EXTERNAL_LIMIT, Verdict, doubled, external_start_limit};
use super::{Exit, ServiceEvent, Supervisor};
use crate::RunFailure;

impl Supervisor<'_> {
    pub(super) fn is_external_service(&self, at: usize) -> bool {
        let service = self.members[at].service;
        self.start.scenario.program_of(service).is_some()
    }

    /// Returns the services that are replaced by external programs.
    pub(crate) fn external_services(&self) -> impl Iterator<Item = ServiceId> {
        let at = 0..self.members.len();
        at.filter(|&at| self.is_external_service(at))
            .map(|at| self.members[at].service)
    }

    /// Validates a message of an external service and updates its cell of the control block. Returns the violation of
    /// the contract, if any.
    pub(super) fn handle_external_message(&self, at: usize, message: &ToOrchestrator) -> Result<(), String> {
        let service = self.members[at].service;
        let cell = &self.page.control_block().cells[service.index()];
        match (message, self.members[at].phase) {
            (ToOrchestrator::Ready { receivers, .. }, Phase::Starting) => {
                self.store_receivers(service, cell, receivers)
            }
            (ToOrchestrator::Connected { birth }, Phase::Flying) => {
                // Release, as in a service's own process: the supervisor's Acquire in `resume` pairs with it.
                cell.restarts_seen.store(*birth, Ordering::Release);
                Ok(())
            }
            (ToOrchestrator::Deployed { .. }, Phase::Starting)
            | (ToOrchestrator::Finished, Phase::Flying)
            | (ToOrchestrator::Failed { .. }, _) => Ok(()),
            (message, _) => {
                let message = presentable(&serde_json::to_string(message).unwrap_or_default());
                Err(format!("says {message}, which it is not its turn to send"))
            }
        }
    }

    /// In simulated time publishers wait for these receivers when their buffers are full.
    fn store_receivers(&self, service: ServiceId, cell: &Cell, receivers: &[String]) -> Result<(), String> {
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

    /// Kills an external service that has violated the contract. Before the flight and in simulated time this ends the
    /// run; in real time another process replaces it, as after any death.
    pub(super) fn blame_external_service(&mut self, at: usize, what: String) -> Option<ServiceEvent> {
        self.members[at].process.kill_group();
        if self.can_be_followed() {
            self.members[at].blamed.get_or_insert(what);
            return None;
        }
        self.members[at].phase = Phase::GivenUp;
        Some(ServiceEvent::Lost(self.external_service_failure(at, what)))
    }

    /// Returns the failure of the flight after the end of a process, if it was an external service that cannot be
    /// replaced.
    pub(super) fn external_end_failure(&self, at: usize, exit: &Exit) -> Option<RunFailure> {
        if !self.is_external_service(at) || self.can_be_followed() {
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
        Some(self.external_service_failure(at, what))
    }

    /// Returns whether another process may replace an external service.
    fn can_be_followed(&self) -> bool {
        let is_in_flight = self.page.control_block().start_ns.load(Ordering::Acquire) != 0;
        self.start.host == Host::RealTime && is_in_flight
    }

    /// Limits the time in which external services connect to a restarted service.
    ///
    /// # Errors
    /// [`RunFailure::ExternalService`] if an external service in flight has not connected to restart number `birth` in
    /// time.
    pub(super) fn limit_connect_time(&self, birth: u32, announced_at: Instant) -> Result<(), RunFailure> {
        let is_unconnected = |&at: &usize| {
            let member = &self.members[at];
            let seen = &self.page.control_block().cells[member.service.index()].restarts_seen;
            self.is_external_service(at)
                && member.phase == Phase::Flying
                && seen.load(Ordering::Acquire) < birth
        };
        let unconnected = (0..self.members.len()).find(is_unconnected);
        let Some(at) = unconnected.filter(|_| announced_at.elapsed() > EXTERNAL_LIMIT) else {
            return Ok(());
        };
        let what = format!(
            "has not answered `Connect` within {} s, and no service can fly on before",
            EXTERNAL_LIMIT.as_secs()
        );
        Err(self.external_service_failure(at, what))
    }

    /// Kills an external service that has not created its ports in time.
    ///
    /// # Errors
    /// [`RunFailure::ExternalService`] if it cannot be replaced.
    pub(super) fn limit_external_start(&mut self, at: usize, now: Instant) -> Result<(), RunFailure> {
        let starting = self.starting_process(at, now);
        match starting.verdict_on_external_service() {
            Verdict::Wait | Verdict::Hedge => Ok(()),
            Verdict::Replace => {
                let seconds = starting.elapsed.as_secs_f64();
                self.replace(at, format!("was not ready after {seconds:.3} s"));
                Ok(())
            }
            Verdict::Fail => {
                let limit = EXTERNAL_LIMIT.as_secs();
                self.members[at].process.kill_group();
                let what = format!("has not said that it is ready within {limit} s");
                Err(self.external_service_failure(at, what))
            }
        }
    }

    /// Returns the time limit of an external service's first step; 0 for other services.
    #[must_use]
    pub fn first_step_limit(&self, service: ServiceId) -> Duration {
        let member = &self.members[service.index()];
        match self.is_external_service(service.index()) {
            true => doubled(external_start_limit(member.longest_start), member.fruitless),
            false => Duration::ZERO,
        }
    }

    /// Tells external services in flight to connect to a restarted service.
    ///
    /// # Errors
    /// [`RunFailure`] if a message cannot be sent.
    pub(super) fn connect_external_services(&self, birth: u32) -> Result<(), RunFailure> {
        let mut external_services = self.external_services();
        external_services
            .try_for_each(|external_service| self.send(external_service, &ToService::Connect { birth }))
    }

    /// Returns the failure of an external service that reports the end of its steps although samples are missing.
    pub(crate) fn blame_for_missing(&self, external_service: ServiceId) -> RunFailure {
        let what = "says that it has finished, and has not published all its samples";
        self.external_service_failure(external_service.index(), what.to_owned())
    }

    /// Returns whether a service has reported the end of its steps.
    pub(crate) fn is_finished(&self, service: ServiceId) -> bool {
        self.members[service.index()].phase == Phase::Finished
    }

    /// Updates the progress of external services from their samples: `newest` returns the tick of a service's newest
    /// sample and the number of samples.
    pub(crate) fn note_external_services_steps(&self, newest: impl Fn(ServiceId) -> Option<(u64, u64)>) {
        for external_service in self.external_services() {
            if let Some((tick, samples)) = newest(external_service) {
                let cell = &self.page.control_block().cells[external_service.index()];
                // Relaxed: counters for the display and the heartbeat; no data depends on them.
                cell.steps_until.store(tick + 1, Ordering::Relaxed);
                cell.steps.store(samples, Ordering::Relaxed);
            }
        }
    }

    fn external_service_failure(&self, at: usize, what: String) -> RunFailure {
        RunFailure::ExternalService {
            service: self.members[at].name.to_owned(),
            pid: self.members[at].process.id(),
            what,
        }
    }
}

/// Returns the reason why a message is invalid, without the advice for services of another build.
pub(super) fn reason(error: &ControlError) -> String {
    match error {
        ControlError::Message(problem) => problem.to_string(),
        other => other.to_string(),
    }
}
