//! All services in one thread: no shared memory, no waiting. The reference that the other hosts must equal.

use std::ops::{ControlFlow, Range};

use shared_types::finiteness::FinitenessCheck;
use shared_types::schedule::{Edge, OutageSchedule, Publication};
use shared_types::service::{ErasedService, InputView, header_of};
use shared_types::{Schedule, ServiceId, Topic};

use crate::edge_store::EdgeStore;
use crate::owned_sample::OwnedSample;
use crate::sample_ring::SampleRing;
use crate::step::{self, NonFinite, Slots, Timetable, Views};

/// Ticks of a batch. Their samples stay in the nearest cache of the processor.
const BATCH: u64 = 8;

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
    /// `true` if every service steps at every tick and gets what the others then publish.
    is_steady: bool,
    /// Number of ticks that are flown before they are handed over.
    batch: u64,
    next_tick: u64,
    /// The slot before which the flight has paused, within the next tick.
    paused: Option<usize>,
}

/// State of a flight between two steps of a service, from which it can go on any number of times.
#[derive(Clone)]
pub struct FlightState {
    services: Vec<Vec<u8>>,
    /// Of the feeds of each service.
    stores: Vec<Vec<Option<Box<EdgeStore>>>>,
    rings: Vec<SampleRing>,
    next_tick: u64,
    paused: Option<usize>,
}

/// Service with its steps, inputs and outputs.
struct ServiceSlot {
    service: Box<dyn ErasedService>,
    /// The service's state before its first step.
    newborn: Vec<u8>,
    timetable: Timetable,
    /// Its inputs, in the order of the wiring table.
    feeds: Vec<Feed>,
    /// `true` if any of them has planned faults.
    has_stores: bool,
    /// Places of the histories of its outputs.
    own: Range<usize>,
    /// Its outputs while they are written, in the order of the wiring table.
    drafts: Vec<OwnedSample>,
}

/// Source of an input.
struct Feed {
    edge: Edge,
    /// Place of the topic's history.
    source: usize,
    /// Samples so far, if faults of the input are planned.
    store: Option<Box<EdgeStore>>,
}

/// The latest samples of a topic, as many as any consumer may still need.
struct History {
    publication: Publication,
    samples: SampleRing,
}

impl History {
    fn new(topic: Topic, schedule: &Schedule, batch: u64) -> Self {
        let publication = schedule.publication(topic);
        let consumers = topic.consumers();
        let latest = consumers
            .map(|(service, input)| schedule.latency(service, input))
            .max();
        let period = publication.ticks.rate.period;
        let depth = (latest.unwrap_or(0) / period + 2).max(batch.div_ceil(period));
        Self {
            samples: SampleRing::new(topic, depth),
            publication,
        }
    }

    /// Returns whether a sample is published at a tick; of a `STEADY` flight, whether there are any.
    #[inline]
    fn is_due<const STEADY: bool>(&self, tick: u64) -> bool {
        let ticks = &self.publication.ticks;
        if STEADY {
            ticks.is_always()
        } else {
            ticks.occurs_at(tick)
        }
    }

    #[inline]
    fn bytes(&self, tick: u64) -> &[u8] {
        self.bytes_of::<false>(tick)
    }

    #[inline]
    fn bytes_of<const STEADY: bool>(&self, tick: u64) -> &[u8] {
        self.samples.at(self.place_of::<STEADY>(tick))
    }

    /// Takes the sample of a tick; `draft` becomes one that is not needed any more.
    #[inline]
    fn publish<const STEADY: bool>(&mut self, tick: u64, draft: &mut OwnedSample) {
        self.samples.swap(self.place_of::<STEADY>(tick), draft);
    }

    #[inline]
    fn place_of<const STEADY: bool>(&self, tick: u64) -> u64 {
        if STEADY {
            tick
        } else {
            self.publication.ticks.count_before(tick)
        }
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
            .map(|output| History::new(output.topic, &schedule, 1))
            .collect();
        let services: Vec<_> = services
            .into_iter()
            .map(|service| ServiceSlot::new(service, &schedule, &histories))
            .collect();
        let mut published: Vec<_> = (0..histories.len()).collect();
        published.sort_by_key(|&place| histories[place].publication.topic);
        Self {
            has_stores: services.iter().any(|slot| slot.has_stores),
            is_steady: services.iter().all(|slot| slot.is_steady(&histories)),
            services,
            histories,
            published,
            schedule,
            batch: 1,
            next_tick: 0,
            paused: None,
        }
    }

    /// Lets the flight be handed over several ticks at a time. That is quicker: a tick runs through more code than the
    /// processor keeps at hand, and that of the sink is then fetched once for all of them.
    ///
    /// It is for flights that end where the sink says `Break`, because the services have stepped on by then; and for
    /// services that neither panic nor wait for ever, or the last ticks before it would be lost.
    ///
    /// # Panics
    /// After the first step.
    #[must_use]
    pub fn in_batches(mut self) -> Self {
        assert!(self.next_tick == 0 && self.paused.is_none(), "it has not begun");
        self.batch = BATCH;
        for history in &mut self.histories {
            *history = History::new(history.publication.topic, &self.schedule, BATCH);
        }
        self
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
            let begin = self.next_tick;
            let end = (begin + self.batch).min(self.schedule.last_tick() + 1);
            let (ticks, found) = self.step_ticks(begin..end);
            if self.hand_over(ticks, wanted, sink)?.is_break() {
                break;
            }
            found.map_err(FlightError::NonFinite)?;
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
                self.step_services(tick, from.unwrap_or(0)..place)
                    .map_err(FlightError::NonFinite)?;
                self.paused = Some(place);
                return Ok(true);
            }
            self.paused = from;
            let (ticks, found) = self.step_ticks(tick..tick + 1);
            found.map_err(FlightError::NonFinite)?;
            if self.hand_over(ticks, wanted, sink)?.is_break() {
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
            stores: self.services.iter().map(ServiceSlot::stores).collect(),
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
            for (feed, store) in slot.feeds.iter_mut().zip(stores) {
                feed.store.clone_from(store);
            }
        }
        for (history, ring) in self.histories.iter_mut().zip(&state.rings) {
            history.samples.clone_from(ring);
        }
        (self.next_tick, self.paused) = (state.next_tick, state.paused);
    }

    /// Steps all services, from where the flight has paused, at some ticks. Returns the ticks that are whole, and what ended
    /// them.
    #[inline]
    fn step_ticks(&mut self, ticks: Range<u64>) -> (Range<u64>, Result<(), NonFinite>) {
        for tick in ticks.clone() {
            let from = self.paused.take().unwrap_or(0);
            if let Err(found) = self.step_services(tick, from..self.services.len()) {
                return (ticks.start..tick, Err(found));
            }
            if self.has_stores {
                self.keep_published(tick);
            }
        }
        (ticks, Ok(()))
    }

    /// Steps some of the services, and checks all that they publish at once.
    #[inline]
    fn step_services(&mut self, tick: u64, which: Range<usize>) -> Result<(), NonFinite> {
        let mut check = FinitenessCheck::default();
        if self.is_steady {
            for slot in &mut self.services[which] {
                slot.step::<true>(&mut self.histories, tick, &mut check);
            }
        } else {
            for slot in &mut self.services[which] {
                slot.step::<false>(&mut self.histories, tick, &mut check);
            }
        }
        if check.is_surely_finite() {
            Ok(())
        } else {
            self.examine(tick)
        }
    }

    /// Finds the first service, in the order of steps, that made a number that is not finite: later ones may have
    /// stepped on it.
    #[cold]
    fn examine(&self, tick: u64) -> Result<(), NonFinite> {
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
                slot.keep_published(&self.histories, tick, |_| true);
            }
        }
    }

    /// Hands over ticks that are whole.
    #[inline]
    fn hand_over<S: TickSink>(
        &mut self,
        ticks: Range<u64>,
        wanted: &[usize],
        sink: &mut S,
    ) -> Result<ControlFlow<()>, FlightError<S::Error>> {
        for tick in ticks {
            for &place in wanted {
                let history = &self.histories[place];
                if history.publication.is_due(tick) {
                    let bytes = history.bytes(tick);
                    debug_assert_eq!(header_of(bytes), history.publication.header(tick));
                    let taken = sink.sample(history.publication.topic, bytes);
                    taken.map_err(FlightError::Sink)?;
                }
            }
            self.next_tick = tick + 1;
            if sink.end_tick(tick).map_err(FlightError::Sink)?.is_break() {
                return Ok(ControlFlow::Break(()));
            }
        }
        Ok(ControlFlow::Continue(()))
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
        let feeds = timetable.inputs.iter().map(|edge| Feed {
            source: place(edge.topic),
            store: edge.has_faults().then(|| Box::new(EdgeStore::new(edge.clone()))),
            edge: edge.clone(),
        });
        let outputs = timetable.outputs.iter();
        Self {
            service,
            newborn,
            feeds: feeds.collect(),
            has_stores: timetable.inputs.iter().any(Edge::has_faults),
            own: first_own..first_own + timetable.outputs.len(),
            drafts: outputs.map(|output| OwnedSample::of(output.topic)).collect(),
            timetable,
        }
    }

    /// Returns whether the service steps at every tick, gets something new from all its sources then, and publishes at
    /// every tick what it publishes at all.
    fn is_steady(&self, histories: &[History]) -> bool {
        fn ticks(history: &History) -> &OutageSchedule {
            &history.publication.ticks
        }
        let mut sources = self.feeds.iter().map(|feed| &histories[feed.source]);
        let mut own = histories[self.own.clone()].iter();
        self.timetable.steps.is_always()
            && !self.has_stores
            && sources.all(|source| ticks(source).is_always())
            && own.all(|own| ticks(own).is_always() || ticks(own).is_never())
    }

    /// Steps, if a step is due, on the samples that the schedule says are due, and publishes what it makes. In a
    /// `STEADY` flight all of it is, which need not be asked.
    #[inline]
    fn step<const STEADY: bool>(
        &mut self,
        histories: &mut [History],
        tick: u64,
        check: &mut FinitenessCheck,
    ) {
        if !STEADY {
            if !self.timetable.steps.occurs_at(tick) {
                return;
            }
            self.prepare(histories, tick);
        }
        let mut views = Views::default();
        let inputs = self.feeds.len();
        for (view, feed) in views.iter_mut().zip(&mut self.feeds) {
            feed.look::<STEADY>(histories, tick, view);
        }
        let mut slots = Slots::default();
        let drafts = slots.iter_mut().zip(&mut self.drafts);
        for ((slot, draft), history) in drafts.zip(&histories[self.own.clone()]) {
            if history.is_due::<STEADY>(tick) {
                let publication = &history.publication;
                *slot = step::prepared(publication.topic, publication.header(tick), draft.bytes_mut());
            }
        }
        let (inputs, outputs) = (&views[..inputs], &mut slots[..self.own.len()]);
        self.service.step(&self.timetable.now(tick), inputs, outputs);
        for (draft, history) in self.drafts.iter_mut().zip(&mut histories[self.own.clone()]) {
            if history.is_due::<STEADY>(tick) {
                check.take_in(draft.bytes());
                history.publish::<STEADY>(tick, draft);
            }
        }
    }

    /// Loses the service's state where that is planned, and keeps the samples of inputs with planned faults.
    fn prepare(&mut self, histories: &[History], tick: u64) {
        if self.timetable.begins_anew_at(tick) {
            self.service.restore(&self.newborn);
        }
        if self.has_stores {
            // What is published later in the tick is due later as well.
            self.keep_published(histories, tick, |edge| edge.latency == 0);
        }
    }

    /// Keeps what is published at `tick` over those of the edges with planned faults that are `wanted`.
    #[cold]
    fn keep_published(&mut self, histories: &[History], tick: u64, wanted: impl Fn(&Edge) -> bool) {
        for feed in &mut self.feeds {
            let history = &histories[feed.source];
            if let Some(store) = &mut feed.store
                && wanted(&feed.edge)
                && history.publication.is_due(tick)
            {
                store.keep(history.bytes(tick));
            }
        }
    }

    fn stores(&self) -> Vec<Option<Box<EdgeStore>>> {
        self.feeds.iter().map(|feed| feed.store.clone()).collect()
    }
}

impl Feed {
    /// Puts the sample that is due at `tick` into a view, if there is one.
    #[inline]
    fn look<'a, const STEADY: bool>(
        &'a mut self,
        histories: &'a [History],
        tick: u64,
        view: &mut InputView<'a>,
    ) {
        let due = if STEADY {
            tick.checked_sub(self.edge.latency)
        } else {
            self.edge.due_sample(tick)
        };
        let Some(due) = due else {
            return;
        };
        match &mut self.store {
            Some(store) if !STEADY => {
                store.forget_before(due);
                *view = store.view(tick, due);
            }
            _ => {
                let bytes = histories[self.source].bytes_of::<STEADY>(due);
                debug_assert_eq!(header_of(bytes).tick, due, "histories hold all that is still due");
                // Member by member: a view that is made elsewhere and copied costs a wait for its last byte.
                view.bytes = Some(bytes);
                view.fresh = STEADY || self.edge.is_fresh(tick, due);
            }
        }
    }
}
