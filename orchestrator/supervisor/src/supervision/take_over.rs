//! A supervisor that another orchestrator has started, and that flies.

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

/// A service process that was found in flight, and the line to it.
pub type OrphanedService = (Pid, Channel);

impl Shared {
    /// Maps what the processes of a run that is under way share.
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
    /// Takes over the services that fly, and starts those that have died meanwhile.
    ///
    /// # Errors
    /// [`RunFailure::setup`].
    pub(crate) fn adopt(
        member: &'a RunNode,
        lock: BorrowedFd<'a>,
        schedule: &'a Schedule,
        start: Start,
        shared: Shared,
        mut survivors: [Option<OrphanedService>; ServiceId::ALL.len()],
    ) -> Result<Self, RunFailure> {
        let mut supervisor = Self::without_members(member, lock, schedule, start, shared)?;
        supervisor.is_in_flight = true;
        for service in ServiceId::ALL {
            let survivor = survivors[service.index()].take();
            // One that has died since is as good as one that had died before.
            let process = survivor.and_then(|(pid, channel)| Process::adopt(pid, channel).ok());
            let adopted = match process {
                Some(process) => {
                    let mut flying = ManagedService::new(service, supervisor.name_of(service), process);
                    flying.phase = Phase::Flying;
                    supervisor.take_in(flying);
                    Ok(())
                }
                None => supervisor.start_service(service),
            };
            if let Err(failure) = adopted {
                supervisor.leave_alone();
                return Err(failure);
            }
        }
        Ok(supervisor)
    }

    /// Lets go of all services without a word: without an orchestrator they land by themselves.
    pub(super) fn leave_alone(&mut self) {
        self.members.clear();
    }
}
