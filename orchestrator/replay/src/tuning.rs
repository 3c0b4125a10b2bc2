//! Gains that were changed in flight, from the events in the log.

use std::collections::BTreeMap;

use scenario::Scenario;
use scenario_file::tuning::{from_event_text, tune};
use shared_types::Gains;
use shared_types::samples::RunEvent;
use zerocopy::FromBytes;

use super::ReplayError;

/// Recorded changes of gains by number.
pub(super) struct RecordedTuning {
    /// Scenario after all changes so far, including the planned ones: an operator's changes are applied to them.
    scenario: Scenario,
    gains: BTreeMap<u64, Gains>,
}

impl RecordedTuning {
    pub(super) fn of(scenario: &Scenario) -> Self {
        Self {
            scenario: match scenario.planned_gains().last() {
                Some((_, gains)) => scenario.with_gains(gains),
                None => scenario.clone(),
            },
            gains: BTreeMap::new(),
        }
    }

    /// Applies the next event of the log. Several keys that changed at once are several events of one number; the last
    /// one completes the change.
    pub(super) fn take(&mut self, event: &[u8]) -> Result<(), ReplayError> {
        let event = RunEvent::read_from_bytes(event).ok();
        let event = event.filter(|event| event.kind == RunEvent::KIND_OPERATOR_TUNES);
        let Some(event) = event else { return Ok(()) };
        let words = event.words();
        let (setting, number) = from_event_text(&words)
            .ok_or_else(|| ReplayError::Tuning(format!("`{words}` is not a change of a gain").into()))?;
        let tuned = tune(&self.scenario, setting);
        self.scenario = tuned.map_err(|error| ReplayError::Tuning(error.into()))?.scenario;
        self.gains.insert(number, self.scenario.gains());
        Ok(())
    }

    /// Returns the gains after a change, where `None` inside means those of the scenario; `None` if the change was not
    /// recorded.
    pub(super) fn gains(&self, number: u64) -> Option<Option<Gains>> {
        if number == 0 {
            return Some(None);
        }
        self.gains.get(&number).copied().map(Some)
    }
}
