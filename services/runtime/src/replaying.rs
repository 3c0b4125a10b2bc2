//! Host of one service in a replay: the orchestrator says which steps there are and which samples each of them sees.
//!
//! The ports are made as for a flight, of topics that only this service and the orchestrator open. The orchestrator
//! publishes the recorded samples of the inputs and receives the outputs. Steps come in batches. Their inputs are
//! published before they are ordered, and their outputs find room, so no process waits within a batch.
//!
//! A number that is not finite is not published here either. But it does not end the replay: the log says what came
//! next.

use shared_types::service::{ErasedService, InputView};
use shared_types::{Schedule, ServiceId};

use crate::control::{Channel, ControlError, Memory, StepOrder, ToOrchestrator, ToService};
use crate::crash::CrashPoint;
use crate::flight_error::FlightError;
use crate::output_ports::OutputPorts;
use crate::ports::{PortError, RECORDER_BUFFER, Receiver, Topics};
use host::step::{Slots, Timetable, Views};

/// Most steps of a batch. The samples of two batches have room: the one in progress, and the one that is published
/// meanwhile.
pub const BATCH: usize = 256;
const _: () = assert!(2 * BATCH <= RECORDER_BUFFER);

/// Ports of a service in a replay.
pub struct ReplayPorts {
    /// In the order of the wiring table.
    receivers: Vec<Box<dyn Receiver>>,
    outputs: OutputPorts,
}

impl ReplayPorts {
    /// Makes the ports that the wiring table gives a service.
    ///
    /// # Errors
    /// [`PortError`].
    pub fn open(topics: &Topics, id: ServiceId, schedule: &Schedule) -> Result<Self, PortError> {
        let inputs = id.inputs().iter();
        // As much room as the recorder's: a whole batch waits in it.
        let receivers = inputs.map(|input| topics.of(input.topic).recorder(RECORDER_BUFFER));
        Ok(Self {
            receivers: receivers.collect::<Result<_, _>>()?,
            outputs: OutputPorts::open(topics, id, schedule, |topic| topic.newest_sender())?,
        })
    }

    /// Connects all ports to those of the orchestrator.
    ///
    /// # Errors
    /// [`PortError`].
    pub fn connect(&mut self) -> Result<(), PortError> {
        self.receivers
            .iter_mut()
            .try_for_each(|receiver| receiver.connect())?;
        self.outputs.connect()
    }
}

/// Returns the inputs of a step. Takes the samples that it is the first to see.
fn views<'a>(
    receivers: &'a mut [Box<dyn Receiver>],
    service: ServiceId,
    order: &StepOrder,
) -> Result<Views<'a>, PortError> {
    let mut views = Views::default();
    let inputs = receivers.iter_mut().zip(service.inputs());
    for (input, ((receiver, spec), view)) in inputs.zip(&mut views).enumerate() {
        let has = |bits: u32| bits & 1 << input != 0;
        if has(order.next) && !receiver.receive()? {
            return Err(PortError::Transport {
                topic: spec.topic,
                source: format!("an input of the step at tick {} has not come", order.now.tick).into(),
            });
        }
        if has(order.seen) {
            *view = InputView {
                bytes: receiver.held(),
                fresh: has(order.fresh),
            };
        }
    }
    Ok(views)
}

/// Executes the steps that the orchestrator orders, until it ends the replay.
///
/// # Errors
/// [`FlightError`].
pub fn obey(
    service: &mut dyn ErasedService,
    schedule: &Schedule,
    ports: &mut ReplayPorts,
    channel: &Channel,
) -> Result<(), FlightError> {
    let mut newborn = vec![0; service.state_size()];
    service.save(&mut newborn);
    let mut replaying = Replaying {
        timetable: Timetable::new(schedule, service.id()),
        before_last: newborn.clone(),
        newborn,
        service,
        ports,
    };
    loop {
        match channel.receive() {
            Ok(ToService::Steps { orders, tells_state }) => {
                let not_finite = replaying.do_all(&orders)?;
                let state = tells_state.then(|| replaying.state());
                channel.send(&ToOrchestrator::Stepped { not_finite, state })?;
            }
            Ok(ToService::Tune { gains }) => replaying.service.tune(gains.as_ref()),
            Ok(ToService::Know { state }) => replaying.service.restore(&state),
            Ok(_) | Err(ControlError::Closed) => return Ok(()),
            Err(error) => return Err(error.into()),
        }
    }
}

/// Service whose steps are executed again.
struct Replaying<'a> {
    service: &'a mut dyn ErasedService,
    timetable: Timetable,
    ports: &'a mut ReplayPorts,
    /// Its initial state.
    newborn: Vec<u8>,
    /// Its state before its last step.
    before_last: Vec<u8>,
}

impl Replaying<'_> {
    fn state(&self) -> Vec<u8> {
        let mut state = vec![0; self.service.state_size()];
        self.service.save(&mut state);
        state
    }

    /// Executes the steps of a batch. Returns the places of those that computed a number that is not finite.
    fn do_all(&mut self, orders: &[StepOrder]) -> Result<Vec<usize>, PortError> {
        let mut not_finite = Vec::new();
        for (place, order) in orders.iter().enumerate() {
            if !self.step(order)? {
                not_finite.push(place);
            }
        }
        Ok(not_finite)
    }

    /// Executes a step and publishes its outputs. Returns `false` if one is not finite.
    fn step(&mut self, order: &StepOrder) -> Result<bool, PortError> {
        match order.memory {
            Memory::AfterLast => {}
            Memory::BeforeLast => self.service.restore(&self.before_last),
            Memory::Newborn => self.service.restore(&self.newborn),
        }
        self.service.save(&mut self.before_last);
        let tick = order.now.tick;
        let ReplayPorts { receivers, outputs } = &mut *self.ports;
        let views = views(receivers, self.timetable.service, order)?;
        let mut slots = Slots::default();
        outputs.loan(tick, &mut slots)?;
        let is_finite = self
            .timetable
            .step_at(self.service, &order.now, &views, &mut slots)
            .is_ok();
        if is_finite {
            outputs.send(tick, CrashPoint::default())?;
        } else {
            outputs.take_back();
        }
        Ok(is_finite)
    }
}
