//! All services in one thread: no shared memory, no waiting. The reference that the other hosts must equal.

use std::ops::ControlFlow;

use shared_types::schedule::MAX_PORTS;
use shared_types::service::{ErasedService, InputView, OutputSlot};
use shared_types::{Schedule, ServiceId, Topic};
use zerocopy::IntoBytes;

use crate::step::{self, NonFinite, Slots, Views};

/// Receives everything that is published, in the order of the log: (tick, topic).
pub trait TickSink {
    /// Why a sample could not be taken.
    type Error;

    /// Takes one sample.
    ///
    /// # Errors
    /// If it cannot be kept.
    fn sample(&mut self, topic: Topic, bytes: &[u8]) -> Result<(), Self::Error>;

    /// All samples of `tick` have been handed over; `Break` ends the flight here.
    ///
    /// # Errors
    /// If the tick cannot be kept.
    fn end_tick(&mut self, tick: u64) -> Result<ControlFlow<()>, Self::Error>;
}

/// Why a flight in one process ended early.
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
    services: Vec<Box<dyn ErasedService>>,
    history: Vec<History>,
    next_tick: u64,
}

/// The latest samples of a topic, as many as any consumer may still need.
struct History {
    slots: Vec<Box<[u64]>>,
    size: usize,
}

impl History {
    fn new(topic: Topic, schedule: &Schedule) -> Self {
        let size = topic.kind().size;
        let latest = topic
            .consumers()
            .map(|(service, input)| schedule.latency(service, input))
            .max();
        let depth = latest.unwrap_or(0) / schedule.topic_rate(topic).period + 2;
        let words = size.div_ceil(size_of::<u64>());
        Self {
            slots: (0..depth).map(|_| vec![0; words].into_boxed_slice()).collect(),
            size,
        }
    }

    #[inline]
    fn slot_of(&self, seq: u64) -> usize {
        let depth = self.slots.len() as u64;
        // The ring of the ideal schedule is two deep.
        let index = if depth == 2 { seq & 1 } else { seq % depth };
        usize::try_from(index).expect("below the depth")
    }

    #[inline]
    fn bytes(&self, seq: u64) -> &[u8] {
        &self.slots[self.slot_of(seq)].as_bytes()[..self.size]
    }
}

impl InProcess {
    /// Prepares a flight of all services of the wiring table.
    ///
    /// # Panics
    /// If `services` are not exactly those of the wiring table.
    #[must_use]
    pub fn new(schedule: Schedule, services: Vec<Box<dyn ErasedService>>) -> Self {
        let mut by_place: Vec<Option<Box<dyn ErasedService>>> = ServiceId::ALL.iter().map(|_| None).collect();
        for service in services {
            let place = service.id().index();
            by_place[place] = Some(service);
        }
        let services = by_place
            .into_iter()
            .map(|service| service.expect("one of each service"))
            .collect();
        let history = Topic::ALL
            .into_iter()
            .map(|topic| History::new(topic, &schedule))
            .collect();
        Self {
            schedule,
            services,
            history,
            next_tick: 0,
        }
    }

    /// The schedule that is flown.
    #[must_use]
    pub fn schedule(&self) -> &Schedule {
        &self.schedule
    }

    /// A service, to look at or to restore.
    pub fn service_mut(&mut self, service: ServiceId) -> &mut dyn ErasedService {
        self.services[service.index()].as_mut()
    }

    /// Puts a service in the place of its predecessor.
    pub fn replace(&mut self, service: Box<dyn ErasedService>) {
        let place = service.id().index();
        self.services[place] = service;
    }

    /// Flies on to the last tick, or until the sink says `Break`.
    ///
    /// # Errors
    /// [`FlightError`]; the sink then has every tick before the failure whole.
    pub fn fly<S: TickSink>(&mut self, sink: &mut S) -> Result<(), FlightError<S::Error>> {
        while self.next_tick <= self.schedule.last_tick() {
            let tick = self.next_tick;
            self.step_services(tick).map_err(FlightError::NonFinite)?;
            self.hand_over(tick, sink).map_err(FlightError::Sink)?;
            self.next_tick += 1;
            if sink.end_tick(tick).map_err(FlightError::Sink)?.is_break() {
                break;
            }
        }
        Ok(())
    }

    #[inline]
    fn step_services(&mut self, tick: u64) -> Result<(), NonFinite> {
        for index in 0..self.services.len() {
            let id = self.schedule.order()[index];
            if self.schedule.service_rate(id).occurs_at(tick) {
                self.step_service(id, tick)?;
            }
        }
        Ok(())
    }

    #[inline]
    fn step_service(&mut self, id: ServiceId, tick: u64) -> Result<(), NonFinite> {
        let now = step::now(&self.schedule, id, tick);
        let mut places = self.take_places(id, tick);
        let result = {
            let mut slots = Slots::default();
            for ((slot, place), output) in slots.iter_mut().zip(&mut places).zip(id.outputs()) {
                if !place.is_empty() {
                    let size = self.history[output.topic.index()].size;
                    let bytes = &mut place.as_mut_bytes()[..size];
                    step::prepare(&self.schedule, output.topic, tick, bytes);
                    *slot = OutputSlot { bytes: Some(bytes) };
                }
            }
            let views = Self::views(&self.history, &self.schedule, id, tick);
            step::step(self.services[id.index()].as_mut(), &now, &views, &mut slots)
        };
        self.return_places(id, tick, places);
        result
    }

    /// The inputs of a service: the samples that the schedule says are due.
    #[inline]
    fn views<'a>(history: &'a [History], schedule: &Schedule, id: ServiceId, tick: u64) -> Views<'a> {
        let mut views = Views::default();
        for (index, (view, input)) in views.iter_mut().zip(id.inputs()).enumerate() {
            if let Some(due) = schedule.due_sample(id, index, tick) {
                let seq = schedule.topic_rate(input.topic).count_before(due);
                *view = InputView {
                    bytes: Some(history[input.topic.index()].bytes(seq)),
                    fresh: is_fresh(schedule, id, index, tick, due),
                };
            }
        }
        views
    }

    /// Takes the places of the due outputs out of the history; an output that is not due gets an empty one.
    #[inline]
    fn take_places(&mut self, id: ServiceId, tick: u64) -> [Box<[u64]>; MAX_PORTS] {
        let mut places: [Box<[u64]>; MAX_PORTS] = Default::default();
        for (place, output) in places.iter_mut().zip(id.outputs()) {
            let rate = self.schedule.topic_rate(output.topic);
            if rate.occurs_at(tick) {
                let history = &mut self.history[output.topic.index()];
                let slot = history.slot_of(rate.count_before(tick));
                *place = std::mem::take(&mut history.slots[slot]);
            }
        }
        places
    }

    #[inline]
    fn return_places(&mut self, id: ServiceId, tick: u64, places: [Box<[u64]>; MAX_PORTS]) {
        for (place, output) in places.into_iter().zip(id.outputs()) {
            if !place.is_empty() {
                let seq = self.schedule.topic_rate(output.topic).count_before(tick);
                let history = &mut self.history[output.topic.index()];
                let slot = history.slot_of(seq);
                history.slots[slot] = place;
            }
        }
    }

    #[inline]
    fn hand_over<S: TickSink>(&self, tick: u64, sink: &mut S) -> Result<(), S::Error> {
        for (topic, history) in Topic::ALL.into_iter().zip(&self.history) {
            let rate = self.schedule.topic_rate(topic);
            if topic.publisher().is_some() && rate.occurs_at(tick) {
                sink.sample(topic, history.bytes(rate.count_before(tick)))?;
            }
        }
        Ok(())
    }
}

/// Whether the sample `due` at `tick` was not yet due at the service's previous step.
#[must_use]
#[inline]
pub fn is_fresh(schedule: &Schedule, service: ServiceId, input: usize, tick: u64, due: u64) -> bool {
    let rate = schedule.service_rate(service);
    if tick < rate.phase + rate.period {
        return true;
    }
    schedule.due_sample(service, input, tick - rate.period) != Some(due)
}
