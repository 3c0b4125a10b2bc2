//! What a service process does: join the run, make its ports, say that it is ready, fly, wait for the end.

use std::sync::Arc;

use shared_types::ServiceId;
use shared_types::scenario::{Scenario, ServiceDeployment};
use shared_types::service::ErasedService;

use crate::checkpoints::Checkpoints;
use crate::control::{
    CHECKPOINTS_FD, CONTROL_FD, Channel, ControlError, FIRST_DOORBELL_FD, SHARED_PAGE_FD, Start,
    ToOrchestrator, ToService,
};
use crate::crash::{CrashPlace, CrashPoint};
use crate::deployment::{self, Scheduler, Setting};
use crate::descriptors::inherited;
use crate::doorbell::Doorbell;
use crate::lock_step::{self, Cockpit, FlightError, ServicePorts};
use crate::ports::{Member, PortError};
use crate::shared_page::SharedPage;
use crate::step::Timetable;
use crate::wait::Waiter;

/// Why a service process could not do its work, if there was no orchestrator left to be told.
#[derive(Debug, thiserror::Error)]
pub enum ProcessError {
    /// Nobody has handed the process its descriptors.
    #[error(
        "a service is started by `gerono run`, which hands it a control channel; it cannot be started by hand"
    )]
    NotSpawned,
    /// The control channel failed.
    #[error(transparent)]
    Control(#[from] ControlError),
    /// A port could not be made.
    #[error(transparent)]
    Port(#[from] PortError),
    /// The scenario does not make a service or schedule.
    #[error("the scenario cannot be flown: {0}")]
    Scenario(String),
    /// The system refused something.
    #[error(transparent)]
    Io(#[from] std::io::Error),
    /// The flight ended early.
    #[error(transparent)]
    Flight(#[from] FlightError),
}

/// Runs a service that `gerono run` has spawned, from its first message to its last.
///
/// # Errors
/// [`ProcessError`].
pub fn run(
    id: ServiceId,
    build: impl FnOnce(&Scenario) -> Result<Box<dyn ErasedService>, String>,
) -> Result<(), ProcessError> {
    let inherited = Inherited::take()?;
    deployment::die_with_parent()?;
    let Inherited {
        channel,
        page,
        checkpoints,
        doorbells,
    } = inherited;
    let start = match channel.receive()? {
        ToService::Start(start) => *start,
        // Ended before it began.
        ToService::Stop | ToService::Go { .. } | ToService::Missed { .. } => return Ok(()),
    };
    let (scheduler, warnings) = deploy(id, &start);
    let mut waiter = Waiter::new(id, Arc::new(page), doorbells, channel, scheduler);
    let result = fly(id, build, &start, warnings, &checkpoints, &mut waiter);
    report(waiter.channel(), result)
}

/// Lets the process use the machine as the scenario and the command line say, as far as the system permits.
fn deploy(id: ServiceId, start: &Start) -> (Scheduler, Vec<String>) {
    let stated = start.scenario.deployment_of(id);
    let of_the_run = start.core.and_then(|core| u32::try_from(core).ok());
    let fifo = (start.scheduler == Scheduler::Fifo).then_some(deployment::FIFO_PRIORITY);
    let settings = ServiceDeployment {
        core: stated.core.or(of_the_run),
        priority: stated.priority.or(fifo),
        ..stated
    };
    let refusals = deployment::apply(&settings);
    let may_not = |setting| refusals.iter().any(|refusal| refusal.setting == setting);
    let scheduler = match (settings.priority, start.scheduler) {
        (Some(_), _) if !may_not(Setting::Priority) => Scheduler::Fifo,
        // It needs no privilege; a sandbox that refuses it costs a little time and nothing else.
        (None, Scheduler::Batch) if deployment::use_scheduler(Scheduler::Batch).is_ok() => Scheduler::Batch,
        _ => Scheduler::Fair,
    };
    (scheduler, refusals.iter().map(ToString::to_string).collect())
}

fn fly(
    id: ServiceId,
    build: impl FnOnce(&Scenario) -> Result<Box<dyn ErasedService>, String>,
    start: &Start,
    warnings: Vec<String>,
    checkpoints: &Checkpoints,
    waiter: &mut Waiter,
) -> Result<(), ProcessError> {
    let crash = CrashPoint::new(start.crash);
    let schedule = start
        .scenario
        .schedule()
        .map_err(|problems| ProcessError::Scenario(format!("{problems:?}")))?;
    let mut service = build(&start.scenario).map_err(ProcessError::Scenario)?;
    let member = Member::join(&start.iceoryx2_configuration, id.name())?;
    crash.pass(CrashPlace::BeforePorts, 0);
    let mut ports = ServicePorts::open(&member, id, &schedule, waiter)?;
    ports.connect()?;
    crash.pass(CrashPlace::AfterPorts, 0);
    waiter.channel().send(&ToOrchestrator::Ready { warnings })?;
    let ToService::Go { reborn } = waiter.channel().receive()? else {
        return Ok(());
    };
    ports.connect()?;
    ports.make_known();
    let mut first_tick = 0;
    if reborn {
        ports.expect_missed(waiter.channel().try_clone()?)?;
        if let Some(checkpoint) = checkpoints.newest(id) {
            first_tick = checkpoint.next_tick;
            let timetable = Timetable::new(&schedule, id);
            let next = timetable.steps.first_at_or_after(first_tick);
            if !next.is_some_and(|next| timetable.begins_anew_at(next)) {
                service.restore(&checkpoint.state);
            }
        }
        crash.pass(CrashPlace::Recovering, first_tick);
    }
    let mut cockpit = Cockpit {
        ports: &mut ports,
        waiter,
        checkpoints,
        crash,
    };
    lock_step::fly(service.as_mut(), &schedule, first_tick, &mut cockpit)?;
    waiter.channel().send(&ToOrchestrator::Finished)?;
    // The last samples stay mapped until everyone has read them.
    loop {
        match waiter.channel().receive::<ToService>() {
            // Nothing is missing any more.
            Ok(ToService::Missed { .. }) => {}
            Ok(_) | Err(ControlError::Closed) => return Ok(()),
            Err(error) => return Err(error.into()),
        }
    }
}

/// Tells the orchestrator how it went, if it is still there.
fn report(channel: &Channel, result: Result<(), ProcessError>) -> Result<(), ProcessError> {
    let Err(error) = result else { return Ok(()) };
    let message = match &error {
        ProcessError::Flight(FlightError::Stopping) => return Ok(()),
        ProcessError::Flight(FlightError::NonFinite(found)) => ToOrchestrator::NonFinite(found.clone()),
        error => ToOrchestrator::Failed {
            reason: error.to_string(),
        },
    };
    // Once told, the orchestrator reports it; an error that nobody can be told ends the process.
    channel.send(&message).or(Err(error))
}

/// What the orchestrator hands to a service, by number.
struct Inherited {
    channel: Channel,
    page: SharedPage,
    checkpoints: Checkpoints,
    doorbells: Vec<Doorbell>,
}

impl Inherited {
    fn take() -> Result<Self, ProcessError> {
        let inherited = |number| inherited(number).map_err(|_| ProcessError::NotSpawned);
        let channel = Channel::inherited(inherited(CONTROL_FD)?);
        let page = SharedPage::open(inherited(SHARED_PAGE_FD)?).map_err(|_| ProcessError::NotSpawned)?;
        let checkpoints =
            Checkpoints::open(inherited(CHECKPOINTS_FD)?).map_err(|_| ProcessError::NotSpawned)?;
        let numbers = (FIRST_DOORBELL_FD..).take(ServiceId::ALL.len());
        let doorbells = numbers
            .map(|number| inherited(number).map(Doorbell::inherited))
            .collect::<Result<_, _>>()?;
        Ok(Self {
            channel,
            page,
            checkpoints,
            doorbells,
        })
    }
}
