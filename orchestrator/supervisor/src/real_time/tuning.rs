//! Gains that an operator changes in flight: validated like a scenario, sent to all services, recorded as events.

use scenario::{Problem, Scenario};
use scenario_file::gain_rules::{self, Finding};
use scenario_file::tuning::{Values, event_text, settings_between, tunable_keys, tune};
use shared_types::samples::RunEvent;
use shared_types::service::{nanoseconds, seconds};
use shared_types::{FlightPhase, ServiceId};
use zerocopy::FromZeros;

use super::Flight;
use run_client::Answer;

/// Delay from a request until the change takes effect, s: long enough for every service to read it, unless the machine
/// is late.
const NOTICE: f64 = 0.02;

/// Maximum number of keys in a change.
const MAX_KEYS: usize = 16;

impl Flight<'_> {
    /// Changes keys from one tick on, and records the change; all of them or none.
    pub(super) fn tune(&mut self, settings: &[String]) -> Answer {
        match self.try_to_tune(settings) {
            Ok(text) => {
                self.record_event(&text);
                Answer::Done(format!("{text} in {}", self.identity()))
            }
            Err(reason) => Answer::Refused(format!("not set: {reason} ({})", self.identity())),
        }
    }

    /// Returns the present values of keys, or of all tunable ones.
    pub(super) fn tuned(&self, names: &[String]) -> Answer {
        let flown = Values::new(&self.as_flown());
        let all = names.is_empty().then(tunable_keys).unwrap_or_default();
        let values: Result<Vec<_>, _> = names.iter().chain(&all).map(|name| flown.setting(name)).collect();
        match values {
            Ok(values) => Answer::Values(values),
            Err(reason) => Answer::Refused(reason),
        }
    }

    fn try_to_tune(&mut self, settings: &[String]) -> Result<String, String> {
        if settings.is_empty() || settings.len() > MAX_KEYS {
            return Err(format!(
                "give 1 to {MAX_KEYS} settings, such as `controller.k1=3`"
            ));
        }
        self.check_tunable()?;
        let before = self.as_flown();
        let mut scenario = before.clone();
        let mut stated = Vec::new();
        for setting in settings {
            let tuned = tune(&scenario, setting).map_err(|error| error.to_string())?;
            scenario = tuned.scenario;
            stated.push(tuned.key);
        }
        let changed = settings_between(&before, &scenario, &stated);
        if self.is_in_the_air()
            && let Some(problem) = newly_unsafe(&before, &scenario)
        {
            return Err(format!(
                "the vehicle is in the air, and {}: {}; {}",
                problem.key, problem.reason, problem.fix
            ));
        }
        let from_tick = self.clock.tick() + nanoseconds(NOTICE).div_ceil(self.schedule.tick_ns());
        if from_tick > self.schedule.last_tick() {
            return Err("the flight ends before the change takes effect".to_owned());
        }
        let number = self.next_change();
        let events: Vec<_> = changed
            .iter()
            .map(|setting| event_text(setting, number))
            .collect();
        if let Some(text) = events
            .iter()
            .find(|text| text.len() > RunEvent::new_zeroed().text.len())
        {
            return Err(format!(
                "`{text}` is too long for an event of the log; write fewer digits"
            ));
        }
        self.supervisor
            .page()
            .control_block()
            .tuning
            .change(from_tick, &scenario.gains());
        self.record_changes(from_tick, events);
        self.tuned = Some(scenario);
        let time = seconds(self.schedule.time_ns(from_tick));
        Ok(format!("{} from {time:.3} s on", changed.join(", ")))
    }

    fn check_tunable(&self) -> Result<(), String> {
        if self.scenario.is_foreign(ServiceId::Controller) {
            return Err(
                "a plug-in or a program flies in place of the controller, and has its own gains".to_owned(),
            );
        }
        if !self.scenario.controller.law.is_adaptive() {
            return Err(
                "only the adaptive law (`controller.law = \"adaptive\"`) has gains that change in flight"
                    .to_owned(),
            );
        }
        let planned = self.scenario.planned_gains();
        match planned
            .last()
            .filter(|(from_tick, _)| *from_tick > self.clock.tick())
        {
            Some((from_tick, _)) => {
                let time = seconds(self.schedule.time_ns(*from_tick));
                Err(format!(
                    "the scenario plans changes of gains up to {time} s; try again after the last one"
                ))
            }
            None => Ok(()),
        }
    }

    /// Returns the scenario with the gains in effect.
    fn as_flown(&self) -> Scenario {
        if let Some(tuned) = &self.tuned {
            return tuned.clone();
        }
        let planned = self.scenario.planned_gains();
        let begun = planned.partition_point(|(from_tick, _)| *from_tick <= self.clock.tick());
        let gains = planned[..begun].last().map(|(_, gains)| *gains);
        self.scenario
            .with_gains(&gains.unwrap_or_else(|| self.scenario.gains()))
    }

    fn is_in_the_air(&self) -> bool {
        !matches!(self.phase(), Some(FlightPhase::Disarmed | FlightPhase::Armed))
    }

    fn next_change(&self) -> u64 {
        let last = self.supervisor.page().control_block().tuning.last();
        last.map_or(0, |(number, _)| number) + 1
    }

    fn record_changes(&mut self, from_tick: u64, texts: Vec<String>) {
        let events = texts
            .into_iter()
            .map(|text| (from_tick, RunEvent::KIND_OPERATOR_TUNES, text.into()));
        self.pending_events.extend(events);
    }

    /// After a take-over, reads the last change of gains from the control block, and records it at the first tick of
    /// this log: without it, the rest of the flight could not be replayed.
    pub(super) fn inherit_tuning(&mut self) {
        let Some((number, gains)) = self.supervisor.page().control_block().tuning.last() else {
            return;
        };
        let tuned = self.scenario.with_gains(&gains);
        let values = Values::new(&tuned);
        let settings = tunable_keys()
            .into_iter()
            .filter_map(|key| values.setting(&key).ok());
        let events = settings.map(|setting| event_text(&setting, number)).collect();
        self.record_changes(self.recorder.ticks(), events);
        self.tuned = Some(tuned);
    }
}

/// Returns the first rule between gains and vehicle that a change violates and that was met before.
fn newly_unsafe(before: &Scenario, after: &Scenario) -> Option<Problem> {
    let before = gain_rules::findings(before);
    let was_kept = |finding: &Finding| {
        let is_same = |old: &&Finding| (old.rule, &old.key) == (finding.rule, &finding.key);
        before.iter().find(is_same).is_none_or(Finding::is_kept)
    };
    let mut after = gain_rules::findings(after).into_iter();
    let broken = after.find(|finding| !finding.is_kept() && was_kept(finding));
    broken.map(|finding| finding.warning())
}

#[cfg(test)]
mod tests {
    use super::*;
    use run_log::test_flight::scenario;

    #[test]
    fn a_change_is_unsafe_if_it_breaks_a_rule_that_was_kept() {
        let before = scenario(0.001, 20.0);
        assert_eq!(newly_unsafe(&before, &before), None);
        let mut after = before.clone();
        after.controller.beta = Some(before.beta() / 100.0);
        let problem = newly_unsafe(&before, &after).unwrap();
        assert!(problem.fix.contains("controller.beta"), "{problem:?}");
        assert_eq!(newly_unsafe(&after, &after), None);
    }
}
