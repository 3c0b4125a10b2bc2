//! The real-time host of one service: the clock says when to step, and the newest sample wins.
//!
//! The schedule is that of lock-step, with ticks on `CLOCK_MONOTONIC`. A step begins when its tick does, and for inputs
//! that are published at the same tick, as soon as they have come: the chain from the capture to the radio frame runs
//! at the beginning of a tick, each service woken by the one before. Whoever waits in vain flies, after a grace, with
//! what it has, and at once where whom it waits for is known to be dead; whoever wakes too late leaves out the steps
//! whose time has passed. So a flight in which nothing is late is the flight of lock-step, sample by sample, and else
//! every deviation is in the records of the steps ([`crate::step_log`]), from which they can be done again.
//!
//! The simulated world is the exception: it leaves out no step, since its time does not stand still, and makes up for
//! those that it could not do in time. The real world of a laboratory needs nobody who does that for it.

use std::num::NonZeroU32;
use std::sync::Arc;
use std::sync::atomic::{Ordering, fence};

use rustix::thread::futex;
use shared_types::ExternalServices;
use shared_types::samples::PathReference;
use shared_types::service::{ErasedService, Operator};
use shared_types::{Now, Schedule, ServiceId, Topic};
use zerocopy::FromBytes;

use crate::checkpoints::{Checkpoint, Checkpoints};
use crate::crash::{self, CrashPlace, CrashPoint};
use crate::doorbell::Doorbell;
use crate::flight_clock::{FlightClock, deadline, monotonic_ns, nap_until};
use crate::flight_error::FlightError;
use crate::input_queue::InputQueue;
use crate::orchestrator_watchdog::OrchestratorWatchdog;
use crate::output_ports::OutputPorts;
use crate::ports::{PortError, Receiver, Topics};
use crate::shared_page::{Cell, SharedPage};
use crate::step_log::{StepLog, StepRecord};
use crate::untrusted::UntrustedReceiver;
use crate::wait::announcement;
use crate::watchdog::{self, Work};
use host::step::{self, Slots, Timetable, Views};

/// Longest sleep before somebody looks whether the run is to end, ns.
const LONGEST_SLEEP_NS: u64 = 100_000_000;

/// A service's ports in real time.
pub struct RealTimePorts {
    queues: Vec<InputQueue>,
    outputs: OutputPorts,
}

impl RealTimePorts {
    /// Makes the ports that the wiring table gives a service. What `external_services` publish is refused unless it may be there by
    /// the clock of `page`.
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
        let mut queues = Vec::new();
        for (index, spec) in schedule.inputs_read(id) {
            let mut receiver = topics.of(spec.topic).receiver()?;
            let publisher = spec
                .topic
                .publisher()
                .expect("services consume what services publish");
            if external_services[publisher.index()] {
                receiver = Box::new(within_clock(receiver, schedule, spec.topic, page));
            }
            queues.push(InputQueue::new(schedule, id, index, publisher, receiver));
        }
        queues.sort_by_key(|queue| step::waiting_order(schedule, &queue.edge, queue.publisher));
        let outputs = OutputPorts::open(topics, id, schedule, |topic| topic.newest_sender())?;
        Ok(Self { queues, outputs })
    }

    /// Connects all ports to those of the others that exist by now.
    ///
    /// # Errors
    /// [`PortError`].
    pub fn connect(&mut self) -> Result<(), PortError> {
        self.queues.iter_mut().try_for_each(InputQueue::connect)?;
        self.outputs.connect()
    }
}

/// What comes of an external program, as far as it may be there by the flight's clock.
fn within_clock(
    receiver: Box<dyn Receiver>,
    schedule: &Schedule,
    topic: Topic,
    page: &Arc<SharedPage>,
) -> UntrustedReceiver {
    let publication = schedule.publication(topic);
    let (page, tick_ns) = (Arc::clone(page), schedule.tick_ns());
    // When the flight begins is known only later than which ports there are.
    let clock_tick = move || {
        let start_ns = page.control_block().start_ns.load(Ordering::Acquire);
        FlightClock { start_ns, tick_ns }.tick()
    };
    UntrustedReceiver::new(receiver, &publication).within_clock(publication, schedule.last_tick(), clock_tick)
}

/// What a service flies with in real time beside its step logic.
pub struct ServiceContext<'a> {
    /// Its ports.
    pub ports: RealTimePorts,
    /// The words that the run shares.
    pub page: Arc<SharedPage>,
    /// The doorbells of all services, by which external services wake others and are woken: they know nothing of the words.
    pub doorbells: Arc<[Doorbell]>,
    /// Which services are external_services.
    pub external_services: ExternalServices,
    /// Where it keeps what it knows.
    pub checkpoints: &'a Checkpoints,
    /// Where it tells of its steps.
    pub step_log: &'a StepLog,
    /// The flight's clock.
    pub clock: FlightClock,
    /// How long a step waits beyond the begin of its tick for inputs of that tick, ns: half of the service's period if
    /// that is longer, and never longer than to its next.
    pub grace_ns: u64,
    /// What it does once the orchestrator is gone.
    pub orchestrator_watchdog: OrchestratorWatchdog,
    /// Where it shall die.
    pub crash: CrashPoint,
}

fn bits_of(operator: Operator) -> u64 {
    let Operator { armed, land, killed } = operator;
    u64::from(armed) | u64::from(land) << 1 | u64::from(killed) << 2
}

/// Whether what a service is about to publish says that the vehicle rests disarmed.
#[cold]
fn tells_of_rest(timetable: &Timetable, slots: &Slots<'_>) -> bool {
    let mut outputs = timetable.outputs.iter().zip(slots);
    let reference = outputs.find(|(output, _)| output.topic == Topic::PathReference);
    let bytes = reference.and_then(|(_, slot)| slot.bytes.as_deref());
    let reference = bytes.and_then(|bytes| PathReference::ref_from_bytes(bytes).ok());
    reference.is_some_and(|reference| reference.phase == PathReference::PHASE_DISARMED)
}

/// Flies a service from now to its last step; with `checkpoint` as it was after an earlier one.
///
/// # Errors
/// [`FlightError`].
pub fn fly(
    service: &mut dyn ErasedService,
    schedule: &Schedule,
    checkpoint: Option<&Checkpoint>,
    context: &mut ServiceContext<'_>,
) -> Result<(), FlightError> {
    // Whoever it follows may have died in the middle of publishing.
    context.step_log.finish_for_the_dead(service.id());
    watchdog::take_off();
    let timetable = Timetable::new(schedule, service.id());
    let mut previous = None;
    let mut first_tick = 0;
    if let Some(checkpoint) = checkpoint {
        first_tick = checkpoint.next_tick;
        if checkpoint.resume(service, &timetable) {
            previous = first_tick.checked_sub(1);
        }
    }
    let mut next = timetable.steps.first_at_or_after(first_tick);
    while let Some(due) = next.filter(|&tick| tick <= schedule.last_tick()) {
        let (tick, missed) = context.step_to_do(&timetable, due, schedule.last_tick());
        debug_assert!(
            due <= tick && tick <= schedule.last_tick() && timetable.steps.occurs_at(tick),
            "a step of the schedule, and none that is past"
        );
        // Also who is woken by an input wakes with the tick: with its memory in the caches again it is a fifth faster then.
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
        if timetable.begins_anew_at(tick) {
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
        previous = Some(tick);
        next = timetable.steps.first_at_or_after(tick + 1);
        debug_assert!(next.is_none_or(|next| next > tick), "ticks go forward");
        if timetable.dies_after(tick, next) {
            crash::die();
        }
    }
    Ok(())
}

impl ServiceContext<'_> {
    /// The step to do next, of those from `due` on: the newest whose time has come, or else the first to come; and how
    /// many are left out. None is left out that is the newest to publish something.
    fn step_to_do(&self, timetable: &Timetable, due: u64, last_tick: u64) -> (u64, u64) {
        if timetable.makes_up {
            return (due, 0);
        }
        let now = self.clock.tick().min(last_tick);
        let Some(newest) = timetable
            .steps
            .last_at_or_before(now)
            .filter(|&newest| newest > due)
        else {
            return (due, 0);
        };
        let publications = timetable.outputs.iter();
        let to_be_published = publications
            .filter_map(|output| output.ticks.last_at_or_before(now))
            .filter(|&tick| tick >= due);
        let tick = to_be_published.min().unwrap_or(newest);
        let missed = timetable.steps.count_before(tick) - timetable.steps.count_before(due);
        (tick, missed)
    }

    fn cell(&self, service: ServiceId) -> &Cell {
        &self.page.control_block().cells[service.index()]
    }

    fn is_stopping(&self) -> bool {
        self.page.control_block().stopping.load(Ordering::Relaxed) != 0
    }

    /// Sleeps until a time has come.
    fn sleep_until(&self, service: ServiceId, at_ns: u64) -> Result<(), FlightError> {
        watchdog::rest();
        loop {
            if self.is_stopping() {
                return Err(FlightError::Stopping);
            }
            let now = monotonic_ns();
            if now >= at_ns {
                return Ok(());
            }
            if at_ns - now > LONGEST_SLEEP_NS {
                let rung = self.cell(service).bell.load(Ordering::SeqCst);
                self.doze(service, rung, now + LONGEST_SLEEP_NS);
            } else {
                nap_until(at_ns);
            }
        }
    }

    /// Sleeps until the bell has been rung more often than `rung` times, or a time has come.
    #[inline]
    fn doze(&self, service: ServiceId, rung: u32, until_ns: u64) {
        // Rung meanwhile, interrupted or timed out: in any case everything is looked at again.
        let _ = futex::wait_bitset(
            &self.cell(service).bell,
            futex::Flags::empty(),
            rung,
            Some(&deadline(until_ns)),
            NonZeroU32::MAX,
        );
    }

    /// Waits for the inputs that are published at the tick of the step, up to the grace; which of them are late.
    #[inline]
    fn await_inputs(&mut self, timetable: &Timetable, tick: u64) -> Result<u64, FlightError> {
        let service = timetable.service;
        let half_a_period_ns = timetable.steps.rate.period * self.clock.tick_ns / 2;
        let next = timetable.steps.first_at_or_after(tick + 1);
        let give_up_at = (self.clock.begins_at(tick) + self.grace_ns.max(half_a_period_ns))
            .min(self.clock.begins_at(next.unwrap_or(u64::MAX)));
        let mut late = 0;
        for place in 0..self.ports.queues.len() {
            if !self.ports.queues[place].is_awaited(tick) {
                self.ports.queues[place].collect()?;
                continue;
            }
            if !self.await_input(service, place, tick, give_up_at)? {
                late |= 1 << self.ports.queues[place].index;
            }
        }
        Ok(late)
    }

    /// Waits for one input; `false` if it is late.
    #[inline]
    fn await_input(
        &mut self,
        service: ServiceId,
        place: usize,
        tick: u64,
        give_up_at: u64,
    ) -> Result<bool, FlightError> {
        if self.ports.queues[place].has_come(tick)? {
            return Ok(true);
        }
        let publisher = self.ports.queues[place].publisher;
        let announced = announcement(publisher);
        self.cell(service).waiting_for.store(announced, Ordering::Relaxed);
        let has_come = loop {
            let rung = self.cell(service).bell.load(Ordering::SeqCst);
            // Announcement before, the look after: pairs with the fence in `wake`.
            fence(Ordering::SeqCst);
            if self.ports.queues[place].has_come(tick)? {
                break true;
            }
            if self.is_stopping() {
                return Err(FlightError::Stopping);
            }
            if monotonic_ns() >= give_up_at || self.need_not_wait_for(publisher, place) {
                break false;
            }
            if self.external_services[publisher.index()] {
                let left = give_up_at.saturating_sub(monotonic_ns());
                self.doorbells[service.index()].sleep_up_to(left);
            } else {
                self.doze(service, rung, give_up_at);
            }
            Cell::count(&self.cell(service).blocks);
        };
        self.cell(service).waiting_for.store(0, Ordering::Relaxed);
        Ok(has_come)
    }

    /// Whether an input's publisher is dead and something of it has come that one can fly on. Whoever has only just been
    /// born has nothing, and waits.
    #[inline]
    fn need_not_wait_for(&self, publisher: ServiceId, place: usize) -> bool {
        let is_gone = self.cell(publisher).gone.load(Ordering::Relaxed) != 0;
        is_gone && self.ports.queues[place].has_any()
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
        record.operator = bits_of(now.operator);
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
        if self.orchestrator_watchdog.is_to_land() && tells_of_rest(timetable, &slots) {
            // The vehicle is down, and nobody is there to end the run.
            self.page.control_block().stopping.store(1, Ordering::Relaxed);
        }
        self.crash.pass(CrashPlace::AfterStep, tick);
        self.step_log.begin(service.id(), record);
        outputs.send(tick, self.crash)?;
        self.crash.pass(CrashPlace::AfterPublishing, tick);
        let published_ns = self.clock.elapsed_ns();
        self.crash.pass(CrashPlace::BeforeWaking, tick);
        self.wake(service.id());
        self.step_log.finish(service.id(), published_ns);
        self.keep(service, tick + 1);
        Ok(())
    }

    /// What the operator asks for, or whoever takes the place of people once the orchestrator is gone.
    #[inline]
    fn operator(&self, planned: Operator) -> Operator {
        let asked = self.page.control_block().operator(planned);
        Operator {
            land: asked.land || self.orchestrator_watchdog.is_to_land(),
            ..asked
        }
    }

    /// Wakes those services that sleep for a publication of this one, and external services in any case.
    #[inline]
    fn wake(&self, service: ServiceId) {
        // Publications before, announcements after: pairs with the fence in `await_input`.
        fence(Ordering::SeqCst);
        let mine = announcement(service);
        for &consumer in self.ports.outputs.consumers() {
            let cell = self.cell(consumer);
            if self.external_services[consumer.index()] {
                self.doorbells[consumer.index()].ring();
            } else if cell.waiting_for.load(Ordering::Relaxed) == mine {
                cell.ring();
            }
        }
    }

    /// Keeps what the service knows before its step at `next_tick`: after the step was told, so that none is ever known
    /// and untold.
    #[inline]
    fn keep(&self, service: &dyn ErasedService, next_tick: u64) {
        self.checkpoints.write(service.id(), next_tick, |keep| {
            service.save_with(keep);
            self.crash.pass(CrashPlace::Checkpointing, next_tick);
        });
        let cell = self.cell(service.id());
        cell.steps_until.store(next_tick, Ordering::Relaxed);
        Cell::count(&cell.steps);
    }
}
