//! The service processes of a run: started, watched, restarted after deaths, stopped, and never left behind.
//!
//! After a death in flight, another process resumes from the last checkpoint and gets the samples that it has missed
//! from the recorder ([`runtime::input_port`]). A service that dies repeatedly at the same tick is given up: its crash
//! is a function of its inputs, so the next process would crash as well.
//!
//! In normal operation a standby process waits to take the role of the next service that dies.

mod external_service;
mod managed_service;
mod presentable;
pub mod process;
mod restart;
pub mod restart_policy;
mod standby;
mod starting;
mod take_over;

use std::os::fd::{AsFd, BorrowedFd};
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

use runtime::activity::Activity;
use runtime::checkpoints::Checkpoints;
use runtime::control::{ControlError, Role, Start, ToOrchestrator, ToService};
use runtime::crash::Crash;
use runtime::doorbell::Doorbell;
use runtime::ports::RunNode;
use runtime::shared_page::{Cell, SharedPage};
use runtime::step_log::StepLog;
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::process::Signal;
use shared_types::{Schedule, ServiceId};

use managed_service::{ManagedService, Phase};
pub use metrics::summary::restart::Restart;
pub use process::Exit;
use process::Process;
pub use restart_policy::READY_LIMIT;
use restart_policy::RestartPolicy;
use standby::Standby;
pub use take_over::OrphanedService;

use super::reserve::Reserve;
use super::{Outcome, RunFailure};

/// Timeout of a service that was told to stop, before it is killed.
pub const STOP_LIMIT: Duration = Duration::from_secs(2);

/// Maximum number of messages received from one process in a row: a process that sends without pauses must not block
/// the others.
const MAX_MESSAGES: usize = 64;

/// Period of the supervisor's checks while a service restarts.
pub(super) const RESTART_POLL_PERIOD: Duration = Duration::from_micros(100);

pub type RestartPolicies = [RestartPolicy; ServiceId::ALL.len()];

/// Supervisor of all service processes of a run. Dropping it ends them.
pub struct Supervisor<'a> {
    node: &'a RunNode,
    lock: BorrowedFd<'a>,
    schedule: &'a Schedule,
    start: Start,
    /// Planned crashes: the first one of a service applies until its process dies by itself, and so on.
    crashes: Vec<(ServiceId, Crash)>,
    restart_policies: RestartPolicies,
    members: Vec<ManagedService>,
    page: SharedPage,
    checkpoints: Checkpoints,
    step_log: StepLog,
    doorbells: Vec<Doorbell>,
    standby: Standby,
    /// Reserved shared memory for restarted processes.
    reserve: Option<Reserve>,
    exits: Vec<(Option<ServiceId>, u32, Exit)>,
    restarts: Vec<Restart>,
    /// `true` from the start of the flight: the start-up limits of the set-up do not apply any more.
    is_in_flight: bool,
    /// Events that occurred between two calls of [`Supervisor::watch`].
    pending: Vec<ServiceEvent>,
}

/// Observer of the processes of a run, for the record of the machine.
pub trait SupervisionObserver {
    /// All processes have started and are ready.
    fn ready(&mut self, supervisor: &Supervisor<'_>, core: Option<usize>);
    /// Processes may have died, and services may fly again.
    fn changed(&mut self, supervisor: &Supervisor<'_>);
    /// The flight has reached a tick. Called often.
    fn progressed(&mut self, supervisor: &Supervisor<'_>, tick: u64);
    /// About a second of the flight has passed, or it has ended.
    fn health(&mut self, supervisor: &Supervisor<'_>);
    /// The flight has ended.
    fn ended(&mut self, supervisor: &Supervisor<'_>, outcome: &Outcome);
}

/// Memory shared by all processes of a run.
pub struct Shared {
    page: SharedPage,
    checkpoints: Checkpoints,
    step_log: StepLog,
}

impl Shared {
    /// Returns the page with the control block.
    pub(super) fn page(&self) -> &SharedPage {
        &self.page
    }

    fn create() -> std::io::Result<Self> {
        Ok(Self {
            page: SharedPage::create()?,
            checkpoints: Checkpoints::create()?,
            step_log: StepLog::create()?,
        })
    }
}

/// Event of a service process.
#[derive(Debug)]
pub enum ServiceEvent {
    /// The service has created its ports; with the refused settings of its deployment.
    Ready(ServiceId, Vec<String>),
    /// The service has done its last step.
    Finished(ServiceId),
    /// The service or the standby process has died, and will be restarted.
    Died,
    /// The service cannot be restarted.
    Lost(RunFailure),
}

impl<'a> Supervisor<'a> {
    /// Starts a process for each service and sends it the start message. Each holds `lock`, that of the run's folder.
    ///
    /// # Errors
    /// [`RunFailure`] if one cannot be started.
    pub fn start(
        node: &'a RunNode,
        lock: BorrowedFd<'a>,
        schedule: &'a Schedule,
        start: Start,
        crashes: Vec<(ServiceId, Crash)>,
        restart_policies: RestartPolicies,
    ) -> Result<Self, RunFailure> {
        let shared = Shared::create().map_err(RunFailure::setup)?;
        let mut supervisor = Self::without_members(node, lock, schedule, start, shared)?;
        supervisor.crashes = crashes;
        supervisor.restart_policies = restart_policies;
        for service in ServiceId::ALL {
            supervisor.start_service(service)?;
        }
        Ok(supervisor)
    }

    fn without_members(
        node: &'a RunNode,
        lock: BorrowedFd<'a>,
        schedule: &'a Schedule,
        start: Start,
        shared: Shared,
    ) -> Result<Self, RunFailure> {
        let doorbells = ServiceId::ALL.iter().map(|_| Doorbell::create());
        let doorbells = doorbells.collect::<Result<_, _>>().map_err(RunFailure::setup)?;
        Ok(Self {
            node,
            lock,
            schedule,
            start,
            crashes: Vec::new(),
            restart_policies: RestartPolicies::default(),
            members: Vec::new(),
            page: shared.page,
            checkpoints: shared.checkpoints,
            step_log: shared.step_log,
            doorbells,
            standby: Standby::default(),
            reserve: None,
            exits: Vec::new(),
            restarts: Vec::new(),
            is_in_flight: false,
            pending: Vec::new(),
        })
    }

    /// Starts the first process of the next service.
    fn start_service(&mut self, service: ServiceId) -> Result<(), RunFailure> {
        let name = self.name_of(service);
        let process = self.spawn(name)?;
        // Stored first, so that it is ended even if the next steps fail.
        self.add(ManagedService::new(service, name, process));
        let role = Role {
            service,
            crash: self.crash_of(service, 0),
        };
        self.send_start(&self.members[service.index()].process, Some(role))?;
        self.send(service, &ToService::MakePorts)
    }

    #[must_use]
    pub fn name_of(&self, service: ServiceId) -> &'static str {
        self.start.scenario.process_name(service)
    }

    fn add(&mut self, member: ManagedService) {
        assert_eq!(
            self.members.len(),
            member.service.index(),
            "members are found by the service's index"
        );
        self.members.push(member);
    }

    /// Returns the planned crash of a service after `deaths`.
    fn crash_of(&self, service: ServiceId, deaths: u32) -> Option<Crash> {
        let mut own = self.crashes.iter().filter(|(whose, _)| *whose == service);
        own.nth(deaths as usize).map(|(_, crash)| *crash)
    }

    fn spawn(&self, name: &str) -> Result<Process, RunFailure> {
        let shared = [
            self.page.file(),
            self.checkpoints.file(),
            self.step_log.file(),
            self.lock,
        ];
        let label = run_client::runs::label(self.start.place(), self.start.host);
        Process::start(name, label, shared, &self.doorbells).map_err(RunFailure::setup)
    }

    /// Sends the start message to a new process, with its role if it has one.
    fn send_start(&self, process: &Process, role: Option<Role>) -> Result<(), RunFailure> {
        let start = Start {
            role,
            ..self.start.clone()
        };
        send_to(process, &ToService::Start(Box::new(start)))
    }

    /// Returns the page with the control block.
    #[must_use]
    pub fn page(&self) -> &SharedPage {
        &self.page
    }

    #[must_use]
    pub fn step_log(&self) -> &StepLog {
        &self.step_log
    }

    /// Returns the checkpoints of the services.
    #[must_use]
    pub fn checkpoints(&self) -> &Checkpoints {
        &self.checkpoints
    }

    #[must_use]
    pub fn schedule(&self) -> &Schedule {
        self.schedule
    }

    /// Returns the PID of each service.
    pub fn processes(&self) -> impl Iterator<Item = (ServiceId, u32)> {
        self.members
            .iter()
            .map(|member| (member.service, member.process.id()))
    }

    /// Returns the exits of processes in their order; those of standby processes have no service.
    #[must_use]
    pub fn exits(&self) -> &[(Option<ServiceId>, u32, Exit)] {
        &self.exits
    }

    /// Describes the last exit, if it was that of a service.
    #[must_use]
    pub fn last_death(&self) -> Option<String> {
        let (service, pid, exit) = self.exits.last()?;
        let name = self.name_of((*service)?);
        Some(format!("`{name}` (process {pid}) died: {}", exit.description))
    }

    #[must_use]
    pub fn restarts(&self) -> &[Restart] {
        &self.restarts
    }

    /// Waits until every service has created its ports. Returns the refused settings.
    ///
    /// # Errors
    /// [`RunFailure`] if a service fails or is not ready in time.
    pub fn await_ready(&mut self) -> Result<Vec<String>, RunFailure> {
        let mut notes = Vec::new();
        while self.members.iter().any(|member| member.phase != Phase::Ready) {
            self.restart_dead()?;
            for event in self.watch(Duration::from_millis(10)) {
                match event {
                    ServiceEvent::Ready(service, warnings) => {
                        notes.extend(warnings);
                        self.note_restart(service);
                    }
                    ServiceEvent::Lost(failure) => return Err(failure),
                    ServiceEvent::Finished(_) | ServiceEvent::Died => {}
                }
            }
        }
        notes.sort();
        notes.dedup();
        Ok(notes)
    }

    /// Starts the flight of all services, in the order of the ring.
    ///
    /// # Errors
    /// [`RunFailure`] if a message cannot be sent.
    pub fn go(&mut self) -> Result<(), RunFailure> {
        self.is_in_flight = true;
        for service in ServiceId::ALL {
            self.members[service.index()].phase = Phase::Flying;
            self.send_go(service, false)?;
        }
        Ok(())
    }

    fn send_go(&self, service: ServiceId, restarted: bool) -> Result<(), RunFailure> {
        let block = self.page.control_block();
        // Must be stored before `Go` is sent: a consumer that waits for the service again then finds it flying, or
        // about to.
        block.cells[service.index()].gone.store(0, Ordering::SeqCst);
        let start_ns = block.start_ns.load(Ordering::Acquire);
        self.send(service, &ToService::Go { restarted, start_ns })
    }

    /// Returns whether a service is dead, restarting, or catching up.
    #[must_use]
    #[inline]
    pub fn needs_care(&self) -> bool {
        let is_settled = |member: &ManagedService| matches!(member.phase, Phase::Flying | Phase::Finished);
        !self.members.iter().all(is_settled)
    }

    /// Returns whether a service is in flight: neither starting, nor dead, nor finished.
    #[must_use]
    pub fn flies(&self, service: ServiceId) -> bool {
        self.members[service.index()].phase == Phase::Flying
    }

    /// Returns the activity of a service's process, if the kernel reports it.
    #[must_use]
    pub fn activity(&self, service: ServiceId) -> Option<Activity> {
        Activity::read(self.members[service.index()].process.id())
    }

    /// Replaces the process of a service, which has hung for `hung_for`.
    pub fn replace_hung(&mut self, service: ServiceId, hung_for: Duration) {
        self.members[service.index()].silent_since = Instant::now().checked_sub(hung_for);
        self.replace(service.index(), "hung".to_owned());
    }

    pub fn kill(&mut self, service: ServiceId) {
        self.members[service.index()].process.signal(Signal::KILL);
    }

    /// Stops the process of a service (SIGSTOP), so that it hangs.
    pub fn freeze(&self, service: ServiceId) {
        self.members[service.index()].process.signal(Signal::STOP);
    }

    /// Returns whether every service has done its last step.
    #[must_use]
    pub fn has_finished(&self) -> bool {
        self.unfinished().next().is_none()
    }

    /// Returns the services that have not reported the end of their steps.
    pub fn unfinished(&self) -> impl Iterator<Item = ServiceId> {
        let unfinished = self
            .members
            .iter()
            .filter(|member| member.phase != Phase::Finished);
        unfinished.map(|member| member.service)
    }

    /// Returns whether a service has done its last step.
    #[must_use]
    pub fn has_flown_all(&self, service: ServiceId) -> bool {
        let steps = self.schedule.steps(service);
        let next = steps.first_at_or_after(self.steps_until(service));
        next.is_none_or(|next| next > self.schedule.last_tick())
    }

    /// Returns 1 + the last tick at which a service has stepped.
    #[must_use]
    pub fn steps_until(&self, service: ServiceId) -> u64 {
        let cell = &self.page.control_block().cells[service.index()];
        // Relaxed: a counter on which no data depends; for a dead service it is final, because the end of its process
        // was awaited.
        cell.steps_until.load(Ordering::Relaxed)
    }

    /// Returns whether a service with steps to do is delayed by the machine or by its restart: it runs, waits for a
    /// processor or for memory, or is restarting.
    #[must_use]
    pub fn is_delayed(&self) -> bool {
        let is_delayed = |member: &ManagedService| match member.phase {
            Phase::Finished | Phase::GivenUp => false,
            Phase::Flying => {
                !self.has_flown_all(member.service)
                    && self
                        .activity(member.service)
                        .is_some_and(|activity| activity.is_runnable)
            }
            Phase::Starting | Phase::Ready | Phase::CatchingUp(_) | Phase::Dead(_) => true,
        };
        self.members.iter().any(is_delayed)
    }

    /// Waits up to `limit` for events and returns them.
    pub fn watch(&mut self, limit: Duration) -> Vec<ServiceEvent> {
        let timeout = Timespec::try_from(limit).unwrap_or_default();
        let mut events = std::mem::take(&mut self.pending);
        let living: Vec<usize> = (0..self.members.len())
            .filter(|&at| !self.members[at].process.is_gone)
            .collect();
        let services = living.iter().map(|&at| &self.members[at].process);
        let processes = services.chain(&self.standby.process);
        let mut files: Vec<PollFd<'_>> = processes
            .flat_map(|process| [process.channel.as_fd(), process.death.as_fd()])
            .map(|file| PollFd::from_borrowed_fd(file, PollFlags::IN))
            .collect();
        // An interrupted poll counts as one without events.
        let has_events = poll(&mut files, Some(&timeout)).unwrap_or(0) > 0;
        if !has_events {
            return events;
        }
        let mut pairs = files.chunks_exact(2);
        let has_called = |pair: &[PollFd<'_>]| pair.iter().any(|file| !file.revents().is_empty());
        let called: Vec<usize> = living
            .iter()
            .zip(&mut pairs)
            .filter(|(_, pair)| has_called(pair))
            .map(|(&at, _)| at)
            .collect();
        let standby_has_called = pairs.next().is_some_and(has_called);
        events.extend(called.into_iter().flat_map(|at| self.receive_from(at)));
        if standby_has_called {
            events.extend(self.receive_from_standby());
        }
        events
    }

    /// Receives the messages of a process, and handles its end if it has ended.
    fn receive_from(&mut self, at: usize) -> Vec<ServiceEvent> {
        let mut events = Vec::new();
        for _ in 0..MAX_MESSAGES {
            // Checked before the receive: all messages of a process that has ended by now are already in the channel.
            let has_ended = self.members[at].process.has_ended();
            match self.members[at].process.channel.try_receive::<ToOrchestrator>() {
                // Messages of a process that is being killed do not count.
                Ok(Some(_)) if self.members[at].blamed.is_some() => {}
                Ok(Some(message)) => {
                    if self.is_external_service(at)
                        && let Err(what) = self.handle_external_message(at, &message)
                    {
                        events.extend(self.blame_external_service(at, what));
                        break;
                    }
                    let steps_until = self.steps_until(self.members[at].service);
                    let event = self.members[at].handle(message, self.start.host, steps_until);
                    events.extend(event);
                }
                // A program may have passed its end of the channel to a process that outlives it.
                Ok(None) if !has_ended => break,
                Ok(None) | Err(ControlError::Closed) => {
                    events.extend(self.reap(at));
                    break;
                }
                Err(error) if self.is_external_service(at) => {
                    let what = format!(
                        "says what is no message of the contract: {}",
                        external_service::reason(&error)
                    );
                    events.extend(self.blame_external_service(at, what));
                    break;
                }
                Err(error) => {
                    events.push(ServiceEvent::Lost(RunFailure::GaveUp {
                        service: self.members[at].name.to_owned(),
                        reason: error.to_string(),
                    }));
                    break;
                }
            }
        }
        events
    }

    /// Stores the reserve for restarted processes.
    pub(super) fn keep_reserve(&mut self, reserve: Reserve) {
        self.reserve = Some(reserve);
    }

    /// Wakes all services, so that they check their conditions again even if a wake-up was lost.
    pub fn wake_all(&self) {
        self.doorbells.iter().for_each(Doorbell::ring);
        self.page.control_block().cells.iter().for_each(Cell::ring);
    }

    /// Removes shared memory that a service was creating when it died: others may wait for it.
    pub fn remove_unfinished(&self) {
        self.node.remove_unfinished();
    }

    /// Stops all services, waits for their ends, and kills those that do not end in time.
    pub fn stop(&mut self) {
        self.standby.end();
        if self.members.is_empty() {
            return;
        }
        let block = self.page.control_block();
        // The flag must be stored first, then the messages sent, then the doorbells rung: a service that wakes up must
        // find the flag.
        block.stopping.store(1, Ordering::SeqCst);
        for member in &self.members {
            // A failure is ignored: the process has ended, or it reads no messages and is killed below.
            let _ = member.process.channel.try_send(&ToService::Stop);
        }
        self.wake_all();
        let deadline = Instant::now() + STOP_LIMIT;
        while self.members.iter().any(|member| !member.process.is_gone) {
            let left = deadline.saturating_duration_since(Instant::now());
            if left.is_zero() {
                break;
            }
            self.watch(left);
        }
        for member in &mut self.members {
            if !member.process.is_gone {
                let exit = member.process.end();
                self.exits.push((Some(member.service), member.process.id(), exit));
            }
        }
    }

    /// Sends a message to a service. A dead process is detected by `watch`.
    fn send(&self, service: ServiceId, message: &ToService) -> Result<(), RunFailure> {
        send_to(&self.members[service.index()].process, message)
    }
}

impl Drop for Supervisor<'_> {
    fn drop(&mut self) {
        self.stop();
    }
}

/// Sends a message to a process. A dead process is detected by `watch`; one whose channel is full has not read for long
/// and is killed.
fn send_to(process: &Process, message: &ToService) -> Result<(), RunFailure> {
    match process.channel.try_send(message) {
        Ok(true) | Err(ControlError::Closed) => Ok(()),
        Ok(false) => {
            process.signal(Signal::KILL);
            Ok(())
        }
        Err(error) => Err(RunFailure::setup(error)),
    }
}
