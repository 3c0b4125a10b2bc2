//! The lock-step host of one service: waits for exactly the samples that the schedule says are due.
//!
//! Results cannot depend on how the processes are scheduled: a step begins only when the due sample of every
//! input is here, and later ones stay in their buffers. No sample is lost; publishers run ahead at most as
//! far as the schedule lets them.

use std::sync::Arc;
use std::sync::atomic::Ordering;

use shared_types::schedule::{Edge, Publication};
use shared_types::service::{ErasedService, InputView, header_of};
use shared_types::{Schedule, ServiceId, Topic};

use crate::ports::{Member, OwnReceivers, PortError, Receiver, Sender};
use crate::shared_page::{Cell, SharedPage};
use crate::step::{self, NonFinite, Slots, Timetable, Views};
use crate::wait::{Interrupted, Waiter};

/// Why a flight ended before its last tick.
#[derive(Debug, thiserror::Error)]
pub enum FlightError {
    /// A number that is not finite came up.
    #[error(transparent)]
    NonFinite(#[from] NonFinite),
    /// A port failed.
    #[error(transparent)]
    Port(#[from] PortError),
    /// A sample other than the one that was due came: the publisher and this service disagree.
    #[error("at tick {tick} the sample {got} of `{topic}` came where {due} was due: a sample was lost")]
    Lost {
        /// Tick of the step.
        tick: u64,
        /// The topic.
        topic: Topic,
        /// Tick of the sample that was due.
        due: u64,
        /// Tick of the sample that came.
        got: u64,
    },
    /// The run ends.
    #[error("the run was stopped")]
    Stopping,
}

impl From<Interrupted> for FlightError {
    fn from(_: Interrupted) -> Self {
        Self::Stopping
    }
}

/// A service's ports.
pub struct ServicePorts {
    inputs: Vec<InputPort>,
    outputs: Vec<OutputPort>,
    consumers: Vec<ServiceId>,
    receivers: OwnReceivers,
}

struct InputPort {
    /// Place of the input in the wiring table.
    index: usize,
    edge: Edge,
    publisher: ServiceId,
    receiver: Box<dyn Receiver>,
}

struct OutputPort {
    publication: Publication,
    sender: Box<dyn Sender>,
}

impl ServicePorts {
    /// Makes the ports that the wiring table gives a service.
    ///
    /// # Errors
    /// [`PortError`].
    pub fn open(
        member: &Member,
        id: ServiceId,
        schedule: &Schedule,
        page: &Arc<SharedPage>,
    ) -> Result<Self, PortError> {
        let receivers = OwnReceivers::default();
        let mut inputs = Vec::new();
        for (index, spec) in id.inputs().iter().enumerate() {
            let receiver = member.open_topic(spec.topic, schedule)?.receiver()?;
            let publisher = spec
                .topic
                .publisher()
                .expect("services consume what services publish");
            inputs.push(InputPort {
                index,
                edge: schedule.edge(id, index),
                publisher,
                receiver,
            });
        }
        // The publisher that steps last is waited for first: once its sample is here, the others' are too,
        // so that a step sleeps once and not once an input.
        let place = |service| schedule.order().iter().position(|&other| other == service);
        inputs.sort_by_key(|input| std::cmp::Reverse((input.edge.latency == 0, place(input.publisher))));

        let mut outputs = Vec::new();
        for spec in id.outputs() {
            let page = Arc::clone(page);
            let stopping = Arc::new(move || page.words().stopping.load(Ordering::Relaxed) != 0);
            let sender = member
                .open_topic(spec.topic, schedule)?
                .sender(receivers.clone(), stopping)?;
            outputs.push(OutputPort {
                publication: schedule.publication(spec.topic),
                sender,
            });
        }
        let mut consumers: Vec<_> = id
            .outputs()
            .iter()
            .flat_map(|spec| spec.topic.consumers())
            .map(|(service, _)| service)
            .collect();
        consumers.sort_unstable();
        consumers.dedup();
        Ok(Self {
            inputs,
            outputs,
            consumers,
            receivers,
        })
    }

    /// Ids of this service's receivers.
    #[must_use]
    pub fn receiver_ids(&self) -> Vec<u128> {
        self.inputs.iter().map(|input| input.receiver.id()).collect()
    }

    /// Learns the run's own receivers and connects all ports, once everybody has made theirs.
    ///
    /// # Errors
    /// [`PortError`].
    pub fn connect(&mut self, own: impl IntoIterator<Item = u128>) -> Result<(), PortError> {
        self.receivers.extend(own);
        self.inputs
            .iter_mut()
            .try_for_each(|input| input.receiver.connect())?;
        self.outputs
            .iter_mut()
            .try_for_each(|output| output.sender.connect())
    }
}

/// Flies a service from its first step to its last.
///
/// # Errors
/// [`FlightError`].
pub fn fly(
    service: &mut dyn ErasedService,
    schedule: &Schedule,
    ports: &mut ServicePorts,
    waiter: &mut Waiter,
) -> Result<(), FlightError> {
    let timetable = Timetable::new(schedule, service.id());
    let mut tick = timetable.rate.phase;
    while tick <= schedule.last_tick() {
        if waiter.is_stopping() {
            return Err(FlightError::Stopping);
        }
        await_inputs(ports, waiter, tick)?;
        step_and_publish(service, &timetable, ports, tick)?;
        let cell = waiter.cell();
        cell.steps_until.store(tick + 1, Ordering::Relaxed);
        Cell::count(&cell.steps);
        waiter.wake(&ports.consumers);
        tick += timetable.rate.period;
    }
    Ok(())
}

/// Waits until the due sample of every input is held.
#[inline]
fn await_inputs(ports: &mut ServicePorts, waiter: &mut Waiter, tick: u64) -> Result<(), FlightError> {
    for input in &mut ports.inputs {
        let Some(due) = input.edge.due_sample(tick) else {
            continue;
        };
        let (topic, receiver) = (input.edge.topic, input.receiver.as_mut());
        waiter.wait(input.publisher, || advance(receiver, topic, tick, due))?;
    }
    Ok(())
}

/// Takes samples until the one of tick `due` is held.
#[inline]
fn advance(receiver: &mut dyn Receiver, topic: Topic, tick: u64, due: u64) -> Result<bool, FlightError> {
    loop {
        if let Some(bytes) = receiver.held() {
            let got = header_of(bytes).tick;
            if got == due {
                return Ok(true);
            }
            if got > due {
                return Err(FlightError::Lost {
                    tick,
                    topic,
                    due,
                    got,
                });
            }
        }
        if !receiver.receive()? {
            return Ok(false);
        }
    }
}

#[inline]
fn step_and_publish(
    service: &mut dyn ErasedService,
    timetable: &Timetable,
    ports: &mut ServicePorts,
    tick: u64,
) -> Result<(), FlightError> {
    let mut views = Views::default();
    for input in &ports.inputs {
        if let Some(due) = input.edge.due_sample(tick) {
            views[input.index] = InputView {
                bytes: input.receiver.held(),
                fresh: input.edge.is_fresh(tick, due),
            };
        }
    }
    let mut slots = Slots::default();
    for (slot, output) in slots.iter_mut().zip(&mut ports.outputs) {
        if output.publication.is_due(tick) {
            *slot = step::prepared(&output.publication, tick, output.sender.loan()?);
        }
    }
    timetable.step(service, tick, &views, &mut slots)?;
    for output in &mut ports.outputs {
        match output.sender.send() {
            Err(PortError::Stopping) => return Err(FlightError::Stopping),
            result => result?,
        }
    }
    Ok(())
}
