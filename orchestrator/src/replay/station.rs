//! One service in a replay: what it sees at each step, what it publishes, and whether that is what was recorded.

use runtime::edge_store::EdgeStore;
use runtime::step::{Timetable, Views};
use shared_types::schedule::MAX_PORTS;
use shared_types::service::{InputView, header_of};
use shared_types::{Now, Schedule, ServiceId};

use super::ReplayError;
use super::compare::Comparison;
use super::history::History;
use super::judge::Jury;
use super::recorded_steps::RecordedStep;
use super::stepper::{Step, Stepper};

/// What a step sees of an input: the sequence number of the sample, and whether the step before saw another one.
pub(super) type Seen = [Option<(u64, bool)>; MAX_PORTS];

/// A service that does its steps again.
pub(super) struct Station {
    stepper: Box<dyn Stepper>,
    timetable: Timetable,
    /// Ticks of the last step and of the one before it.
    last: Option<u64>,
    last_but_one: Option<u64>,
    /// Of each input with planned faults, what has come.
    stores: [Option<EdgeStore>; MAX_PORTS],
    /// Of each input, the next sample that its store wants.
    next_stored: [u64; MAX_PORTS],
    jury: Jury,
    pub(super) steps: u64,
    pub(super) steps_without_inputs: u64,
}

impl Station {
    pub(super) fn new(service: ServiceId, schedule: &Schedule, stepper: Box<dyn Stepper>) -> Self {
        let timetable = Timetable::new(schedule, service);
        let mut stores: [Option<EdgeStore>; MAX_PORTS] = Default::default();
        for (store, edge) in stores.iter_mut().zip(&timetable.inputs) {
            *store = edge.has_faults().then(|| EdgeStore::new(edge.clone()));
        }
        Self {
            stepper,
            last: None,
            last_but_one: None,
            stores,
            next_stored: [0; MAX_PORTS],
            jury: Jury::new(timetable.outputs.iter().map(|output| output.topic)),
            timetable,
            steps: 0,
            steps_without_inputs: 0,
        }
    }

    pub(super) fn service(&self) -> ServiceId {
        self.timetable.service
    }

    /// Returns when all steps have been compared.
    pub(super) fn settle(&mut self, history: &History) -> Result<(), ReplayError> {
        self.stepper.finish(&mut self.jury, history)
    }

    pub(super) fn finish(self) -> impl Iterator<Item = Comparison> {
        self.jury.into_comparisons()
    }

    /// Does the step at `tick`, if there is one, on the samples that the schedule has due.
    pub(super) fn step_as_scheduled(&mut self, tick: u64, history: &History) -> Result<(), ReplayError> {
        if self.timetable.steps.occurs_at(tick) {
            self.step_on_due(tick, history)?;
        }
        self.end_tick(tick, history)
    }

    fn step_on_due(&mut self, tick: u64, history: &History) -> Result<(), ReplayError> {
        if self.timetable.begins_anew_at(tick) {
            self.stepper.begin_anew();
        }
        let mut seen = Seen::default();
        for (seen, edge) in seen.iter_mut().zip(&self.timetable.inputs) {
            *seen = edge
                .due_sample(tick)
                .map(|due| (edge.sequence_number(due), edge.is_fresh(tick, due)));
        }
        self.step(self.timetable.now(tick), &seen, true, history)?;
        Ok(())
    }

    /// Does the steps of a tick on the samples that they are recorded to have seen.
    pub(super) fn step_as_recorded(
        &mut self,
        tick: u64,
        steps: &[RecordedStep],
        history: &History,
    ) -> Result<(), ReplayError> {
        for step in steps {
            self.do_again(step, history)?;
        }
        self.end_tick(tick, history)
    }

    fn do_again(&mut self, recorded: &RecordedStep, history: &History) -> Result<(), ReplayError> {
        if !self.remember_only(recorded.previous) {
            self.steps_without_inputs += 1;
            return Ok(());
        }
        let now = Now {
            operator: recorded.operator,
            ..self.timetable.now_after(recorded.previous, recorded.tick)
        };
        if self.step(now, &recorded.seen, recorded.is_finished, history)? {
            self.last_but_one = self.last.replace(recorded.tick);
        } else {
            (self.last, self.last_but_one) = (None, None);
        }
        Ok(())
    }

    /// Goes back to what a process knew that took another one's place, if one did: the step after which the dead one
    /// had kept what it knew was its last or the one before.
    /// `false` if that is not known here: the log begins later, or a step that led to it could not be done.
    fn remember_only(&mut self, previous: Option<u64>) -> bool {
        if previous.is_none() {
            self.stepper.begin_anew();
        } else if previous == self.last {
            return true;
        } else if previous == self.last_but_one {
            self.stepper.go_back();
        } else {
            return false;
        }
        self.last = previous;
        true
    }

    /// Has a step done; `false` if a sample that it saw was not recorded.
    fn step(
        &mut self,
        now: Now,
        seen: &Seen,
        is_finished: bool,
        history: &History,
    ) -> Result<bool, ReplayError> {
        self.fill_stores(now.tick, history);
        let mut views = Views::default();
        let mut as_recorded = [None; MAX_PORTS];
        let inputs = self.timetable.inputs.iter().zip(&mut self.stores);
        let places = views.iter_mut().zip(&mut as_recorded);
        for (((view, as_recorded), seen), (edge, store)) in places.zip(seen).zip(inputs) {
            let Some((seq, fresh)) = *seen else { continue };
            let Some(bytes) = history.sample(edge.topic, seq) else {
                // What this step saw is not known, and so is nothing that it led to.
                self.steps_without_inputs += 1;
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
            views,
            as_recorded,
            is_finished,
        };
        self.stepper.step(&step, &mut self.jury, history)?;
        self.steps += 1;
        Ok(true)
    }

    fn end_tick(&mut self, tick: u64, history: &History) -> Result<(), ReplayError> {
        self.stepper.end_tick(tick, &mut self.jury, history)
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
