//! Host of one service in a replay: the orchestrator orders each step with its samples.
//!
//! The ports are made as for a flight, of topics that only this service and the orchestrator open. The orchestrator
//! publishes the recorded samples of the inputs and receives the outputs. Steps are ordered in batches: the orchestrator
//! publishes their inputs before the order, and the buffers hold all outputs, so no process waits within a batch.
//!
//! As in a flight, a number that is not finite is not published. It does not end the replay: the log has what happened
//! next.

use shared_types::service::{ErasedService, InputView};
use shared_types::{Schedule, ServiceId};

use crate::control::{Channel, ControlError, StateBefore, StepOrder, ToOrchestrator, ToService};
use crate::crash::CrashPoint;
use crate::flight_error::FlightError;
use crate::output_ports::OutputPorts;
use crate::ports::{PortError, RECORDER_BUFFER, Receiver, Topics};
use host::step::{Slots, Timetable, Views};

/// Maximum number of steps in a batch. The buffers hold the samples of two batches: the one in progress, and the one that is
/// published meanwhile.
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
        // A whole batch must fit into the buffer.
        let receivers = inputs.map(|input| topics.ports(input.topic).recorder(RECORDER_BUFFER));
        Ok(Self {
            receivers: receivers.collect::<Result<_, _>>()?,
            outputs: OutputPorts::open(topics, id, schedule, |topic| topic.newest_sender())?,
        })
    }

    /// Connects all ports to the orchestrator's.
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

/// Returns the inputs of a step, and receives the samples that the step is the first to read.
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
                source: format!("an input of the step at tick {} has not arrived", order.now.tick).into(),
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

/// Executes the orchestrator's orders until the replay ends.
///
/// # Errors
/// [`FlightError`].
pub fn execute_orders(
    service: &mut dyn ErasedService,
    schedule: &Schedule,
    ports: &mut ReplayPorts,
    channel: &Channel,
) -> Result<(), FlightError> {
    let mut initial = vec![0; service.state_size()];
    service.save(&mut initial);
    let mut replaying = Replaying {
        timetable: Timetable::new(schedule, service.id()),
        before_last: initial.clone(),
        initial,
        service,
        ports,
    };
    loop {
        match channel.receive() {
            Ok(ToService::Steps {
                orders,
                returns_state,
            }) => {
                let not_finite = replaying.execute(&orders)?;
                let state = returns_state.then(|| replaying.state());
                channel.send(&ToOrchestrator::Stepped { not_finite, state })?;
            }
            Ok(ToService::Tune { gains }) => replaying.service.tune(gains.as_ref()),
            Ok(ToService::Restore { state }) => replaying.service.restore(&state),
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
    /// State before the first step.
    initial: Vec<u8>,
    /// State before the last step.
    before_last: Vec<u8>,
}

impl Replaying<'_> {
    fn state(&self) -> Vec<u8> {
        let mut state = vec![0; self.service.state_size()];
        self.service.save(&mut state);
        state
    }

    /// Executes the steps of a batch. Returns the indices of the steps that computed a number that is not finite.
    fn execute(&mut self, orders: &[StepOrder]) -> Result<Vec<usize>, PortError> {
        let mut not_finite = Vec::new();
        for (index, order) in orders.iter().enumerate() {
            if !self.step(order)? {
                not_finite.push(index);
            }
        }
        Ok(not_finite)
    }

    /// Executes a step and publishes its outputs, unless a number is not finite. Returns whether all are finite.
    fn step(&mut self, order: &StepOrder) -> Result<bool, PortError> {
        match order.state {
            StateBefore::AfterLast => {}
            StateBefore::BeforeLast => self.service.restore(&self.before_last),
            StateBefore::Initial => self.service.restore(&self.initial),
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
            outputs.discard_loan();
        }
        Ok(is_finite)
    }
}
