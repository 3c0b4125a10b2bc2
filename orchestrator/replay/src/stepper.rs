//! Execution of a service's steps in a replay, by this process or a separate one.
//! [`ServiceReplay`](super::service_replay::ServiceReplay) determines the inputs in both cases.

use host::owned_sample::OwnedSample;
use host::step::{self, Slots, Timetable, Views};
use shared_types::schedule::MAX_PORTS;
use shared_types::service::ErasedService;
use shared_types::{Gains, Now, Schedule};

use super::ReplayError;
use super::comparator::Comparator;
use super::history::History;

/// Step to execute.
pub(super) struct Step<'a> {
    pub(super) now: Now,
    /// Gains in effect, if they were changed in flight.
    pub(super) gains: Option<Gains>,
    /// Views of the inputs.
    pub(super) views: Views<'a>,
    /// Sequence number of each input's recorded sample; `None` if a fault alters it.
    pub(super) as_recorded: [Option<u64>; MAX_PORTS],
    /// `true` if all samples of the step were published in the flight.
    pub(super) is_finished: bool,
    /// `true` if its samples are compared.
    pub(super) is_compared: bool,
}

/// Executes the steps of a service in their order, at once or later.
pub(super) trait Stepper {
    /// Makes the next step start from the service's initial state.
    fn reset(&mut self);

    /// Makes the next step start from the state before the last one.
    fn roll_back(&mut self);

    /// Makes the next step start from this state.
    fn resume(
        &mut self,
        state: &[u8],
        comparator: &mut Comparator,
        history: &History,
    ) -> Result<(), ReplayError>;

    /// Executes a step. Its samples are passed to the comparator at once or later; samples that are not finite are
    /// dropped, because a flight does not publish them.
    fn step(
        &mut self,
        step: &Step<'_>,
        comparator: &mut Comparator,
        history: &History,
    ) -> Result<(), ReplayError>;

    /// Compares the state after the last step, at `tick`, with a checkpoint, at once or later.
    fn compare_state(&mut self, tick: u64, recorded: &[u8], comparator: &mut Comparator);

    /// Ends a tick: all its steps have been passed. Called for every tick, so that a batch is not delayed too long.
    fn end_tick(
        &mut self,
        tick: u64,
        comparator: &mut Comparator,
        history: &History,
    ) -> Result<(), ReplayError>;

    /// Waits until all steps have been compared.
    fn finish(&mut self, comparator: &mut Comparator, history: &History) -> Result<(), ReplayError>;
}

/// Service in this process, which executes steps at once.
pub(super) struct InThisProcess {
    service: Box<dyn ErasedService>,
    timetable: Timetable,
    /// Initial state of the service.
    initial_state: Vec<u8>,
    /// State before the last step: a successor of a process that died during its step starts from it.
    before_last: Vec<u8>,
    outputs: Vec<OwnedSample>,
    /// Gains of the last step, if they were changed in flight.
    gains: Option<Gains>,
}

impl InThisProcess {
    pub(super) fn new(service: Box<dyn ErasedService>, schedule: &Schedule) -> Self {
        let timetable = Timetable::new(schedule, service.id());
        let mut initial_state = vec![0; service.state_size()];
        service.save(&mut initial_state);
        let outputs = timetable.outputs.iter();
        Self {
            service,
            before_last: initial_state.clone(),
            initial_state,
            outputs: outputs.map(|output| OwnedSample::zeroed(output.topic)).collect(),
            timetable,
            gains: None,
        }
    }
}

impl Stepper for InThisProcess {
    fn reset(&mut self) {
        self.service.restore(&self.initial_state);
    }

    fn roll_back(&mut self) {
        self.service.restore(&self.before_last);
    }

    fn resume(
        &mut self,
        state: &[u8],
        _comparator: &mut Comparator,
        _history: &History,
    ) -> Result<(), ReplayError> {
        self.service.restore(state);
        Ok(())
    }

    fn step(
        &mut self,
        step: &Step<'_>,
        comparator: &mut Comparator,
        history: &History,
    ) -> Result<(), ReplayError> {
        if step.gains != self.gains {
            self.service.tune(step.gains.as_ref());
            self.gains = step.gains;
        }
        self.service.save(&mut self.before_last);
        let tick = step.now.tick;
        let mut slots = Slots::default();
        let outputs = self.timetable.outputs.iter().zip(&mut self.outputs);
        for (slot, (output, sample)) in slots.iter_mut().zip(outputs) {
            if output.is_due(tick) {
                *slot = step::prepared(output.topic, output.header(tick), sample.bytes_mut());
            }
        }
        let done = self
            .timetable
            .step_at(self.service.as_mut(), &step.now, &step.views, &mut slots);
        if done.is_ok() && step.is_compared {
            for (output, slot) in slots.iter().enumerate() {
                if let Some(bytes) = slot.bytes.as_deref() {
                    comparator.compare(output, bytes, step.is_finished, history);
                }
            }
        }
        Ok(())
    }

    fn compare_state(&mut self, tick: u64, recorded: &[u8], comparator: &mut Comparator) {
        let mut state = vec![0; self.service.state_size()];
        self.service.save(&mut state);
        comparator.compare_checkpoint(tick, &state, recorded);
    }

    fn end_tick(
        &mut self,
        _tick: u64,
        comparator: &mut Comparator,
        history: &History,
    ) -> Result<(), ReplayError> {
        comparator.end_tick(history);
        Ok(())
    }

    fn finish(&mut self, _comparator: &mut Comparator, _history: &History) -> Result<(), ReplayError> {
        Ok(())
    }
}
