//! Lock-step host of one service: each step waits for exactly the due samples of the schedule.
//!
//! Results cannot depend on the scheduling of the processes: a step begins only when the due sample of every input has
//! arrived, and later samples stay in their buffers. No sample is lost; publishers run ahead at most as far as the
//! schedule permits.
//!
//! Every ten ticks the service writes a checkpoint. After a death a new process resumes from it. It receives the missed
//! samples, repeats the steps since the checkpoint, and publishes their outputs again; consumers skip the samples that they
//! have received before. Steps are pure functions, so a death leaves no trace in the published samples.

use std::sync::Arc;
use std::sync::atomic::Ordering;

use shared_types::service::ErasedService;
use shared_types::{Schedule, ServiceId};

use crate::checkpoints::Checkpoints;
use crate::control::{Channel, ToOrchestrator, ToService};
use crate::crash::{self, CrashPlace, CrashPoint};
use crate::flight_error::FlightError;
use crate::input_port::InputPort;
use crate::output_ports::OutputPorts;
use crate::ports::{PortError, Topics};
use crate::shared_page::{Cell, SharedPage};
use crate::untrusted::UntrustedReceiver;
use crate::wait::Waiter;
use host::step::{self, Slots, Timetable, Views};
use host::watchdog::{self, Work};

/// Maximum number of ticks that are repeated after a death. A checkpoint is a copy of some kilobytes and takes a twentieth of
/// a tick in which each service writes one; ten ticks of steps take less than the start of a process.
const CHECKPOINT_PERIOD: u64 = 10;

/// A service's ports.
pub struct ServicePorts {
    id: ServiceId,
    page: Arc<SharedPage>,
    inputs: Vec<InputPort>,
    outputs: OutputPorts,
    /// Source of the samples that a restarted service has missed.
    missed: Option<Channel>,
    /// `true` if a fault is planned, or a service was restarted. Then publishers may run ahead, or repeat samples,
    /// until buffers are full, and a service that waits for one input must not block the publisher of another one.
    drains_all: bool,
    /// Restarts of other services whose ports are connected.
    restarts_seen: u32,
}

impl ServicePorts {
    /// Makes the ports that the wiring table gives a service.
    ///
    /// # Errors
    /// [`PortError`].
    pub fn open(
        topics: &Topics,
        id: ServiceId,
        schedule: &Schedule,
        waiter: &Waiter,
    ) -> Result<Self, PortError> {
        let page = waiter.page();
        let mut inputs = Vec::new();
        for (index, spec) in schedule.inputs_read(id) {
            let mut receiver = topics.ports(spec.topic).receiver()?;
            let publisher = spec
                .topic
                .publisher()
                .expect("services consume what services publish");
            if waiter.external_services()[publisher.index()] {
                receiver = Box::new(UntrustedReceiver::new(
                    receiver,
                    &schedule.publication(spec.topic),
                ));
            }
            inputs.push(InputPort::new(
                index,
                schedule.edge(id, index),
                publisher,
                receiver,
            ));
        }
        inputs.sort_by_key(|input| step::waiting_order(schedule, &input.edge, input.publisher));
        let outputs = OutputPorts::open(topics, id, schedule, |topic| {
            topic.sender(Arc::clone(page), waiter.doorbells())
        })?;
        Ok(Self {
            id,
            page: Arc::clone(page),
            inputs,
            outputs,
            missed: None,
            drains_all: schedule.has_faults(),
            restarts_seen: 0,
        })
    }

    /// Publishes the ids of the receivers in the control block: from now on publishers wait for them when a buffer is full.
    /// Before, publishers ignore them: a restarted service must not block others until it flies.
    pub fn publish_receivers(&mut self) {
        let receivers = &self.page.control_block().cells[self.id.index()].receivers;
        for input in &mut self.inputs {
            receivers[input.index].store(input.receiver().id());
        }
    }

    /// Connects all ports to the existing ports of other services.
    ///
    /// # Errors
    /// [`PortError`].
    pub fn connect(&mut self) -> Result<(), PortError> {
        self.inputs
            .iter_mut()
            .try_for_each(|input| input.receiver().connect())?;
        self.outputs.connect()
    }

    /// Marks the service as restarted, with the source of the samples that it has missed.
    ///
    /// # Errors
    /// [`PortError`].
    pub fn expect_missed(&mut self, channel: Channel) -> Result<(), PortError> {
        self.inputs.iter_mut().try_for_each(InputPort::expect_missed)?;
        self.missed = Some(channel);
        Ok(())
    }

    /// Connects to the ports of restarted services, and confirms it: they do not fly before.
    #[inline]
    fn connect_restarted(&mut self) -> Result<(), PortError> {
        // Acquire: the new ports exist before the orchestrator counts the restart. An older view of the ports would be
        // confirmed as connected without them.
        let restarts = self.page.control_block().restarts.load(Ordering::Acquire);
        if restarts == self.restarts_seen {
            return Ok(());
        }
        self.restarts_seen = restarts;
        self.drains_all = true;
        self.connect()?;
        let cell = &self.page.control_block().cells[self.id.index()];
        // Release: connected before confirmed. The restarted service flies once all have confirmed; a confirmation that
        // came first would let it publish to a consumer without a connection, which would lose the sample.
        cell.restarts_seen.store(restarts, Ordering::Release);
        Ok(())
    }

    /// Checks for the sample of tick `due` of an input.
    #[inline]
    fn poll_input(&mut self, input: usize, tick: u64, due: u64) -> Result<bool, FlightError> {
        self.connect_restarted()?;
        if self.missed.is_some() {
            self.read_missed()?;
        }
        let has_arrived = self.inputs[input].advance(tick, due)?;
        if !has_arrived && self.drains_all {
            self.make_room(tick)?;
        }
        Ok(has_arrived)
    }

    /// Receives the samples of every input up to the due one.
    #[cold]
    fn make_room(&mut self, tick: u64) -> Result<(), FlightError> {
        for input in &mut self.inputs {
            if let Some(due) = input.edge.published_by(tick) {
                input.advance(tick, due)?;
            }
        }
        Ok(())
    }

    #[cold]
    fn read_missed(&mut self) -> Result<(), FlightError> {
        let Some(channel) = &self.missed else {
            return Ok(());
        };
        while let Some(message) = channel.try_receive()? {
            if let ToService::Missed { input: index, bytes } = message
                && let Some(input) = self.inputs.iter_mut().find(|input| input.index == index)
            {
                input.take_missed(&bytes);
            }
        }
        Ok(())
    }

    /// Reports to the orchestrator, once, that all further samples come from the ports.
    #[cold]
    fn catch_up(&mut self) -> Result<(), FlightError> {
        if self.inputs.iter().all(InputPort::has_caught_up)
            && let Some(channel) = self.missed.take()
        {
            channel.send(&ToOrchestrator::CaughtUp)?;
        }
        Ok(())
    }
}

/// Context in which a service flies.
pub struct ServiceContext<'a> {
    /// Ports of the service.
    pub ports: &'a mut ServicePorts,
    /// Waiting for other services of the ring.
    pub waiter: &'a mut Waiter,
    /// Checkpoints of the run.
    pub checkpoints: &'a Checkpoints,
    /// Planned crash.
    pub crash: CrashPoint,
}

/// Flies a service from its step at `first_tick`, or the first one after it, to its last.
///
/// # Errors
/// [`FlightError`].
pub fn fly(
    service: &mut dyn ErasedService,
    schedule: &Schedule,
    first_tick: u64,
    context: &mut ServiceContext<'_>,
) -> Result<(), FlightError> {
    let timetable = Timetable::new(schedule, service.id());
    let mut next = timetable.steps.first_at_or_after(first_tick);
    while let Some(tick) = next.filter(|&tick| tick <= schedule.last_tick()) {
        if context.waiter.is_stopping() {
            return Err(FlightError::Stopping);
        }
        watchdog::work(Work::Step);
        context.await_inputs(tick)?;
        context.crash.pass(CrashPlace::BeforeStep, tick);
        context.step_and_publish(service, &timetable, tick)?;
        next = timetable.steps.first_at_or_after(tick + 1);
        debug_assert!(next.is_none_or(|next| next > tick), "ticks go forward");
        let dies = timetable.dies_after(tick, next);
        let is_last = next.is_none_or(|next| next > schedule.last_tick());
        if dies || is_last || next.map(period_of) != Some(period_of(tick)) {
            context.write_checkpoint(service, tick + 1);
        }
        context.crash.pass(CrashPlace::BeforeWaking, tick);
        let cell = context.waiter.cell();
        cell.steps_until.store(tick + 1, Ordering::Relaxed);
        Cell::count(&cell.steps);
        context.waiter.wake(context.ports.outputs.consumers());
        if context.ports.missed.is_some() {
            context.ports.catch_up()?;
        }
        if dies {
            crash::die();
        }
    }
    Ok(())
}

/// Returns the checkpoint period that a step at `tick` belongs to.
fn period_of(tick: u64) -> u64 {
    tick / CHECKPOINT_PERIOD
}

impl ServiceContext<'_> {
    /// Waits for the due sample of every input.
    #[inline]
    fn await_inputs(&mut self, tick: u64) -> Result<(), FlightError> {
        for at in 0..self.ports.inputs.len() {
            let input = &self.ports.inputs[at];
            let Some(due) = input.edge.published_by(tick) else {
                continue;
            };
            let publisher = input.publisher;
            self.waiter
                .wait(publisher, due, || self.ports.poll_input(at, tick, due))?;
        }
        Ok(())
    }

    #[inline]
    fn step_and_publish(
        &mut self,
        service: &mut dyn ErasedService,
        timetable: &Timetable,
        tick: u64,
    ) -> Result<(), FlightError> {
        let ServicePorts { inputs, outputs, .. } = &mut *self.ports;
        let mut views = Views::default();
        for input in inputs {
            if let Some(due) = input.edge.due_sample(tick) {
                let index = input.index;
                views[index] = input.view(tick, due);
            }
        }
        let mut slots = Slots::default();
        outputs.loan(tick, &mut slots)?;
        timetable.step(service, tick, &views, &mut slots)?;
        self.crash.pass(CrashPlace::AfterStep, tick);
        match outputs.send(tick, self.crash) {
            Err(PortError::Stopping) => return Err(FlightError::Stopping),
            result => result?,
        }
        self.crash.pass(CrashPlace::AfterPublishing, tick);
        service.try_saved_state().map_err(FlightError::IncompleteState)
    }

    /// Writes the checkpoint of the service before its step at `next_tick`.
    #[inline]
    fn write_checkpoint(&self, service: &dyn ErasedService, next_tick: u64) {
        self.checkpoints.write(service.id(), next_tick, |write| {
            service.save_with(write);
            self.crash.pass(CrashPlace::Checkpointing, next_tick);
        });
    }
}
