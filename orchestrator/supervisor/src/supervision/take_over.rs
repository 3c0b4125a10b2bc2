//! Supervisor of services that another orchestrator has started.

use std::os::fd::{BorrowedFd, OwnedFd};

use runtime::checkpoints::Checkpoints;
use runtime::control::{Channel, Start};
use runtime::ports::RunNode;
use runtime::shared_page::SharedPage;
use runtime::step_log::StepLog;
use rustix::process::Pid;
use shared_types::{Schedule, ServiceId};

use super::managed_service::{ManagedService, Phase};
use super::process::Process;
use super::{Shared, Supervisor};
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
    /// [`RunFailure`] if one cannot be started.
    pub(crate) fn adopt(
        node: &'a RunNode,
        lock: BorrowedFd<'a>,
        schedule: &'a Schedule,
        start: Start,
        shared: Shared,
        mut survivors: [Option<OrphanedService>; ServiceId::ALL.len()],
    ) -> Result<Self, RunFailure> {
        let mut supervisor = Self::without_members(node, lock, schedule, start, shared)?;
        supervisor.is_in_flight = true;
        for service in ServiceId::ALL {
            let survivor = survivors[service.index()].take();
            // A process that has died since it connected counts as dead.
            let process = survivor.and_then(|(pid, channel)| Process::adopt(pid, channel).ok());
            let adopted = match process {
                Some(process) => {
                    let mut flying = ManagedService::new(service, supervisor.name_of(service), process);
                    flying.phase = Phase::Flying;
                    supervisor.add(flying);
                    Ok(())
                }
                None => supervisor.start_service(service),
            };
            if let Err(failure) = adopted {
                supervisor.release_all();
                return Err(failure);
            }
        }
        Ok(supervisor)
    }

    /// Releases all services without stopping them: without an orchestrator they land by themselves.
    pub(super) fn release_all(&mut self) {
        self.members.clear();
    }
}
