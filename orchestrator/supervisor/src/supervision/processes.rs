//! The processes of a run as the system knows them, and the memory that they share.

use std::io;
use std::os::fd::{AsFd, BorrowedFd};
use std::sync::atomic::Ordering;
use std::time::Duration;

use decisions::event::Facts;
use decisions::process::{Exit, ProcessNumber, Role};
use host::activity::Activity;
use runtime::checkpoints::Checkpoints;
use runtime::control::{self, ControlError, Start, ToService};
use runtime::crash::Crash;
use runtime::doorbell::Doorbell;
use runtime::ports::RunNode;
use runtime::process::SPARE;
use runtime::shared_page::{Cell, SharedPage};
use runtime::step_log::StepLog;
use runtime::{activity, deployment};
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use shared_types::ServiceId;

use super::Shared;
use super::descriptor_reserve::DescriptorReserve;
use super::process::Process;
use crate::RunFailure;

/// The processes that have not ended, and what they share.
pub(super) struct Processes<'a> {
    pub(super) node: &'a RunNode,
    lock: BorrowedFd<'a>,
    pub(super) start: Start,
    /// Planned crashes: the first one of a service applies until its process dies by itself, and so on.
    pub(super) crashes: Vec<(ServiceId, Crash)>,
    pub(super) page: SharedPage,
    pub(super) checkpoints: Checkpoints,
    pub(super) step_log: StepLog,
    pub(super) doorbells: Vec<Doorbell>,
    /// Reserved descriptors for restarts.
    pub(super) descriptors: DescriptorReserve,
    living: Vec<(ProcessNumber, Process)>,
}

impl<'a> Processes<'a> {
    pub(super) fn new(
        node: &'a RunNode,
        lock: BorrowedFd<'a>,
        start: Start,
        shared: Shared,
    ) -> Result<Self, RunFailure> {
        let doorbells = ServiceId::ALL.iter().map(|_| Doorbell::create());
        Ok(Self {
            node,
            lock,
            start,
            crashes: Vec::new(),
            page: shared.page,
            checkpoints: shared.checkpoints,
            step_log: shared.step_log,
            doorbells: doorbells.collect::<Result<_, _>>().map_err(RunFailure::setup)?,
            descriptors: DescriptorReserve::new(),
            living: Vec::new(),
        })
    }

    pub(super) fn add(&mut self, number: ProcessNumber, process: Process) {
        self.living.push((number, process));
    }

    pub(super) fn get(&self, number: ProcessNumber) -> Option<&Process> {
        let mut living = self.living.iter();
        living
            .find(|(other, _)| *other == number)
            .map(|(_, process)| process)
    }

    pub(super) fn get_mut(&mut self, number: ProcessNumber) -> Option<&mut Process> {
        let mut living = self.living.iter_mut();
        living
            .find(|(other, _)| *other == number)
            .map(|(_, process)| process)
    }

    /// Removes a process that has ended, or ends it; returns its exit.
    pub(super) fn end(&mut self, number: ProcessNumber) -> Option<Exit> {
        let at = self.living.iter().position(|(other, _)| *other == number)?;
        let (_, mut process) = self.living.swap_remove(at);
        Some(process.end())
    }

    /// Removes what ended processes have left in shared memory.
    pub(super) fn clean_up(&mut self) {
        self.descriptors.lend();
        self.node.clean_up_after_the_dead();
    }

    /// Returns the role as a process gets it, with its planned crash.
    pub(super) fn role(&self, Role { service, deaths }: Role) -> control::Role {
        let mut own = self.crashes.iter().filter(|(whose, _)| *whose == service);
        let crash = own.nth(deaths as usize).map(|(_, crash)| *crash);
        control::Role { service, crash }
    }

    /// Starts a process, and returns its PID. In flight it starts on the core on which it will fly: the other services
    /// wait for it there, while this process is busy on another core.
    pub(super) fn spawn(
        &mut self,
        number: ProcessNumber,
        role: Option<Role>,
        is_in_flight: bool,
    ) -> io::Result<u32> {
        let name = role.map_or(SPARE, |role| self.start.scenario.process_name(role.service));
        let core = self.start.core.filter(|_| is_in_flight && role.is_some());
        let own = core.map(|_| deployment::allowed_cores());
        let is_moved = core.is_some_and(|core| deployment::pin_to(&[core]).is_ok());
        let shared = [
            self.page.file(),
            self.checkpoints.file(),
            self.step_log.file(),
            self.lock,
        ];
        let label = run_client::runs::label(self.start.place(), self.start.host);
        self.descriptors.lend();
        let process = Process::start(name, label, shared, &self.doorbells);
        if let (Some(own), true) = (own, is_moved) {
            // A refusal is ignored: it only costs time.
            let _ = deployment::pin_to(&own);
        }
        let process = process?;
        let pid = process.id();
        self.add(number, process);
        Ok(pid)
    }

    /// Sends the start message to a new process, with its role if it has one.
    pub(super) fn send_start(&self, number: ProcessNumber, role: Option<Role>) -> Result<(), ControlError> {
        let start = Start {
            role: role.map(|role| self.role(role)),
            ..self.start.clone()
        };
        let Some(process) = self.get(number) else {
            return Ok(());
        };
        match process.channel.try_send(&ToService::Start(Box::new(start))) {
            // A dead process is detected by its end.
            Ok(_) | Err(ControlError::Closed) => Ok(()),
            Err(error) => Err(error),
        }
    }

    /// Waits up to `limit` until processes have sent messages or ended, and returns these.
    pub(super) fn wait(&self, limit: Duration) -> Vec<ProcessNumber> {
        let timeout = Timespec::try_from(limit).unwrap_or_default();
        let mut files: Vec<PollFd<'_>> = Vec::with_capacity(2 * self.living.len());
        for (_, process) in &self.living {
            // A closed channel would be reported without end.
            let channel = match process.has_hung_up {
                true => process.death.as_fd(),
                false => process.channel.as_fd(),
            };
            files.extend(
                [channel, process.death.as_fd()].map(|file| PollFd::from_borrowed_fd(file, PollFlags::IN)),
            );
        }
        // An interrupted poll counts as one without events.
        if poll(&mut files, Some(&timeout)).unwrap_or(0) == 0 {
            return Vec::new();
        }
        let has_called = |pair: &[PollFd<'_>]| pair.iter().any(|file| !file.revents().is_empty());
        let called = self.living.iter().zip(files.chunks_exact(2));
        called
            .filter(|(_, pair)| has_called(pair))
            .map(|((number, _), _)| *number)
            .collect()
    }

    /// Wakes all services, so that they check their conditions again even if a wake-up was lost.
    pub(super) fn wake_all(&self) {
        self.doorbells.iter().for_each(Doorbell::ring);
        self.page.control_block().cells.iter().for_each(Cell::ring);
    }
}

impl Facts for Processes<'_> {
    fn steps_until(&self, service: ServiceId) -> u64 {
        let cell = &self.page.control_block().cells[service.index()];
        // Relaxed: a counter on which no data depends; for a dead service it is final, because the end of its process
        // was awaited.
        cell.steps_until.load(Ordering::Relaxed)
    }

    fn next_tick(&self, service: ServiceId) -> u64 {
        let newest = self.checkpoints.newest(service);
        newest.map_or(0, |checkpoint| checkpoint.next_tick)
    }

    fn restarts_seen(&self, service: ServiceId) -> u32 {
        // Acquire: pairs with the Release by which a service confirms that it is connected.
        let cell = &self.page.control_block().cells[service.index()];
        cell.restarts_seen.load(Ordering::Acquire)
    }

    fn activity(&self, process: ProcessNumber) -> Option<Activity> {
        activity::read(self.get(process)?.id())
    }
}
