//! Process or thread that does the steps of a service in a replay. For both the [`ServiceReplay`](super::service_replay::ServiceReplay) says what they see.

use host::owned_sample::OwnedSample;
use host::step::{self, Slots, Timetable, Views};
use shared_types::schedule::MAX_PORTS;
use shared_types::service::ErasedService;
use shared_types::{Gains, Now, Schedule};

use super::ReplayError;
use super::comparator::Comparator;
use super::history::History;

/// A step that is to be done.
pub(super) struct Step<'a> {
    /// Its moment.
    pub(super) now: Now,
    /// The gains that held, if they had been changed in flight.
    pub(super) gains: Option<Gains>,
    /// Its views of the inputs.
    pub(super) views: Views<'a>,
    /// Of each input, the sequence number of the recorded sample that it sees; none where it is altered on its way.
    pub(super) as_recorded: [Option<u64>; MAX_PORTS],
    /// `true` if all that it had to publish was published in the flight.
    pub(super) is_finished: bool,
    /// `true` if the comparator is to hear of it.
    pub(super) is_compared: bool,
}

/// Does the steps of a service, in their order, now or later.
pub(super) trait Stepper {
    /// The next step shall know what the service knew before its first one.
    fn begin_anew(&mut self);

    /// The next step shall know what the service knew before the last one.
    fn go_back(&mut self);

    /// The next step shall know this.
    fn resume(
        &mut self,
        state: &[u8],
        comparator: &mut Comparator,
        history: &History,
    ) -> Result<(), ReplayError>;

    /// Does a step. The comparator hears, sooner or later, what comes of it; of what is not finite nothing, for it was never
    /// published.
    fn step(
        &mut self,
        step: &Step<'_>,
        comparator: &mut Comparator,
        history: &History,
    ) -> Result<(), ReplayError>;

    /// Lets the comparator compare, sooner or later, what the service knows after the step at `tick`, which was told just before.
    fn compare_state(&mut self, tick: u64, recorded: &[u8], comparator: &mut Comparator);

    /// All steps of a tick have been told. Called for every tick, so that nothing is put off for too long.
    fn end_tick(
        &mut self,
        tick: u64,
        comparator: &mut Comparator,
        history: &History,
    ) -> Result<(), ReplayError>;

    /// All steps have been told: returns when the comparator has heard of all of them.
    fn finish(&mut self, comparator: &mut Comparator, history: &History) -> Result<(), ReplayError>;
}

/// A service in this process, which does its steps at once.
pub(super) struct InThisProcess {
    service: Box<dyn ErasedService>,
    timetable: Timetable,
    /// The service's state before its first step.
    newborn: Vec<u8>,
    /// The state before the last step: who dies in its step goes on from there.
    before_last: Vec<u8>,
    outputs: Vec<OwnedSample>,
    /// The gains of the last step, if they had been changed in flight.
    gains: Option<Gains>,
}

impl InThisProcess {
    pub(super) fn new(service: Box<dyn ErasedService>, schedule: &Schedule) -> Self {
        let timetable = Timetable::new(schedule, service.id());
        let mut newborn = vec![0; service.state_size()];
        service.save(&mut newborn);
        let outputs = timetable.outputs.iter();
        Self {
            service,
            before_last: newborn.clone(),
            newborn,
            outputs: outputs.map(|output| OwnedSample::of(output.topic)).collect(),
            timetable,
            gains: None,
        }
    }
}

impl Stepper for InThisProcess {
    fn begin_anew(&mut self) {
        self.service.restore(&self.newborn);
    }

    fn go_back(&mut self) {
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
                    comparator.hear(output, bytes, step.is_finished, history);
                }
            }
        }
        Ok(())
    }

    fn compare_state(&mut self, tick: u64, recorded: &[u8], comparator: &mut Comparator) {
        let mut state = vec![0; self.service.state_size()];
        self.service.save(&mut state);
        comparator.hear_state(tick, &state, recorded);
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
