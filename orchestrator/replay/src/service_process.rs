//! A service that does its steps in a process of its own.
//!
//! Steps are told in batches: while the process does one, the next is read from the log and published. So what comes of a
//! step is heard some hundred ticks later, in the order in which the steps were told.

mod failure;
mod ports;

use std::time::{Duration, Instant};

use runtime::control::{ControlError, ToOrchestrator, ToService};
use runtime::control::{Memory, StepOrder};
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
use flight::interrupt::Interrupt;
use supervisor::supervision::process::Process;
use supervisor::supervision::{READY_LIMIT, STOP_LIMIT};

/// Time that a process may take for a batch of steps: some thousand times as long as it takes.
const BATCH_LIMIT: Duration = READY_LIMIT;

/// Period at which the end of the replay is checked.
const LOOK_PERIOD: Duration = Duration::from_millis(100);

fn timespec(duration: Duration) -> Timespec {
    Timespec {
        tv_sec: i64::try_from(duration.as_secs()).unwrap_or(i64::MAX),
        tv_nsec: i64::from(duration.subsec_nanos()),
    }
}

/// Messages to the comparator, in their order.
enum ComparatorMessage {
    /// A step; whether it was finished in the flight, and whether it is compared.
    Step {
        tick: u64,
        is_finished: bool,
        is_compared: bool,
    },
    /// The recorded state of the service after the last step of a batch.
    State { tick: u64, recorded: Vec<u8> },
    /// No more steps of a tick follow.
    EndOfTick,
}

/// A service in a process of its own. Dropping it ends the process.
pub(super) struct ServiceProcess {
    service: ServiceId,
    process: Process,
    interrupt: Interrupt,
    inputs: Vec<InputPort>,
    outputs: Vec<OutputPort>,
    /// `true` if it has made its ports.
    is_ready: bool,
    /// The state before the step that is told next.
    memory: Memory,
    /// The gains of the step that was told last, if they had been changed in flight.
    gains: Option<Gains>,
    /// The steps that are to be handed over next.
    orders: Vec<StepOrder>,
    told: Vec<ComparatorMessage>,
    /// `true` if the process is to tell what it knows after them.
    tells_state: bool,
    /// The work of the process.
    under_way: Vec<ComparatorMessage>,
    /// The tick from which on the next batch is.
    batch_begins: u64,
    /// The last tick of which a step was compared.
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
            memory: Memory::default(),
            gains: None,
            orders: Vec::with_capacity(BATCH),
            told: Vec::new(),
            tells_state: false,
            under_way: Vec::new(),
            batch_begins: 0,
            compared: None,
        }
    }

    /// Tells the process something. One that is gone is found so when its answer is awaited.
    pub(super) fn say(&self, message: &ToService) -> Result<(), ProcessFailure> {
        match self.process.channel.send(message) {
            Ok(()) | Err(ControlError::Closed) => Ok(()),
            Err(error) => Err(self.gave_up(&error)),
        }
    }

    /// Waits until the process has made its ports, and lets it begin. Before, nothing may be published for it.
    fn make_ready(&mut self) -> Result<(), ProcessFailure> {
        if self.is_ready {
            return Ok(());
        }
        let ToOrchestrator::Ready { .. } = self.hear()? else {
            return Err(self.gave_up(&"it did not get ready"));
        };
        let senders = self.inputs.iter_mut().map(InputPort::connect);
        let receivers = self.outputs.iter_mut().map(OutputPort::connect);
        let connected: Result<(), PortError> = senders.chain(receivers).collect();
        connected.map_err(|error| self.gave_up(&error))?;
        self.is_ready = true;
        self.say(&ToService::Go {
            restarted: false,
            start_ns: 0,
        })
    }

    /// The next thing that the process says.
    fn hear(&mut self) -> Result<ToOrchestrator, ProcessFailure> {
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
            // The end of the process closes its channel. After an interrupted sleep all is looked at again.
            let mut channel = [PollFd::new(&self.process.channel, PollFlags::IN)];
            let _ = poll(&mut channel, Some(&timespec(LOOK_PERIOD)));
        }
    }

    fn how_far(&self) -> String {
        let before_any = || "before any of its steps was compared".to_owned();
        let compared = |tick| format!("after its step at tick {tick} was compared");
        self.compared.map_or_else(before_any, compared)
    }

    fn died(&mut self) -> ProcessFailure {
        // One that ends closes its line a little before.
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

    /// Publishes what a step sees; how it is told.
    fn order(&mut self, step: &Step<'_>) -> Result<StepOrder, PortError> {
        let mut order = StepOrder {
            now: step.now,
            memory: std::mem::take(&mut self.memory),
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

    /// Lets the process do the steps that have been told, once it has done those before.
    fn hand_over(&mut self, comparator: &mut Comparator, history: &History) -> Result<(), ProcessFailure> {
        self.collect(comparator, history)?;
        if !self.orders.is_empty() {
            let orders = std::mem::take(&mut self.orders);
            let tells_state = std::mem::take(&mut self.tells_state);
            self.say(&ToService::Steps { orders, tells_state })?;
        }
        self.under_way.append(&mut self.told);
        Ok(())
    }

    /// Lets the comparator hear what has come of the steps that the process was doing.
    fn collect(&mut self, comparator: &mut Comparator, history: &History) -> Result<(), ProcessFailure> {
        if self.under_way.is_empty() {
            return Ok(());
        }
        let ToOrchestrator::Stepped { not_finite, state } = self.hear()? else {
            return Err(self.gave_up(&"it did not do its steps"));
        };
        let mut place = 0;
        for told in std::mem::take(&mut self.under_way) {
            match told {
                ComparatorMessage::Step {
                    tick,
                    is_finished,
                    is_compared,
                } => {
                    if !not_finite.contains(&place) {
                        let hear = |output: usize, bytes: &[u8]| {
                            if is_compared {
                                comparator.hear(output, bytes, is_finished, history);
                            }
                        };
                        self.listen(tick, hear)?;
                    }
                    place += 1;
                    self.compared = Some(tick);
                }
                ComparatorMessage::State { tick, recorded } => {
                    comparator.hear_state(tick, state.as_deref().unwrap_or_default(), &recorded);
                }
                ComparatorMessage::EndOfTick => comparator.end_tick(history),
            }
        }
        Ok(())
    }

    /// Takes what a step has published, output by output.
    fn listen(&mut self, tick: u64, mut hear: impl FnMut(usize, &[u8])) -> Result<(), ProcessFailure> {
        for at in 0..self.outputs.len() {
            let output = &mut self.outputs[at];
            if !output.is_due(tick) {
                continue;
            }
            match output.receive(tick) {
                Ok(Some(bytes)) => hear(at, bytes),
                Ok(None) => return Err(self.gave_up(&format!("a sample of tick {tick} was lost"))),
                Err(error) => return Err(self.gave_up(&error)),
            }
        }
        Ok(())
    }
}

impl Stepper for ServiceProcess {
    fn begin_anew(&mut self) {
        self.memory = Memory::Newborn;
    }

    fn go_back(&mut self) {
        self.memory = Memory::BeforeLast;
    }

    fn resume(
        &mut self,
        state: &[u8],
        comparator: &mut Comparator,
        history: &History,
    ) -> Result<(), ReplayError> {
        self.make_ready()?;
        self.hand_over(comparator, history)?;
        self.memory = Memory::AfterLast;
        let state = state.to_vec();
        Ok(self.say(&ToService::Know { state })?)
    }

    fn step(
        &mut self,
        step: &Step<'_>,
        comparator: &mut Comparator,
        history: &History,
    ) -> Result<(), ReplayError> {
        if self.orders.len() == BATCH {
            self.hand_over(comparator, history)?;
        }
        self.make_ready()?;
        if step.gains != self.gains {
            self.hand_over(comparator, history)?;
            self.gains = step.gains;
            self.say(&ToService::Tune { gains: self.gains })?;
        }
        let order = self.order(step).map_err(|error| self.gave_up(&error))?;
        self.orders.push(order);
        self.told.push(ComparatorMessage::Step {
            tick: step.now.tick,
            is_finished: step.is_finished,
            is_compared: step.is_compared,
        });
        Ok(())
    }

    fn compare_state(&mut self, tick: u64, recorded: &[u8], _comparator: &mut Comparator) {
        self.tells_state = true;
        let recorded = recorded.to_vec();
        self.told.push(ComparatorMessage::State { tick, recorded });
    }

    fn end_tick(
        &mut self,
        tick: u64,
        comparator: &mut Comparator,
        history: &History,
    ) -> Result<(), ReplayError> {
        if let Some(ComparatorMessage::Step { .. } | ComparatorMessage::State { .. }) = self.told.last() {
            self.told.push(ComparatorMessage::EndOfTick);
        }
        // What the service knows it tells after the last step of a batch.
        let next = tick + 1;
        if self.tells_state || next >= self.batch_begins + BATCH as u64 {
            self.hand_over(comparator, history)?;
            self.batch_begins = next;
        }
        Ok(())
    }

    fn finish(&mut self, comparator: &mut Comparator, history: &History) -> Result<(), ReplayError> {
        self.hand_over(comparator, history)?;
        Ok(self.collect(comparator, history)?)
    }
}

impl Drop for ServiceProcess {
    /// Ends the process, whatever it does.
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
