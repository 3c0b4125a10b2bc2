//! The service processes of a run: started, watched, started again when they die, stopped, and never left behind.
//!
//! After a death in flight another process goes on from the dead one's last checkpoint and gets from the
//! recorder what it has missed ([`runtime::input_port`]). A service that dies again and again at the same place is given
//! up: its crash is a function of its inputs, and so will the next be.
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

/// Time for which a service that was told to stop may take before it is killed.
pub const STOP_LIMIT: Duration = Duration::from_secs(2);

/// Messages of one process that are taken at a look: one that speaks without a pause must not keep this process from the
/// others.
const MESSAGES_AT_A_LOOK: usize = 64;

/// Period of the supervisor's checks while a service restarts.
pub(super) const RESTART_POLL_PERIOD: Duration = Duration::from_micros(100);

/// The restart policy of each service.
pub type RestartPolicies = [RestartPolicy; ServiceId::ALL.len()];

/// All service processes of a run. Dropping it ends them.
pub struct Supervisor<'a> {
    member: &'a RunNode,
    lock: BorrowedFd<'a>,
    schedule: &'a Schedule,
    start: Start,
    /// Deaths that processes shall bring upon themselves, the first of a service upon its first process and so on.
    crashes: Vec<(ServiceId, Crash)>,
    restart_policies: RestartPolicies,
    members: Vec<ManagedService>,
    page: SharedPage,
    checkpoints: Checkpoints,
    step_log: StepLog,
    doorbells: Vec<Doorbell>,
    standby: Standby,
    /// Room in shared memory for processes that are started again.
    reserve: Option<Reserve>,
    exits: Vec<(Option<ServiceId>, u32, Exit)>,
    restarts: Vec<Restart>,
    /// `true` from the start of the flight: from then on no process may take as long as while the run is set up.
    is_in_flight: bool,
    /// What has happened between two calls of [`Supervisor::watch`].
    pending: Vec<ServiceEvent>,
}

/// Events of the processes of a run, for the record of the machine.
pub trait SupervisionObserver {
    /// The processes have been started and are ready.
    fn ready(&mut self, supervisor: &Supervisor<'_>, core: Option<usize>);
    /// Processes may have died, and services may fly again.
    fn changed(&mut self, supervisor: &Supervisor<'_>);
    /// The flight has come to a tick. Called often.
    fn progressed(&mut self, supervisor: &Supervisor<'_>, tick: u64);
    /// About a second of the flight has passed, or it has ended.
    fn health(&mut self, supervisor: &Supervisor<'_>);
    /// The flight has ended, and this is how.
    fn ended(&mut self, supervisor: &Supervisor<'_>, outcome: &Outcome);
}

/// The memory that all processes of a run share.
pub struct Shared {
    page: SharedPage,
    checkpoints: Checkpoints,
    step_log: StepLog,
}

impl Shared {
    /// The words.
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

/// A message or an act of a service process.
#[derive(Debug)]
pub enum ServiceEvent {
    /// It made its ports; what it could not have of its deployment.
    Ready(ServiceId, Vec<String>),
    /// It has flown its last tick.
    Finished(ServiceId),
    /// It died, or the standby process did, and will be started again.
    Died,
    /// It cannot go on.
    Lost(RunFailure),
}

impl<'a> Supervisor<'a> {
    /// Starts one process a service and tells each what to fly. Each holds `lock`, that of the run's place.
    ///
    /// # Errors
    /// [`RunFailure::setup`].
    pub fn start(
        member: &'a RunNode,
        lock: BorrowedFd<'a>,
        schedule: &'a Schedule,
        start: Start,
        crashes: Vec<(ServiceId, Crash)>,
        restart_policies: RestartPolicies,
    ) -> Result<Self, RunFailure> {
        let shared = Shared::create().map_err(RunFailure::setup)?;
        let mut supervisor = Self::without_members(member, lock, schedule, start, shared)?;
        supervisor.crashes = crashes;
        supervisor.restart_policies = restart_policies;
        for service in ServiceId::ALL {
            supervisor.start_service(service)?;
        }
        Ok(supervisor)
    }

    fn without_members(
        member: &'a RunNode,
        lock: BorrowedFd<'a>,
        schedule: &'a Schedule,
        start: Start,
        shared: Shared,
    ) -> Result<Self, RunFailure> {
        let doorbells = ServiceId::ALL.iter().map(|_| Doorbell::create());
        let doorbells = doorbells.collect::<Result<_, _>>().map_err(RunFailure::setup)?;
        Ok(Self {
            member,
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

    /// Starts the first process of the next service and tells it what to fly.
    fn start_service(&mut self, service: ServiceId) -> Result<(), RunFailure> {
        let name = self.name_of(service);
        let process = self.spawn(name)?;
        // Kept before it is spoken to, so that it is ended whatever happens next.
        self.take_in(ManagedService::new(service, name, process));
        let role = Role {
            service,
            crash: self.crash_of(service, 0),
        };
        self.instruct(&self.members[service.index()].process, Some(role))?;
        self.say(service, &ToService::MakePorts)
    }

    /// Returns the name of a service's process.
    #[must_use]
    pub fn name_of(&self, service: ServiceId) -> &'static str {
        self.start.scenario.process_name(service)
    }

    fn take_in(&mut self, member: ManagedService) {
        assert_eq!(
            self.members.len(),
            member.service.index(),
            "members are found by the service's index"
        );
        self.members.push(member);
    }

    /// Returns where the process of a service is to kill itself that follows so many others.
    fn crash_of(&self, service: ServiceId, lives: u32) -> Option<Crash> {
        let mut own = self.crashes.iter().filter(|(whose, _)| *whose == service);
        own.nth(lives as usize).map(|(_, crash)| *crash)
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

    /// Tells a process that has just been started what to fly, and which service it is, if that is known.
    fn instruct(&self, process: &Process, role: Option<Role>) -> Result<(), RunFailure> {
        let start = Start {
            role,
            ..self.start.clone()
        };
        tell(process, &ToService::Start(Box::new(start)))
    }

    /// The words that the supervisor shares.
    #[must_use]
    pub fn page(&self) -> &SharedPage {
        &self.page
    }

    /// Returns the services' log of their steps in real time.
    #[must_use]
    pub fn step_log(&self) -> &StepLog {
        &self.step_log
    }

    /// Returns the services' states after their last steps.
    #[must_use]
    pub fn checkpoints(&self) -> &Checkpoints {
        &self.checkpoints
    }

    /// Returns when everybody steps.
    #[must_use]
    pub fn schedule(&self) -> &Schedule {
        self.schedule
    }

    /// The processes, by service.
    pub fn processes(&self) -> impl Iterator<Item = (ServiceId, u32)> {
        self.members
            .iter()
            .map(|member| (member.service, member.process.id()))
    }

    /// Returns the processes that have ended, in the order of their ends; a standby one was of no service.
    #[must_use]
    pub fn exits(&self) -> &[(Option<ServiceId>, u32, Exit)] {
        &self.exits
    }

    /// Returns the end of the last process that has ended, in words, if it was that of a service.
    #[must_use]
    pub fn last_death(&self) -> Option<String> {
        let (service, pid, exit) = self.exits.last()?;
        let name = self.name_of((*service)?);
        Some(format!("`{name}` (process {pid}) died: {}", exit.description))
    }

    /// Restarts, in their order.
    #[must_use]
    pub fn restarts(&self) -> &[Restart] {
        &self.restarts
    }

    /// Waits until every service has made its ports; their warnings.
    ///
    /// # Errors
    /// [`RunFailure`] if one of them fails or takes too long.
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

    /// Lets everybody fly, in the order of the ring.
    ///
    /// # Errors
    /// [`RunFailure`] if the system refuses.
    pub fn go(&mut self) -> Result<(), RunFailure> {
        self.is_in_flight = true;
        for service in ServiceId::ALL {
            self.members[service.index()].phase = Phase::Flying;
            self.say_go(service, false)?;
        }
        Ok(())
    }

    fn say_go(&self, service: ServiceId, restarted: bool) -> Result<(), RunFailure> {
        let block = self.page.control_block();
        // Before `Go`, which the service acts upon: a consumer that waits for it again finds it flying, or soon to be.
        block.cells[service.index()].gone.store(0, Ordering::SeqCst);
        let start_ns = block.start_ns.load(Ordering::Acquire);
        self.say(service, &ToService::Go { restarted, start_ns })
    }

    /// Returns whether a service is dead, restarting, or has samples to catch up with.
    #[must_use]
    #[inline]
    pub fn needs_care(&self) -> bool {
        let is_well = |member: &ManagedService| matches!(member.phase, Phase::Flying | Phase::Finished);
        !self.members.iter().all(is_well)
    }

    /// Returns whether a service is in flight: neither starting nor dead nor at its end.
    #[must_use]
    pub fn flies(&self, service: ServiceId) -> bool {
        self.members[service.index()].phase == Phase::Flying
    }

    /// Returns the activity of a service's process, if the system tells.
    #[must_use]
    pub fn activity(&self, service: ServiceId) -> Option<Activity> {
        Activity::of(self.members[service.index()].process.id())
    }

    /// Replaces the process of a service, which has hung for some time.
    pub fn replace_hung(&mut self, service: ServiceId, hung_for: Duration) {
        self.members[service.index()].silent_since = Instant::now().checked_sub(hung_for);
        self.replace(service.index(), "hung".to_owned());
    }

    /// Kills the process of a service, which is then restarted.
    pub fn kill(&mut self, service: ServiceId) {
        self.members[service.index()].process.signal(Signal::KILL);
    }

    /// Stops the process of a service (SIGSTOP): it hangs from now on.
    pub fn freeze(&self, service: ServiceId) {
        self.members[service.index()].process.signal(Signal::STOP);
    }

    /// Returns whether every service has flown its last tick.
    #[must_use]
    pub fn has_finished(&self) -> bool {
        self.unfinished().next().is_none()
    }

    /// Returns the services that have not reported their end after their last tick.
    pub fn unfinished(&self) -> impl Iterator<Item = ServiceId> {
        let unfinished = self
            .members
            .iter()
            .filter(|member| member.phase != Phase::Finished);
        unfinished.map(|member| member.service)
    }

    /// Returns whether a service has stepped at its last tick.
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
        // Relaxed: a count and nothing else; of a dead service it is the last, because the end of its process was awaited.
        cell.steps_until.load(Ordering::Relaxed)
    }

    /// Returns whether a service that has steps to do is delayed by the machine or by its restart: it runs, waits for a processor
    /// or for its memory, or is about to fly again.
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

    /// Waits up to `limit` for something to happen and tells what did.
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
        // An interrupted poll is one in which nothing happened.
        let happened = poll(&mut files, Some(&timeout)).unwrap_or(0) > 0;
        if !happened {
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
        events.extend(called.into_iter().flat_map(|at| self.listen(at)));
        if standby_has_called {
            events.extend(self.listen_to_standby());
        }
        events
    }

    /// Takes a process's messages, and its end if it has ended.
    fn listen(&mut self, at: usize) -> Vec<ServiceEvent> {
        let mut events = Vec::new();
        for _ in 0..MESSAGES_AT_A_LOOK {
            // Before the look: the last words of a process that has ended by now have all been sent.
            let has_ended = self.members[at].process.has_ended();
            match self.members[at].process.channel.try_receive::<ToOrchestrator>() {
                // What it says until it is dead counts no more.
                Ok(Some(_)) if self.members[at].blamed.is_some() => {}
                Ok(Some(message)) => {
                    if self.is_external_service(at)
                        && let Err(what) = self.hear_external_service(at, &message)
                    {
                        events.extend(self.blame_external_service(at, what));
                        break;
                    }
                    let steps_until = self.steps_until(self.members[at].service);
                    let event = self.members[at].understand(message, self.start.host, steps_until);
                    events.extend(event);
                }
                // A program may have handed its end of the line on to one that outlives it.
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

    /// Keeps room for processes that are started again.
    pub(super) fn keep_reserve(&mut self, reserve: Reserve) {
        self.reserve = Some(reserve);
    }

    /// Wakes everybody to look again, whatever has become of their wake-ups.
    pub fn wake_all(&self) {
        self.doorbells.iter().for_each(Doorbell::ring);
        self.page.control_block().cells.iter().for_each(Cell::ring);
    }

    /// Removes shared memory that a service was making when it died: others may be waiting for it.
    pub fn remove_unfinished(&self) {
        self.member.remove_unfinished();
    }

    /// Tells everybody to stop, waits until all are gone, and kills who does not go.
    pub fn stop(&mut self) {
        self.standby.end();
        if self.members.is_empty() {
            return;
        }
        let block = self.page.control_block();
        // The word first, then the message, then the doorbells: a sleeper that wakes must find the reason.
        block.stopping.store(1, Ordering::SeqCst);
        for member in &self.members {
            // Who is gone already need not be told, and who takes no messages is killed below.
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

    /// Tells a service something. One that is gone is found so when the supervisor is watched.
    fn say(&self, service: ServiceId, message: &ToService) -> Result<(), RunFailure> {
        tell(&self.members[service.index()].process, message)
    }
}

impl Drop for Supervisor<'_> {
    fn drop(&mut self) {
        self.stop();
    }
}

/// Tells a process something. One that is gone is found so when the supervisor is watched, and one that has not read anything
/// for so long that its line is full is killed.
fn tell(process: &Process, message: &ToService) -> Result<(), RunFailure> {
    match process.channel.try_send(message) {
        Ok(true) | Err(ControlError::Closed) => Ok(()),
        Ok(false) => {
            process.signal(Signal::KILL);
            Ok(())
        }
        Err(error) => Err(RunFailure::setup(error)),
    }
}
