//! Checks of `[safety]`: existing inputs, their values, and the order of stages.

use super::Findings;
use crate::timing::names::unknown_edge;
use crate::{EdgeName, InputSafety, Key, Scenario};
use shared_types::service::seconds;
use shared_types::wiring::Topic;

impl Scenario {
    /// Requires policies of existing inputs that have an effect.
    pub(super) fn check_safety(&self, found: &mut Findings) {
        for (name, safety) in &self.safety {
            let at = Key::root().then("safety").then(name);
            match EdgeName::find(name) {
                None => found.problems.push(unknown_edge(at, name)),
                Some(edge) => self.check_input(edge, safety, &at, found),
            }
        }
    }

    fn check_input(&self, edge: EdgeName, safety: &InputSafety, at: &Key, found: &mut Findings) {
        let Some(uses) = InputSafety::uses(edge) else {
            return found.add(
                at.clone(),
                format!("`{}` does not depend on the age of this input", edge.service),
                format!("leave `{at}` out; none of its values has an effect"),
            );
        };
        let has_limit = "the filter has its own limit for the time without captures";
        let own_limit = match (&self.estimator, self.fuses_poses()) {
            (None, None) => None,
            (None, Some(false)) => Some((
                "no camera captures a vehicle with inertial navigation",
                "navigation.coast",
            )),
            (None, Some(true)) => Some((has_limit, "navigation.coast")),
            _ => Some((has_limit, "estimator.kalman.coast")),
        };
        if let Some((reason, key)) = own_limit.filter(|_| edge.topic == Topic::MocapPose) {
            return found.add(at.clone(), reason, format!("leave `{at}` out and state `{key}`"));
        }
        if let Some((section, false)) = self.section_for(edge) {
            return found.add(
                at.clone(),
                format!("without `[{section}]` `{}` does not use this input", edge.service),
                format!("add `[{section}]`, or leave `{at}` out"),
            );
        }
        for (name, is_stated) in safety.special_values() {
            if is_stated && !uses.contains(&name) {
                found.add(
                    at.then(name),
                    format!("`{}` does not use it for this input", edge.service),
                    used_values(uses),
                );
            }
        }
        safety.check_ages(at, found);
        self.check_ordinary_age(edge, safety, &at.then("max_age"), found);
    }

    /// Requires that no sample is too old in a flight without faults.
    fn check_ordinary_age(&self, edge: EdgeName, safety: &InputSafety, key: &Key, found: &mut Findings) {
        let ordinary = seconds(self.ordinary_age_ns(edge));
        if safety.max_age < ordinary {
            found.add(
                key.clone(),
                format!(
                    "by the schedule a sample of this input is up to {ordinary:?} s old without faults, but {:?} s would be \
                     too old",
                    safety.max_age
                ),
                format!("give {ordinary:?} s or more, or publish `{}` more often", edge.topic),
            );
        }
    }
}

impl InputSafety {
    /// Requires ages that increase from stage to stage.
    fn check_ages(&self, at: &Key, found: &mut Findings) {
        let stated: Vec<_> = self
            .ages()
            .into_iter()
            .filter_map(|(name, age)| Some((name, age?)))
            .collect();
        for pair in stated.windows(2) {
            let [(earlier, before), (later, after)] = [pair[0], pair[1]];
            if after <= before && found.are_in_range(at, &[earlier, later]) {
                found.add(
                    at.then(later),
                    format!("`{later}` = {after:?} s is not above `{earlier}` = {before:?} s"),
                    format!("raise it above {before:?} s, or leave `{later}` out"),
                );
            }
        }
    }
}

/// Returns advice on the values of an input.
fn used_values(uses: &[&str]) -> String {
    let names: Vec<_> = std::iter::once(&"max_age")
        .chain(uses)
        .map(|name| format!("`{name}`"))
        .collect();
    format!("state only {}, as needed", names.join(", "))
}
