//! Gains that were changed in flight, from the events in the log.

use std::collections::BTreeMap;

use scenario::{Key, Scenario};
use scenario_file::tuning::{from_event_text, tune};
use shared_types::Gains;
use shared_types::samples::RunEvent;
use shared_types::service::seconds;
use zerocopy::FromBytes;

use super::ReplayError;

/// Recorded changes of gains by number.
pub(super) struct RecordedTuning {
    /// Scenario after all changes so far, including the planned ones: an operator's changes are applied to them.
    scenario: Scenario,
    gains: BTreeMap<u64, Gains>,
    /// The changed keys, each with the time of its first change, s.
    pub(super) keys: Vec<(Key, f64)>,
}

impl RecordedTuning {
    pub(super) fn of(scenario: &Scenario) -> Self {
        Self {
            scenario: match scenario.planned_gains().last() {
                Some((_, gains)) => scenario.with_gains(gains),
                None => scenario.clone(),
            },
            gains: BTreeMap::new(),
            keys: Vec::new(),
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
        let tuned = tune(&self.scenario, setting).map_err(|error| ReplayError::Tuning(error.into()))?;
        self.scenario = tuned.scenario;
        if self.keys.iter().all(|(key, _)| *key != tuned.key) {
            self.keys.push((tuned.key, seconds(event.header.stamp_ns)));
        }
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

#[cfg(test)]
mod tests {
    use super::*;
    use run_log::test_flight;
    use scenario_file::tuning::event_text;
    use shared_types::Header;
    use zerocopy::{FromZeros, IntoBytes};

    #[test]
    fn the_first_change_of_each_key_is_recorded_with_its_time() {
        let mut tuning = RecordedTuning::of(&test_flight::scenario_of_own_controller(0.01, 4.0));
        for (number, setting) in (1..).zip(["controller.k1=3", "controller.k2=4", "controller.k1=5"]) {
            let stamp_ns = number * 1_000_000_000;
            let text = event_text(setting, number);
            let mut event = RunEvent {
                header: Header {
                    stamp_ns,
                    ..Header::new_zeroed()
                },
                kind: RunEvent::KIND_OPERATOR_TUNES,
                text_length: u32::try_from(text.len()).unwrap(),
                ..RunEvent::new_zeroed()
            };
            event.text[..text.len()].copy_from_slice(text.as_bytes());
            tuning.take(event.as_bytes()).unwrap();
        }
        let keys: Vec<_> = tuning
            .keys
            .iter()
            .map(|(key, time)| (key.to_string(), *time))
            .collect();
        let expected = [("controller.k1", 1.0), ("controller.k2", 2.0)];
        assert_eq!(keys, expected.map(|(key, time)| (key.to_owned(), time)));
    }
}
