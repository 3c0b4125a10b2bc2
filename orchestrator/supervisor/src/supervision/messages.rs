//! Messages of processes, and what is validated in those of external services.
//!
//! An external service has no access to the control block, so the orchestrator writes its state there.

use std::sync::atomic::Ordering;

use decisions::event::Event;
use decisions::presentable::presentable;
use decisions::process::{ProcessNumber, Said};
use runtime::control::{ControlError, Host, ToOrchestrator};
use shared_types::ServiceId;

use super::Supervisor;
use crate::RunFailure;

impl Supervisor<'_> {
    /// Returns the next event of a process, if there is one.
    pub(super) fn next_event(&mut self, number: ProcessNumber) -> Option<Event> {
        let process = self.processes.get(number)?;
        // Checked before the receive: all messages of a process that has ended by now are already in the channel.
        let has_ended = process.has_ended();
        let received = match process.has_hung_up {
            true => Ok(None),
            false => process.channel.try_receive::<ToOrchestrator>(),
        };
        Some(match received {
            Ok(Some(message)) => self.validated(number, message),
            // A program may have passed its end of the channel to a process that outlives it.
            Ok(None) | Err(ControlError::Closed) if has_ended => Event::Ended(self.processes.end(number)?),
            Ok(None) => return None,
            Err(ControlError::Closed) => {
                self.processes.get_mut(number)?.has_hung_up = true;
                Event::HungUp
            }
            Err(error) => self.unreadable(number, &error),
        })
    }

    fn unreadable(&self, number: ProcessNumber, error: &ControlError) -> Event {
        if self.supervision.external_service_of(number).is_none() {
            return Event::Unreadable(error.to_string());
        }
        // Without the advice for services of another build.
        let reason = match error {
            ControlError::Message(problem) => problem.to_string(),
            other => other.to_string(),
        };
        Event::Unreadable(format!("says what is no message of the contract: {reason}"))
    }

    /// Returns a message as an event. That of an external service is validated, and its cell of the control block
    /// updated.
    fn validated(&self, number: ProcessNumber, message: ToOrchestrator) -> Event {
        let Some(service) = self.supervision.external_service_of(number) else {
            return Event::Said(said(message));
        };
        let cell = &self.page().control_block().cells[service.index()];
        let text = || presentable(&serde_json::to_string(&message).unwrap_or_default());
        if !self.supervision.is_its_turn(service, &said(message.clone())) {
            return Event::Violated(format!("says {}, which it is not its turn to send", text()));
        }
        match &message {
            ToOrchestrator::Ready { receivers, .. } => {
                if let Err(what) = self.store_receivers(service, receivers) {
                    return Event::Violated(what);
                }
            }
            // Release, as in a service's own process: the supervisor's Acquire pairs with it.
            ToOrchestrator::Connected { birth } => cell.restarts_seen.store(*birth, Ordering::Release),
            _ => {}
        }
        Event::Said(said(message))
    }

    /// In simulated time publishers wait for these receivers when their buffers are full.
    fn store_receivers(&self, service: ServiceId, receivers: &[String]) -> Result<(), String> {
        let cell = &self.page().control_block().cells[service.index()];
        let inputs = self.schedule.inputs(service).count();
        if receivers.len() != inputs {
            let named = receivers.len();
            return Err(format!(
                "is ready with {named} receivers, and has {inputs} inputs"
            ));
        }
        if self.processes.start.host == Host::LockStep {
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

    /// Returns the failure of an external service that reports the end of its steps although samples are missing.
    pub(crate) fn blame_for_missing(&self, external_service: ServiceId) -> RunFailure {
        let what = "says that it has finished, and has not published all its samples";
        self.supervision
            .violation(external_service, what.to_owned())
            .into()
    }

    /// Updates the progress of external services from their samples: `newest` returns the tick of a service's newest
    /// sample and the number of samples.
    pub(crate) fn note_external_services_steps(&self, newest: impl Fn(ServiceId) -> Option<(u64, u64)>) {
        for external_service in self.supervision.external_services() {
            if let Some((tick, samples)) = newest(external_service) {
                let cell = &self.page().control_block().cells[external_service.index()];
                // Relaxed: counters for the display and the heartbeat; no data depends on them.
                cell.steps_until.store(tick + 1, Ordering::Relaxed);
                cell.steps.store(samples, Ordering::Relaxed);
            }
        }
    }
}

fn said(message: ToOrchestrator) -> Said {
    match message {
        ToOrchestrator::Prepared => Said::Prepared,
        ToOrchestrator::Deployed { warnings } => Said::Deployed { warnings },
        ToOrchestrator::Ready { warnings, .. } => Said::Ready { warnings },
        ToOrchestrator::Connected { .. } => Said::Connected,
        ToOrchestrator::CaughtUp => Said::CaughtUp,
        ToOrchestrator::Finished => Said::Finished,
        ToOrchestrator::NonFinite(found) => Said::NonFinite(found),
        ToOrchestrator::Failed { reason } => Said::Failed { reason },
        ToOrchestrator::Refused { reason } => Said::Refused { reason },
        ToOrchestrator::Dying { reason } => Said::Dying { reason },
        ToOrchestrator::Stepped { .. } => Said::Stepped,
    }
}
