//! All services in one thread: no shared memory, no waiting. The reference that the other hosts must equal.

use std::ops::{ControlFlow, Range};

use shared_types::finiteness::FinitenessCheck;
use shared_types::schedule::{Edge, MAX_PORTS, Publication};
use shared_types::service::{ErasedService, header_of};
use shared_types::{Schedule, ServiceId, Topic};

use crate::edge_store::EdgeStore;
use crate::sample_ring::SampleRing;
use crate::step::{self, NonFinite, Slots, Timetable, Views};

/// Sink of all published samples, in the order of the log: (tick, topic).
pub trait TickSink {
    /// Error of a sample that could not be taken.
    type Error;

    /// Returns whether samples of a topic are to be handed over; by default all are. It does not change in a flight.
    fn wants(&self, _topic: Topic) -> bool {
        true
    }

    /// Takes one sample.
    ///
    /// # Errors
    /// If it cannot be kept.
    fn sample(&mut self, topic: Topic, bytes: &[u8]) -> Result<(), Self::Error>;

    /// Ends a tick, whose samples have all been handed over; `Break` ends the flight here. By default it goes on.
    ///
    /// # Errors
    /// If the tick cannot be kept.
    fn end_tick(&mut self, _tick: u64) -> Result<ControlFlow<()>, Self::Error> {
        Ok(ControlFlow::Continue(()))
    }

    /// Records an event at a tick that no service publishes: its kind and text are those of a
    /// [`RunEvent`](shared_types::samples::RunEvent). Sinks that keep no events ignore it.
    fn event(&mut self, _tick: u64, _kind: u32, _text: &str) {}
}

/// Error that ended a flight in one process early.
#[derive(Debug)]
pub enum FlightError<E> {
    /// A service computed a number that is not finite.
    NonFinite(NonFinite),
    /// The sink could not take a sample.
    Sink(E),
}

/// A flight in one process.
pub struct InProcess {
    schedule: Schedule,
    /// In the order of a tick.
    services: Vec<ServiceSlot>,
    /// Of each output of each slot, in their order.
    histories: Vec<History>,
    /// Places of the histories, in the order of the log.
    published: Vec<usize>,
    /// `true` if any input has planned faults.
    has_stores: bool,
    next_tick: u64,
    /// The slot before which the flight has paused, within the next tick.
    paused: Option<usize>,
}

/// State of a flight between two steps of a service, from which it can go on any number of times.
#[derive(Clone)]
pub struct FlightState {
    services: Vec<Vec<u8>>,
    stores: Vec<[Option<EdgeStore>; MAX_PORTS]>,
    rings: Vec<SampleRing>,
    next_tick: u64,
    paused: Option<usize>,
}

/// Service with its steps and the sources of its inputs.
struct ServiceSlot {
    service: Box<dyn ErasedService>,
    /// The service's state before its first step.
    newborn: Vec<u8>,
    timetable: Timetable,
    /// Of each input, the place of its topic's history.
    sources: Vec<usize>,
    /// Places of the histories of its outputs.
    own: Range<usize>,
    /// Samples so far of each input with planned faults.
    stores: [Option<EdgeStore>; MAX_PORTS],
    has_stores: bool,
}

/// The latest samples of a topic, as many as any consumer may still need.
struct History {
    publication: Publication,
    samples: SampleRing,
}

impl History {
    fn new(topic: Topic, schedule: &Schedule) -> Self {
        let publication = schedule.publication(topic);
        let consumers = topic.consumers();
        let latest = consumers
            .map(|(service, input)| schedule.latency(service, input))
            .max();
        let depth = latest.unwrap_or(0) / publication.ticks.rate.period + 2;
        Self {
            samples: SampleRing::new(topic, depth),
            publication,
        }
    }

    #[inline]
    fn bytes(&self, tick: u64) -> &[u8] {
        self.samples.at(self.publication.ticks.count_before(tick))
    }

    #[inline]
    fn bytes_mut(&mut self, tick: u64) -> &mut [u8] {
        let place = self.publication.ticks.count_before(tick);
        self.samples.at_mut(place)
    }
}

impl InProcess {
    /// Prepares a flight of all services of the wiring table.
    ///
    /// # Panics
    /// If `services` are not exactly those of the wiring table.
    #[must_use]
    pub fn new(schedule: Schedule, mut services: Vec<Box<dyn ErasedService>>) -> Self {
        let order = schedule.order();
        services.sort_by_key(|service| order.iter().position(|&other| other == service.id()));
        let complete = services
            .iter()
            .map(|service| service.id())
            .eq(order.iter().copied());
        assert!(complete, "one of each service");
        let outputs = order.iter().flat_map(|service| service.outputs());
        let histories: Vec<_> = outputs
            .map(|output| History::new(output.topic, &schedule))
            .collect();
        let services: Vec<_> = services
            .into_iter()
            .map(|service| ServiceSlot::new(service, &schedule, &histories))
            .collect();
        let mut published: Vec<_> = (0..histories.len()).collect();
        published.sort_by_key(|&place| histories[place].publication.topic);
        Self {
            has_stores: services.iter().any(|slot| slot.has_stores),
            services,
            histories,
            published,
            schedule,
            next_tick: 0,
            paused: None,
        }
    }

    /// Returns the flown schedule.
    #[must_use]
    pub fn schedule(&self) -> &Schedule {
        &self.schedule
    }

    /// Returns a service, to inspect or to restore it.
    ///
    /// # Panics
    /// Never: there is one of each.
    pub fn service_mut(&mut self, service: ServiceId) -> &mut dyn ErasedService {
        let slot = self
            .services
            .iter_mut()
            .find(|slot| slot.timetable.service == service);
        slot.expect("one of each service").service.as_mut()
    }

    /// Replaces a service.
    pub fn replace(&mut self, service: Box<dyn ErasedService>) {
        for slot in &mut self.services {
            if slot.timetable.service == service.id() {
                slot.service = service;
                return;
            }
        }
    }

    /// Flies on to the last tick, or until the sink says `Break`.
    ///
    /// # Errors
    /// [`FlightError`]; the sink then has every tick before the failure whole.
    pub fn fly<S: TickSink>(&mut self, sink: &mut S) -> Result<(), FlightError<S::Error>> {
        let (wanted, count) = self.wanted(sink);
        let wanted = &wanted[..count];
        while self.next_tick <= self.schedule.last_tick() {
            let tick = self.next_tick;
            let from = self.paused.take().unwrap_or(0);
            self.step_services(tick, from, self.services.len());
            if self.end_tick(tick, wanted, sink)?.is_break() {
                break;
            }
        }
        Ok(())
    }

    /// Flies on to the next step of a service, which has all its inputs then; `false` if none is left, or if the sink says
    /// `Break`.
    ///
    /// # Errors
    /// [`FlightError`], as [`fly`](Self::fly).
    pub fn fly_to<S: TickSink>(
        &mut self,
        service: ServiceId,
        sink: &mut S,
    ) -> Result<bool, FlightError<S::Error>> {
        let (wanted, count) = self.wanted(sink);
        let wanted = &wanted[..count];
        let mut places = self.services.iter();
        let place = places
            .position(|slot| slot.timetable.service == service)
            .expect("one of each service");
        while self.next_tick <= self.schedule.last_tick() {
            let tick = self.next_tick;
            let from = self.paused.take();
            let is_due = self.services[place].timetable.steps.occurs_at(tick);
            if is_due && from.is_none_or(|from| from < place) {
                self.step_services(tick, from.unwrap_or(0), place);
                self.paused = Some(place);
                return Ok(true);
            }
            self.step_services(tick, from.unwrap_or(0), self.services.len());
            if self.end_tick(tick, wanted, sink)?.is_break() {
                break;
            }
        }
        Ok(false)
    }

    /// Returns the places of the histories that a sink wants, in the order of the log, and their number.
    fn wanted<S: TickSink>(&self, sink: &S) -> ([usize; Topic::ALL.len()], usize) {
        let mut wanted = [0; Topic::ALL.len()];
        let mut count = 0;
        for &place in &self.published {
            if sink.wants(self.histories[place].publication.topic) {
                wanted[count] = place;
                count += 1;
            }
        }
        (wanted, count)
    }

    /// Returns the newest sample of a topic, if one has been published.
    #[must_use]
    pub fn newest(&self, topic: Topic) -> Option<&[u8]> {
        let place = self
            .histories
            .iter()
            .position(|history| history.publication.topic == topic)?;
        let history = &self.histories[place];
        let mut slots = self.services.iter();
        let publisher = slots.position(|slot| slot.own.contains(&place))?;
        // Within a tick the services before the pause have published its samples.
        let has_stepped = self.paused.is_some_and(|paused| publisher < paused);
        let newest = if has_stepped {
            Some(self.next_tick)
        } else {
            self.next_tick.checked_sub(1)
        };
        let tick = history.publication.ticks.last_at_or_before(newest?)?;
        Some(history.bytes(tick))
    }

    /// Returns the tick that is flown next, or in which the flight has paused.
    #[must_use]
    pub fn next_tick(&self) -> u64 {
        self.next_tick
    }

    /// Returns the state of the flight.
    #[must_use]
    pub fn save(&self) -> FlightState {
        let state = |slot: &ServiceSlot| {
            let mut state = vec![0; slot.service.state_size()];
            slot.service.save(&mut state);
            state
        };
        FlightState {
            services: self.services.iter().map(state).collect(),
            stores: self.services.iter().map(|slot| slot.stores.clone()).collect(),
            rings: self
                .histories
                .iter()
                .map(|history| history.samples.clone())
                .collect(),
            next_tick: self.next_tick,
            paused: self.paused,
        }
    }

    /// Goes back, or forth, to a state of this flight.
    pub fn restore(&mut self, state: &FlightState) {
        for (slot, (own, stores)) in self
            .services
            .iter_mut()
            .zip(state.services.iter().zip(&state.stores))
        {
            slot.service.restore(own);
            slot.stores.clone_from(stores);
        }
        for (history, ring) in self.histories.iter_mut().zip(&state.rings) {
            history.samples.clone_from(ring);
        }
        (self.next_tick, self.paused) = (state.next_tick, state.paused);
    }

    /// Ends a tick that all services have stepped.
    #[inline]
    fn end_tick<S: TickSink>(
        &mut self,
        tick: u64,
        wanted: &[usize],
        sink: &mut S,
    ) -> Result<ControlFlow<()>, FlightError<S::Error>> {
        self.check(tick).map_err(FlightError::NonFinite)?;
        self.hand_over(wanted, tick, sink).map_err(FlightError::Sink)?;
        self.next_tick += 1;
        sink.end_tick(tick).map_err(FlightError::Sink)
    }

    /// Steps the services from one place to another.
    #[inline]
    fn step_services(&mut self, tick: u64, from: usize, to: usize) {
        for slot in &mut self.services[from..to] {
            if slot.timetable.steps.occurs_at(tick) {
                let (others, own) = Others::beside(&mut self.histories, &slot.own);
                slot.step(&others, own, tick);
            }
        }
    }

    /// Checks the samples of a tick, and keeps those of inputs with planned faults.
    #[inline]
    fn check(&mut self, tick: u64) -> Result<(), NonFinite> {
        self.examine(tick)?;
        if self.has_stores {
            self.keep_published(tick);
        }
        Ok(())
    }

    /// Checks all samples of a tick at once.
    #[inline]
    fn examine(&self, tick: u64) -> Result<(), NonFinite> {
        let mut check = FinitenessCheck::default();
        for history in &self.histories {
            if history.publication.is_due(tick) {
                check.take_in(history.bytes(tick));
            }
        }
        if check.is_surely_finite() {
            Ok(())
        } else {
            self.examine_each(tick)
        }
    }

    /// Finds the first service, in the order of steps, that made a number that is not finite: later ones may have
    /// stepped on it.
    #[cold]
    fn examine_each(&self, tick: u64) -> Result<(), NonFinite> {
        for slot in &self.services {
            for history in &self.histories[slot.own.clone()] {
                let publication = &history.publication;
                if publication.is_due(tick) {
                    let bytes = history.bytes(tick);
                    slot.timetable.examine(tick, publication.topic, bytes)?;
                }
            }
        }
        Ok(())
    }

    /// Keeps the samples of a tick for every input with planned faults.
    #[cold]
    fn keep_published(&mut self, tick: u64) {
        for slot in &mut self.services {
            if slot.has_stores {
                let (others, _) = Others::beside(&mut self.histories, &slot.own);
                slot.keep_published(&others, tick, |_| true);
            }
        }
    }

    #[inline]
    fn hand_over<S: TickSink>(&self, wanted: &[usize], tick: u64, sink: &mut S) -> Result<(), S::Error> {
        for &place in wanted {
            let history = &self.histories[place];
            if history.publication.is_due(tick) {
                let bytes = history.bytes(tick);
                debug_assert_eq!(header_of(bytes), history.publication.header(tick));
                sink.sample(history.publication.topic, bytes)?;
            }
        }
        Ok(())
    }
}

/// Histories of the other services' topics.
struct Others<'a> {
    before: &'a [History],
    after: &'a [History],
    /// Place of the first one after.
    first_after: usize,
}

impl<'a> Others<'a> {
    /// Splits the histories into those of one slot and the others.
    #[inline]
    fn beside(histories: &'a mut [History], own: &Range<usize>) -> (Self, &'a mut [History]) {
        let (rest, after) = histories.split_at_mut(own.end);
        let (before, of_slot) = rest.split_at_mut(own.start);
        let others = Self {
            before,
            after,
            first_after: own.end,
        };
        (others, of_slot)
    }

    #[inline]
    fn history(&self, place: usize) -> &'a History {
        match self.before.get(place) {
            Some(history) => history,
            None => &self.after[place - self.first_after],
        }
    }
}

impl ServiceSlot {
    /// The slot of a service whose outputs are among `histories`, as are its inputs.
    fn new(service: Box<dyn ErasedService>, schedule: &Schedule, histories: &[History]) -> Self {
        let timetable = Timetable::new(schedule, service.id());
        let mut newborn = vec![0; service.state_size()];
        service.save(&mut newborn);
        let place = |topic| {
            let mut topics = histories.iter().map(|history| history.publication.topic);
            let place = topics.position(|other| other == topic);
            place.expect("services consume what services publish")
        };
        let first_own = timetable.outputs.first().map_or(0, |output| place(output.topic));
        let mut stores: [Option<EdgeStore>; MAX_PORTS] = Default::default();
        for (store, edge) in stores.iter_mut().zip(&timetable.inputs) {
            *store = edge.has_faults().then(|| EdgeStore::new(edge.clone()));
        }
        Self {
            service,
            newborn,
            has_stores: stores.iter().any(Option::is_some),
            stores,
            sources: timetable.inputs.iter().map(|input| place(input.topic)).collect(),
            own: first_own..first_own + timetable.outputs.len(),
            timetable,
        }
    }

    /// Steps on the samples that the schedule says are due.
    #[inline]
    fn step(&mut self, others: &Others<'_>, own: &mut [History], tick: u64) {
        if self.timetable.begins_anew_at(tick) {
            self.service.restore(&self.newborn);
        }
        if self.has_stores {
            // What is published later in the tick is due later as well.
            self.keep_published(others, tick, |edge| edge.latency == 0);
        }
        let mut views = Views::default();
        let edges = self.timetable.inputs.iter().zip(&self.sources);
        for ((view, (input, &source)), store) in views.iter_mut().zip(edges).zip(&mut self.stores) {
            let Some(due) = input.due_sample(tick) else {
                continue;
            };
            if let Some(store) = store {
                store.forget_before(due);
                *view = store.view(tick, due);
            } else {
                let bytes = others.history(source).bytes(due);
                debug_assert_eq!(header_of(bytes).tick, due, "histories hold all that is still due");
                // Member by member: a view that is made elsewhere and copied costs a wait for its last byte.
                view.bytes = Some(bytes);
                view.fresh = input.is_fresh(tick, due);
            }
        }
        let mut slots = Slots::default();
        for (slot, history) in slots.iter_mut().zip(own.iter_mut()) {
            if history.publication.is_due(tick) {
                let header = history.publication.header(tick);
                *slot = step::prepared(history.publication.topic, header, history.bytes_mut(tick));
            }
        }
        let (inputs, outputs) = (&views[..self.sources.len()], &mut slots[..self.own.len()]);
        self.service.step(&self.timetable.now(tick), inputs, outputs);
    }

    /// Keeps what is published at `tick` over those of the edges with planned faults that are `wanted`.
    #[cold]
    fn keep_published(&mut self, others: &Others<'_>, tick: u64, wanted: impl Fn(&Edge) -> bool) {
        let edges = self.timetable.inputs.iter().zip(&self.sources);
        for ((edge, &source), store) in edges.zip(&mut self.stores) {
            let history = others.history(source);
            if let Some(store) = store
                && wanted(edge)
                && history.publication.is_due(tick)
            {
                store.keep(history.bytes(tick));
            }
        }
    }
}
