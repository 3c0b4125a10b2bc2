//! Recorded checkpoints of a service.

use std::collections::BTreeMap;

/// Checkpoints of one service, by the tick of the first step that each does not include.
#[derive(Debug, Default)]
pub(super) struct RecordedCheckpoints(BTreeMap<u64, Vec<u8>>);

impl RecordedCheckpoints {
    pub(super) fn keep(&mut self, next_tick: u64, state: Vec<u8>) {
        self.0.insert(next_tick, state);
    }

    /// Returns the state after the step at a tick, if it was recorded.
    pub(super) fn after(&self, tick: u64) -> Option<&[u8]> {
        self.0.get(&(tick + 1)).map(Vec::as_slice)
    }

    /// Returns the newest checkpoint that includes no step at `tick` or later, with the tick of the first step that it
    /// does not include.
    pub(super) fn newest_before(&self, tick: u64) -> Option<(u64, &[u8])> {
        let (&next_tick, state) = self.0.range(..=tick).next_back()?;
        Some((next_tick, state))
    }

    /// Removes the checkpoints older than the newest one before a tick.
    pub(super) fn remove_old(&mut self, tick: u64) {
        if let Some(newest) = self.newest_before(tick).map(|(next_tick, _)| next_tick) {
            while self.0.first_entry().is_some_and(|oldest| *oldest.key() < newest) {
                self.0.pop_first();
            }
        }
    }
}
