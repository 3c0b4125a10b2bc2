//! One step of a service, the same in every host.

use shared_types::schedule::{Edge, MAX_PORTS, Publication, Rate};
use shared_types::service::{ErasedService, InputView, OutputSlot};
use shared_types::{Now, Schedule, ServiceId, Topic};

/// A number that is not finite, stopped at the service that made it.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error, serde::Serialize, serde::Deserialize)]
#[error(
    "`{service}` computed a number that is not finite at tick {tick}: `{field}` of `{topic}`; \
     it was not published. Look at the last ticks of the log for what led to it"
)]
pub struct NonFinite {
    /// Name of the service that made it.
    pub service: String,
    /// Tick of the step.
    pub tick: u64,
    /// Name of the topic.
    pub topic: String,
    /// Member of the sample.
    pub field: String,
}

/// What a host holds of a service's inputs during a step.
pub type Views<'a> = [InputView<'a>; MAX_PORTS];

/// What a host holds of a service's outputs during a step.
pub type Slots<'a> = [OutputSlot<'a>; MAX_PORTS];

/// What the schedule says of the steps of one service, looked up once before the flight.
#[derive(Clone, Debug)]
pub struct Timetable {
    /// The service.
    pub service: ServiceId,
    /// When it steps.
    pub rate: Rate,
    /// Its inputs, in the order of the wiring table.
    pub inputs: Vec<Edge>,
    /// Its outputs, in the order of the wiring table.
    pub outputs: Vec<Publication>,
    tick_ns: u64,
}

impl Timetable {
    /// The timetable of a service.
    #[must_use]
    pub fn new(schedule: &Schedule, service: ServiceId) -> Self {
        let outputs = service.outputs().iter();
        Self {
            service,
            rate: schedule.service_rate(service),
            inputs: (0..service.inputs().len())
                .map(|input| schedule.edge(service, input))
                .collect(),
            outputs: outputs.map(|output| schedule.publication(output.topic)).collect(),
            tick_ns: schedule.tick_ns(),
        }
    }

    /// The moment of the step at `tick`, with the time since the previous step.
    #[must_use]
    #[inline]
    pub fn now(&self, tick: u64) -> Now {
        let elapsed_ticks = if tick > self.rate.phase {
            self.rate.period
        } else {
            0
        };
        Now {
            tick,
            time_ns: tick * self.tick_ns,
            elapsed_ns: elapsed_ticks * self.tick_ns,
        }
    }

    /// Steps `service` at `tick` and examines what it wrote.
    ///
    /// # Errors
    /// [`NonFinite`] if an output holds a number that is not finite.
    #[inline]
    pub fn step(
        &self,
        service: &mut dyn ErasedService,
        tick: u64,
        views: &Views<'_>,
        slots: &mut Slots<'_>,
    ) -> Result<(), NonFinite> {
        let (inputs, outputs) = (self.inputs.len(), self.outputs.len());
        service.step(&self.now(tick), &views[..inputs], &mut slots[..outputs]);
        for (slot, output) in slots.iter().zip(&self.outputs) {
            if let Some(bytes) = slot.bytes.as_deref()
                && let Some(field) = output.topic.kind().first_non_finite_field(bytes)
            {
                return Err(self.non_finite(tick, output.topic, field));
            }
        }
        Ok(())
    }

    #[cold]
    fn non_finite(&self, tick: u64, topic: Topic, field: &str) -> NonFinite {
        NonFinite {
            service: self.service.to_string(),
            tick,
            topic: topic.to_string(),
            field: field.to_owned(),
        }
    }
}

/// A due output's place: zeroed, its header filled in.
#[inline]
pub fn prepared<'a>(output: &Publication, tick: u64, bytes: &'a mut [u8]) -> OutputSlot<'a> {
    output.topic.kind().prepare(bytes, output.header(tick));
    OutputSlot { bytes: Some(bytes) }
}
