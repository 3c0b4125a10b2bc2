//! Supervisor of services that another orchestrator has started.

use std::os::fd::{BorrowedFd, OwnedFd};

use runtime::checkpoints::Checkpoints;
use runtime::control::{Channel, Start};
use runtime::ports::RunNode;
use runtime::shared_page::SharedPage;
use runtime::step_log::StepLog;
use rustix::process::Pid;
use shared_types::{Schedule, ServiceId};

use super::process::Process;
use super::{RestartPolicies, Shared, Supervisor, now};
use crate::RunFailure;

/// Service process found in flight, with its channel.
pub type OrphanedService = (Pid, Channel);

impl Shared {
    /// Maps the memory shared by the processes of a running flight.
    ///
    /// # Errors
    /// If the files are not those of a run of this build.
    pub(crate) fn inherit(page: OwnedFd, checkpoints: OwnedFd, step_log: OwnedFd) -> std::io::Result<Self> {
        Ok(Self {
            page: SharedPage::open(page)?,
            checkpoints: Checkpoints::open(checkpoints)?,
            step_log: StepLog::open(step_log)?,
        })
    }
}

impl<'a> Supervisor<'a> {
    /// Takes over the flying services, and starts those that have died meanwhile.
    ///
    /// # Errors
    /// [`RunFailure`] if there is no memory or descriptor for the supervisor itself.
    pub(crate) fn adopt(
        node: &'a RunNode,
        lock: BorrowedFd<'a>,
        schedule: &'a Schedule,
        start: Start,
        shared: Shared,
        mut survivors: [Option<OrphanedService>; ServiceId::ALL.len()],
    ) -> Result<Self, RunFailure> {
        let policies = RestartPolicies::default();
        let mut supervisor = Self::without_members(node, lock, schedule, start, shared, policies)?;
        supervisor.supervision.continue_flight();
        for service in ServiceId::ALL {
            let survivor = survivors[service.index()].take();
            // A process that has died since it connected counts as dead.
            let process = survivor.and_then(|(pid, channel)| Process::adopt(pid, channel).ok());
            match process {
                Some(process) => supervisor.adopt_next(process),
                // If the system refuses, the flight has failed: it lands, and the start is tried again.
                None => supervisor.begin_next(),
            }
        }
        Ok(supervisor)
    }

    fn adopt_next(&mut self, process: Process) {
        let scenario = &self.processes.start.scenario;
        let number = self.supervision.adopt_next(now(), scenario, process.id());
        self.processes.add(number, process);
    }
}
