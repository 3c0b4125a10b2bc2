//! One service in a replay: what it sees at each step, what it publishes, and whether that is what was recorded.

use runtime::edge_store::EdgeStore;
use runtime::owned_sample::OwnedSample;
use runtime::step::{self, Slots, Timetable, Views};
use shared_types::scenario::Scenario;
use shared_types::schedule::MAX_PORTS;
use shared_types::service::{ErasedService, InputView, header_of};
use shared_types::{Now, Schedule, ServiceId};

use super::compare::Comparison;
use super::history::History;
use super::judge::Judge;
use super::recorded_steps::RecordedStep;
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
    /// Of each input with planned faults, what has come.
    stores: [Option<EdgeStore>; MAX_PORTS],
    /// Of each input, the next sample that its store wants.
    next_stored: [u64; MAX_PORTS],
    judges: Vec<Judge>,
    outputs: Vec<OwnedSample>,
    pub(super) steps: u64,
    pub(super) steps_without_inputs: u64,
}

impl Station {
    pub(super) fn new(service: ServiceId, scenario: &Scenario, schedule: &Schedule) -> Result<Self, String> {
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
        })
    }

    pub(super) fn service(&self) -> ServiceId {
        self.timetable.service
    }

    pub(super) fn finish(self) -> impl Iterator<Item = Comparison> {
        self.judges.into_iter().map(Judge::into_comparison)
    }

    /// Does the step at `tick`, if there is one, on the samples that the schedule has due.
    pub(super) fn step_as_scheduled(&mut self, tick: u64, history: &History) {
        if !self.timetable.steps.occurs_at(tick) {
            return;
        }
        if self.timetable.begins_anew_at(tick) {
            self.service.restore(&self.newborn);
        }
        let mut seen = Seen::default();
        for (seen, edge) in seen.iter_mut().zip(&self.timetable.inputs) {
            *seen = edge
                .due_sample(tick)
                .map(|due| (edge.sequence_number(due), edge.is_fresh(tick, due)));
        }
        self.step(&self.timetable.now(tick), &seen, true, history);
        self.end_tick(history);
    }

    /// Does the steps of a tick on the samples that they are recorded to have seen.
    pub(super) fn step_as_recorded(&mut self, steps: &[RecordedStep], history: &History) {
        for step in steps {
            self.do_again(step, history);
        }
        self.end_tick(history);
    }

    fn do_again(&mut self, recorded: &RecordedStep, history: &History) {
        if !self.remember_only(recorded.previous) {
            self.steps_without_inputs += 1;
            return;
        }
        let now = Now {
            operator: recorded.operator,
            ..self.timetable.now_after(recorded.previous, recorded.tick)
        };
        self.before_last.resize(self.service.state_size(), 0);
        self.service.save(&mut self.before_last);
        if self.step(&now, &recorded.seen, recorded.is_finished, history) {
            self.last_but_one = self.last.replace(recorded.tick);
        } else {
            (self.last, self.last_but_one) = (None, None);
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
                self.steps_without_inputs += 1;
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
        self.steps += 1;
        for (slot, judge) in slots.iter().zip(&mut self.judges) {
            if let Some(bytes) = slot.bytes.as_deref().filter(|_| finite) {
                judge.hear(bytes, is_finished, history);
            }
        }
        true
    }

    fn end_tick(&mut self, history: &History) {
        for judge in &mut self.judges {
            judge.end_tick(history);
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
