//! Checks of a scenario beyond its types: each violation with its place, the reason and the fix.

mod actuators;
mod air;
mod assumption;
mod cameras;
mod controller;
mod envelope;
mod estimator;
mod events;
mod faults;
mod flight;
mod judge;
mod law;
mod machine;
mod motion_capture;
mod motors_stop;
mod operator;
mod path;
mod plugins;
mod programs;
mod radio;
mod radio_link;
mod record;
mod safety;
mod sections;
mod vehicle;

use std::f64::consts::TAU;

use super::{Key, Problem, Scenario, Vector};

/// Largest plausible magnitude of a number in a scenario; products of several stay finite.
const LARGEST: f64 = 1e9;

/// Length of a vector up to which it gives no direction: the square of a smaller one may be 0.
const NO_DIRECTION: f64 = 1e-9;

impl Scenario {
    /// Returns all problems of the scenario; empty for a valid one.
    #[must_use]
    pub fn problems(&self) -> Vec<Problem> {
        let root = Key::root();
        let mut found = Findings::default();
        self.vehicle
            .check(self.duration, &root.then("vehicle"), &mut found);
        self.path.check(self.duration, &root.then("path"), &mut found);
        self.controller.check(&root.then("controller"), &mut found);
        self.controller
            .check_changes(self.duration, &root.then("controller"), &mut found);
        self.controller.check_law(&root.then("controller"), &mut found);
        self.check_assumption_1(&mut found);
        self.check_rig(&root, &mut found);
        self.check_faults(&mut found);
        self.check_safety(&mut found);
        self.check_flight(&mut found);
        self.check_envelope(&mut found);
        self.check_judge(&mut found);
        self.check_machine(&mut found);
        self.check_operator(&mut found);
        self.check_plugins(&mut found);
        self.check_telemetry(&mut found);
        self.check_harmonics(&mut found);
        self.check_programs(&mut found);
        self.check_record(&mut found);
        found.problems.extend(self.schedule().err().unwrap_or_default());
        found.problems
    }

    /// Checks the sections that the ideal flight does not have, each by itself and all together.
    fn check_rig(&self, root: &Key, found: &mut Findings) {
        if let Some(cameras) = &self.cameras {
            let at = root.then("cameras");
            cameras.check(self.duration, &at, found);
            self.check_jitter(cameras, &at.then("jitter"), found);
        }
        if let Some(estimator) = &self.estimator {
            let at = root.then("estimator").then("kalman");
            estimator.kalman.check(&at, found);
        }
        if let Some(link) = &self.rc_output {
            let at = root.then("rc_output");
            link.check(&at, found);
            link.check_transmitter(&at, found);
        }
        if let Some(model) = &self.model {
            model.check(&root.then("model"), found);
        }
        self.check_motion_capture(found);
        self.check_sections(found);
    }
}

/// Problems found so far, and the rules for many values. A rule returns whether the value satisfies it, so that
/// dependent rules are checked only then.
#[derive(Debug, Default)]
struct Findings {
    problems: Vec<Problem>,
}

impl Findings {
    /// Returns whether a check finds no problem.
    fn has_none(check: impl FnOnce(&mut Self)) -> bool {
        let mut found = Self::default();
        check(&mut found);
        found.problems.is_empty()
    }

    fn add(&mut self, key: Key, reason: impl Into<String>, fix: impl Into<String>) {
        self.problems.push(Problem::new(key, reason, fix));
    }

    /// Requires a number that can be computed with.
    fn number(&mut self, key: &Key, value: f64) -> bool {
        let good = value.abs() <= LARGEST;
        if !good {
            let reason = if value.is_finite() {
                format!("{value:?} is beyond anything that can be flown")
            } else {
                format!("{value:?} is not a finite number")
            };
            let fix = format!("give a finite number of at most {LARGEST:e} in magnitude");
            self.add(key.clone(), reason, fix);
        }
        good
    }

    /// Requires an angle of at most a turn, rad: a larger one was probably meant in degrees.
    fn angle(&mut self, key: &Key, value: f64) {
        if self.number(key, value) && value.abs() > TAU {
            let reason = format!("{value:?} rad is more than a turn");
            let fix = format!(
                "angles are in rad: give {} if {value:?}° is meant, else an angle within ±2π",
                six_digits(value.to_radians())
            );
            self.add(key.clone(), reason, fix);
        }
    }

    /// Requires three angles of at most a turn each, rad.
    fn angles(&mut self, key: &Key, value: &Vector) {
        for (index, &component) in value.iter().enumerate() {
            self.angle(&key.then(index), component);
        }
    }

    /// Requires three numbers that can be computed with.
    fn vector(&mut self, key: &Key, value: &Vector) -> bool {
        let components = value.iter().enumerate();
        components.fold(true, |good, (index, &component)| {
            self.number(&key.then(index), component) && good
        })
    }

    /// Requires three numbers that give a direction; `reason` says what is without one.
    fn direction(&mut self, key: &Key, value: &Vector, reason: &str, fix: &str) -> bool {
        if !self.vector(key, value) {
            return false;
        }
        let length = value
            .iter()
            .map(|component| component * component)
            .sum::<f64>()
            .sqrt();
        if length <= NO_DIRECTION {
            let reason = format!("{reason}: {value:?} is no longer than {NO_DIRECTION:e}");
            self.add(key.clone(), reason, fix);
        }
        length > NO_DIRECTION
    }

    fn positive(&mut self, key: &Key, symbol: &str, value: f64) -> bool {
        if !self.number(key, value) {
            return false;
        }
        if value <= 0.0 {
            let reason = format!("{symbol} = {value:?} is not above 0");
            self.add(key.clone(), reason, "give a number above 0");
        }
        value > 0.0
    }

    fn not_negative(&mut self, key: &Key, symbol: &str, value: f64) -> bool {
        if !self.number(key, value) {
            return false;
        }
        if value < 0.0 {
            let reason = format!("{symbol} = {value:?} is below 0");
            self.add(key.clone(), reason, "give 0 or a number above it");
        }
        value >= 0.0
    }

    /// Requires a share from 0 to below 1.
    fn share(&mut self, key: &Key, value: f64) {
        if !(0.0..1.0).contains(&value) {
            let reason = format!("{value:?} is not a share from 0 to below 1");
            self.add(
                key.clone(),
                reason,
                "give a number from 0 to below 1; 0.1 is one in ten",
            );
        }
    }
}

/// Formats a computed number with six digits.
fn six_digits(value: f64) -> String {
    let rounded: f64 = format!("{value:.5e}").parse().unwrap_or(value);
    format!("{rounded:?}")
}

#[cfg(test)]
mod tests;
