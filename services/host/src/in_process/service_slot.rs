//! A service of a flight in one process, with the sources of its inputs and the histories of its outputs.

use std::ops::Range;

use shared_types::Schedule;
use shared_types::finiteness::FinitenessCheck;
use shared_types::schedule::Edge;
use shared_types::service::{ErasedService, InputView, header_of};

use super::history::History;
use crate::edge_store::EdgeStore;
use crate::owned_sample::OwnedSample;
use crate::step::{self, Slots, Timetable, Views};

/// Service with its steps, inputs and outputs.
pub(super) struct ServiceSlot {
    pub(super) service: Box<dyn ErasedService>,
    /// State before the first step.
    initial_state: Vec<u8>,
    pub(super) timetable: Timetable,
    /// Inputs, in the order of the wiring table.
    feeds: Vec<Feed>,
    /// `true` if any input has planned faults.
    pub(super) has_stores: bool,
    /// Indices of the histories of the outputs. Outputs that the flight does not have come last in the wiring table.
    pub(super) own: Range<usize>,
    /// `true` if the saved state of the service is verified after each step.
    has_trials: bool,
    /// Outputs of the current step.
    drafts: Vec<OwnedSample>,
}

/// Source of an input.
struct Feed {
    edge: Edge,
    /// Index of the topic's history.
    source: usize,
    /// Latency in a `STEADY` flight, ticks; [`u64::MAX`] if the input is never due.
    steady_latency: u64,
    /// Samples that may be due, if faults of the input are planned.
    store: Option<Box<EdgeStore>>,
}

impl ServiceSlot {
    /// Makes the slot of a service. `histories` contain its inputs and outputs.
    pub(super) fn new(service: Box<dyn ErasedService>, schedule: &Schedule, histories: &[History]) -> Self {
        let id = service.id();
        let timetable = Timetable::new(schedule, id);
        let initial_state = state_of(service.as_ref());
        let place = |topic| {
            let mut topics = histories.iter().map(|history| history.publication.topic);
            let place = topics.position(|other| other == topic);
            place.expect("services consume what services publish")
        };
        let outputs: Vec<_> = schedule.outputs(service.id()).collect();
        let first_own = outputs.first().map_or(0, |output| place(output.topic));
        let feeds = timetable.inputs.iter().enumerate().map(|(input, edge)| Feed {
            source: place(edge.topic),
            steady_latency: match schedule.reads(id, input) {
                true => edge.latency,
                false => u64::MAX,
            },
            store: edge.has_faults().then(|| Box::new(EdgeStore::new(edge.clone()))),
            edge: edge.clone(),
        });
        Self {
            has_trials: service.has_trials(),
            service,
            initial_state,
            feeds: feeds.collect(),
            has_stores: timetable.inputs.iter().any(Edge::has_faults),
            own: first_own..first_own + outputs.len(),
            drafts: outputs
                .iter()
                .map(|output| OwnedSample::zeroed(output.topic))
                .collect(),
            timetable,
        }
    }

    /// Replaces the service, which starts from its present state.
    pub(super) fn replace(&mut self, service: Box<dyn ErasedService>) {
        self.initial_state = state_of(service.as_ref());
        self.has_trials = service.has_trials();
        self.service = service;
    }

    /// Returns whether the service steps at every tick, and no fault of its inputs is planned.
    pub(super) fn is_steady(&self) -> bool {
        self.timetable.steps.is_always() && !self.has_stores
    }

    /// Executes a step on the due samples, if one is due, and publishes the due outputs. In a `STEADY` flight all are due.
    ///
    /// # Panics
    /// If the service's saved state is incomplete.
    #[inline]
    pub(super) fn step<const STEADY: bool>(
        &mut self,
        histories: &mut [History],
        tick: u64,
        check: &mut FinitenessCheck,
    ) {
        if !STEADY {
            if !self.timetable.steps.occurs_at(tick) {
                return;
            }
            self.prepare(histories, tick);
        }
        let mut views = Views::default();
        let (inputs, outputs) = (
            self.timetable.service.inputs().len(),
            self.timetable.outputs.len(),
        );
        for (view, feed) in views.iter_mut().zip(&mut self.feeds) {
            feed.read::<STEADY>(histories, tick, view);
        }
        let mut slots = Slots::default();
        let drafts = slots.iter_mut().zip(&mut self.drafts);
        for ((slot, draft), history) in drafts.zip(&histories[self.own.clone()]) {
            if history.is_due::<STEADY>(tick) {
                let publication = &history.publication;
                *slot = step::prepared(publication.topic, publication.header(tick), draft.bytes_mut());
            }
        }
        let (inputs, outputs) = (&views[..inputs], &mut slots[..outputs]);
        self.service.step(&self.timetable.now(tick), inputs, outputs);
        for (draft, history) in self.drafts.iter_mut().zip(&mut histories[self.own.clone()]) {
            if history.is_due::<STEADY>(tick) {
                check.take_in(draft.bytes());
                history.publish::<STEADY>(tick, draft);
            }
        }
        if self.has_trials
            && let Err(reason) = self.service.try_saved_state()
        {
            panic!("{reason}");
        }
    }

    /// Resets the service at a planned cold start, and stores the samples of inputs with planned faults.
    fn prepare(&mut self, histories: &[History], tick: u64) {
        if self.timetable.is_cold_start_at(tick) {
            self.service.restore(&self.initial_state);
        }
        if self.has_stores {
            // Samples that are published later in the tick are due later.
            self.keep_published(histories, tick, |edge| edge.latency == 0);
        }
    }

    /// Stores the samples of `tick` for the `wanted` edges with planned faults.
    #[cold]
    pub(super) fn keep_published(
        &mut self,
        histories: &[History],
        tick: u64,
        wanted: impl Fn(&Edge) -> bool,
    ) {
        for feed in &mut self.feeds {
            let history = &histories[feed.source];
            if let Some(store) = &mut feed.store
                && wanted(&feed.edge)
                && history.publication.is_due(tick)
            {
                store.keep(history.bytes(tick));
            }
        }
    }

    /// Returns the stored samples of the inputs.
    pub(super) fn stores(&self) -> Vec<Option<Box<EdgeStore>>> {
        self.feeds.iter().map(|feed| feed.store.clone()).collect()
    }

    /// Restores the stored samples of the inputs.
    pub(super) fn restore_stores(&mut self, stores: &[Option<Box<EdgeStore>>]) {
        for (feed, store) in self.feeds.iter_mut().zip(stores) {
            feed.store.clone_from(store);
        }
    }
}

/// Returns the state of a service.
pub(super) fn state_of(service: &dyn ErasedService) -> Vec<u8> {
    let mut state = vec![0; service.state_size()];
    service.save(&mut state);
    state
}

impl Feed {
    /// Sets a view to the sample that is due at `tick`, if there is one.
    #[inline]
    fn read<'a, const STEADY: bool>(
        &'a mut self,
        histories: &'a [History],
        tick: u64,
        view: &mut InputView<'a>,
    ) {
        let due = if STEADY {
            tick.checked_sub(self.steady_latency)
        } else {
            self.edge.due_sample(tick)
        };
        let Some(due) = due else {
            return;
        };
        match &mut self.store {
            Some(store) if !STEADY => {
                store.forget_before(due);
                *view = store.view(tick, due);
            }
            _ => {
                let bytes = histories[self.source].bytes_of::<STEADY>(due);
                debug_assert_eq!(
                    header_of(bytes).tick,
                    due,
                    "histories hold all samples that may be due"
                );
                // Field by field: the copy of a whole view stalls on store forwarding of its last byte.
                view.bytes = Some(bytes);
                view.fresh = STEADY || self.edge.is_fresh(tick, due);
            }
        }
    }
}
