//! All services in one thread as in real time: they step by the clock with their newest samples, and may be absent.
//!
//! Time is counted in ticks, and the steps of a tick take none of it. A step begins at its tick, and for inputs of the same
//! tick when they have arrived, or when its grace time is over. A service that returns late skips the steps whose time has
//! passed, except those that real time does not skip either ([`next_step`]). The samples of all topics equal those of
//! [`InProcess`](crate::in_process::InProcess) while every service is present.
//!
//! The plant is the vehicle, whose time does not stop: it steps at every tick under the newest frame, however old. Its
//! absence is that of the cameras' driver, which holds this role in a laboratory: the captures of this time are lost.
//!
//! Planned outages of the schedule leave out steps, as in `InProcess`; they end no process.

use std::ops::Range;

use shared_types::finiteness::FinitenessCheck;
use shared_types::schedule::{MAX_PORTS, Publication};
use shared_types::service::{ErasedService, Operator};
use shared_types::wiring::Published;
use shared_types::{Now, Schedule, ServiceId, Topic};

use crate::kept_samples::{self, KeptSamples};
use crate::owned_sample::OwnedSample;
use crate::step::{self, NonFinite, Slots, Timetable, Views, next_step};

/// All services of a flight in one thread, as in real time.
pub struct NewestWins {
    schedule: Schedule,
    /// Services in the order of their steps in a tick.
    services: Vec<Slot>,
    /// Inputs of all services, those of each one together.
    inputs: Vec<Input>,
    next_tick: u64,
}

/// State of a flight between two ticks, from which it can be continued any number of times.
#[derive(Clone)]
pub struct RealTimeState {
    services: Vec<(Vec<u8>, Progress, Vec<Output>)>,
    inputs: Vec<KeptSamples>,
    next_tick: u64,
}

/// Whether a service steps, and what its consumers know about that.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Presence {
    /// It steps when its steps are due.
    Present,
    /// Its process hangs, or its death was not noticed yet: its consumers wait for its samples up to their grace time.
    Absent,
    /// Its process is known to be dead: its consumers do not wait for it if they have a sample of it.
    Gone,
}

/// State with which another process of a service begins.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Start {
    /// The newest checkpoint; the initial state before the first step.
    FromCheckpoint,
    /// The initial state.
    Cold,
}

/// A step of a service.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct DoneStep {
    /// Its tick.
    pub tick: u64,
    /// Tick of the last step that its state included.
    pub previous: Option<u64>,
    /// Tick of the sample of each input, in the order of the wiring table.
    pub consumed: [Option<u64>; MAX_PORTS],
    /// Bit for each input: its sample was new.
    pub fresh_inputs: u64,
    /// Number of steps that were skipped before it.
    pub missed: u64,
}

/// A service with its outputs.
struct Slot {
    service: Box<dyn ErasedService>,
    /// State before the first step.
    initial_state: Vec<u8>,
    timetable: Timetable,
    /// Inputs in the list of all inputs.
    inputs: Range<usize>,
    /// Grace time, whole ticks.
    grace: u64,
    progress: Progress,
    outputs: Vec<Output>,
}

/// State of a service's process.
#[derive(Clone)]
struct Progress {
    presence: Presence,
    /// Next step of the schedule, or later ones instead; `None` after the last.
    due: Option<u64>,
    /// Step that the process waits for or is about to execute. It is chosen after the step before.
    pending: Option<u64>,
    last: Option<DoneStep>,
    /// Number of outputs that the next step sends; the process ends in it then.
    dies_after_sending: Option<usize>,
    /// `true` if the newest checkpoint is `before_lost`, from before the last step.
    has_lost_step: bool,
    /// State and samples seen before the step in which the process ended.
    before_lost: Vec<u8>,
    seen_before_lost: [Option<u64>; MAX_PORTS],
    /// Tick of the last step that the newest checkpoint includes; of the vehicle that of its last step.
    previous: Option<u64>,
    /// Number of steps that the next step skips.
    missed: u64,
    steps_until: u64,
}

/// An input that steps read.
struct Input {
    kept: KeptSamples,
    /// Index in the wiring table.
    index: usize,
    publisher: ServiceId,
}

/// An output.
#[derive(Clone)]
struct Output {
    publication: Publication,
    /// Consumers in the list of all inputs.
    consumers: Vec<usize>,
    /// Sample of the current step.
    draft: OwnedSample,
    newest: OwnedSample,
    /// Tick of the newest sample.
    published: Option<u64>,
}

/// What a service can do at a tick.
enum Readiness {
    /// It has executed all steps that it can.
    Done,
    /// It waits for inputs, and the grace time of this step is over.
    GraceOver(u64),
}

impl NewestWins {
    /// Prepares a flight of all services of the wiring table. A step waits for the inputs of its own tick for
    /// `grace_ns`, or half of its service's period if that is longer.
    ///
    /// # Panics
    /// If `services` are not exactly those of the wiring table.
    #[must_use]
    pub fn new(schedule: Schedule, grace_ns: u64, mut services: Vec<Box<dyn ErasedService>>) -> Self {
        step::put_in_order(&mut services, &schedule);
        let (mut inputs, mut slots) = (Vec::new(), Vec::new());
        for service in services {
            let first = inputs.len();
            inputs.extend(inputs_of(&schedule, service.id()));
            slots.push(Slot::new(service, &schedule, first..inputs.len(), grace_ns));
        }
        for output in slots.iter_mut().flat_map(|slot| &mut slot.outputs) {
            let reads = |&at: &usize| inputs[at].kept.edge().topic == output.publication.topic;
            output.consumers = (0..inputs.len()).filter(reads).collect();
        }
        Self {
            schedule,
            services: slots,
            inputs,
            next_tick: 0,
        }
    }

    /// Returns the schedule of the flight.
    #[must_use]
    pub fn schedule(&self) -> &Schedule {
        &self.schedule
    }

    /// Returns the next tick.
    #[must_use]
    pub fn next_tick(&self) -> u64 {
        self.next_tick
    }

    /// Returns the planned requests of the operator at the next tick.
    #[must_use]
    pub fn planned_operator(&self) -> Operator {
        self.schedule.operator().at(self.next_tick)
    }

    /// Flies the next tick: the present services execute their due steps, in the order of the schedule. All of them read
    /// these requests of the operator, of which the planned ones are a part.
    ///
    /// # Errors
    /// [`NonFinite`] if a service computed a number that is not finite. The flight cannot continue after that.
    pub fn step(&mut self, operator: Operator) -> Result<(), NonFinite> {
        let now = self.next_tick.min(self.schedule.last_tick());
        loop {
            let mut expired = [None; ServiceId::ALL.len()];
            for (at, expired) in expired.iter_mut().enumerate() {
                if let Readiness::GraceOver(tick) = self.advance(at, now, operator)? {
                    *expired = Some(tick);
                }
            }
            if expired.iter().all(Option::is_none) {
                break;
            }
            // The grace times of a chain of services end together: each service gives up before its publisher, which has
            // given up at the same time, has computed its sample. So consumers step first.
            for (at, tick) in expired.into_iter().enumerate().rev() {
                if let Some(tick) = tick {
                    self.execute(at, tick, now, operator)?;
                }
            }
        }
        self.next_tick += 1;
        Ok(())
    }

    /// Sets whether a service steps, from the next tick on. A hung process that continues first executes the step before
    /// which it hung. A process that has died is replaced by [`restart`](Self::restart) instead. The vehicle flies on while
    /// the plant is absent; only its captures are lost.
    pub fn set_presence(&mut self, service: ServiceId, presence: Presence) {
        let at = self.index_of(service);
        let slot = &mut self.services[at];
        slot.progress.presence = presence;
        if presence == Presence::Present && slot.progress.pending.is_none() {
            // The process was started in the last tick.
            let now = self.next_tick.saturating_sub(1);
            slot.choose(&self.inputs, now, self.schedule.last_tick());
        }
    }

    /// Returns whether a service steps.
    #[must_use]
    pub fn presence(&self, service: ServiceId) -> Presence {
        self.slot(service).progress.presence
    }

    /// Lets the process of a service die in its next step, after this number of outputs was sent, in the order of the
    /// wiring table, and before its checkpoint was written. The service is [`Presence::Absent`] from then on.
    ///
    /// The vehicle has no checkpoint: of the plant only the outputs are not sent.
    pub fn die_in_next_step(&mut self, service: ServiceId, sent: usize) {
        self.slot_mut(service).progress.dies_after_sending = Some(sent);
    }

    /// Gives a service another process, which begins to step now: [`open_ports`](Self::open_ports) and
    /// [`Presence::Present`].
    pub fn restart(&mut self, service: ServiceId, start: Start) {
        self.open_ports(service, start);
        self.set_presence(service, Presence::Present);
    }

    /// Gives a service another process, which does not step yet. Its ports are new: it receives what is published from now
    /// on, and if it reads every sample also those that its state does not include. With [`Presence::Present`] it begins
    /// to step: now is late in the last tick, whose step it executes first.
    pub fn open_ports(&mut self, service: ServiceId, start: Start) {
        let at = self.index_of(service);
        let slot = &mut self.services[at];
        slot.progress.dies_after_sending = None;
        if slot.is_vehicle() {
            return;
        }
        let progress = &mut slot.progress;
        let has_lost_step = std::mem::take(&mut progress.has_lost_step);
        match start {
            Start::FromCheckpoint if has_lost_step => slot.service.restore(&progress.before_lost),
            Start::FromCheckpoint => {}
            Start::Cold => {
                slot.service.restore(&slot.initial_state);
                progress.previous = None;
            }
        }
        let next = progress.previous.map_or(0, |previous| previous + 1);
        progress.steps_until = next;
        progress.due = slot.timetable.steps.first_at_or_after(next);
        progress.pending = None;
        for input in &mut self.inputs[slot.inputs.clone()] {
            let seen = match start {
                Start::FromCheckpoint if has_lost_step => progress.seen_before_lost[input.index],
                Start::FromCheckpoint => input.kept.seen(),
                Start::Cold => None,
            };
            let first = slot.timetable.first_needed(input.kept.edge(), next, seen);
            input.kept.restart(first);
        }
    }

    /// Returns 1 + the tick of the last step that the service's newest checkpoint includes; 0 before the first. The plant
    /// has steps only while it is present.
    #[must_use]
    pub fn steps_until(&self, service: ServiceId) -> u64 {
        self.slot(service).progress.steps_until
    }

    /// Returns the last step of a service, also if the process died in it.
    #[must_use]
    pub fn last_step(&self, service: ServiceId) -> Option<&DoneStep> {
        self.slot(service).progress.last.as_ref()
    }

    /// Returns the newest sample of a topic that was published, if there is one. The truth is always that of the last
    /// tick.
    #[must_use]
    pub fn newest(&self, topic: Topic) -> Option<&[u8]> {
        let publisher = topic.publisher()?;
        let mut outputs = self.slot(publisher).outputs.iter();
        let output = outputs.find(|output| output.publication.topic == topic)?;
        output.published.map(|_| output.newest.bytes())
    }

    /// Returns the newest sample of type `T` that was published, if there is one: see [`newest`](Self::newest).
    #[must_use]
    pub fn newest_sample<T: Published>(&self) -> Option<&T> {
        T::ref_from_bytes(self.newest(T::TOPIC)?).ok()
    }

    /// Returns a service, to inspect it or to change its gains.
    pub fn service_mut(&mut self, service: ServiceId) -> &mut dyn ErasedService {
        self.slot_mut(service).service.as_mut()
    }

    /// Returns the state of the flight.
    #[must_use]
    pub fn save(&self) -> RealTimeState {
        let services = self.services.iter().map(|slot| {
            let state = state_of(slot.service.as_ref());
            (state, slot.progress.clone(), slot.outputs.clone())
        });
        RealTimeState {
            services: services.collect(),
            inputs: self.inputs.iter().map(|input| input.kept.clone()).collect(),
            next_tick: self.next_tick,
        }
    }

    /// Restores a state of this flight.
    pub fn restore(&mut self, state: &RealTimeState) {
        for (slot, (own, progress, outputs)) in self.services.iter_mut().zip(&state.services) {
            slot.service.restore(own);
            slot.progress.clone_from(progress);
            slot.outputs.clone_from(outputs);
        }
        for (input, kept) in self.inputs.iter_mut().zip(&state.inputs) {
            input.kept.clone_from(kept);
        }
        self.next_tick = state.next_tick;
    }

    fn index_of(&self, service: ServiceId) -> usize {
        let mut slots = self.services.iter();
        slots
            .position(|slot| slot.timetable.service == service)
            .expect("one of each service")
    }

    fn slot(&self, service: ServiceId) -> &Slot {
        &self.services[self.index_of(service)]
    }

    fn slot_mut(&mut self, service: ServiceId) -> &mut Slot {
        let at = self.index_of(service);
        &mut self.services[at]
    }

    /// Executes all steps of a service that are due and whose inputs have arrived.
    #[inline]
    fn advance(&mut self, at: usize, now: u64, operator: Operator) -> Result<Readiness, NonFinite> {
        loop {
            let slot = &mut self.services[at];
            if slot.progress.presence != Presence::Present && !slot.is_vehicle() {
                return Ok(Readiness::Done);
            }
            if slot.progress.pending.is_none() {
                slot.choose(&self.inputs, now, self.schedule.last_tick());
            }
            let Some(tick) = slot.progress.pending.filter(|&tick| tick <= now) else {
                return Ok(Readiness::Done);
            };
            if !self.has_inputs(at, tick) {
                return Ok(match self.services[at].gives_up_at(tick) <= now {
                    true => Readiness::GraceOver(tick),
                    false => Readiness::Done,
                });
            }
            self.execute(at, tick, now, operator)?;
        }
    }

    /// Returns whether a step need not wait for any input.
    #[inline]
    fn has_inputs(&self, at: usize, tick: u64) -> bool {
        self.inputs[self.services[at].inputs.clone()].iter().all(|input| {
            let newest = input.kept.newest();
            !input.kept.is_awaited(tick)
                || newest >= Some(tick)
                || newest.is_some() && self.presence(input.publisher) == Presence::Gone
        })
    }

    /// Executes a step on the newest samples, publishes its outputs, and chooses the next step.
    #[inline]
    fn execute(&mut self, at: usize, tick: u64, now: u64, operator: Operator) -> Result<(), NonFinite> {
        let slot = &mut self.services[at];
        let sent = slot.begin(&self.inputs, tick);
        let mut done = DoneStep {
            tick,
            previous: slot.progress.previous,
            missed: slot.progress.missed,
            ..DoneStep::default()
        };
        let mut views = Views::default();
        for input in &mut self.inputs[slot.inputs.clone()] {
            if let Some(delivery) = input.kept.deliver(tick) {
                done.consumed[input.index] = Some(delivery.tick);
                done.fresh_inputs |= u64::from(delivery.view.fresh) << input.index;
                views[input.index].bytes = delivery.view.bytes;
                views[input.index].fresh = delivery.view.fresh;
            }
        }
        slot.step(tick, operator, &views)?;
        let publishes = slot.progress.presence == Presence::Present;
        for (index, output) in slot.outputs.iter_mut().enumerate() {
            if !output.publication.is_due(tick) {
                continue;
            }
            // The truth shows the vehicle also while no process publishes it.
            let is_sent = publishes && index < sent || output.publication.topic == Topic::VehicleTruth;
            if !is_sent || output.published >= Some(tick) {
                continue;
            }
            std::mem::swap(&mut output.draft, &mut output.newest);
            output.published = Some(tick);
            for &consumer in &output.consumers {
                self.inputs[consumer].kept.keep(output.newest.bytes());
            }
        }
        slot.finish(done, sent < usize::MAX);
        slot.choose(&self.inputs, now, self.schedule.last_tick());
        Ok(())
    }
}

impl Slot {
    fn new(
        service: Box<dyn ErasedService>,
        schedule: &Schedule,
        inputs: Range<usize>,
        grace_ns: u64,
    ) -> Self {
        let timetable = Timetable::new(schedule, service.id());
        let initial_state = state_of(service.as_ref());
        let outputs = timetable.outputs.iter().map(|publication| Output {
            draft: OwnedSample::zeroed(publication.topic),
            newest: OwnedSample::zeroed(publication.topic),
            published: None,
            consumers: Vec::new(),
            publication: publication.clone(),
        });
        let half_a_period_ns = schedule.time_ns(timetable.steps.rate.period) / 2;
        Self {
            grace: grace_ns.max(half_a_period_ns) / schedule.tick_ns(),
            inputs,
            outputs: outputs.collect(),
            progress: Progress {
                presence: Presence::Present,
                due: timetable.steps.first_at_or_after(0),
                pending: None,
                last: None,
                dies_after_sending: None,
                has_lost_step: false,
                before_lost: initial_state.clone(),
                seen_before_lost: [None; MAX_PORTS],
                previous: None,
                missed: 0,
                steps_until: 0,
            },
            initial_state,
            timetable,
            service,
        }
    }

    /// Returns whether the service is the vehicle, whose time does not stop.
    #[inline]
    fn is_vehicle(&self) -> bool {
        self.timetable.service.is_the_world()
    }

    /// Chooses the next step as in real time: the due one, or a later one if the service is late.
    #[inline]
    fn choose(&mut self, inputs: &[Input], now: u64, last_tick: u64) {
        let progress = &mut self.progress;
        progress.missed = 0;
        progress.pending = progress.due.filter(|&due| due <= last_tick);
        let Some(due) = progress.pending else { return };
        if now <= due || self.timetable.service.is_the_world() {
            return;
        }
        let mut unseen = None;
        if self.timetable.reads_every_sample {
            for input in &inputs[self.inputs.clone()] {
                let oldest = input.kept.oldest_unseen_is_due();
                unseen = oldest.into_iter().chain(unseen).min();
            }
        }
        let tick = next_step(&self.timetable, due, now, unseen);
        let steps = &self.timetable.steps;
        progress.missed = steps.count_before(tick) - steps.count_before(due);
        progress.pending = Some(tick);
    }

    /// Returns the tick at which a step no longer waits for its inputs.
    fn gives_up_at(&self, tick: u64) -> u64 {
        let next = self.timetable.steps.first_at_or_after(tick + 1);
        (tick + self.grace).min(next.unwrap_or(u64::MAX))
    }

    /// Prepares a step. Returns the number of outputs that it sends, [`usize::MAX`] if the process does not end in it.
    #[inline]
    fn begin(&mut self, inputs: &[Input], tick: u64) -> usize {
        if self.timetable.is_cold_start_at(tick) {
            self.service.restore(&self.initial_state);
            self.progress.previous = None;
        }
        let Some(sent) = self.progress.dies_after_sending.take() else {
            return usize::MAX;
        };
        self.service.save(&mut self.progress.before_lost);
        for input in &inputs[self.inputs.clone()] {
            self.progress.seen_before_lost[input.index] = input.kept.seen();
        }
        sent
    }

    /// Executes a step into the drafts of its outputs.
    #[inline]
    fn step(&mut self, tick: u64, operator: Operator, views: &Views<'_>) -> Result<(), NonFinite> {
        let planned = self.timetable.now_after(self.progress.previous, tick);
        let now = Now { operator, ..planned };
        let mut slots = Slots::default();
        for (slot, output) in slots.iter_mut().zip(&mut self.outputs) {
            let publication = &output.publication;
            if publication.is_due(tick) {
                *slot = step::prepared(
                    publication.topic,
                    publication.header(tick),
                    output.draft.bytes_mut(),
                );
            }
        }
        let inputs = self.timetable.service.inputs().len();
        let outputs = self.timetable.outputs.len();
        self.service.step(&now, &views[..inputs], &mut slots[..outputs]);
        let mut check = FinitenessCheck::default();
        for output in &self.outputs {
            if output.publication.is_due(tick) {
                check.take_in(output.draft.bytes());
            }
        }
        if check.is_surely_finite() {
            return Ok(());
        }
        for output in &self.outputs {
            if output.publication.is_due(tick) {
                let topic = output.publication.topic;
                self.timetable.examine(tick, topic, output.draft.bytes())?;
            }
        }
        Ok(())
    }

    /// Ends a step, and the process if it `dies`.
    #[inline]
    fn finish(&mut self, done: DoneStep, dies: bool) {
        let is_vehicle = self.is_vehicle();
        let progress = &mut self.progress;
        progress.due = self.timetable.steps.first_at_or_after(done.tick + 1);
        progress.last = Some(done);
        if dies {
            progress.presence = Presence::Absent;
            progress.has_lost_step = !is_vehicle;
        } else if progress.presence == Presence::Present {
            progress.steps_until = done.tick + 1;
        }
        if is_vehicle || !dies {
            progress.previous = Some(done.tick);
        }
    }
}

/// Makes the inputs that a service reads.
fn inputs_of(schedule: &Schedule, service: ServiceId) -> impl Iterator<Item = Input> {
    let mut timetable = Timetable::new(schedule, service);
    // The plant is never late here.
    timetable.catches_up = false;
    schedule.inputs_read(service).map(move |(index, spec)| {
        let edge = schedule.edge(service, index);
        let capacity = kept_samples::capacity(schedule, &timetable, &edge);
        Input {
            kept: KeptSamples::new(edge, capacity),
            index,
            publisher: spec
                .topic
                .publisher()
                .expect("services consume what services publish"),
        }
    })
}

fn state_of(service: &dyn ErasedService) -> Vec<u8> {
    let mut state = vec![0; service.state_size()];
    service.save(&mut state);
    state
}
