//! Real-time host of one service: steps follow the clock, and the newest sample wins.
//!
//! The schedule is that of lock step, with ticks on `CLOCK_MONOTONIC`. A step begins when its tick does, and for inputs
//! of the same tick as soon as they have arrived. The chain from the capture to the radio frame runs at the beginning of a
//! tick, each service woken by its predecessor. A service whose inputs are late steps with its latest samples, after a grace
//! time, or at once if the publisher is known to be dead. A service that wakes too late skips the steps whose time has
//! passed; the estimator skips only those at which no sample became due, so that it reads all frames and captures in order.
//! Without delays the flight therefore equals that in lock step, sample by sample. The records of the steps
//! ([`crate::step_log`]) contain every deviation, so that replays can execute the steps again.
//!
//! The simulated plant is an exception: it skips no step, because its time does not stand still, and catches up with late
//! steps. The real plant of a laboratory has no such steps.

use std::num::NonZeroU32;
use std::sync::Arc;
use std::sync::atomic::Ordering;

use rustix::thread::futex;
use shared_types::ExternalServices;
use shared_types::checkpoint::Checkpoint;
use shared_types::samples::PathReference;
use shared_types::service::{ErasedService, Operator};
use shared_types::{Now, Schedule, ServiceId, Topic};
use zerocopy::FromBytes;

use crate::announcement::{Published, announce, rings, withdraw};
use crate::checkpoints::Checkpoints;
use crate::crash::{self, CrashPlace, CrashPoint};
use crate::doorbell::Doorbell;
use crate::flight_clock::{FlightClock, deadline, monotonic_ns, nap_until};
use crate::flight_error::FlightError;
use crate::input_queue::InputQueue;
use crate::orchestrator_watchdog::OrchestratorWatchdog;
use crate::output_ports::OutputPorts;
use crate::ports::{PortError, RECORDER_BUFFER, Receiver, Topics, consumer_buffer};
use crate::shared_page::{Cell, SharedPage};
use crate::step_log::{StepLog, StepRecord, TUNING_SHIFT};
use crate::tuning::TuningReader;
use crate::untrusted::UntrustedReceiver;
use crate::wait::announcement;
use crate::watchdog::take_off;
use host::kept_samples;
use host::step::{self, Slots, Timetable, Views, next_step};
use host::watchdog::{self, Work};

/// Longest sleep between two checks for the end of the run, ns.
const LONGEST_SLEEP_NS: u64 = 100_000_000;

/// Ports of a service in real time.
pub struct RealTimePorts {
    queues: Vec<InputQueue>,
    outputs: OutputPorts,
}

impl RealTimePorts {
    /// Makes the ports that the wiring table gives a service. Refuses samples of `external_services` that are ahead of the
    /// clock of `page`.
    ///
    /// # Errors
    /// [`PortError`].
    pub fn open(
        topics: &Topics,
        id: ServiceId,
        schedule: &Schedule,
        external_services: ExternalServices,
        page: &Arc<SharedPage>,
    ) -> Result<Self, PortError> {
        let timetable = Timetable::new(schedule, id);
        let mut queues = Vec::new();
        for (index, spec) in schedule.inputs_read(id) {
            let topic = topics.ports(spec.topic);
            let mut receiver = if timetable.catches_up || timetable.reads_every_sample {
                let kept = kept_samples::capacity(schedule, &timetable, &schedule.edge(id, index));
                topic.recorder(
                    kept.max(consumer_buffer(schedule, spec.topic))
                        .min(RECORDER_BUFFER),
                )?
            } else {
                topic.receiver()?
            };
            let publisher = spec
                .topic
                .publisher()
                .expect("services consume what services publish");
            if external_services[publisher.index()] {
                receiver = Box::new(within_clock(receiver, schedule, spec.topic, page));
            }
            queues.push(InputQueue::new(schedule, id, index, publisher, receiver));
        }
        queues.sort_by_key(|queue| step::waiting_order(schedule, queue.edge(), queue.publisher));
        let outputs = OutputPorts::open(topics, id, schedule, |topic| topic.newest_sender())?;
        Ok(Self { queues, outputs })
    }

    /// Stores concatenated samples that were published before the ports existed, of the input with this index in the wiring
    /// table.
    pub fn take_missed(&mut self, index: usize, samples: &[u8]) {
        if let Some(queue) = self.queues.iter_mut().find(|queue| queue.index == index) {
            queue.take_missed(samples);
        }
    }

    /// Connects all ports to the existing ports of other services.
    ///
    /// # Errors
    /// [`PortError`].
    pub fn connect(&mut self) -> Result<(), PortError> {
        self.queues.iter_mut().try_for_each(InputQueue::connect)?;
        self.outputs.connect()
    }
}

/// Refuses samples of an external service that are ahead of the flight's clock.
fn within_clock(
    receiver: Box<dyn Receiver>,
    schedule: &Schedule,
    topic: Topic,
    page: &Arc<SharedPage>,
) -> UntrustedReceiver {
    let publication = schedule.publication(topic);
    let (page, tick_ns) = (Arc::clone(page), schedule.tick_ns());
    // Loaded at each call: the start of the flight is set after the ports are made.
    let clock_tick = move || {
        let start_ns = page.control_block().start_ns.load(Ordering::Acquire);
        FlightClock { start_ns, tick_ns }.tick()
    };
    UntrustedReceiver::new(receiver, &publication).within_clock(publication, schedule.last_tick(), clock_tick)
}

/// Context in which a service flies in real time.
pub struct ServiceContext<'a> {
    /// Ports of the service.
    pub ports: RealTimePorts,
    /// The run's control block.
    pub page: Arc<SharedPage>,
    /// Doorbells of all services, by which external services wake others and are woken: they have no access to the control
    /// block.
    pub doorbells: Arc<[Doorbell]>,
    /// Set of external services.
    pub external_services: ExternalServices,
    /// Checkpoints of the run.
    pub checkpoints: &'a Checkpoints,
    /// Step records of the run.
    pub step_log: &'a StepLog,
    /// The flight's clock.
    pub clock: FlightClock,
    /// Grace time: maximum wait of a step for inputs of its own tick, from the beginning of the tick, ns. At least half of
    /// the service's period, and at most the time until its next step.
    pub grace_ns: u64,
    /// Watchdog over the orchestrator.
    pub orchestrator_watchdog: OrchestratorWatchdog,
    /// Reader of the changes of gains.
    pub tuning: TuningReader,
    /// Planned crash.
    pub crash: CrashPoint,
}

/// Time from the start of the flight within which an incomplete saved state ends the flight at once, ns. Later the vehicle
/// may be airborne, and the flight fails at its end.
const TAKE_OFF_NS: u64 = 500_000_000;

/// Returns whether the outputs of a step report the vehicle as disarmed.
#[cold]
fn reports_disarmed(timetable: &Timetable, slots: &Slots<'_>) -> bool {
    let mut outputs = timetable.outputs.iter().zip(slots);
    let reference = outputs.find(|(output, _)| output.topic == Topic::PathReference);
    let bytes = reference.and_then(|(_, slot)| slot.bytes.as_deref());
    let reference = bytes.and_then(|bytes| PathReference::ref_from_bytes(bytes).ok());
    reference.is_some_and(|reference| reference.phase == PathReference::PHASE_DISARMED)
}

/// Flies a service from now to its last step. With a `checkpoint` it resumes from that state.
///
/// # Errors
/// [`FlightError`].
pub fn fly(
    service: &mut dyn ErasedService,
    schedule: &Schedule,
    checkpoint: Option<&Checkpoint>,
    context: &mut ServiceContext<'_>,
) -> Result<(), FlightError> {
    // The predecessor may have died during a publication.
    context.step_log.finish_abandoned(service.id());
    take_off();
    let timetable = Timetable::new(schedule, service.id());
    let mut previous = None;
    let mut first_tick = 0;
    if let Some(checkpoint) = checkpoint {
        first_tick = checkpoint.next_tick;
        if timetable.resume(service, checkpoint) {
            previous = first_tick.checked_sub(1);
        }
    }
    let mut incomplete_state = None;
    let mut next = timetable.steps.first_at_or_after(first_tick);
    while let Some(due) = next.filter(|&tick| tick <= schedule.last_tick()) {
        let (tick, missed) = context.step_to_do(&timetable, due, schedule.last_tick())?;
        debug_assert!(
            due <= tick && tick <= schedule.last_tick() && timetable.steps.occurs_at(tick),
            "a step of the schedule at or after the due one"
        );
        // Also a service that an input will wake wakes at the beginning of the tick: its memory is then in the caches, which
        // makes the step a fifth shorter.
        context.sleep_until(service.id(), context.clock.begins_at(tick))?;
        watchdog::work(Work::Step);
        let late_inputs = context.await_inputs(&timetable, tick)?;
        context.crash.pass(CrashPlace::BeforeStep, tick);
        let began = monotonic_ns();
        if context
            .orchestrator_watchdog
            .has_ended(context.page.control_block(), began)
        {
            return Err(FlightError::Stopping);
        }
        if timetable.is_cold_start_at(tick) {
            previous = None;
        }
        let begun = StepRecord {
            tick,
            began_ns: began.saturating_sub(context.clock.start_ns),
            missed,
            late_inputs,
            ..StepRecord::default()
        };
        context.step_and_publish(service, &timetable, previous, begun)?;
        if let Err(reason) = service.try_saved_state() {
            // Only a restart needs the saved state: an airborne vehicle continues its flight.
            if context.clock.begins_at(tick) < context.clock.begins_at(0) + TAKE_OFF_NS {
                return Err(FlightError::IncompleteState(reason));
            }
            incomplete_state.get_or_insert(reason);
        }
        previous = Some(tick);
        next = timetable.steps.first_at_or_after(tick + 1);
        debug_assert!(next.is_none_or(|next| next > tick), "ticks go forward");
        if timetable.dies_after(tick, next) {
            crash::die();
        }
    }
    incomplete_state.map_or(Ok(()), |reason| Err(FlightError::IncompleteState(reason)))
}

impl ServiceContext<'_> {
    /// Returns the next step to execute, at `due` or after it, and the number of steps skipped before it: see
    /// [`next_step`].
    fn step_to_do(
        &mut self,
        timetable: &Timetable,
        due: u64,
        last_tick: u64,
    ) -> Result<(u64, u64), FlightError> {
        let now = self.clock.tick().min(last_tick);
        if timetable.catches_up || now <= due {
            return Ok((due, 0));
        }
        let mut unseen = None;
        if timetable.reads_every_sample {
            for queue in &mut self.ports.queues {
                queue.collect()?;
                let oldest = queue.oldest_unseen_is_due();
                unseen = oldest.into_iter().chain(unseen).min();
            }
        }
        let tick = next_step(timetable, due, now, unseen);
        let missed = timetable.steps.count_before(tick) - timetable.steps.count_before(due);
        Ok((tick, missed))
    }

    fn cell(&self, service: ServiceId) -> &Cell {
        &self.page.control_block().cells[service.index()]
    }

    fn is_stopping(&self) -> bool {
        self.page.control_block().stopping.load(Ordering::Relaxed) != 0
    }

    /// Sleeps until a time.
    fn sleep_until(&self, service: ServiceId, at_ns: u64) -> Result<(), FlightError> {
        watchdog::idle();
        loop {
            if self.is_stopping() {
                return Err(FlightError::Stopping);
            }
            let now = monotonic_ns();
            if now >= at_ns {
                return Ok(());
            }
            if at_ns - now > LONGEST_SLEEP_NS {
                let rung = rings(&self.cell(service).bell);
                self.sleep_on_bell(service, rung, now + LONGEST_SLEEP_NS);
            } else {
                nap_until(at_ns);
            }
        }
    }

    /// Sleeps until the count of the bell differs from `rung`, or until a time.
    #[inline]
    fn sleep_on_bell(&self, service: ServiceId, rung: u32, until_ns: u64) {
        // After a ring, an interruption or a timeout alike the caller checks all its conditions again.
        let _ = futex::wait_bitset(
            &self.cell(service).bell,
            futex::Flags::empty(),
            rung,
            Some(&deadline(until_ns)),
            NonZeroU32::MAX,
        );
    }

    /// Waits for the inputs that are published at the tick of the step, up to the grace time. Returns a bit for each late
    /// input.
    #[inline]
    fn await_inputs(&mut self, timetable: &Timetable, tick: u64) -> Result<u64, FlightError> {
        let service = timetable.service;
        let half_a_period_ns = timetable.steps.rate.period * self.clock.tick_ns / 2;
        let next = timetable.steps.first_at_or_after(tick + 1);
        let give_up_at = (self.clock.begins_at(tick) + self.grace_ns.max(half_a_period_ns))
            .min(self.clock.begins_at(next.unwrap_or(u64::MAX)));
        let mut late = 0;
        for input in 0..self.ports.queues.len() {
            if !self.ports.queues[input].is_awaited(tick) {
                self.ports.queues[input].collect()?;
                continue;
            }
            if !self.await_input(service, input, tick, give_up_at)? {
                late |= 1 << self.ports.queues[input].index;
            }
        }
        Ok(late)
    }

    /// Waits for one input. Returns `false` if it is late.
    #[inline]
    fn await_input(
        &mut self,
        service: ServiceId,
        input: usize,
        tick: u64,
        give_up_at: u64,
    ) -> Result<bool, FlightError> {
        if self.ports.queues[input].has_arrived(tick)? {
            return Ok(true);
        }
        let publisher = self.ports.queues[input].publisher;
        let announced = announcement(publisher);
        announce(&self.cell(service).waiting_for, announced);
        let has_arrived = loop {
            // Before the check for the sample: loaded after it, the count could include the ring for a sample that the
            // check missed.
            let rung = rings(&self.cell(service).bell);
            if self.ports.queues[input].has_arrived(tick)? {
                break true;
            }
            if self.is_stopping() {
                return Err(FlightError::Stopping);
            }
            if monotonic_ns() >= give_up_at || self.may_skip_wait(publisher, input) {
                break false;
            }
            if self.external_services[publisher.index()] {
                let left = give_up_at.saturating_sub(monotonic_ns());
                self.doorbells[service.index()].sleep_with_timeout(left);
            } else {
                self.sleep_on_bell(service, rung, give_up_at);
            }
            Cell::count(&self.cell(service).blocks);
        };
        withdraw(&self.cell(service).waiting_for);
        Ok(has_arrived)
    }

    /// Returns whether an input's publisher is dead and the input has an older sample. A service that was just restarted
    /// has none, and waits.
    #[inline]
    fn may_skip_wait(&self, publisher: ServiceId, input: usize) -> bool {
        let is_gone = self.cell(publisher).gone.load(Ordering::Relaxed) != 0;
        is_gone && self.ports.queues[input].has_any()
    }

    #[inline]
    fn step_and_publish(
        &mut self,
        service: &mut dyn ErasedService,
        timetable: &Timetable,
        previous: Option<u64>,
        begun: StepRecord,
    ) -> Result<(), FlightError> {
        let tick = begun.tick;
        let mut record = begun;
        let planned = timetable.now_after(previous, tick);
        let now = Now {
            operator: self.operator(planned.operator),
            ..planned
        };
        if let Some(gains) = self.tuning.due(&self.page.control_block().tuning, tick) {
            service.tune(Some(&gains));
        }
        record.operator = u64::from(now.operator.to_bits()) | self.tuning.number() << TUNING_SHIFT;
        record.previous = previous.map_or(0, |previous| previous + 1);
        let RealTimePorts { queues, outputs } = &mut self.ports;
        let mut views = Views::default();
        for queue in queues {
            let index = queue.index;
            if let Some(delivery) = queue.deliver(tick) {
                record.consumed[index] = delivery.tick + 1;
                record.fresh_inputs |= u64::from(delivery.view.fresh) << index;
                views[index] = delivery.view;
            }
        }
        let mut slots = Slots::default();
        outputs.loan(tick, &mut slots)?;
        timetable.step_at(service, &now, &views, &mut slots)?;
        if self.orchestrator_watchdog.requires_landing() && reports_disarmed(timetable, &slots) {
            // The vehicle has landed, and no orchestrator exists to end the run.
            self.page.control_block().stopping.store(1, Ordering::Relaxed);
        }
        // Order of crash safety: record, publish, finish the record, checkpoint. A death then leaves no published sample
        // without a record of its inputs, and no state that includes an unrecorded step. Replays need both.
        self.crash.pass(CrashPlace::AfterStep, tick);
        self.step_log.begin(service.id(), record);
        outputs.send(tick, self.crash)?;
        self.crash.pass(CrashPlace::AfterPublishing, tick);
        let published_ns = self.clock.elapsed_ns();
        self.crash.pass(CrashPlace::BeforeWaking, tick);
        self.wake(service.id());
        self.step_log.finish(service.id(), published_ns);
        self.write_checkpoint(service, tick + 1);
        Ok(())
    }

    /// Returns the request of the operator, with a landing after the loss of the orchestrator.
    #[inline]
    fn operator(&self, planned: Operator) -> Operator {
        let requested = self.page.control_block().operator(planned);
        Operator {
            land: requested.land || self.orchestrator_watchdog.requires_landing(),
            ..requested
        }
    }

    /// Wakes those services that sleep for a publication of this one, and external services in any case.
    #[inline]
    fn wake(&self, service: ServiceId) {
        let published = Published::now();
        let mine = announcement(service);
        for &consumer in self.ports.outputs.consumers() {
            let cell = self.cell(consumer);
            if self.external_services[consumer.index()] {
                self.doorbells[consumer.index()].ring();
            } else if published.is_awaited(&cell.waiting_for, mine) {
                cell.ring();
            }
        }
    }

    /// Writes the checkpoint of the service before its step at `next_tick`. Call it after the step's record is finished:
    /// a death in between must not leave a step that the state includes and no record describes.
    #[inline]
    fn write_checkpoint(&self, service: &dyn ErasedService, next_tick: u64) {
        self.checkpoints.write(service.id(), next_tick, |write| {
            service.save_with(write);
            self.crash.pass(CrashPlace::Checkpointing, next_tick);
        });
        let cell = self.cell(service.id());
        cell.steps_until.store(next_tick, Ordering::Relaxed);
        Cell::count(&cell.steps);
    }
}
