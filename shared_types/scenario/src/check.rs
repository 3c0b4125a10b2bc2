//! Checks of a scenario beyond its types: each violation with its key, the reason and the fix.
//!
//! Keys declare the ranges of their numbers, which [`ranges`] checks. The other modules have the rules between values.

mod actuators;
mod air;
mod assumption;
mod cameras;
mod controller;
mod envelope;
mod events;
mod faults;
mod flight;
mod judge;
mod law;
mod link_battery;
mod machine;
mod motion_capture;
mod motors_stop;
mod navigation;
mod operator;
mod path;
mod plugins;
mod programs;
mod radio;
mod radio_link;
mod ranges;
mod receivers;
mod record;
mod safety;
mod sections;
mod vehicle;

use super::{Key, Problem, Scenario, Vector};
use vehicle::check_center_of_mass;

/// Length up to which a vector has no direction: the square of a smaller one may underflow to 0.
const NO_DIRECTION: f64 = 1e-9;

impl Scenario {
    /// Returns all problems of the scenario: numbers out of range, then inconsistent values. Empty for a valid scenario.
    #[must_use]
    pub fn problems(&self) -> Vec<Problem> {
        let root = Key::root();
        let mut found = Findings::from_ranges(self);
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
        for problem in self.schedule().err().unwrap_or_default() {
            found.push(problem);
        }
        found.problems
    }

    /// Checks the sections that an ideal flight does not have, individually and together.
    fn check_rig(&self, root: &Key, found: &mut Findings) {
        if let Some(cameras) = &self.cameras {
            let at = root.then("cameras");
            cameras.check(self.duration, &at, found);
            self.check_jitter(cameras, &at.then("jitter"), found);
        }
        let mut has_good_link = false;
        if let Some(link) = &self.rc_output {
            let at = root.then("rc_output");
            has_good_link = link.check(&at, found);
            link.check_transmitter(has_good_link, &at, found);
            if let Some(battery) = &link.battery {
                battery.check(link, self.flight.is_some(), &at.then("battery"), found);
            }
        }
        if let Some(model) = &self.model {
            let key = root.then("model").then("marker_offset");
            check_center_of_mass(&model.marker_offset, &key, found);
        }
        self.check_motion_capture(found);
        self.check_outdoors(found);
        self.check_receivers(found);
        self.check_sections(has_good_link, found);
    }
}

/// Problems found so far, starting with numbers out of range.
#[derive(Debug, Default)]
struct Findings {
    problems: Vec<Problem>,
    /// Number of problems that are numbers out of range.
    out_of_range: usize,
}

impl Findings {
    /// Adds a problem, unless its value is already out of range.
    fn push(&mut self, problem: Problem) {
        if self.is_in_range(&problem.key) {
            self.problems.push(problem);
        }
    }

    fn add(&mut self, key: Key, reason: impl Into<String>, fix: impl Into<String>) {
        self.push(Problem::new(key, reason, fix));
    }

    /// Returns whether a value, with all its elements, is in the range that its key declares.
    fn is_in_range(&self, key: &Key) -> bool {
        let refused = &self.problems[..self.out_of_range];
        !refused.iter().any(|problem| problem.key.is_element_of(key))
    }

    /// Returns whether the values of some keys of a table are in their ranges.
    fn are_in_range(&self, table: &Key, names: &[&str]) -> bool {
        self.out_of_range == 0 || names.iter().all(|name| self.is_in_range(&table.then(name)))
    }

    /// Requires a vector with a direction; `reason` names what has none.
    fn direction(&mut self, key: &Key, value: &Vector, reason: &str, fix: &str) {
        let length = value
            .iter()
            .map(|component| component * component)
            .sum::<f64>()
            .sqrt();
        if length <= NO_DIRECTION {
            let reason = format!("{reason}: {value:?} is no longer than {NO_DIRECTION:e}");
            self.add(key.clone(), reason, fix);
        }
    }
}

/// Formats a computed number with six digits.
pub(super) fn six_digits(value: f64) -> String {
    let rounded: f64 = format!("{value:.5e}").parse().unwrap_or(value);
    format!("{rounded:?}")
}

#[cfg(test)]
mod tests;
