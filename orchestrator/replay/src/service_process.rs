//! Replay of a service in a separate process.
//!
//! Steps are ordered in batches: while the process executes one, the next is read from the log and published. So the
//! results of a step arrive about a hundred ticks later, in the order of the steps.

mod failure;
mod ports;

use std::time::{Duration, Instant};

use runtime::control::{ControlError, ToOrchestrator, ToService};
use runtime::control::{StateBefore, StepOrder};
use runtime::ports::PortError;
use runtime::replaying::BATCH;
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use shared_types::{Gains, ServiceId};

pub use failure::ProcessFailure;
pub(super) use ports::{InputPort, OutputPort};

use super::ReplayError;
use super::comparator::Comparator;
use super::history::History;
use super::stepper::{Step, Stepper};
use decisions::restart_policy::{READY_LIMIT, STOP_LIMIT};
use flight::interrupt::Interrupt;
use supervisor::supervision::process::Process;

/// Timeout for a batch of steps; a batch takes about a thousandth of it.
const BATCH_LIMIT: Duration = READY_LIMIT;

/// Period at which an interrupt is checked.
const CHECK_PERIOD: Duration = Duration::from_millis(100);

fn timespec(duration: Duration) -> Timespec {
    Timespec {
        tv_sec: i64::try_from(duration.as_secs()).unwrap_or(i64::MAX),
        tv_nsec: i64::from(duration.subsec_nanos()),
    }
}

/// Comparison to do once the results of a batch arrive, in order.
enum ComparatorMessage {
    /// Samples of a step.
    Step {
        tick: u64,
        is_finished: bool,
        is_compared: bool,
    },
    /// State after the last step of a batch.
    State { tick: u64, recorded: Vec<u8> },
    /// End of a tick's steps.
    EndOfTick,
}

/// Service in a separate process. Dropping it ends the process.
pub(super) struct ServiceProcess {
    service: ServiceId,
    process: Process,
    interrupt: Interrupt,
    inputs: Vec<InputPort>,
    outputs: Vec<OutputPort>,
    /// `true` once the process has created its ports.
    is_ready: bool,
    /// State from which the next step starts.
    state: StateBefore,
    /// Gains of the last ordered step, if they were changed in flight.
    gains: Option<Gains>,
    /// Orders of the next batch.
    orders: Vec<StepOrder>,
    comparisons: Vec<ComparatorMessage>,
    /// `true` if the process is to return its state after the next batch.
    returns_state: bool,
    /// Comparisons of the batch that the process is executing.
    executing: Vec<ComparatorMessage>,
    /// First tick of the next batch.
    batch_begins: u64,
    /// Tick of the last compared step.
    compared: Option<u64>,
}

impl ServiceProcess {
    pub(super) fn new(
        service: ServiceId,
        process: Process,
        inputs: Vec<InputPort>,
        outputs: Vec<OutputPort>,
        interrupt: Interrupt,
    ) -> Self {
        Self {
            service,
            process,
            interrupt,
            inputs,
            outputs,
            is_ready: false,
            state: StateBefore::default(),
            gains: None,
            orders: Vec::with_capacity(BATCH),
            comparisons: Vec::new(),
            returns_state: false,
            executing: Vec::new(),
            batch_begins: 0,
            compared: None,
        }
    }

    /// Sends a message. A dead process is detected when its answer is awaited.
    pub(super) fn send(&self, message: &ToService) -> Result<(), ProcessFailure> {
        match self.process.channel.send(message) {
            Ok(()) | Err(ControlError::Closed) => Ok(()),
            Err(error) => Err(self.gave_up(&error)),
        }
    }

    /// Waits until the process has created its ports, connects to them, and starts it. Nothing may be published before.
    fn make_ready(&mut self) -> Result<(), ProcessFailure> {
        if self.is_ready {
            return Ok(());
        }
        let ToOrchestrator::Ready { .. } = self.compare()? else {
            return Err(self.gave_up(&"it did not get ready"));
        };
        let senders = self.inputs.iter_mut().map(InputPort::connect);
        let receivers = self.outputs.iter_mut().map(OutputPort::connect);
        let connected: Result<(), PortError> = senders.chain(receivers).collect();
        connected.map_err(|error| self.gave_up(&error))?;
        self.is_ready = true;
        self.send(&ToService::Go {
            restarted: false,
            start_ns: 0,
        })
    }

    /// Receives the next message of the process.
    fn compare(&mut self) -> Result<ToOrchestrator, ProcessFailure> {
        let deadline = Instant::now() + BATCH_LIMIT;
        loop {
            match self.process.channel.try_receive::<ToOrchestrator>() {
                Ok(Some(
                    ToOrchestrator::Failed { reason }
                    | ToOrchestrator::Refused { reason }
                    | ToOrchestrator::Dying { reason },
                )) => return Err(self.gave_up(&reason)),
                Ok(Some(message)) => return Ok(message),
                Ok(None) => {}
                Err(ControlError::Closed) => return Err(self.died()),
                Err(error) => return Err(self.gave_up(&error)),
            }
            if let Some(signal) = self.interrupt.signal() {
                return Err(ProcessFailure::Interrupted { signal });
            }
            if Instant::now() > deadline {
                return Err(ProcessFailure::Silent {
                    service: self.service.name(),
                    pid: self.process.id(),
                    when: self.how_far(),
                });
            }
            // The channel is closed when the process ends. After an interruption, everything is checked again.
            let mut channel = [PollFd::new(&self.process.channel, PollFlags::IN)];
            let _ = poll(&mut channel, Some(&timespec(CHECK_PERIOD)));
        }
    }

    fn how_far(&self) -> String {
        let before_any = || "before any of its steps was compared".to_owned();
        let compared = |tick| format!("after its step at tick {tick} was compared");
        self.compared.map_or_else(before_any, compared)
    }

    fn died(&mut self) -> ProcessFailure {
        // A process closes its channel shortly before it ends.
        self.process.ends_within(STOP_LIMIT);
        ProcessFailure::Died {
            service: self.service.name(),
            pid: self.process.id(),
            when: self.how_far(),
            how: self.process.end().description,
        }
    }

    fn gave_up(&self, reason: &dyn ToString) -> ProcessFailure {
        ProcessFailure::GaveUp {
            service: self.service.name(),
            pid: self.process.id(),
            when: self.how_far(),
            reason: reason.to_string(),
        }
    }

    /// Publishes the inputs of a step and returns its order.
    fn order(&mut self, step: &Step<'_>) -> Result<StepOrder, PortError> {
        let mut order = StepOrder {
            now: step.now,
            state: std::mem::take(&mut self.state),
            seen: 0,
            next: 0,
            fresh: 0,
        };
        for (place, input) in self.inputs.iter_mut().enumerate() {
            let view = step.views[place];
            if let Some(bytes) = view.bytes {
                let is_next = input.publish(bytes, step.as_recorded[place])?;
                order.seen |= 1 << place;
                order.next |= u32::from(is_next) << place;
                order.fresh |= u32::from(view.fresh) << place;
            }
        }
        Ok(order)
    }

    /// Sends the next batch, once the results of the one before have arrived.
    fn send_batch(&mut self, comparator: &mut Comparator, history: &History) -> Result<(), ProcessFailure> {
        self.collect(comparator, history)?;
        if !self.orders.is_empty() {
            let orders = std::mem::take(&mut self.orders);
            let returns_state = std::mem::take(&mut self.returns_state);
            self.send(&ToService::Steps {
                orders,
                returns_state,
            })?;
        }
        self.executing.append(&mut self.comparisons);
        Ok(())
    }

    /// Receives the results of the batch under way and compares them.
    fn collect(&mut self, comparator: &mut Comparator, history: &History) -> Result<(), ProcessFailure> {
        if self.executing.is_empty() {
            return Ok(());
        }
        let ToOrchestrator::Stepped { not_finite, state } = self.compare()? else {
            return Err(self.gave_up(&"it did not do its steps"));
        };
        let mut place = 0;
        for comparisons in std::mem::take(&mut self.executing) {
            match comparisons {
                ComparatorMessage::Step {
                    tick,
                    is_finished,
                    is_compared,
                } => {
                    if !not_finite.contains(&place) {
                        let compare = |output: usize, bytes: &[u8]| {
                            if is_compared {
                                comparator.compare(output, bytes, is_finished, history);
                            }
                        };
                        self.receive_samples(tick, compare)?;
                    }
                    place += 1;
                    self.compared = Some(tick);
                }
                ComparatorMessage::State { tick, recorded } => {
                    comparator.compare_checkpoint(tick, state.as_deref().unwrap_or_default(), &recorded);
                }
                ComparatorMessage::EndOfTick => comparator.end_tick(history),
            }
        }
        Ok(())
    }

    /// Receives the samples that a step has published, in the order of its outputs.
    fn receive_samples(
        &mut self,
        tick: u64,
        mut compare: impl FnMut(usize, &[u8]),
    ) -> Result<(), ProcessFailure> {
        for at in 0..self.outputs.len() {
            let output = &mut self.outputs[at];
            if !output.is_due(tick) {
                continue;
            }
            match output.receive(tick) {
                Ok(Some(bytes)) => compare(at, bytes),
                Ok(None) => return Err(self.gave_up(&format!("a sample of tick {tick} was lost"))),
                Err(error) => return Err(self.gave_up(&error)),
            }
        }
        Ok(())
    }
}

impl Stepper for ServiceProcess {
    fn reset(&mut self) {
        self.state = StateBefore::Initial;
    }

    fn roll_back(&mut self) {
        self.state = StateBefore::BeforeLast;
    }

    fn resume(
        &mut self,
        state: &[u8],
        comparator: &mut Comparator,
        history: &History,
    ) -> Result<(), ReplayError> {
        self.make_ready()?;
        self.send_batch(comparator, history)?;
        self.state = StateBefore::AfterLast;
        let state = state.to_vec();
        Ok(self.send(&ToService::Restore { state })?)
    }

    fn step(
        &mut self,
        step: &Step<'_>,
        comparator: &mut Comparator,
        history: &History,
    ) -> Result<(), ReplayError> {
        if self.orders.len() == BATCH {
            self.send_batch(comparator, history)?;
        }
        self.make_ready()?;
        if step.gains != self.gains {
            self.send_batch(comparator, history)?;
            self.gains = step.gains;
            self.send(&ToService::Tune { gains: self.gains })?;
        }
        let order = self.order(step).map_err(|error| self.gave_up(&error))?;
        self.orders.push(order);
        self.comparisons.push(ComparatorMessage::Step {
            tick: step.now.tick,
            is_finished: step.is_finished,
            is_compared: step.is_compared,
        });
        Ok(())
    }

    fn compare_state(&mut self, tick: u64, recorded: &[u8], _comparator: &mut Comparator) {
        self.returns_state = true;
        let recorded = recorded.to_vec();
        self.comparisons.push(ComparatorMessage::State { tick, recorded });
    }

    fn end_tick(
        &mut self,
        tick: u64,
        comparator: &mut Comparator,
        history: &History,
    ) -> Result<(), ReplayError> {
        if let Some(ComparatorMessage::Step { .. } | ComparatorMessage::State { .. }) =
            self.comparisons.last()
        {
            self.comparisons.push(ComparatorMessage::EndOfTick);
        }
        // The process returns its state after the last step of a batch, so a batch ends here if the state is compared.
        let next = tick + 1;
        if self.returns_state || next >= self.batch_begins + BATCH as u64 {
            self.send_batch(comparator, history)?;
            self.batch_begins = next;
        }
        Ok(())
    }

    fn finish(&mut self, comparator: &mut Comparator, history: &History) -> Result<(), ReplayError> {
        self.send_batch(comparator, history)?;
        Ok(self.collect(comparator, history)?)
    }
}

impl Drop for ServiceProcess {
    /// Ends the process, killing it if it does not stop by itself.
    fn drop(&mut self) {
        if self.process.is_gone {
            return;
        }
        if self.process.channel.send(&ToService::Stop).is_ok() && self.is_ready {
            self.process.ends_within(STOP_LIMIT);
        }
        self.process.end();
    }
}
