//! What a service process does: join the run, make its ports, say that it is ready, fly, wait for the end.

use std::num::NonZeroU64;
use std::sync::Arc;
use std::sync::atomic::Ordering;

use shared_types::scenario::Scenario;
use shared_types::service::ErasedService;
use shared_types::{Schedule, ServiceId};

use crate::checkpoints::Checkpoints;
use crate::control::{
    CHECKPOINTS_FD, CONTROL_FD, Channel, ControlError, FIRST_DOORBELL_FD, RealTime, SHARED_PAGE_FD,
    STEP_LOG_FD, Start, ToOrchestrator, ToService,
};
use crate::crash::{CrashPlace, CrashPoint};
use crate::deployment::{self, Scheduler};
use crate::descriptors::inherited;
use crate::doorbell::Doorbell;
use crate::flight_clock::FlightClock;
use crate::lock_step::{self, Cockpit, FlightError, ServicePorts};
use crate::ports::{Member, PortError};
use crate::real_time::{self, RealTimePorts};
use crate::shared_page::SharedPage;
use crate::step::Timetable;
use crate::step_log::StepLog;
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
        step_log,
        doorbells,
    } = inherited;
    let start = match channel.receive()? {
        ToService::Start(start) => *start,
        // Ended before it began.
        ToService::Stop | ToService::Go { .. } | ToService::Missed { .. } => return Ok(()),
    };
    let (scheduler, warnings) = deploy(&start);
    if start.real_time.is_some() {
        // The system may end sleeps late to save power: by 50 µs unless it is told otherwise. It refuses nobody.
        let _ = rustix::thread::set_current_timer_slack(NonZeroU64::new(1));
    }
    let mut waiter = Waiter::new(id, Arc::new(page), doorbells, channel, scheduler);
    let kept = Kept {
        checkpoints,
        step_log,
    };
    let result = fly(id, build, &start, warnings, &kept, &mut waiter);
    report(waiter.channel(), result)
}

/// Pins the process and sets its scheduler, as far as the system permits.
fn deploy(start: &Start) -> (Scheduler, Vec<String>) {
    let mut warnings = Vec::new();
    if let Some(core) = start.core
        && let Err(error) = deployment::pin_to(&[core])
    {
        warnings.push(format!("cannot pin to core {core}: {error}"));
    }
    let refused = match start.scheduler {
        Scheduler::Fair => None,
        scheduler => deployment::use_scheduler(scheduler).err(),
    };
    let scheduler = match (start.scheduler, refused) {
        (scheduler, None) => scheduler,
        (Scheduler::Fifo, Some(error)) => {
            warnings.push(format!(
                "SCHED_FIFO is not permitted ({error}): flying with the ordinary scheduler. \
                 Grant CAP_SYS_NICE or raise `rtprio` in /etc/security/limits.conf"
            ));
            Scheduler::Fair
        }
        // It needs no privilege; a sandbox that refuses it costs a little time and nothing else.
        (Scheduler::Batch | Scheduler::Fair, Some(_)) => Scheduler::Fair,
    };
    (scheduler, warnings)
}

fn fly(
    id: ServiceId,
    build: impl FnOnce(&Scenario) -> Result<Box<dyn ErasedService>, String>,
    start: &Start,
    warnings: Vec<String>,
    kept: &Kept,
    waiter: &mut Waiter,
) -> Result<(), ProcessError> {
    let crash = CrashPoint::new(start.crash);
    let schedule = start
        .scenario
        .schedule()
        .map_err(|problems| ProcessError::Scenario(format!("{problems:?}")))?;
    let mut service = build(&start.scenario).map_err(ProcessError::Scenario)?;
    let member = Member::join(&start.iceoryx2_configuration, id.name())?;
    let launch = Launch {
        schedule: &schedule,
        member: &member,
        kept,
        crash,
        warnings,
    };
    let flown = match start.real_time {
        None => launch.in_lock_step(service.as_mut(), waiter)?,
        Some(settings) => launch.in_real_time(service.as_mut(), settings, waiter)?,
    };
    if !flown {
        return Ok(());
    }
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

/// What a service knows and tells outside of its process.
struct Kept {
    checkpoints: Checkpoints,
    step_log: StepLog,
}

/// A service that has joined the run, before it flies.
struct Launch<'a> {
    schedule: &'a Schedule,
    member: &'a Member,
    kept: &'a Kept,
    crash: CrashPoint,
    warnings: Vec<String>,
}

impl Launch<'_> {
    /// Makes the ports and flies in lock-step; `false` if the run ended before.
    fn in_lock_step(
        self,
        service: &mut dyn ErasedService,
        waiter: &mut Waiter,
    ) -> Result<bool, ProcessError> {
        let id = service.id();
        self.crash.pass(CrashPlace::BeforePorts, 0);
        let mut ports = ServicePorts::open(self.member, id, self.schedule, waiter)?;
        ports.connect()?;
        self.crash.pass(CrashPlace::AfterPorts, 0);
        let Some(reborn) = await_go(waiter.channel(), self.warnings)? else {
            return Ok(false);
        };
        ports.connect()?;
        ports.make_known();
        let mut first_tick = 0;
        if reborn {
            ports.expect_missed(waiter.channel().try_clone()?)?;
            if let Some(checkpoint) = self.kept.checkpoints.newest(id) {
                first_tick = checkpoint.next_tick;
                let timetable = Timetable::new(self.schedule, id);
                let next = timetable.steps.first_at_or_after(first_tick);
                if !next.is_some_and(|next| timetable.begins_anew_at(next)) {
                    service.restore(&checkpoint.state);
                }
            }
            self.crash.pass(CrashPlace::Recovering, first_tick);
        }
        let mut cockpit = Cockpit {
            ports: &mut ports,
            waiter,
            checkpoints: &self.kept.checkpoints,
            crash: self.crash,
        };
        lock_step::fly(service, self.schedule, first_tick, &mut cockpit)?;
        Ok(true)
    }

    /// Makes the ports and flies in real time; `false` if the run ended before.
    fn in_real_time(
        self,
        service: &mut dyn ErasedService,
        settings: RealTime,
        waiter: &mut Waiter,
    ) -> Result<bool, ProcessError> {
        let id = service.id();
        self.crash.pass(CrashPlace::BeforePorts, 0);
        let mut ports = RealTimePorts::open(self.member, id, self.schedule)?;
        self.crash.pass(CrashPlace::AfterPorts, 0);
        let Some(reborn) = await_go(waiter.channel(), self.warnings)? else {
            return Ok(false);
        };
        ports.connect()?;
        let checkpoint = self.kept.checkpoints.newest(id).filter(|_| reborn);
        if let Some(checkpoint) = &checkpoint {
            self.crash.pass(CrashPlace::Recovering, checkpoint.next_tick);
        }
        let page = Arc::clone(waiter.page());
        let mut cockpit = real_time::Cockpit {
            ports,
            checkpoints: &self.kept.checkpoints,
            step_log: &self.kept.step_log,
            clock: FlightClock {
                start_ns: page.words().start_ns.load(Ordering::Acquire),
                tick_ns: self.schedule.tick_ns(),
            },
            page,
            grace_ns: settings.grace_ns,
            crash: self.crash,
        };
        real_time::fly(service, self.schedule, checkpoint.as_ref(), &mut cockpit)?;
        Ok(true)
    }
}

/// Says that all ports are made and waits for the start: whether another process has flown before this one; none if
/// the run ends.
fn await_go(channel: &Channel, warnings: Vec<String>) -> Result<Option<bool>, ProcessError> {
    channel.send(&ToOrchestrator::Ready { warnings })?;
    Ok(match channel.receive()? {
        ToService::Go { reborn } => Some(reborn),
        _ => None,
    })
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
    step_log: StepLog,
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
            doorbells,
        })
    }
}
