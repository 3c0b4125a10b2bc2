//! Store of samples of an edge until they are due, for a restarted service and for planned faults.
//!
//! Ordinarily an input holds one sample, in shared memory. With planned late, lost or altered samples, the store holds copies
//! of all samples that will be due, and may alter the delivered one. Only such edges pay a copy and an allocation a sample.

use std::collections::BTreeMap;

use shared_types::schedule::Edge;
use shared_types::service::{InputView, header_of};

use crate::owned_sample::OwnedSample;

/// Samples of an edge that are or will be due.
#[derive(Clone)]
pub struct EdgeStore {
    edge: Edge,
    /// Copies by tick.
    samples: BTreeMap<u64, OwnedSample>,
    /// The altered sample that is delivered.
    altered: OwnedSample,
    /// Tick of the newest sample that has come, also of one that the plan loses.
    newest_come: Option<u64>,
}

impl EdgeStore {
    /// Makes an empty store of an edge.
    #[must_use]
    pub fn new(edge: Edge) -> Self {
        Self {
            samples: BTreeMap::new(),
            altered: OwnedSample::zeroed(edge.topic),
            newest_come: None,
            edge,
        }
    }

    /// Stores a sample, unless the plan loses it.
    pub fn keep(&mut self, bytes: &[u8]) {
        let tick = header_of(bytes).tick;
        self.newest_come = self.newest_come.max(Some(tick));
        if !self.edge.is_lost(tick) {
            let sample = OwnedSample::copy_of(self.edge.topic, bytes);
            self.samples.insert(tick, sample);
        }
    }

    /// Returns whether the sample of a tick, or a later one, has come, even if the plan loses it.
    #[must_use]
    pub fn has_come_to(&self, tick: u64) -> bool {
        self.newest_come >= Some(tick)
    }

    /// Drops the samples that are not needed once that of tick `due` is due.
    pub fn forget_before(&mut self, due: u64) {
        let oldest = self.oldest_needed(due);
        if self
            .samples
            .first_key_value()
            .is_some_and(|(&first, _)| first < oldest)
        {
            self.samples = self.samples.split_off(&oldest);
        }
    }

    /// Returns whether the store has the sample of tick `due`, and the one that it repeats.
    #[must_use]
    pub fn has(&self, due: u64) -> bool {
        let repeated = self.edge.repeated_by(due);
        self.samples.contains_key(&due) && repeated.is_none_or(|tick| self.samples.contains_key(&tick))
    }

    /// Returns the tick of the oldest sample that is needed once that of tick `due` is due.
    #[must_use]
    pub fn oldest_needed(&self, due: u64) -> u64 {
        self.edge.oldest_needed(due)
    }

    /// Returns the tick of the newest sample up to `due`.
    #[must_use]
    pub fn newest_at_or_before(&self, due: u64) -> Option<u64> {
        self.samples.range(..=due).next_back().map(|(&tick, _)| tick)
    }

    /// Returns the tick of the newest sample.
    #[must_use]
    pub fn newest(&self) -> Option<u64> {
        self.samples.last_key_value().map(|(&tick, _)| tick)
    }

    /// Returns the consumer's input at its step at `tick`, for which the sample of tick `due` is due; empty if it is missing.
    pub fn view(&mut self, tick: u64, due: u64) -> InputView<'_> {
        let Some(sample) = self.samples.get(&due) else {
            return InputView::default();
        };
        let fresh = self.edge.is_fresh(tick, due);
        let Some(corruption) = self.edge.corruption(due) else {
            return InputView {
                bytes: Some(sample.bytes()),
                fresh,
            };
        };
        self.altered.bytes_mut().copy_from_slice(sample.bytes());
        let repeated = self
            .edge
            .repeated_by(due)
            .and_then(|tick| self.samples.get(&tick));
        let altered = self.altered.bytes_mut();
        corruption.alter(due, repeated.map(OwnedSample::bytes), altered);
        InputView {
            bytes: Some(altered),
            fresh,
        }
    }
}
