//! The five step functions called in a row, without a host: the floor of flight in one process.

use std::time::Instant;

use host::owned_sample::OwnedSample;
use host::step::{self, Slots, Timetable, Views};
use shared_types::service::{ErasedService, InputView};
use shared_types::{Schedule, ServiceId, Topic};

/// The services of a flight at one rate, each with its timetable.
pub(super) struct InARow {
    services: Vec<(Box<dyn ErasedService>, Timetable)>,
    /// The newest sample of each topic.
    newest: [Option<OwnedSample>; Topic::ALL.len()],
    last_tick: u64,
}

impl InARow {
    /// # Panics
    /// If a service does not step at every tick, which only a host supports.
    pub(super) fn new(schedule: &Schedule, mut services: Vec<Box<dyn ErasedService>>) -> Self {
        let index = |service: &ServiceId| schedule.order().iter().position(|other| other == service);
        services.sort_by_key(|service| index(&service.id()));
        let every_tick = |service: ServiceId| schedule.service_rate(service).period == 1;
        assert!(ServiceId::ALL.into_iter().all(every_tick));
        let timed = |service: Box<dyn ErasedService>| {
            let timetable = Timetable::new(schedule, service.id());
            (service, timetable)
        };
        Self {
            services: services.into_iter().map(timed).collect(),
            newest: Topic::ALL.map(|topic| {
                let mut published = schedule.published_topics();
                published
                    .any(|other| other == topic)
                    .then(|| OwnedSample::zeroed(topic))
            }),
            last_tick: schedule.last_tick(),
        }
    }

    /// Steps all services at every tick. Returns the simulated seconds per second, at 1 kHz.
    pub(super) fn fly(&mut self) -> f64 {
        let started = Instant::now();
        for tick in 0..=self.last_tick {
            self.tick(tick);
        }
        #[expect(clippy::cast_precision_loss, reason = "few ticks")]
        let seconds = (self.last_tick + 1) as f64 / 1000.0;
        seconds / started.elapsed().as_secs_f64()
    }

    #[inline]
    fn tick(&mut self, tick: u64) {
        for (service, timetable) in &mut self.services {
            let outputs = timetable.outputs.len();
            let mut own: [Option<OwnedSample>; shared_types::schedule::MAX_PORTS] = Default::default();
            for (sample, output) in own.iter_mut().zip(&timetable.outputs) {
                *sample = self.newest[output.topic.index()].take();
            }
            let mut views = Views::default();
            for (view, edge) in views.iter_mut().zip(&timetable.inputs) {
                if edge.due_sample(tick).is_some() {
                    *view = InputView {
                        bytes: self.newest[edge.topic.index()].as_ref().map(OwnedSample::bytes),
                        fresh: true,
                    };
                }
            }
            let mut slots = Slots::default();
            let due = slots.iter_mut().zip(&mut own).zip(&timetable.outputs);
            for ((slot, sample), output) in due.filter(|(_, output)| output.is_due(tick)) {
                let bytes = sample.as_mut().expect("a topic has one publisher").bytes_mut();
                *slot = step::prepared(output.topic, output.header(tick), bytes);
            }
            let inputs = &views[..timetable.service.inputs().len()];
            service.step(&timetable.now(tick), inputs, &mut slots[..outputs]);
            for (sample, output) in own.iter_mut().zip(&timetable.outputs) {
                self.newest[output.topic.index()] = sample.take();
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use std::convert::Infallible;

    use super::*;
    use host::in_process::{InProcess, TickSink};
    use scenario::Scenario;

    struct Last(Vec<Vec<u8>>);

    impl TickSink for Last {
        type Error = Infallible;

        fn sample(&mut self, topic: Topic, bytes: &[u8]) -> Result<(), Infallible> {
            self.0[topic.index()] = bytes.to_vec();
            Ok(())
        }
    }

    #[test]
    fn the_floor_computes_what_the_host_does() {
        let scenario: Scenario = toml::from_str(super::super::SCENARIO).unwrap();
        let scenario = Scenario {
            duration: 0.5,
            vehicle: scenario::Vehicle {
                change: Vec::new(),
                ..scenario.vehicle.clone()
            },
            ..scenario
        };
        let schedule = scenario.schedule().unwrap();
        let build = || registry::build_all(&scenario).unwrap();
        let mut host = Last(vec![Vec::new(); Topic::ALL.len()]);
        assert!(InProcess::new(schedule.clone(), build()).fly(&mut host).is_ok());
        let mut floor = InARow::new(&schedule, build());
        floor.fly();
        for topic in Topic::ALL {
            let computed = floor.newest[topic.index()].as_ref().map(OwnedSample::bytes);
            assert_eq!(computed.unwrap_or_default(), host.0[topic.index()], "{topic}");
        }
    }
}
