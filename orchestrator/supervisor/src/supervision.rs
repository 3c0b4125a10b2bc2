//! The service processes of a run: started, watched, restarted after deaths, stopped, and never left behind.
//!
//! What is to be done is decided in [`decisions::supervision`]. Here, signals, messages and ends of processes become
//! events, and the actions that result are performed. A restarted service gets the samples that it has missed from the
//! recorder ([`runtime::input_port`]).

pub(crate) mod descriptor_reserve;
mod hand_over;
mod messages;
pub mod process;
mod processes;
mod take_over;

use std::os::fd::BorrowedFd;
use std::sync::atomic::Ordering;
use std::time::Duration;

pub use decisions::event::News;
use decisions::event::{Action, Event, Facts};
use decisions::moment::Moment;
use decisions::process::{ProcessNumber, Role};
pub use decisions::supervision::RestartPolicies;
use decisions::supervision::Supervision;
use runtime::checkpoints::Checkpoints;
use runtime::control::{ControlError, Host, Start, ToService};
use runtime::crash::Crash;
use runtime::flight_clock::monotonic_ns;
use runtime::ports::RunNode;
use runtime::shared_page::SharedPage;
use runtime::step_log::StepLog;
use rustix::process::Signal;
use shared_types::{Schedule, ServiceId};
use system_limits::resource_limits;

use hand_over::HandOvers;
pub use metrics::summary::restart::Restart;
pub use process::Exit;
use processes::Processes;
pub use take_over::OrphanedService;

use super::reserve::Reserve;
use super::{Outcome, RunFailure};

/// Maximum number of messages received from one process in a row: a process that sends without pauses must not block
/// the others.
const MAX_MESSAGES: usize = 64;

/// Period of the supervisor's checks while a service restarts.
pub(super) const RESTART_POLL_PERIOD: Duration = Duration::from_micros(100);

/// Period of the checks while services become ready or end.
const SETTLING_PERIOD: Duration = Duration::from_millis(10);

/// Supervisor of all service processes of a run. Dropping it ends them.
pub struct Supervisor<'a> {
    schedule: &'a Schedule,
    supervision: Supervision,
    processes: Processes<'a>,
    hand_overs: HandOvers,
    /// Reserved shared memory for restarted processes.
    reserve: Option<Reserve>,
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

/// Returns the present moment.
pub(super) fn now() -> Moment {
    Moment(monotonic_ns())
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
        let mut supervisor = Self::without_members(node, lock, schedule, start, shared, restart_policies)?;
        supervisor.processes.crashes = crashes;
        for _ in ServiceId::ALL {
            supervisor.start_next()?;
        }
        Ok(supervisor)
    }

    fn without_members(
        node: &'a RunNode,
        lock: BorrowedFd<'a>,
        schedule: &'a Schedule,
        start: Start,
        shared: Shared,
        restart_policies: RestartPolicies,
    ) -> Result<Self, RunFailure> {
        let is_real_time = start.host == Host::RealTime;
        Ok(Self {
            schedule,
            supervision: Supervision::new(schedule, is_real_time, restart_policies),
            processes: Processes::new(node, lock, start, shared)?,
            hand_overs: HandOvers::default(),
            reserve: None,
        })
    }

    /// Starts a process of the next service. The news tell if the system refuses.
    fn begin_next(&mut self) {
        self.supervision.start_next(now(), &self.processes.start.scenario);
        self.perform_all();
    }

    /// Starts the first process of the next service.
    fn start_next(&mut self) -> Result<(), RunFailure> {
        self.begin_next();
        match self.supervision.take_news().pop() {
            Some(News::Lost(failure)) => Err(failure.into()),
            _ => Ok(()),
        }
    }

    /// Does what is due, and returns the actions for which samples are needed that the recorder has: they are to be
    /// performed by [`Self::announce`], [`Self::catch_up`] and [`Self::send_missed`], and the others between them by
    /// [`Self::perform`].
    #[must_use]
    pub fn look(&mut self) -> Vec<Action> {
        self.supervision.look(now(), &self.processes);
        self.supervision.take_actions()
    }

    /// Handles an event of a process and performs what results.
    fn handle(&mut self, number: ProcessNumber, event: Event) {
        self.supervision.handle(now(), number, event, &self.processes);
        self.perform_all();
    }

    fn perform_all(&mut self) {
        for action in self.supervision.take_actions() {
            self.perform(action);
        }
    }

    /// Performs an action. What it leads to is handled before the next one.
    ///
    /// # Panics
    /// If it is one that [`Self::look`] lists.
    pub fn perform(&mut self, action: Action) {
        match action {
            Action::Start { process, role } => self.start_process(process, role),
            Action::Become { process, role } => {
                let role = self.processes.role(role);
                self.send(process, &ToService::Become(role));
                self.handle(process, Event::Asked);
            }
            Action::MakePorts { process } => self.send(process, &ToService::MakePorts),
            Action::Go {
                process,
                service,
                is_restarted,
            } => self.send_go(process, service, is_restarted),
            Action::Beat { process } => self.send(process, &ToService::Beat),
            Action::Connect { process, birth } => self.send(process, &ToService::Connect { birth }),
            Action::Stop { process } => self.send(process, &ToService::Stop),
            Action::Kill { process } => {
                if let Some(process) = self.processes.get(process) {
                    process.kill_group();
                }
            }
            Action::MarkGone { service } => {
                let block = self.page().control_block();
                block.cells[service.index()].gone.store(1, Ordering::SeqCst);
            }
            Action::ForgetReceivers { service } => {
                let block = self.page().control_block();
                block.forget_receivers(service);
                block.cells[service.index()]
                    .waiting_for
                    .store(0, Ordering::Relaxed);
            }
            Action::CleanUp => self.processes.clean_up(),
            Action::Wake => self.wake_all(),
            Action::LendReserve => {
                if let Some(reserve) = &mut self.reserve {
                    reserve.lend();
                }
            }
            Action::RefillReserve => {
                self.processes.descriptors.refill();
                if let Some(reserve) = &mut self.reserve {
                    reserve.refill();
                }
            }
            Action::SetStopping => self.page().control_block().stopping.store(1, Ordering::SeqCst),
            Action::Announce { .. } | Action::CatchUp { .. } | Action::SendMissed { .. } => {
                unreachable!("performed with the recorder's samples")
            }
        }
    }

    fn start_process(&mut self, number: ProcessNumber, role: Option<Role>) {
        match self
            .processes
            .spawn(number, role, self.supervision.is_in_flight())
        {
            Ok(pid) => {
                self.handle(number, Event::Started { pid });
                if let Err(error) = self.processes.send_start(number, role) {
                    self.processes.end(number);
                    self.handle(number, Event::NotStarted(error.to_string()));
                }
            }
            Err(error) => {
                self.handle(number, Event::NotStarted(resource_limits::in_words(&error)));
            }
        }
    }

    fn send_go(&mut self, process: ProcessNumber, service: ServiceId, restarted: bool) {
        let block = self.page().control_block();
        // Must be stored before `Go` is sent: a consumer that waits for the service again then finds it flying, or
        // about to.
        block.cells[service.index()].gone.store(0, Ordering::SeqCst);
        let start_ns = block.start_ns.load(Ordering::Acquire);
        self.send(process, &ToService::Go { restarted, start_ns });
    }

    /// Sends a message to a process. One whose channel is full has not read for long; the end of a dead one is detected
    /// by [`Self::watch`].
    fn send(&mut self, number: ProcessNumber, message: &ToService) {
        let Some(process) = self.processes.get(number) else {
            return;
        };
        match process.channel.try_send(message) {
            Ok(true) | Err(ControlError::Closed) => {}
            Ok(false) | Err(_) => self.handle(number, Event::Deaf),
        }
    }

    /// Waits up to `limit` for events and handles them.
    pub fn watch(&mut self, limit: Duration) {
        for number in self.processes.wait(limit) {
            for _ in 0..MAX_MESSAGES {
                let Some(event) = self.next_event(number) else {
                    break;
                };
                self.handle(number, event);
            }
        }
    }

    /// Takes the actions that are to be performed, as those of [`Self::look`].
    pub(super) fn take_actions(&mut self) -> Vec<Action> {
        self.supervision.take_actions()
    }

    /// Takes the news since the last call.
    pub fn take_news(&mut self) -> Vec<News> {
        self.supervision.take_news()
    }

    /// Waits until every service has created its ports. Returns the refused settings.
    ///
    /// # Errors
    /// [`RunFailure`] if a service fails or is not ready in time.
    pub fn await_ready(&mut self) -> Result<Vec<String>, RunFailure> {
        let mut notes = Vec::new();
        while !self.supervision.is_ready() {
            self.supervision.look(now(), &self.processes);
            self.perform_all();
            self.watch(SETTLING_PERIOD);
            for news in self.take_news() {
                match news {
                    News::Ready(service, warnings) => {
                        notes.extend(warnings);
                        self.supervision.note_restart_of(service, now(), &self.processes);
                    }
                    News::Lost(failure) => return Err(failure.into()),
                    News::Finished(_) | News::Died { .. } => {}
                }
            }
        }
        notes.sort();
        notes.dedup();
        Ok(notes)
    }

    /// Starts the flight of all services, in the order of the ring.
    pub fn go(&mut self) {
        self.supervision.go();
        self.perform_all();
    }

    /// Stops all services, waits for their ends, and kills those that do not end in time.
    pub fn stop(&mut self) {
        self.supervision.stop(now());
        self.perform_all();
        while !self.supervision.has_stopped(now()) {
            self.watch(SETTLING_PERIOD);
            self.supervision.look(now(), &self.processes);
            self.perform_all();
        }
    }

    /// Stores the reserve for restarted processes.
    pub(super) fn keep_reserve(&mut self, reserve: Reserve) {
        self.reserve = Some(reserve);
    }

    /// Wakes all services, so that they check their conditions again even if a wake-up was lost.
    pub fn wake_all(&self) {
        self.processes.wake_all();
    }

    /// Removes shared memory that a service was creating when it died: others may wait for it.
    pub fn remove_unfinished(&self) {
        self.processes.node.remove_unfinished();
    }

    /// Kills the process of a service.
    pub fn kill(&self, service: ServiceId) {
        self.signal(service, Signal::KILL);
    }

    /// Stops the process of a service (SIGSTOP), so that it hangs.
    pub fn freeze(&self, service: ServiceId) {
        self.signal(service, Signal::STOP);
    }

    fn signal(&self, service: ServiceId, signal: Signal) {
        if let Some(process) = self.processes.get(self.supervision.process_of(service)) {
            process.signal(signal);
        }
    }
}

/// What is known of the run.
impl Supervisor<'_> {
    /// Returns the decisions on the processes.
    #[must_use]
    pub fn supervision(&self) -> &Supervision {
        &self.supervision
    }

    /// Returns the decisions on the processes, and the facts for them.
    pub(super) fn supervision_mut(&mut self) -> (&mut Supervision, &dyn Facts) {
        (&mut self.supervision, &self.processes)
    }

    /// Returns the facts on which decisions are based.
    pub(super) fn facts(&self) -> &dyn Facts {
        &self.processes
    }

    #[must_use]
    pub fn name_of(&self, service: ServiceId) -> &'static str {
        self.supervision.name_of(service)
    }

    /// Returns the page with the control block.
    #[must_use]
    pub fn page(&self) -> &SharedPage {
        &self.processes.page
    }

    #[must_use]
    pub fn step_log(&self) -> &StepLog {
        &self.processes.step_log
    }

    /// Returns the checkpoints of the services.
    #[must_use]
    pub fn checkpoints(&self) -> &Checkpoints {
        &self.processes.checkpoints
    }

    #[must_use]
    pub fn schedule(&self) -> &Schedule {
        self.schedule
    }

    /// Returns the PID of each service.
    pub fn processes(&self) -> impl Iterator<Item = (ServiceId, u32)> {
        self.supervision
            .processes()
            .map(|(service, _, pid)| (service, pid))
    }

    /// Returns whether a service is in flight: neither starting, nor dead, nor finished.
    #[must_use]
    pub fn flies(&self, service: ServiceId) -> bool {
        self.supervision.flies(service)
    }

    /// Returns whether a service is dead, restarting, or catching up.
    #[must_use]
    #[inline]
    pub fn needs_care(&self) -> bool {
        self.supervision.needs_care()
    }

    #[must_use]
    pub fn restarts(&self) -> &[Restart] {
        self.supervision.restarts()
    }
}

impl Drop for Supervisor<'_> {
    fn drop(&mut self) {
        self.stop();
    }
}
