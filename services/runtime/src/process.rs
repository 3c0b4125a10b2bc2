//! Life of a service process: join the run, make its ports, report ready, fly, wait for the end.
//!
//! A **standby process** completes the start that all services have in common before it has a role: when a service dies, it
//! is loaded, has joined the run and has built all services.

use std::os::fd::{AsFd, OwnedFd};
use std::sync::Arc;

use rustix::process::DumpableBehavior;
use scenario::{Scenario, ServiceDeployment, Unflyable};
use shared_types::service::{Built, ErasedService};
use shared_types::{Schedule, ServiceId};
use system_limits::resource_limits;

use crate::checkpoints::Checkpoints;
use crate::control::{
    CHECKPOINTS_FD, CONTROL_FD, Channel, FIRST_DOORBELL_FD, Host, LOCK_FD, Role, SHARED_PAGE_FD, STEP_LOG_FD,
    Start, ToOrchestrator, ToService,
};
use crate::crash::CrashPoint;
use crate::deployment::{self, Scheduler, Setting};
use crate::descriptors::{self, inherited};
use crate::doorbell::Doorbell;
use crate::external_service::{self, LaunchDescriptors, LaunchManifest};
use crate::flight_error::FlightError;
use crate::launch::Launch;
use crate::ports::{PortError, RunNode, Topics};
pub use crate::process_error::ProcessError;
use crate::shared_page::SharedPage;
use crate::step_log::StepLog;
use crate::wait::Waiter;
use crate::watchdog;

/// Name of a standby process.
pub const SPARE: &str = "spare";

/// Default timer slack of services in real time, s: the system's minimum.
const MIN_TIMER_SLACK: f64 = 1e-9;

/// Runs a process that `gerono run` has spawned, from its first message to its last: a service, or a standby process that
/// takes the role of a service that dies. `name` is the system's name of the process until it has a role.
///
/// `build` makes the step logic of a role. In real time, once the process has a role and before the service is ready,
/// `connect` connects the step logic to the scenario's laboratory hardware.
///
/// # Errors
/// [`ProcessError`].
pub fn run(
    name: &str,
    build: impl Fn(ServiceId, &Scenario) -> Built,
    connect: impl FnOnce(Box<dyn ErasedService>, &Scenario, &Arc<SharedPage>) -> Built,
) -> Result<(), ProcessError> {
    let inherited = Inherited::take()?;
    // Services, and in particular external programs, must not inherit other descriptors that iceoryx2 and the shell left
    // open in the orchestrator. A system older than the call leaves them open.
    let _ = descriptors::close_from(
        FIRST_DOORBELL_FD + i32::try_from(ServiceId::ALL.len()).expect("few services"),
    );
    deployment::die_with_parent()?;
    deployment::die_by_signals();
    deployment::name_process(name)?;
    // The kernel denies other processes of the user access to a program with capabilities, so that `gerono kill` could not
    // reach the control block. A dumpable process permits the access again, to processes with the same capabilities.
    rustix::process::set_dumpable_behavior(DumpableBehavior::Dumpable).map_err(std::io::Error::from)?;
    // Any other message ends the run before its start.
    let ToService::Start(start) = inherited.channel.receive()? else {
        return Ok(());
    };
    let channel = inherited.channel.try_clone()?;
    // A replay executes the built-in service instead of the program.
    if let Some(role) = start.role
        && start.host != Host::Replay
        && let Some(program) = start.scenario.program_of(role.service)
    {
        return report(
            &channel,
            write_manifest(program, role.service, &start, &inherited),
        );
    }
    if start.host == Host::RealTime {
        // An airborne vehicle must survive the orchestrator: see `orchestrator_watchdog`.
        deployment::outlive_parent()?;
    }
    let result = prepare_and_fly(inherited, &start, name, build, connect);
    report(&channel, result)
}

/// Replaces this process by the program that flies in place of a service. The program ends with the orchestrator, because
/// no other orchestrator could take it over.
fn write_manifest(
    program: &[String],
    service: ServiceId,
    start: &Start,
    inherited: &Inherited,
) -> Result<(), ProcessError> {
    let schedule = schedule_of(start)?;
    let manifest = LaunchManifest::new(service, start, &schedule).map_err(ProcessError::ExternalService)?;
    let (_, warnings) = deploy(service, start);
    inherited.channel.send(&ToOrchestrator::Deployed { warnings })?;
    let folder = start.scenario.programs.as_ref();
    let folder = folder.and_then(|programs| programs.folder.as_deref());
    // A separate open file of the lock: an unlock of the inherited one by the program would release the lock of all
    // processes of the run, and its folder could be removed.
    let lock = std::fs::File::open(format!("/proc/self/fd/{LOCK_FD}"))?;
    let handed_over = LaunchDescriptors {
        channel: &inherited.channel,
        lock: lock.as_fd(),
        doorbells: &inherited.doorbells,
    };
    let reason = external_service::become_program(program, folder, &manifest, &handed_over);
    Err(ProcessError::ExternalService(reason))
}

fn schedule_of(start: &Start) -> Result<Schedule, ProcessError> {
    let schedule = start.scenario.schedule();
    schedule.map_err(|problems| ProcessError::Scenario(Unflyable(problems).into()))
}

/// Prepares the flight, and flies. A process without a role prepares all roles and waits for one.
fn prepare_and_fly(
    inherited: Inherited,
    start: &Start,
    name: &str,
    build: impl Fn(ServiceId, &Scenario) -> Built,
    connect: impl FnOnce(Box<dyn ErasedService>, &Scenario, &Arc<SharedPage>) -> Built,
) -> Result<(), ProcessError> {
    let Inherited {
        channel,
        page,
        checkpoints,
        step_log,
        lock,
        doorbells,
    } = inherited;
    let line = Arc::new(channel.try_clone()?);
    let (watched, line_of_panics) = (Arc::clone(&line), Arc::clone(&line));
    let report_hang = move |reason| {
        // Without a receiver the orchestrator is gone or hangs as well.
        let _ = line.try_send(&ToOrchestrator::Failed { reason });
    };
    report_panics(line_of_panics);
    watchdog::watch_service(report_hang, move || watched.is_hung_up())?;
    let build = |id| build(id, &start.scenario).map_err(ProcessError::Scenario);
    // A standby process stays off the services' core until it has a role.
    let deployed = start.role.map(|role| deploy(role.service, start));
    if deployed.is_none() {
        lock_standby_memory(start);
    }
    let schedule = schedule_of(start)?;
    let node = RunNode::join(&start.iceoryx2_configuration, name)?;
    let (role, mut service) = if let Some(role) = start.role {
        (role, build(role.service)?)
    } else {
        let services: Result<Vec<_>, _> = ServiceId::ALL.into_iter().map(build).collect();
        let mut services = services?;
        let Some(role) = await_role(&channel)? else {
            return Ok(());
        };
        deployment::name_process(start.scenario.process_name(role.service))?;
        (role, services.swap_remove(role.service.index()))
    };
    let (scheduler, warnings) = deployed.unwrap_or_else(|| deploy(role.service, start));
    let topics = match start.host {
        Host::LockStep | Host::RealTime => Topics::open(&node, role.service, &schedule)?,
        Host::Replay => Topics::open_replayed(&node, role.service, &schedule)?,
    };
    let ToService::MakePorts = channel.receive()? else {
        return Ok(());
    };
    let page = Arc::new(page);
    if start.host == Host::RealTime {
        service = connect(service, &start.scenario, &page).map_err(ProcessError::Connection)?;
    }
    let mut waiter = Waiter::new(
        role.service,
        page,
        doorbells,
        channel,
        scheduler,
        start.scenario.external_services(),
    );
    let launch = Launch {
        schedule: &schedule,
        topics: &topics,
        checkpoints: &checkpoints,
        step_log: &step_log,
        crash: CrashPoint::new(role.crash),
        warnings,
    };
    match start.host {
        Host::LockStep => launch.in_lock_step(service.as_mut(), &mut waiter),
        Host::RealTime => launch.in_real_time(service, start, lock.as_fd(), &waiter),
        Host::Replay => launch.in_replay(service.as_mut(), waiter.channel()),
    }
}

/// Reports the message of a panic to the orchestrator before the process ends: an exit code has no reason.
fn report_panics(line: Arc<Channel>) {
    let print = std::panic::take_hook();
    std::panic::set_hook(Box::new(move |panic| {
        let reason = panic.payload_as_str().unwrap_or("it panicked").to_owned();
        // Without this message the orchestrator still has the exit code.
        let _ = line.try_send(&ToOrchestrator::Dying { reason });
        print(panic);
    }));
}

/// Reports that a standby process is prepared, and answers each heartbeat, until it receives a role. `None` if the run ends.
fn await_role(channel: &Channel) -> Result<Option<Role>, ProcessError> {
    loop {
        channel.send(&ToOrchestrator::Prepared)?;
        match channel.receive()? {
            ToService::Beat => {}
            ToService::Become(role) => return Ok(Some(role)),
            _ => return Ok(None),
        }
    }
}

/// Applies the scenario's and the command line's deployment, as far as the system permits.
fn deploy(id: ServiceId, start: &Start) -> (Scheduler, Vec<String>) {
    let stated = start.scenario.deployment_of(id);
    let of_the_run = start.core.and_then(|core| u32::try_from(core).ok());
    let fifo = (start.scheduler == Scheduler::Fifo).then_some(deployment::FIFO_PRIORITY);
    let settings = ServiceDeployment {
        core: stated.core.or(of_the_run),
        priority: stated.priority.or(fifo),
        // The system may end sleeps late to save power: by 50 µs by default.
        timer_slack: stated
            .timer_slack
            .or((start.host == Host::RealTime).then_some(MIN_TIMER_SLACK)),
        ..stated
    };
    let refusals = deployment::apply(&settings);
    let may_not = |setting| refusals.iter().any(|refusal| refusal.setting == setting);
    let scheduler = match (settings.priority, start.scheduler) {
        (Some(_), _) if !may_not(Setting::Priority) => Scheduler::Fifo,
        // Needs no privilege. A refusal by a sandbox costs only some time.
        (None, Scheduler::Batch) if deployment::use_scheduler(Scheduler::Batch).is_ok() => Scheduler::Batch,
        _ => Scheduler::Fair,
    };
    if start.host == Host::RealTime && scheduler == Scheduler::Fair {
        // After a refusal the service is only late occasionally, under long-running other load.
        let _ = deployment::use_short_slices();
    }
    (scheduler, refusals.iter().map(ToString::to_string).collect())
}

/// Locks the memory of a standby process in advance if any service locks its memory: locking touches every page, which
/// takes too long for a restart. The services report a refusal.
fn lock_standby_memory(start: &Start) {
    let locks = |id| start.scenario.deployment_of(id).lock_memory == Some(true);
    let settings = ServiceDeployment {
        lock_memory: Some(ServiceId::ALL.into_iter().any(locks)),
        ..ServiceDeployment::default()
    };
    let _reported_by_the_services = deployment::apply(&settings);
}

/// Reports the result to the orchestrator, if it still exists.
fn report(channel: &Channel, result: Result<(), ProcessError>) -> Result<(), ProcessError> {
    let Err(error) = result else { return Ok(()) };
    let message = match &error {
        ProcessError::Flight(FlightError::Stopping) => return Ok(()),
        ProcessError::Flight(FlightError::NonFinite(found)) => ToOrchestrator::NonFinite(found.clone()),
        // Its successor connects again.
        ProcessError::Port(PortError::Unconnected { .. })
        | ProcessError::Flight(FlightError::Port(PortError::Unconnected { .. })) => ToOrchestrator::Dying {
            reason: resource_limits::in_words(&error),
        },
        ProcessError::Scenario(_) => ToOrchestrator::Refused {
            reason: resource_limits::in_words(&error),
        },
        error => ToOrchestrator::Failed {
            reason: resource_limits::in_words(error),
        },
    };
    // The orchestrator reports the error to the user; if it is gone, the process does.
    channel.send(&message).or(Err(error))
}

/// Descriptors that a service inherits from the orchestrator, by number.
struct Inherited {
    channel: Channel,
    page: SharedPage,
    checkpoints: Checkpoints,
    step_log: StepLog,
    /// Held until the process ends.
    lock: OwnedFd,
    doorbells: Vec<Doorbell>,
}

impl Inherited {
    fn take() -> Result<Self, ProcessError> {
        let inherited = |number| inherited(number).map_err(|_| ProcessError::NotSpawned);
        let channel = Channel::inherited(inherited(CONTROL_FD)?);
        let page = SharedPage::open(inherited(SHARED_PAGE_FD)?).map_err(|_| ProcessError::NotSpawned)?;
        let checkpoints =
            Checkpoints::open(inherited(CHECKPOINTS_FD)?).map_err(|_| ProcessError::NotSpawned)?;
        let step_log = StepLog::open(inherited(STEP_LOG_FD)?).map_err(|_| ProcessError::NotSpawned)?;
        let numbers = (FIRST_DOORBELL_FD..).take(ServiceId::ALL.len());
        let doorbells = numbers
            .map(|number| inherited(number).map(Doorbell::inherited))
            .collect::<Result<_, _>>()?;
        Ok(Self {
            channel,
            page,
            checkpoints,
            step_log,
            lock: inherited(LOCK_FD)?,
            doorbells,
        })
    }
}
