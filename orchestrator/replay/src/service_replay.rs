//! Replay of one service: the inputs of each step, and the comparison of its samples.

use host::edge_store::EdgeStore;
use host::step::{Timetable, Views};
use run_log::Manifest;
use scenario::Recorded;
use shared_types::schedule::MAX_PORTS;
use shared_types::service::{InputView, header_of};
use shared_types::{Gains, Now, Schedule, ServiceId, Topic};

use super::ReplayError;
use super::checkpoints::RecordedCheckpoints;
use super::comparator::Comparator;
use super::compare::Comparison;
use super::history::{HISTORY, History};
use super::recorded_steps::{InputSequences, RecordedStep};
use super::scope::Scope;
use super::stepper::{Step, Stepper};
use super::tuning::RecordedTuning;

/// Replay of one service.
pub(super) struct ServiceReplay {
    stepper: Box<dyn Stepper>,
    timetable: Timetable,
    /// Ticks of the last step and of the one before it.
    last: Option<u64>,
    last_but_one: Option<u64>,
    /// `true` if the state of the service is unknown: a step consumed a sample that was not recorded.
    is_state_unknown: bool,
    /// Compared part of the flight; steps before it are executed, not compared.
    scope: Scope,
    /// First tick to execute: the service started from a checkpoint.
    begins_at: u64,
    /// Samples of each input with planned faults.
    stores: [Option<EdgeStore>; MAX_PORTS],
    /// Next sequence number for the store of each input.
    next_stored: [u64; MAX_PORTS],
    comparator: Comparator,
    pub(super) steps: u64,
    pub(super) steps_without_inputs: u64,
    /// Number of times that the service resumed from a checkpoint because its state was unknown.
    pub(super) resumptions: u64,
}

impl ServiceReplay {
    pub(super) fn new(
        service: ServiceId,
        schedule: &Schedule,
        stepper: Box<dyn Stepper>,
        scope: Scope,
        recorded: &[Recorded; Topic::ALL.len()],
        manifest: &Manifest,
    ) -> Self {
        let timetable = Timetable::new(schedule, service);
        let outputs = schedule.outputs(service);
        let outputs = outputs.map(|output| {
            let topic = output.topic;
            (topic, recorded[topic.index()], manifest.padding(topic))
        });
        let mut stores: [Option<EdgeStore>; MAX_PORTS] = Default::default();
        for (store, edge) in stores.iter_mut().zip(&timetable.inputs) {
            *store = edge.has_faults().then(|| EdgeStore::new(edge.clone()));
        }
        Self {
            stepper,
            last: None,
            last_but_one: None,
            is_state_unknown: false,
            scope,
            begins_at: 0,
            stores,
            next_stored: [0; MAX_PORTS],
            comparator: Comparator::new(outputs),
            timetable,
            steps: 0,
            steps_without_inputs: 0,
            resumptions: 0,
        }
    }

    /// Starts from the checkpoint before the step at `next_tick`.
    pub(super) fn begin_with(
        &mut self,
        next_tick: u64,
        state: &[u8],
        history: &History,
    ) -> Result<(), ReplayError> {
        self.last = next_tick.checked_sub(1);
        self.begins_at = next_tick;
        self.stepper.resume(state, &mut self.comparator, history)
    }

    pub(super) fn service(&self) -> ServiceId {
        self.timetable.service
    }

    /// Returns whether the service consumes or publishes a topic.
    pub(super) fn uses(&self, topic: Topic) -> bool {
        let mut inputs = self.timetable.inputs.iter();
        let mut outputs = self.timetable.outputs.iter();
        inputs.any(|edge| edge.topic == topic) || outputs.any(|output| output.topic == topic)
    }

    pub(super) fn begins_at(&self) -> u64 {
        self.begins_at
    }

    /// Returns the findings so far; they are complete after [`Self::settle`].
    pub(super) fn comparator(&self) -> &Comparator {
        &self.comparator
    }

    /// Waits until all steps have been compared.
    pub(super) fn settle(&mut self, history: &History) -> Result<(), ReplayError> {
        self.stepper.finish(&mut self.comparator, history)
    }

    pub(super) fn finish(self) -> impl Iterator<Item = Comparison> {
        self.comparator.into_comparisons()
    }

    /// Executes the step at `tick`, if there is one, with the inputs that the schedule determines.
    pub(super) fn step_as_scheduled(
        &mut self,
        tick: u64,
        history: &History,
        checkpoints: &RecordedCheckpoints,
    ) -> Result<(), ReplayError> {
        if self.timetable.steps.occurs_at(tick) {
            self.step_on_due(tick, history, checkpoints)?;
            self.compare_state(tick, checkpoints);
        }
        self.stepper.end_tick(tick, &mut self.comparator, history)
    }

    fn step_on_due(
        &mut self,
        tick: u64,
        history: &History,
        checkpoints: &RecordedCheckpoints,
    ) -> Result<(), ReplayError> {
        if tick < self.begins_at {
            self.follow(tick, history);
            return Ok(());
        }
        if self.timetable.is_cold_start_at(tick) {
            self.stepper.reset();
            self.is_state_unknown = false;
        } else if self.is_state_unknown {
            let previous = tick.checked_sub(1);
            let previous = previous.and_then(|before| self.timetable.steps.last_at_or_before(before));
            if !self.resume_after(previous, history, checkpoints)? {
                self.skip(tick, history);
                return Ok(());
            }
        }
        let mut seen = InputSequences::default();
        for (seen, edge) in seen.iter_mut().zip(&self.timetable.inputs) {
            *seen = edge
                .due_sample(tick)
                .map(|due| (edge.sequence_number(due), edge.is_fresh(tick, due)));
        }
        if self.lacks_repeated(tick, history) {
            self.skip(tick, history);
            return Ok(());
        }
        self.is_state_unknown = !self.step(self.timetable.now(tick), None, &seen, true, history)?;
        Ok(())
    }

    /// Returns whether a fault repeats an older sample that was not recorded.
    fn lacks_repeated(&mut self, tick: u64, history: &History) -> bool {
        self.fill_stores(tick, history);
        let mut inputs = self.stores.iter().zip(&self.timetable.inputs);
        inputs.any(|(store, edge)| {
            let due = edge.due_sample(tick);
            store
                .as_ref()
                .zip(due)
                .is_some_and(|(store, due)| !store.has(due))
        })
    }

    /// Executes the steps of a tick with their recorded inputs.
    pub(super) fn step_as_recorded(
        &mut self,
        tick: u64,
        steps: &[RecordedStep],
        tuning: &RecordedTuning,
        history: &History,
        checkpoints: &RecordedCheckpoints,
    ) -> Result<(), ReplayError> {
        if tick < self.begins_at {
            self.follow(tick, history);
            return Ok(());
        }
        for step in steps {
            self.repeat(step, tuning, history, checkpoints)?;
        }
        if !steps.is_empty() {
            self.compare_state(tick, checkpoints);
        }
        self.stepper.end_tick(tick, &mut self.comparator, history)
    }

    fn repeat(
        &mut self,
        recorded: &RecordedStep,
        tuning: &RecordedTuning,
        history: &History,
        checkpoints: &RecordedCheckpoints,
    ) -> Result<(), ReplayError> {
        // If a change of gains was not recorded, the results of all steps with it are unknown.
        let Some(gains) = tuning.gains(recorded.tuning) else {
            self.skip(recorded.tick, history);
            (self.last, self.last_but_one) = (None, None);
            return Ok(());
        };
        let previous = recorded.previous;
        if !self.roll_back_to(previous) && !self.resume_after(previous, history, checkpoints)? {
            self.skip(recorded.tick, history);
            return Ok(());
        }
        let now = Now {
            operator: recorded.operator,
            ..self.timetable.now_after(recorded.previous, recorded.tick)
        };
        self.is_state_unknown = !self.step(now, gains, &recorded.seen, recorded.is_finished, history)?;
        if self.is_state_unknown {
            (self.last, self.last_but_one) = (None, None);
        } else {
            self.last_but_one = self.last.replace(recorded.tick);
        }
        Ok(())
    }

    /// Resumes from the checkpoint after the step at `previous`, if there is one.
    fn resume_after(
        &mut self,
        previous: Option<u64>,
        history: &History,
        checkpoints: &RecordedCheckpoints,
    ) -> Result<bool, ReplayError> {
        let Some(state) = previous.and_then(|previous| checkpoints.after(previous)) else {
            return Ok(false);
        };
        self.stepper.resume(state, &mut self.comparator, history)?;
        self.last = previous;
        self.is_state_unknown = false;
        self.resumptions += 1;
        Ok(true)
    }

    /// Skips a step that cannot be repeated.
    fn skip(&mut self, tick: u64, history: &History) {
        self.is_state_unknown = true;
        self.steps_without_inputs += u64::from(self.scope.contains(tick));
        self.follow(tick, history);
    }

    /// Stores the samples up to a tick without a step: a fault may repeat them later.
    fn follow(&mut self, tick: u64, history: &History) {
        self.fill_stores(tick, history);
        let long_ago = tick.saturating_sub(HISTORY as u64);
        for (store, edge) in self.stores.iter_mut().zip(&self.timetable.inputs) {
            if let (Some(store), Some(due)) = (store, edge.due_sample(long_ago)) {
                store.forget_before(due);
            }
        }
    }

    /// After a recorded restart, rolls back to the checkpoint that the new process started from: it is from before or
    /// after the dead process's last step. Returns `false` if that state is not available, because the log begins later
    /// or a step could not be repeated.
    fn roll_back_to(&mut self, previous: Option<u64>) -> bool {
        if previous.is_none() {
            self.stepper.reset();
        } else if previous == self.last {
            return true;
        } else if previous == self.last_but_one {
            self.stepper.roll_back();
        } else {
            return false;
        }
        self.last = previous;
        true
    }

    /// Executes a step; `false` if one of its inputs was not recorded.
    fn step(
        &mut self,
        now: Now,
        gains: Option<Gains>,
        seen: &InputSequences,
        is_finished: bool,
        history: &History,
    ) -> Result<bool, ReplayError> {
        self.fill_stores(now.tick, history);
        let is_compared = self.scope.contains(now.tick);
        let mut views = Views::default();
        let mut as_recorded = [None; MAX_PORTS];
        let inputs = self.timetable.inputs.iter().zip(&mut self.stores);
        let places = views.iter_mut().zip(&mut as_recorded);
        for (((view, as_recorded), seen), (edge, store)) in places.zip(seen).zip(inputs) {
            let Some((seq, fresh)) = *seen else { continue };
            let Some(bytes) = history.sample(edge.topic, seq) else {
                // The inputs of this step are unknown, and so are all states that follow from it.
                self.steps_without_inputs += u64::from(is_compared);
                return Ok(false);
            };
            *as_recorded = store.is_none().then_some(seq);
            *view = match store {
                Some(store) => {
                    let due = header_of(bytes).tick;
                    store.forget_before(due);
                    InputView {
                        fresh,
                        ..store.view(now.tick, due)
                    }
                }
                None => InputView {
                    bytes: Some(bytes),
                    fresh,
                },
            };
        }
        let step = Step {
            now,
            gains,
            views,
            as_recorded,
            is_finished,
            is_compared,
        };
        self.stepper.step(&step, &mut self.comparator, history)?;
        self.steps += u64::from(is_compared);
        Ok(true)
    }

    /// Compares the state after the step at `tick` with its checkpoint, if there is one.
    fn compare_state(&mut self, tick: u64, checkpoints: &RecordedCheckpoints) {
        if let Some(recorded) = checkpoints.after(tick)
            && self.scope.contains(tick)
            && self.scope.checkpoints
            && !self.is_state_unknown
        {
            self.stepper.compare_state(tick, recorded, &mut self.comparator);
        }
    }

    /// Stores the samples up to a tick for every input with planned faults.
    fn fill_stores(&mut self, tick: u64, history: &History) {
        let edges = self.timetable.inputs.iter().zip(&mut self.stores);
        for ((edge, store), next) in edges.zip(&mut self.next_stored) {
            let Some(store) = store else { continue };
            let end = edge.sequence_number(tick + 1);
            for seq in *next..end {
                if let Some(bytes) = history.sample(edge.topic, seq) {
                    store.keep(bytes);
                }
            }
            *next = end;
        }
    }
}
