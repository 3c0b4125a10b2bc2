//! All services in one thread: no shared memory, no waiting. The reference that the other hosts must equal.

mod history;
mod service_slot;

use std::ops::{ControlFlow, Range};

use shared_types::finiteness::FinitenessCheck;
use shared_types::service::{ErasedService, header_of};
use shared_types::{Schedule, ServiceId, Topic};

use crate::edge_store::EdgeStore;
use crate::sample_ring::SampleRing;
use crate::step::{NonFinite, put_in_order};
use history::History;
use service_slot::{ServiceSlot, state_of};

/// Ticks of a batch, whose samples fit into the first-level cache.
const BATCH: u64 = 8;

/// Sink of all published samples, in the order of the log: (tick, topic).
pub trait TickSink {
    /// Error of a sample that could not be stored.
    type Error;

    /// Returns whether the sink receives the samples of a topic, by default of all. Constant during a flight.
    fn wants(&self, _topic: Topic) -> bool {
        true
    }

    /// Receives one sample.
    ///
    /// # Errors
    /// If it cannot be stored.
    fn sample(&mut self, topic: Topic, bytes: &[u8]) -> Result<(), Self::Error>;

    /// Ends a tick after its last sample; `Break` ends the flight. By default the flight continues.
    ///
    /// # Errors
    /// If the tick cannot be stored.
    fn end_tick(&mut self, _tick: u64) -> Result<ControlFlow<()>, Self::Error> {
        Ok(ControlFlow::Continue(()))
    }

    /// Records an event at a tick that no service publishes: its kind and text are those of a
    /// [`RunEvent`](shared_types::samples::RunEvent). By default it is ignored.
    fn event(&mut self, _tick: u64, _kind: u32, _text: &str) {}
}

/// Error that ended a flight in one process early.
#[derive(Debug)]
pub enum FlightError<E> {
    /// A service computed a number that is not finite.
    NonFinite(NonFinite),
    /// The sink could not store a sample.
    Sink(E),
}

/// A flight in one process.
pub struct InProcess {
    schedule: Schedule,
    /// Services in the order of their steps in a tick.
    services: Vec<ServiceSlot>,
    /// Samples of each output of each service, in this order.
    histories: Vec<History>,
    /// Indices of the histories, in the order of the log.
    published: Vec<usize>,
    /// `true` if any input has planned faults.
    has_stores: bool,
    /// `true` if every service steps, and every output is published, at every tick.
    is_steady: bool,
    /// Number of ticks between two hand-overs to the sink.
    batch: u64,
    next_tick: u64,
    /// Index of the service before which the flight is paused, within the next tick.
    paused: Option<usize>,
}

/// State of a flight between two steps, from which it can be continued any number of times.
#[derive(Clone)]
pub struct FlightState {
    services: Vec<Vec<u8>>,
    /// Stored samples of the inputs of each service.
    stores: Vec<Vec<Option<Box<EdgeStore>>>>,
    rings: Vec<SampleRing>,
    next_tick: u64,
    paused: Option<usize>,
}

impl InProcess {
    /// Prepares a flight of all services of the wiring table.
    ///
    /// # Panics
    /// If `services` are not exactly those of the wiring table.
    #[must_use]
    pub fn new(schedule: Schedule, mut services: Vec<Box<dyn ErasedService>>) -> Self {
        put_in_order(&mut services, &schedule);
        let order = schedule.order();
        let outputs = order.iter().flat_map(|&service| schedule.outputs(service));
        let histories: Vec<_> = outputs
            .map(|output| History::new(output.topic, &schedule, 1))
            .collect();
        let services: Vec<_> = services
            .into_iter()
            .map(|service| ServiceSlot::new(service, &schedule, &histories))
            .collect();
        let mut published: Vec<_> = (0..histories.len()).collect();
        published.sort_by_key(|&index| histories[index].publication.topic);
        Self {
            has_stores: services.iter().any(|slot| slot.has_stores),
            is_steady: services.iter().all(ServiceSlot::is_steady)
                && histories
                    .iter()
                    .all(|history| history.publication.ticks.is_always()),
            services,
            histories,
            published,
            schedule,
            batch: 1,
            next_tick: 0,
            paused: None,
        }
    }

    /// Hands over several ticks at a time. This is faster: the code of a tick exceeds the instruction cache, and the sink's
    /// code is then fetched once a batch.
    ///
    /// After a `Break` of the sink the flight cannot continue, because the services have stepped beyond that tick. If a
    /// service panics or hangs, the last ticks before that are lost.
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

    /// Returns the schedule of the flight.
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

    /// Replaces a service before the flight. A planned cold start restores its present state.
    pub fn replace(&mut self, service: Box<dyn ErasedService>) {
        for slot in &mut self.services {
            if slot.timetable.service == service.id() {
                slot.replace(service);
                return;
            }
        }
    }

    /// Flies to the last tick, or until the sink returns `Break`.
    ///
    /// # Errors
    /// [`FlightError`]; the sink then has received every tick before the failure completely.
    pub fn fly<S: TickSink>(&mut self, sink: &mut S) -> Result<(), FlightError<S::Error>> {
        let (wanted, count) = self.wanted(sink);
        let wanted = &wanted[..count];
        while self.next_tick <= self.schedule.last_tick() {
            let from = self.paused.take();
            let begin = self.next_tick;
            let end = (begin + self.batch).min(self.schedule.last_tick() + 1);
            if self.fly_ticks(from, begin..end, wanted, sink)?.is_break() {
                break;
            }
        }
        Ok(())
    }

    /// Flies to the next step of a service, and pauses before it, when all its inputs are published. Returns `false` if no
    /// step is left, or if the sink returns `Break`.
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
        let mut slots = self.services.iter();
        let index = slots
            .position(|slot| slot.timetable.service == service)
            .expect("one of each service");
        while self.next_tick <= self.schedule.last_tick() {
            let tick = self.next_tick;
            let from = self.paused.take();
            let is_due = self.services[index].timetable.steps.occurs_at(tick);
            if is_due && from.is_none_or(|from| from < index) {
                self.step_services(tick, from.unwrap_or(0)..index)
                    .map_err(FlightError::NonFinite)?;
                self.paused = Some(index);
                return Ok(true);
            }
            if self.fly_ticks(from, tick..tick + 1, wanted, sink)?.is_break() {
                break;
            }
        }
        Ok(false)
    }

    /// Returns the indices of the histories that a sink receives, in the order of the log, and their number.
    fn wanted<S: TickSink>(&self, sink: &S) -> ([usize; Topic::ALL.len()], usize) {
        let mut wanted = [0; Topic::ALL.len()];
        let mut count = 0;
        for &index in &self.published {
            if sink.wants(self.histories[index].publication.topic) {
                wanted[count] = index;
                count += 1;
            }
        }
        (wanted, count)
    }

    /// Returns the newest sample of a topic, if one has been published.
    #[must_use]
    pub fn newest(&self, topic: Topic) -> Option<&[u8]> {
        let index = self
            .histories
            .iter()
            .position(|history| history.publication.topic == topic)?;
        let history = &self.histories[index];
        let mut slots = self.services.iter();
        let publisher = slots.position(|slot| slot.own.contains(&index))?;
        // In a pause the services before the paused one have published the samples of the tick.
        let has_stepped = self.paused.is_some_and(|paused| publisher < paused);
        let newest = if has_stepped {
            Some(self.next_tick)
        } else {
            self.next_tick.checked_sub(1)
        };
        let tick = history.publication.ticks.last_at_or_before(newest?)?;
        Some(history.bytes(tick))
    }

    /// Returns the next tick, or the one in which the flight is paused.
    #[must_use]
    pub fn next_tick(&self) -> u64 {
        self.next_tick
    }

    /// Returns the state of the flight.
    #[must_use]
    pub fn save(&self) -> FlightState {
        let state = |slot: &ServiceSlot| state_of(slot.service.as_ref());
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

    /// Restores a state of this flight.
    pub fn restore(&mut self, state: &FlightState) {
        for (slot, (own, stores)) in self
            .services
            .iter_mut()
            .zip(state.services.iter().zip(&state.stores))
        {
            slot.service.restore(own);
            slot.restore_stores(stores);
        }
        for (history, ring) in self.histories.iter_mut().zip(&state.rings) {
            history.samples.clone_from(ring);
        }
        (self.next_tick, self.paused) = (state.next_tick, state.paused);
    }

    /// Flies some ticks, the first one from the service at an index on, and hands over the complete ones.
    #[inline]
    fn fly_ticks<S: TickSink>(
        &mut self,
        from: Option<usize>,
        ticks: Range<u64>,
        wanted: &[usize],
        sink: &mut S,
    ) -> Result<ControlFlow<()>, FlightError<S::Error>> {
        let (whole, found) = self.step_ticks(from, ticks);
        if self.hand_over(whole, wanted, sink)?.is_break() {
            return Ok(ControlFlow::Break(()));
        }
        found.map_err(FlightError::NonFinite)?;
        Ok(ControlFlow::Continue(()))
    }

    /// Steps the services at some ticks, at the first one from the service at an index on. Returns the complete ticks, and
    /// the failure that ended them.
    #[inline]
    fn step_ticks(
        &mut self,
        mut from: Option<usize>,
        ticks: Range<u64>,
    ) -> (Range<u64>, Result<(), NonFinite>) {
        for tick in ticks.clone() {
            let from = from.take().unwrap_or(0);
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

    /// Finds the first service, in the order of steps, that computed a number that is not finite: later ones may have used
    /// that number.
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

    /// Stores the samples of a tick for every input with planned faults.
    #[cold]
    fn keep_published(&mut self, tick: u64) {
        for slot in &mut self.services {
            if slot.has_stores {
                slot.keep_published(&self.histories, tick, |_| true);
            }
        }
    }

    /// Hands over complete ticks.
    #[inline]
    fn hand_over<S: TickSink>(
        &mut self,
        ticks: Range<u64>,
        wanted: &[usize],
        sink: &mut S,
    ) -> Result<ControlFlow<()>, FlightError<S::Error>> {
        for tick in ticks {
            for &index in wanted {
                let history = &self.histories[index];
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
