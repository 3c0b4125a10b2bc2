//! One step of a service, the same in every host.

use shared_types::schedule::MAX_PORTS;
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

/// The moment of a service's step at `tick`, with the time since its previous step.
#[must_use]
#[inline]
pub fn now(schedule: &Schedule, service: ServiceId, tick: u64) -> Now {
    let rate = schedule.service_rate(service);
    let elapsed_ticks = if tick > rate.phase { rate.period } else { 0 };
    Now {
        tick,
        time_ns: schedule.time_ns(tick),
        elapsed_ns: schedule.time_ns(elapsed_ticks),
    }
}

/// Zeroes a due output's place and fills its header in.
#[inline]
pub fn prepare(schedule: &Schedule, topic: Topic, tick: u64, bytes: &mut [u8]) {
    topic.kind().prepare(bytes, schedule.header(topic, tick));
}

/// Steps a service and examines what it wrote.
///
/// # Errors
/// [`NonFinite`] if an output holds a number that is not finite.
#[inline]
pub fn step(
    service: &mut dyn ErasedService,
    now: &Now,
    views: &Views<'_>,
    slots: &mut Slots<'_>,
) -> Result<(), NonFinite> {
    let id = service.id();
    let (inputs, outputs) = (id.inputs(), id.outputs());
    service.step(now, &views[..inputs.len()], &mut slots[..outputs.len()]);
    for (slot, output) in slots.iter().zip(outputs) {
        if let Some(bytes) = slot.bytes.as_deref()
            && let Some(field) = output.topic.kind().first_non_finite_field(bytes)
        {
            return Err(NonFinite {
                service: id.to_string(),
                tick: now.tick,
                topic: output.topic.to_string(),
                field: field.to_owned(),
            });
        }
    }
    Ok(())
}
