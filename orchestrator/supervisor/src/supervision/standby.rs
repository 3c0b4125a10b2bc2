//! Standby process: waits to take the role of the next service that dies.
//!
//! It has loaded, joined the run and built all services by then, which is most of what a new process has to do. A run never depends on it: without one the dead are followed by processes that are started then.

use std::time::{Duration, Instant};

use runtime::control::{Role, ToOrchestrator, ToService};
use runtime::process::SPARE;
use rustix::process::Signal;

use super::process::Process;
use super::restart_policy::RestartPolicy;
use super::{Exit, ServiceEvent, Supervisor};

/// One that has lived for so long was well: what it died of was no fault of its own.
const SETTLED: Duration = Duration::from_secs(1);

/// The standby process, if there is one.
#[derive(Default)]
pub(super) struct Standby {
    pub(super) process: Option<Process>,
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

    /// Ends it; nobody misses anything that it has made.
    pub(super) fn end(&mut self) {
        if let Some(mut process) = self.process.take() {
            process.signal(Signal::KILL);
            process.wait();
        }
    }
}

impl Supervisor<'_> {
    /// Starts a standby process if there is none. Call it while no service needs a restart: those come first.
    pub fn keep_standby(&mut self) {
        if let Some(reserve) = &mut self.reserve {
            reserve.refill();
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
    /// further than one that begins now.
    pub(super) fn take_standby(&mut self, role: Role) -> Option<Process> {
        self.listen_to_standby();
        let mut process = self.standby.process.take()?;
        if process.channel.send(&ToService::Become(role)).is_err() {
            self.reap_standby(process, None);
            return None;
        }
        process.asked_at = Instant::now();
        self.standby.fruitless = 0;
        Some(process)
    }

    /// Notices that the standby process has died or cannot do its work. It has nothing else to say.
    pub(super) fn listen_to_standby(&mut self) -> Option<ServiceEvent> {
        let channel = &self.standby.process.as_ref()?.channel;
        let said = match channel.try_receive() {
            Ok(None) => return None,
            Ok(Some(ToOrchestrator::Failed { reason })) => Some(reason),
            Ok(Some(_)) | Err(_) => None,
        };
        let process = self.standby.process.take()?;
        self.reap_standby(process, said);
        Some(ServiceEvent::Died)
    }

    /// Ends a standby process that cannot serve, and keeps what it `said` of that, or else how it ended.
    fn reap_standby(&mut self, mut process: Process, said: Option<String>) {
        // One that has only failed still lives.
        process.signal(Signal::KILL);
        let exit = process.wait();
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
