//! Gains that were changed in flight, from the events of the log.

use std::collections::BTreeMap;

use scenario::Scenario;
use scenario_file::tuning::{from_event_text, tune};
use shared_types::Gains;
use shared_types::samples::RunEvent;
use zerocopy::FromBytes;

use super::ReplayError;

/// The recorded changes, by their numbers.
pub(super) struct RecordedTuning {
    /// The scenario after the changes so far, the planned ones included: what an operator changes comes after them.
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

    /// Takes an event of the log, in their order. Several keys that changed at once are several events of one number: the
    /// last of them tells what holds.
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

    /// Returns the gains that hold after a change, `None` in it those of the scenario; `None` if nothing is known of the
    /// change.
    pub(super) fn gains(&self, number: u64) -> Option<Option<Gains>> {
        if number == 0 {
            return Some(None);
        }
        self.gains.get(&number).copied().map(Some)
    }
}
