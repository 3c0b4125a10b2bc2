//! All services in one thread: no shared memory, no waiting. The reference that the other hosts must equal.

use std::ops::ControlFlow;

use shared_types::schedule::{MAX_PORTS, Rate};
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
    /// In the order of a tick.
    stations: Vec<Station>,
    /// By topic.
    history: Vec<History>,
    /// What services publish, in the order of the log.
    published: Vec<(Topic, Rate)>,
    next_tick: u64,
}

/// A service and what the schedule says of it, so that a step looks nothing up.
struct Station {
    service: Box<dyn ErasedService>,
    id: ServiceId,
    rate: Rate,
    /// Topic and rate of each input.
    inputs: Vec<(Topic, Rate)>,
    /// Topic and rate of each output.
    outputs: Vec<(Topic, Rate)>,
}

impl Station {
    fn new(service: Box<dyn ErasedService>, schedule: &Schedule) -> Self {
        let id = service.id();
        let with_rate = |topic: Topic| (topic, schedule.topic_rate(topic));
        Self {
            service,
            id,
            rate: schedule.service_rate(id),
            inputs: id.inputs().iter().map(|input| with_rate(input.topic)).collect(),
            outputs: id
                .outputs()
                .iter()
                .map(|output| with_rate(output.topic))
                .collect(),
        }
    }
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
    fn slot_mut(&mut self, seq: u64) -> &mut Box<[u64]> {
        let slot = self.slot_of(seq);
        &mut self.slots[slot]
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
        let mut services: Vec<_> = services
            .into_iter()
            .map(|service| Station::new(service, &schedule))
            .collect();
        let place = |id: ServiceId| schedule.order().iter().position(|&other| other == id);
        services.sort_by_key(|station| place(station.id));
        let complete = services
            .iter()
            .map(|station| station.id)
            .eq(schedule.order().iter().copied());
        assert!(complete, "one of each service");
        let topics = Topic::ALL.into_iter();
        let published = topics.clone().filter(|topic| topic.publisher().is_some());
        Self {
            stations: services,
            history: topics.map(|topic| History::new(topic, &schedule)).collect(),
            published: published
                .map(|topic| (topic, schedule.topic_rate(topic)))
                .collect(),
            schedule,
            next_tick: 0,
        }
    }

    /// The schedule that is flown.
    #[must_use]
    pub fn schedule(&self) -> &Schedule {
        &self.schedule
    }

    /// A service, to look at or to restore.
    ///
    /// # Panics
    /// Never: there is one of each.
    pub fn service_mut(&mut self, service: ServiceId) -> &mut dyn ErasedService {
        let station = self.stations.iter_mut().find(|station| station.id == service);
        station.expect("one of each service").service.as_mut()
    }

    /// Puts a service in the place of its predecessor.
    pub fn replace(&mut self, service: Box<dyn ErasedService>) {
        for station in &mut self.stations {
            if station.id == service.id() {
                station.service = service;
                return;
            }
        }
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
        let Self {
            stations,
            history,
            schedule,
            ..
        } = self;
        stations
            .iter_mut()
            .filter(|station| station.rate.occurs_at(tick))
            .try_for_each(|station| station.step(schedule, history, tick))
    }

    #[inline]
    fn hand_over<S: TickSink>(&self, tick: u64, sink: &mut S) -> Result<(), S::Error> {
        for (topic, rate) in &self.published {
            if rate.occurs_at(tick) {
                sink.sample(*topic, self.history[topic.index()].bytes(rate.count_before(tick)))?;
            }
        }
        Ok(())
    }
}

/// Places of a service's outputs, taken out of the history for the time of a step.
type Places = [Box<[u64]>; MAX_PORTS];

impl Station {
    #[inline]
    fn step(&mut self, schedule: &Schedule, history: &mut [History], tick: u64) -> Result<(), NonFinite> {
        let now = step::now(schedule, self.id, tick);
        let mut places = self.take_places(history, tick);
        let result = {
            let mut slots = Slots::default();
            for ((slot, place), (topic, _)) in slots.iter_mut().zip(&mut places).zip(&self.outputs) {
                if !place.is_empty() {
                    let bytes = &mut place.as_mut_bytes()[..topic.kind().size];
                    step::prepare(schedule, *topic, tick, bytes);
                    *slot = OutputSlot { bytes: Some(bytes) };
                }
            }
            let views = self.views(schedule, history, tick);
            step::step(self.service.as_mut(), &now, &views, &mut slots)
        };
        self.return_places(history, tick, places);
        result
    }

    /// The inputs: the samples that the schedule says are due.
    #[inline]
    fn views<'a>(&self, schedule: &Schedule, history: &'a [History], tick: u64) -> Views<'a> {
        let mut views = Views::default();
        for (index, (view, (topic, rate))) in views.iter_mut().zip(&self.inputs).enumerate() {
            if let Some(due) = schedule.due_sample(self.id, index, tick) {
                *view = InputView {
                    bytes: Some(history[topic.index()].bytes(rate.count_before(due))),
                    fresh: schedule.is_fresh(self.id, index, tick, due),
                };
            }
        }
        views
    }

    /// Takes the places of the due outputs out of the history; an output that is not due gets an empty one.
    #[inline]
    fn take_places(&self, history: &mut [History], tick: u64) -> Places {
        let mut places = Places::default();
        for (place, (topic, rate)) in places.iter_mut().zip(&self.outputs) {
            if rate.occurs_at(tick) {
                *place = std::mem::take(history[topic.index()].slot_mut(rate.count_before(tick)));
            }
        }
        places
    }

    #[inline]
    fn return_places(&self, history: &mut [History], tick: u64, places: Places) {
        for (place, (topic, rate)) in places.into_iter().zip(&self.outputs) {
            if !place.is_empty() {
                *history[topic.index()].slot_mut(rate.count_before(tick)) = place;
            }
        }
    }
}
