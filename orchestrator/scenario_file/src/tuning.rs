//! Changes of a scenario in flight, for the keys that its schema marks as tunable (`x-tunable`).
//!
//! The changed scenario is checked as a whole, with the same rules, reasons and fixes as any scenario.

use std::path::Path;

use scenario::{Key, Scenario};

use super::setting::path_of;
use super::{ScenarioError, keys, load_text};
use crate::printable::printable;

/// Scenario after a change.
#[derive(Clone, Debug, PartialEq)]
pub struct Tuned {
    /// The scenario.
    pub scenario: Scenario,
    /// The tunable key that was set.
    pub key: Key,
}

/// Reason why a key cannot be changed in flight.
#[derive(Debug, thiserror::Error)]
pub enum TuningError {
    /// The key may not change.
    #[error(
        "`{key}` cannot change in flight: {reason}; {}; tunable are {}",
        "state it in the scenario before the flight",
        tunable_keys().join(", ")
    )]
    NotTunable {
        /// The key.
        key: String,
        /// Reason why.
        reason: &'static str,
    },
    /// The change is invalid, or the scenario cannot be flown with it.
    #[error("{}", .0.without_positions())]
    Scenario(#[source] ScenarioError),
    /// The scenario cannot be written.
    #[error("the scenario cannot be written: {0}")]
    Unwritable(#[from] toml::ser::Error),
}

/// Returns the keys that may change in flight.
#[must_use]
pub fn tunable_keys() -> Vec<String> {
    keys::tunable().map(|key| key.to_string()).collect()
}

/// Changes a key of a scenario in flight; `setting` has the form of `--set`, such as `controller.k1=3`.
///
/// # Errors
/// [`TuningError`].
pub fn tune(scenario: &Scenario, setting: &str) -> Result<Tuned, TuningError> {
    let (name, _) = setting.split_once('=').unwrap_or((setting, ""));
    // Invalid and unknown keys are refused below with their reason.
    let key = path_of(name).unwrap_or_default();
    if keys::is_tunable(&key) == Some(false) {
        return Err(TuningError::NotTunable {
            key: key.to_string(),
            reason: "services read it once, at their start",
        });
    }
    let text = super::to_toml(scenario)?;
    let flown = Path::new("the scenario in flight");
    let scenario = load_text(flown, &text, &[setting.to_owned()], None).map_err(TuningError::Scenario)?;
    Ok(Tuned { scenario, key })
}

/// Returns the settings that change one scenario to another: those of the tunable keys whose values differ, including
/// derived ones, and of those that are `stated`.
#[must_use]
pub fn settings_between(before: &Scenario, after: &Scenario, stated: &[Key]) -> Vec<String> {
    let is_stated = |key: &Key| {
        stated
            .iter()
            .any(|stated| stated.segments().starts_with(key.segments()))
    };
    let [before, after] = [before, after].map(Values::new);
    let changed = keys::tunable().filter_map(|key| {
        let now = after.get(&key)?;
        let is_new = is_stated(&key) || before.get(&key).as_ref() != Some(&now);
        is_new.then(|| format!("{key}={now}"))
    });
    changed.collect()
}

/// Values of the keys of a scenario.
#[derive(Debug)]
pub struct Values {
    stated: toml::Value,
    /// The gains, which follow from others where they are not stated.
    gains: toml::Value,
}

impl Values {
    /// Collects the values of a scenario.
    ///
    /// # Panics
    /// If the scenario has a value that TOML does not have.
    #[must_use]
    pub fn new(scenario: &Scenario) -> Self {
        let text = super::to_toml(scenario).expect("a scenario was read from TOML");
        let gains = toml::Value::try_from(scenario.gains()).expect("gains are numbers");
        Self {
            stated: toml::from_str(&text).expect("just written"),
            gains,
        }
    }

    /// Returns the value of a key as TOML: stated or derived.
    fn get(&self, key: &Key) -> Option<String> {
        let inside = |value: &toml::Value, segment: &String| match value {
            toml::Value::Array(elements) => elements.get(segment.parse::<usize>().ok()?).cloned(),
            value => value.get(segment).cloned(),
        };
        let mut segments = key.segments().iter();
        let stated = segments.try_fold(self.stated.clone(), |value, segment| inside(&value, segment));
        let follows = || match key.segments() {
            [section, gain] if section == "controller" => self.gains.get(gain).cloned(),
            _ => None,
        };
        stated.or_else(follows).map(|value| value.to_string())
    }

    /// Returns key and value as a setting: `controller.k1=3.0`.
    ///
    /// # Errors
    /// A message if the scenario has no such value.
    pub fn setting(&self, name: &str) -> Result<String, String> {
        let key = path_of(name);
        let value = key.as_ref().and_then(|key| self.get(key));
        let setting = key.zip(value).map(|(key, value)| format!("{key}={value}"));
        setting.ok_or_else(|| {
            format!(
                "the scenario in flight states no `{}`; docs/scenarios.md lists the keys",
                printable(name)
            )
        })
    }
}

/// Formats a setting of a change as the text of an event. A change of several keys has an event for each.
#[must_use]
pub fn event_text(setting: &str, number: u64) -> String {
    format!("{setting} (change {number})")
}

/// Parses the text of an event from [`event_text`].
#[must_use]
pub fn from_event_text(text: &str) -> Option<(&str, u64)> {
    let (setting, rest) = text.strip_suffix(')')?.rsplit_once(" (change ")?;
    Some((setting, rest.parse().ok()?))
}

#[cfg(test)]
mod tests {
    use super::*;
    use scenario::LawKind;

    fn flown() -> Scenario {
        let text = include_str!("../../../scenarios/fig3_6.toml");
        let scenario = load_text(Path::new("fig3_6.toml"), text, &[], None).unwrap();
        scenario.with_gains(&scenario.gains())
    }

    /// A fitting other value of a key.
    fn other_value(key: &str) -> &'static str {
        match key {
            "controller.lambda_disturbance" => "[1.5, 2.5, 3.5]",
            _ => "1.25",
        }
    }

    #[test]
    fn every_tunable_key_is_one_of_the_gains_and_an_event_repeats_it_to_the_bit() {
        let before = flown();
        let keys = tunable_keys();
        assert!(keys.len() >= 8, "{keys:?}");
        for (number, key) in keys.iter().enumerate() {
            let number = number as u64 + 1;
            let tuned = tune(&before, &format!("{key} = {}", other_value(key))).unwrap();
            assert_ne!(tuned.scenario.gains(), before.gains(), "{key}");
            let settings = settings_between(&before, &tuned.scenario, &[tuned.key]);
            assert_eq!(settings, [Values::new(&tuned.scenario).setting(key).unwrap()]);
            let text = event_text(&settings[0], number);
            let (setting, found) = from_event_text(&text).unwrap();
            assert_eq!(found, number);
            assert_eq!(tune(&before, setting).unwrap().scenario, tuned.scenario);
        }
        assert_eq!(from_event_text("gerono arm"), None);
    }

    #[test]
    fn what_a_scenario_may_not_state_or_services_read_once_is_refused_with_the_reason() {
        let before = flown();
        let refused = |setting: &str| tune(&before, setting).unwrap_err().to_string();
        for (setting, words) in [
            ("controller.k1=-3", "is not above 0; give a number above 0"),
            ("controller.k1=1e-3", "raise `sigma_max`"),
            ("controller.law=px4", "cannot change in flight"),
            (
                "controller.delta=0.2",
                "tunable are controller.beta, controller.k1",
            ),
            ("vehicle.mass=1.0", "cannot change in flight"),
            ("controller.kk=3", "did you mean `k1`?"),
            ("controller.k1=fast", "a number is expected here"),
            ("controller.k1", "there is no `=`"),
            ("", "there is no `=`"),
            ("=3", "this is not a key"),
        ] {
            let text = refused(setting);
            assert!(text.contains(words), "{setting}: {text}");
        }
        assert_eq!(before.controller.law, LawKind::Adaptive);
    }

    #[test]
    fn a_value_inside_of_a_tunable_one_can_be_set() {
        let before = flown();
        let tuned = tune(&before, "controller.lambda_disturbance.2=4").unwrap();
        let [x, y, _] = before.controller.lambda_disturbance;
        assert_eq!(tuned.scenario.controller.lambda_disturbance, [x, y, 4.0]);
        let settings = settings_between(&before, &tuned.scenario, &[tuned.key]);
        assert_eq!(settings.len(), 1);
        assert!(
            settings[0].starts_with("controller.lambda_disturbance=["),
            "{settings:?}"
        );
        // A key that has its value already is told too, if it was asked for.
        let same = tune(&before, "controller.k1=4.0").unwrap();
        assert_eq!(
            settings_between(&before, &same.scenario, &[same.key]),
            ["controller.k1=4.0"]
        );
    }
}
