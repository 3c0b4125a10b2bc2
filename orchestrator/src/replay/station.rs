//! One service in a replay: what it sees at each step, what it publishes, and whether that is what was recorded.

use runtime::edge_store::EdgeStore;
use runtime::owned_sample::OwnedSample;
use runtime::step::{self, Slots, Timetable, Views};
use shared_types::scenario::Scenario;
use shared_types::schedule::MAX_PORTS;
use shared_types::service::{ErasedService, InputView, header_of};
use shared_types::{Now, Schedule, ServiceId};

use super::checkpoints::RecordedCheckpoints;
use super::compare::Comparison;
use super::history::{History, KEPT};
use super::judge::Judge;
use super::machine::RecordedStep;
use super::scope::Scope;
use crate::services;

/// What a step sees of an input: the sequence number of the sample, and whether the step before saw another one.
pub(super) type Seen = [Option<(u64, bool)>; MAX_PORTS];

/// A service that does its steps again.
pub(super) struct Station {
    service: Box<dyn ErasedService>,
    timetable: Timetable,
    /// The service's state before its first step.
    newborn: Vec<u8>,
    /// The state before the last step: who dies in its step goes on from there.
    before_last: Vec<u8>,
    /// Ticks of the last step and of the one before it.
    last: Option<u64>,
    last_but_one: Option<u64>,
    /// Whether what the service knows by now cannot be known here: a step saw a sample that was not recorded.
    is_lost: bool,
    /// What is compared; before it steps are only done.
    scope: Scope,
    /// Steps before this tick are not done: the service began with what it is recorded to have known.
    begins_at: u64,
    /// Of each input with planned faults, what has come.
    stores: [Option<EdgeStore>; MAX_PORTS],
    /// Of each input, the next sample that its store wants.
    next_stored: [u64; MAX_PORTS],
    judges: Vec<Judge>,
    outputs: Vec<OwnedSample>,
    pub(super) steps: u64,
    pub(super) steps_without_inputs: u64,
    /// How often it went on from a recorded checkpoint because what the service knew could not be known otherwise.
    pub(super) resumptions: u64,
    pub(super) checkpoints: u64,
    pub(super) checkpoints_different: u64,
    /// Tick of the first step after which the service knew something else than is recorded.
    pub(super) first_different_after: Option<u64>,
}

impl Station {
    pub(super) fn new(
        service: ServiceId,
        scenario: &Scenario,
        schedule: &Schedule,
        scope: Scope,
    ) -> Result<Self, String> {
        let timetable = Timetable::new(schedule, service);
        let service = services::build(service, scenario)?;
        let mut newborn = vec![0; service.state_size()];
        service.save(&mut newborn);
        let mut stores: [Option<EdgeStore>; MAX_PORTS] = Default::default();
        for (store, edge) in stores.iter_mut().zip(&timetable.inputs) {
            *store = edge.has_faults().then(|| EdgeStore::new(edge.clone()));
        }
        Ok(Self {
            service,
            before_last: newborn.clone(),
            newborn,
            last: None,
            last_but_one: None,
            is_lost: false,
            scope,
            begins_at: 0,
            stores,
            next_stored: [0; MAX_PORTS],
            judges: timetable
                .outputs
                .iter()
                .map(|output| Judge::new(output.topic))
                .collect(),
            outputs: timetable
                .outputs
                .iter()
                .map(|output| OwnedSample::of(output.topic))
                .collect(),
            timetable,
            steps: 0,
            steps_without_inputs: 0,
            resumptions: 0,
            checkpoints: 0,
            checkpoints_different: 0,
            first_different_after: None,
        })
    }

    /// Begins with what the service is recorded to have known before its step at `next_tick` or the first one after it.
    pub(super) fn begin_with(&mut self, next_tick: u64, state: &[u8]) {
        self.service.restore(state);
        self.last = next_tick.checked_sub(1);
        self.begins_at = next_tick;
    }

    pub(super) fn service(&self) -> ServiceId {
        self.timetable.service
    }

    /// The tick of the first step that it may do.
    pub(super) fn begins_at(&self) -> u64 {
        self.begins_at
    }

    pub(super) fn finish(self) -> impl Iterator<Item = Comparison> {
        self.judges.into_iter().map(Judge::into_comparison)
    }

    /// Does the step at `tick`, if there is one, on the samples that the schedule has due.
    pub(super) fn step_as_scheduled(
        &mut self,
        tick: u64,
        history: &History,
        checkpoints: &RecordedCheckpoints,
    ) {
        if !self.timetable.steps.occurs_at(tick) {
            return;
        }
        if tick < self.begins_at {
            self.follow(tick, history);
            return;
        }
        if self.timetable.begins_anew_at(tick) {
            self.service.restore(&self.newborn);
            self.is_lost = false;
        } else if self.is_lost {
            let previous = tick.checked_sub(1);
            let previous = previous.and_then(|before| self.timetable.steps.last_at_or_before(before));
            if !self.resume_after(previous, checkpoints) {
                self.leave_out(tick, history);
                return;
            }
        }
        let mut seen = Seen::default();
        for (seen, edge) in seen.iter_mut().zip(&self.timetable.inputs) {
            *seen = edge
                .due_sample(tick)
                .map(|due| (edge.sequence_number(due), edge.is_fresh(tick, due)));
        }
        if self.lacks_repeated(tick, history) {
            self.leave_out(tick, history);
            return;
        }
        self.is_lost = !self.step(&self.timetable.now(tick), &seen, true, history);
        self.end_tick(tick, history, checkpoints);
    }

    /// Whether a fault has a step see the content of an older sample that was not recorded.
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

    /// Does the steps of a tick on the samples that they are recorded to have seen.
    pub(super) fn step_as_recorded(
        &mut self,
        tick: u64,
        steps: &[RecordedStep],
        history: &History,
        checkpoints: &RecordedCheckpoints,
    ) {
        if tick < self.begins_at {
            self.follow(tick, history);
            return;
        }
        for step in steps {
            self.do_again(step, history, checkpoints);
        }
        if !steps.is_empty() {
            self.end_tick(tick, history, checkpoints);
        }
    }

    fn do_again(&mut self, recorded: &RecordedStep, history: &History, checkpoints: &RecordedCheckpoints) {
        if !self.remember_only(recorded.previous) && !self.resume_after(recorded.previous, checkpoints) {
            self.leave_out(recorded.tick, history);
            return;
        }
        let now = Now {
            operator: recorded.operator,
            ..self.timetable.now_after(recorded.previous, recorded.tick)
        };
        self.before_last.resize(self.service.state_size(), 0);
        self.service.save(&mut self.before_last);
        self.is_lost = !self.step(&now, &recorded.seen, recorded.is_finished, history);
        if self.is_lost {
            (self.last, self.last_but_one) = (None, None);
        } else {
            self.last_but_one = self.last.replace(recorded.tick);
        }
    }

    /// Goes on with what the service is recorded to have known after its step at `previous`, if it is.
    fn resume_after(&mut self, previous: Option<u64>, checkpoints: &RecordedCheckpoints) -> bool {
        let Some(state) = previous.and_then(|previous| checkpoints.after(previous)) else {
            return false;
        };
        self.service.restore(state);
        self.last = previous;
        self.is_lost = false;
        self.resumptions += 1;
        true
    }

    /// Leaves out a step that cannot be done again.
    fn leave_out(&mut self, tick: u64, history: &History) {
        self.is_lost = true;
        self.steps_without_inputs += u64::from(self.scope.contains(tick));
        self.follow(tick, history);
    }

    /// Keeps what has come by a tick at which nothing is done: a later step may see it.
    fn follow(&mut self, tick: u64, history: &History) {
        self.fill_stores(tick, history);
        let long_ago = tick.saturating_sub(KEPT as u64);
        for (store, edge) in self.stores.iter_mut().zip(&self.timetable.inputs) {
            if let (Some(store), Some(due)) = (store, edge.due_sample(long_ago)) {
                store.forget_before(due);
            }
        }
    }

    /// Goes back to what a process knew that took another one's place, if one did: the step after which the dead one
    /// had kept what it knew was its last or the one before.
    /// `false` if that is not known here: the log begins later, or a step that led to it could not be done.
    fn remember_only(&mut self, previous: Option<u64>) -> bool {
        if previous.is_none() {
            self.service.restore(&self.newborn);
        } else if previous == self.last {
            return true;
        } else if previous == self.last_but_one {
            self.service.restore(&self.before_last);
        } else {
            return false;
        }
        self.last = previous;
        true
    }

    /// Steps and hears what is published; `false` if a sample that the step saw was not recorded.
    fn step(&mut self, now: &Now, seen: &Seen, is_finished: bool, history: &History) -> bool {
        self.fill_stores(now.tick, history);
        let mut views = Views::default();
        let inputs = self.timetable.inputs.iter().zip(&mut self.stores);
        for ((view, seen), (edge, store)) in views.iter_mut().zip(seen).zip(inputs) {
            let Some((seq, fresh)) = *seen else { continue };
            let Some(bytes) = history.sample(edge.topic, seq) else {
                // What this step saw is not known, and so is nothing that it led to.
                self.steps_without_inputs += u64::from(self.scope.contains(now.tick));
                return false;
            };
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
        let mut slots = Slots::default();
        for ((slot, output), sample) in slots
            .iter_mut()
            .zip(&self.timetable.outputs)
            .zip(&mut self.outputs)
        {
            if output.is_due(now.tick) {
                *slot = step::prepared(output.topic, output.header(now.tick), sample.bytes_mut());
            }
        }
        // What was not finite was never published: there is nothing to compare it with.
        let finite = self
            .timetable
            .step_at(self.service.as_mut(), now, &views, &mut slots)
            .is_ok();
        if !self.scope.contains(now.tick) {
            return true;
        }
        self.steps += 1;
        for (slot, judge) in slots.iter().zip(&mut self.judges) {
            if let Some(bytes) = slot.bytes.as_deref().filter(|_| finite) {
                judge.hear(bytes, is_finished, history);
            }
        }
        true
    }

    fn end_tick(&mut self, tick: u64, history: &History, checkpoints: &RecordedCheckpoints) {
        for judge in &mut self.judges {
            judge.end_tick(history);
        }
        if let Some(recorded) = checkpoints.after(tick)
            && self.scope.contains(tick)
            && self.scope.checkpoints
            && !self.is_lost
        {
            self.compare_state(tick, recorded);
        }
    }

    /// Compares what the service knows after its step at `tick` with what it is recorded to have known.
    fn compare_state(&mut self, tick: u64, recorded: &[u8]) {
        let mut state = vec![0; self.service.state_size()];
        self.service.save(&mut state);
        self.checkpoints += 1;
        if state != recorded {
            self.checkpoints_different += 1;
            self.first_different_after.get_or_insert(tick);
        }
    }

    /// Lets every input with planned faults have the samples up to a tick.
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
