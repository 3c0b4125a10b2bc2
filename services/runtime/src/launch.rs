//! Launch of a service that has joined the run: ports, start, and the state of a dead predecessor.

use std::os::fd::BorrowedFd;
use std::sync::Arc;
use std::sync::atomic::Ordering;

use shared_types::Schedule;
use shared_types::service::{ErasedService, nanoseconds};

use crate::checkpoints::Checkpoints;
use crate::control::{Channel, ControlError, Start, ToOrchestrator, ToService};
use crate::crash::{CrashPlace, CrashPoint};
use crate::flight_clock::FlightClock;
use crate::flight_error::FlightError;
use crate::lock_step::{self, ServiceContext, ServicePorts};
use crate::orchestrator_watchdog::OrchestratorWatchdog;
use crate::ports::Topics;
use crate::process_error::ProcessError;
use crate::real_time::{self, RealTimePorts};
use crate::replaying::{self, ReplayPorts};
use crate::step_log::StepLog;
use crate::take_over::{HandOver, Hello};
use crate::tuning::TuningReader;
use crate::wait::Waiter;
use host::step::Timetable;
use host::watchdog::{self, Work};

/// Resources of a service that has its role and may create its ports.
pub struct Launch<'a> {
    /// Schedule of all steps.
    pub schedule: &'a Schedule,
    /// Topics that the service publishes or consumes.
    pub topics: &'a Topics,
    /// Checkpoints of the run.
    pub checkpoints: &'a Checkpoints,
    /// Step records of the run, in real time.
    pub step_log: &'a StepLog,
    /// Planned crash.
    pub crash: CrashPoint,
    /// Refused parts of the deployment.
    pub warnings: Vec<String>,
}

impl Launch<'_> {
    /// Flies in lock step as soon as all services are ready, and waits for the end of the run.
    ///
    /// # Errors
    /// [`ProcessError`].
    pub fn in_lock_step(
        self,
        service: &mut dyn ErasedService,
        waiter: &mut Waiter,
    ) -> Result<(), ProcessError> {
        self.crash.pass(CrashPlace::BeforePorts, 0);
        let mut ports = watchdog::during(Work::Ports, || {
            let mut ports = ServicePorts::open(self.topics, service.id(), self.schedule, waiter)?;
            ports.connect()?;
            Ok::<_, ProcessError>(ports)
        })?;
        self.crash.pass(CrashPlace::AfterPorts, 0);
        let Some(restarted) = await_go(waiter.channel(), self.warnings, |_, _| {})? else {
            return Ok(());
        };
        watchdog::during(Work::Ports, || ports.connect())?;
        ports.publish_receivers();
        let mut context = ServiceContext {
            ports: &mut ports,
            waiter,
            checkpoints: self.checkpoints,
            crash: self.crash,
        };
        let first_tick = if restarted {
            resume(service, self.schedule, &mut context)?
        } else {
            0
        };
        lock_step::fly(service, self.schedule, first_tick, &mut context)?;
        watchdog::idle();
        wait_for_end(context.waiter.channel())
    }

    /// Executes the steps of a replay, as the orchestrator orders them.
    ///
    /// # Errors
    /// [`ProcessError`].
    pub fn in_replay(self, service: &mut dyn ErasedService, channel: &Channel) -> Result<(), ProcessError> {
        let mut ports = ReplayPorts::open(self.topics, service.id(), self.schedule)?;
        if await_go(channel, self.warnings, |_, _| {})?.is_none() {
            return Ok(());
        }
        ports.connect()?;
        replaying::execute_orders(service, self.schedule, &mut ports, channel)?;
        Ok(())
    }

    /// Flies in real time as soon as all services are ready, and waits for the end of the run. `lock` is the lock of the
    /// run's folder.
    ///
    /// # Errors
    /// [`ProcessError`].
    pub fn in_real_time(
        self,
        mut service: Box<dyn ErasedService>,
        start: &Start,
        lock: BorrowedFd<'_>,
        waiter: &Waiter,
    ) -> Result<(), ProcessError> {
        self.crash.pass(CrashPlace::BeforePorts, 0);
        let external_services = start.scenario.external_services();
        let mut ports = watchdog::during(Work::Ports, || {
            RealTimePorts::open(
                self.topics,
                service.id(),
                self.schedule,
                external_services,
                waiter.page(),
            )
        })?;
        self.crash.pass(CrashPlace::AfterPorts, 0);
        let take_missed = |input, bytes: &[u8]| ports.take_missed(input, bytes);
        let Some(restarted) = await_go(waiter.channel(), self.warnings, take_missed)? else {
            return Ok(());
        };
        watchdog::during(Work::Ports, || ports.connect())?;
        let checkpoint = self.checkpoints.newest(service.id()).filter(|_| restarted);
        if let Some(checkpoint) = &checkpoint {
            self.crash.pass(CrashPlace::Recovering, checkpoint.next_tick);
        }
        let page = Arc::clone(waiter.page());
        let files = [page.file(), self.checkpoints.file(), self.step_log.file(), lock];
        let hello = Hello {
            service: service.id(),
            start: start.clone(),
        };
        let hand_over = HandOver::new(start.place(), &hello, files)?;
        let mut context = real_time::ServiceContext {
            ports,
            checkpoints: self.checkpoints,
            step_log: self.step_log,
            clock: FlightClock {
                start_ns: page.control_block().start_ns.load(Ordering::Acquire),
                tick_ns: self.schedule.tick_ns(),
            },
            page,
            doorbells: waiter.doorbells(),
            external_services,
            grace_ns: nanoseconds(start.scenario.real_time.unwrap_or_default().grace),
            orchestrator_watchdog: OrchestratorWatchdog::new(
                &start.scenario,
                waiter.channel().try_clone()?,
                hand_over,
            ),
            tuning: TuningReader::default(),
            crash: self.crash,
        };
        let flown = real_time::fly(service.as_mut(), self.schedule, checkpoint.as_ref(), &mut context);
        watchdog::idle();
        // Connected laboratory hardware stops with the flight, and not with a process that fails. An incomplete state of a
        // plug-in is reported after its last step.
        if matches!(
            flown,
            Ok(()) | Err(FlightError::Stopping | FlightError::IncompleteState(_))
        ) {
            service.finish();
        }
        flown?;
        drop(service);
        wait_for_end(context.orchestrator_watchdog.channel())
    }
}

/// Reports that all ports exist and waits for the start; passes missed samples to `take_missed` until then. Returns whether
/// this process is a restart; `None` if the run ends.
fn await_go(
    channel: &Channel,
    warnings: Vec<String>,
    mut take_missed: impl FnMut(usize, &[u8]),
) -> Result<Option<bool>, ProcessError> {
    let receivers = Vec::new();
    channel.send(&ToOrchestrator::Ready { warnings, receivers })?;
    loop {
        match channel.receive()? {
            ToService::Missed { input, bytes } => take_missed(input, &bytes),
            ToService::Go { restarted, .. } => return Ok(Some(restarted)),
            _ => return Ok(None),
        }
    }
}

/// Restores the state of the dead predecessor. Returns the first tick that the state does not include.
fn resume(
    service: &mut dyn ErasedService,
    schedule: &Schedule,
    context: &mut ServiceContext<'_>,
) -> Result<u64, ProcessError> {
    let mut first_tick = 0;
    context
        .ports
        .expect_missed(context.waiter.channel().try_clone()?)?;
    if let Some(checkpoint) = context.checkpoints.newest(service.id()) {
        first_tick = checkpoint.next_tick;
        let timetable = Timetable::new(schedule, service.id());
        timetable.resume(service, &checkpoint);
    }
    context.crash.pass(CrashPlace::Recovering, first_tick);
    Ok(first_tick)
}

/// Reports that all steps are done, and waits for the end of the run: the last samples stay mapped until all consumers have
/// read them.
fn wait_for_end(channel: &Channel) -> Result<(), ProcessError> {
    channel.send(&ToOrchestrator::Finished)?;
    loop {
        match channel.receive::<ToService>() {
            // All steps are done: a missed sample is not needed.
            Ok(ToService::Missed { .. }) => {}
            Ok(_) | Err(ControlError::Closed) => return Ok(()),
            Err(error) => return Err(error.into()),
        }
    }
}
