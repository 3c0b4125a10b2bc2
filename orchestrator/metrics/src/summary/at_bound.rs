//! Estimates at the bounds of the projection (5): the vehicle violates Assumption 1, or another estimate is wrong.

use std::fmt::{Display, Formatter, Result};

use scenario::{Bounds, Scenario};
use serde::Serialize;

use super::Parameters;

/// An estimate at its bound at the end of a phase.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct AtBound {
    /// When, s.
    pub time: f64,
    /// The estimate, by the symbol of the paper.
    pub estimate: &'static str,
    /// Its value, kg or m/s².
    pub value: f64,
    /// The bound, in the same unit.
    pub bound: f64,
    /// The key of the bound.
    pub key: &'static str,
    #[serde(skip)]
    calibrated: Calibrated,
}

/// What of the vehicle the scenario calibrates: a wrong calibration looks like a force.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Calibrated {
    /// The thrust at the channels of a radio link.
    thrust: bool,
    /// The attitude of the body in the cameras.
    attitude: bool,
}

impl Calibrated {
    /// Returns what a scenario calibrates.
    pub(super) fn in_scenario(scenario: &Scenario) -> Self {
        Self {
            thrust: scenario.rc_output.is_some(),
            attitude: scenario.motion_capture.is_some(),
        }
    }
}

/// Returns the estimates at their bounds at this time, s.
pub(super) fn at_bound(
    (bounds, calibrated): (&Bounds, Calibrated),
    time: f64,
    parameters: &Parameters,
) -> Vec<AtBound> {
    let mut found = Vec::new();
    let mut look = |estimate, value: f64, [least, largest]: [f64; 2], keys: [&'static str; 2]| {
        let passed = if value <= least {
            Some((least, keys[0]))
        } else if value >= largest {
            Some((largest, keys[1]))
        } else {
            None
        };
        found.extend(passed.map(|(bound, key)| AtBound {
            time,
            estimate,
            value,
            bound,
            key,
            calibrated,
        }));
    };
    if let Some(mass) = parameters.mass_estimate {
        let keys = ["controller.bounds.mass_min", "controller.bounds.mass_max"];
        look("m̂", mass, [bounds.mass_min, bounds.mass_max], keys);
    }
    let components = parameters.disturbance_estimate.into_iter().flatten();
    for (name, component) in ["b̂x", "b̂y", "b̂z"].into_iter().zip(components) {
        let keys = [DISTURBANCE; 2];
        look(name, component, [-bounds.disturbance, bounds.disturbance], keys);
    }
    found
}

impl AtBound {
    /// Returns what else than a bound that is too narrow may be the cause, with what to do about it.
    fn advice(&self) -> String {
        let Self { key, calibrated, .. } = self;
        let is_mass = *key != DISTURBANCE;
        if !is_mass && self.estimate != "b̂z" {
            let attitude = if calibrated.attitude {
                ": `motion_capture.body_from_markers`"
            } else {
                ""
            };
            return format!(
                "Find what pushes it sideways: wind, or an attitude that is not level when the vehicle is{attitude}. If nothing is \
                 wrong, set `{key}` wider."
            );
        }
        let wider = if is_mass {
            format!("`{key}` or `{DISTURBANCE}`")
        } else {
            format!("`{key}`")
        };
        if calibrated.thrust {
            return format!(
                "First compare the thrust with its calibration: `gerono rc identify` finds `rc_output.thrust_offset` and \
                 `thrust_slope`. Then weigh the vehicle for `controller.initial.mass`. If both are right, set {wider} wider."
            );
        }
        format!("Weigh the vehicle for `controller.initial.mass`. If it is right, set {wider} wider.")
    }
}

/// Key of the bound of a disturbance.
const DISTURBANCE: &str = "controller.bounds.disturbance";

impl Display for AtBound {
    fn fmt(&self, formatter: &mut Formatter<'_>) -> Result {
        let Self {
            time,
            estimate,
            value,
            bound,
            key,
            ..
        } = self;
        let unit = if *key == DISTURBANCE { "m/s²" } else { "kg" };
        write!(
            formatter,
            "At {time} s {estimate} = {value:.3} {unit} rests at its bound of {bound:?} {unit}, so that what is beyond it is \
             not compensated. {}",
            self.advice()
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn found(mass: f64, disturbance: [f64; 3]) -> Vec<(&'static str, &'static str)> {
        let parameters = Parameters {
            mass_estimate: Some(mass),
            disturbance_estimate: Some(disturbance),
            ..Parameters::default()
        };
        let found = at_bound((&Bounds::default(), Calibrated::default()), 30.0, &parameters);
        found.iter().map(|found| (found.estimate, found.key)).collect()
    }

    #[test]
    fn estimates_within_their_bounds_or_without_a_sample_are_not_told() {
        assert_eq!(found(0.2, [0.3, -0.2, 2.9]), []);
        let bounds = (&Bounds::default(), Calibrated::default());
        assert_eq!(at_bound(bounds, 30.0, &Parameters::default()), []);
    }

    #[test]
    fn an_estimate_that_the_projection_holds_is_told_with_its_key() {
        let (most, least) = ("controller.bounds.mass_max", "controller.bounds.mass_min");
        let disturbance = "controller.bounds.disturbance";
        assert_eq!(found(0.601, [0.0; 3]), [("m̂", most)]);
        assert_eq!(found(0.099, [0.0; 3]), [("m̂", least)]);
        assert_eq!(
            found(0.2, [3.02, 0.0, -3.1]),
            [("b̂x", disturbance), ("b̂z", disturbance)]
        );
    }

    #[test]
    fn a_thrust_beside_its_calibration_is_named_before_a_mass_is_stated() {
        let told = |calibrated, mass, disturbance| {
            let parameters = Parameters {
                mass_estimate: Some(mass),
                disturbance_estimate: Some(disturbance),
                ..Parameters::default()
            };
            let found = at_bound((&Bounds::default(), calibrated), 30.0, &parameters);
            found.iter().map(ToString::to_string).collect::<String>()
        };
        let laboratory = Calibrated {
            thrust: true,
            attitude: true,
        };
        for (mass, vertical) in [(0.2, -3.1), (0.2, 3.1), (0.099, 0.0), (0.601, 0.0)] {
            let text = told(laboratory, mass, [0.0, 0.0, vertical]);
            let place = |words: &str| text.find(words).unwrap_or_else(|| panic!("{words}: {text}"));
            assert!(place("`gerono rc identify`") < place("`controller.initial.mass`"));
            assert!(place("thrust_slope") < place("set `controller.bounds"));
        }
        let simulated = told(Calibrated::default(), 0.2, [0.0, 0.0, -3.1]);
        assert!(simulated.contains("Weigh the vehicle") && !simulated.contains("rc identify"));
        // Neither a mass nor a thrust pushes sideways.
        let sideways = told(laboratory, 0.2, [3.1, 0.0, 0.0]);
        assert!(sideways.contains("wind") && sideways.contains("`motion_capture.body_from_markers`"));
        assert!(
            !sideways.contains("mass") && !sideways.contains("thrust"),
            "{sideways}"
        );
    }
}
