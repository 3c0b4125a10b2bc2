//! All services in one thread: no shared memory, no waiting. The reference that the other hosts must equal.

use std::ops::ControlFlow;

use shared_types::schedule::{Edge, MAX_PORTS, Publication};
use shared_types::service::{ErasedService, InputView};
use shared_types::{Schedule, ServiceId, Topic};

use crate::edge_store::EdgeStore;
use crate::sample_ring::SampleRing;
use crate::step::{self, NonFinite, Slots, Timetable, Views};

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
    /// What services publish, in the order of the log.
    published: Vec<Source>,
    /// Whether any input has planned faults.
    has_stores: bool,
    next_tick: u64,
}

/// A service, when it steps, where its inputs come from and the latest of what it published.
struct Station {
    service: Box<dyn ErasedService>,
    /// The service's state before its first step.
    newborn: Vec<u8>,
    timetable: Timetable,
    /// Of each input.
    sources: Vec<Source>,
    /// Of each input with planned faults, what has come.
    stores: [Option<EdgeStore>; MAX_PORTS],
    has_stores: bool,
    /// Of each output.
    histories: Vec<History>,
}

/// Where a topic's samples are: which output of which station.
#[derive(Clone, Copy)]
struct Source {
    station: usize,
    output: usize,
}

impl Source {
    /// Finds the publisher of a topic among the services in the order of a tick.
    fn of(topic: Topic, order: &[ServiceId]) -> Option<Self> {
        let publishes = |service: &ServiceId| {
            let mut outputs = service.outputs().iter();
            outputs.position(|output| output.topic == topic)
        };
        order
            .iter()
            .enumerate()
            .find_map(|(station, service)| publishes(service).map(|output| Self { station, output }))
    }
}

impl Station {
    fn new(service: Box<dyn ErasedService>, schedule: &Schedule) -> Self {
        let timetable = Timetable::new(schedule, service.id());
        let mut newborn = vec![0; service.state_size()];
        service.save(&mut newborn);
        let source =
            |topic| Source::of(topic, schedule.order()).expect("services consume what services publish");
        let mut stores: [Option<EdgeStore>; MAX_PORTS] = Default::default();
        for (store, edge) in stores.iter_mut().zip(&timetable.inputs) {
            *store = edge.has_faults().then(|| EdgeStore::new(edge.clone()));
        }
        Self {
            service,
            newborn,
            has_stores: stores.iter().any(Option::is_some),
            stores,
            sources: timetable.inputs.iter().map(|input| source(input.topic)).collect(),
            histories: timetable
                .outputs
                .iter()
                .map(|output| History::new(output.clone(), schedule))
                .collect(),
            timetable,
        }
    }
}

/// The latest samples of a topic, as many as any consumer may still need.
struct History {
    publication: Publication,
    samples: SampleRing,
}

impl History {
    fn new(publication: Publication, schedule: &Schedule) -> Self {
        let latest = publication
            .topic
            .consumers()
            .map(|(service, input)| schedule.latency(service, input))
            .max();
        let depth = latest.unwrap_or(0) / publication.ticks.rate.period + 2;
        Self {
            samples: SampleRing::new(publication.topic, depth),
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
    pub fn new(schedule: Schedule, services: Vec<Box<dyn ErasedService>>) -> Self {
        let mut stations: Vec<_> = services
            .into_iter()
            .map(|service| Station::new(service, &schedule))
            .collect();
        let place = |id: ServiceId| schedule.order().iter().position(|&other| other == id);
        stations.sort_by_key(|station| place(station.timetable.service));
        let complete = stations
            .iter()
            .map(|station| station.timetable.service)
            .eq(schedule.order().iter().copied());
        assert!(complete, "one of each service");
        let topics = Topic::ALL.into_iter();
        Self {
            has_stores: stations.iter().any(|station| station.has_stores),
            stations,
            published: topics
                .filter_map(|topic| Source::of(topic, schedule.order()))
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
        let station = self
            .stations
            .iter_mut()
            .find(|station| station.timetable.service == service);
        station.expect("one of each service").service.as_mut()
    }

    /// Puts a service in the place of its predecessor.
    pub fn replace(&mut self, service: Box<dyn ErasedService>) {
        for station in &mut self.stations {
            if station.timetable.service == service.id() {
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
        for place in 0..self.stations.len() {
            let (before, rest) = self.stations.split_at_mut(place);
            let (station, after) = rest.split_first_mut().expect("the place is one of theirs");
            if station.timetable.steps.occurs_at(tick) {
                station.step(&Others { before, after }, tick)?;
            }
        }
        if self.has_stores {
            self.keep_published(tick);
        }
        Ok(())
    }

    /// Lets every input with planned faults keep what was published at a tick.
    #[cold]
    fn keep_published(&mut self, tick: u64) {
        for place in 0..self.stations.len() {
            let (before, rest) = self.stations.split_at_mut(place);
            let (station, after) = rest.split_first_mut().expect("the place is one of theirs");
            if station.has_stores {
                station.keep_published(&Others { before, after }, tick, |_| true);
            }
        }
    }

    #[inline]
    fn hand_over<S: TickSink>(&self, tick: u64, sink: &mut S) -> Result<(), S::Error> {
        for source in &self.published {
            let history = &self.stations[source.station].histories[source.output];
            if history.publication.is_due(tick) {
                sink.sample(history.publication.topic, history.bytes(tick))?;
            }
        }
        Ok(())
    }
}

/// The stations beside the one that steps.
struct Others<'a> {
    before: &'a [Station],
    after: &'a [Station],
}

impl<'a> Others<'a> {
    #[inline]
    fn history(&self, source: Source) -> &'a History {
        let place = self.before.len();
        let station = if source.station < place {
            &self.before[source.station]
        } else {
            &self.after[source.station - place - 1]
        };
        &station.histories[source.output]
    }
}

impl Station {
    #[inline]
    fn step(&mut self, others: &Others<'_>, tick: u64) -> Result<(), NonFinite> {
        if self.timetable.begins_anew_at(tick) {
            self.service.restore(&self.newborn);
        }
        if self.has_stores {
            // What is published later in the tick is due later as well.
            self.keep_published(others, tick, |edge| edge.latency == 0);
        }
        // The samples that the schedule says are due.
        let mut views = Views::default();
        let edges = self.timetable.inputs.iter().zip(&self.sources);
        for ((view, (input, &source)), store) in views.iter_mut().zip(edges).zip(&mut self.stores) {
            let Some(due) = input.due_sample(tick) else {
                continue;
            };
            *view = if let Some(store) = store {
                store.forget_before(due);
                store.view(tick, due)
            } else {
                InputView {
                    bytes: Some(others.history(source).bytes(due)),
                    fresh: input.is_fresh(tick, due),
                }
            };
        }
        let mut slots = Slots::default();
        for (slot, history) in slots.iter_mut().zip(&mut self.histories) {
            if history.publication.is_due(tick) {
                let header = history.publication.header(tick);
                *slot = step::prepared(history.publication.topic, header, history.bytes_mut(tick));
            }
        }
        self.timetable
            .step(self.service.as_mut(), tick, &views, &mut slots)
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
