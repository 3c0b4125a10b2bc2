//! Checks of the controller's gains and bounds: the conditions of the theorem.

use super::vehicle::check_inertia;
use super::{Findings, six_digits};
use crate::{Bounds, Controller, Key};

impl Controller {
    pub(super) fn check(&self, at: &Key, found: &mut Findings) {
        if found.are_in_range(at, &["k1", "sigma_max", "delta"]) {
            self.check_saturation(&at.then("sigma_max"), found);
        }
        self.bounds.check(&at.then("bounds"), found);
        let inertia = at.then("initial").then("inertia");
        check_inertia(&self.initial.inertia, &inertia, found);
    }

    /// Checks the changes of gains in a flight of `duration` s.
    pub(super) fn check_changes(&self, duration: f64, at: &Key, found: &mut Findings) {
        let at = at.then("change");
        if !self.change.is_empty() && !self.law.is_adaptive() {
            found.add(
                at.clone(),
                "only the adaptive law has gains that change in flight",
                "leave `controller.change` out, or `controller.law`",
            );
        }
        for (index, change) in self.change.iter().enumerate() {
            let at = at.then(index);
            if let Some(k1) = change.k1
                && found.are_in_range(&at, &["k1"])
            {
                let changed = Self { k1, ..self.clone() };
                changed.check_saturation(&at.then("k1"), found);
            }
        }
        let times: Vec<_> = self.change.iter().map(|change| change.at).collect();
        found.check_events(["change", "changes"], &at, &times, duration);
    }

    /// Requires σmax > ‖δ‖/k1, the condition of the theorem: otherwise no position error balances δ.
    fn check_saturation(&self, key: &Key, found: &mut Findings) {
        let least = self.delta.abs() / self.k1;
        if self.sigma_max <= least {
            found.add(
                key.clone(),
                format!(
                    "σmax = {:?} is not above |δ|/k1 = {:?}/{:?} = {}, so the theorem bounds no position error",
                    self.sigma_max,
                    self.delta.abs(),
                    self.k1,
                    six_digits(least)
                ),
                format!(
                    "raise `sigma_max` above {}, raise `k1` or bring `delta` closer to 0; the paper uses 1.5, 4 and 0.1",
                    six_digits(least)
                ),
            );
        }
    }
}

impl Bounds {
    fn check(&self, at: &Key, found: &mut Findings) {
        if self.mass_min >= self.mass_max && found.are_in_range(at, &["mass_min", "mass_max"]) {
            found.add(
                at.then("mass_min"),
                format!(
                    "mmin = {:?} kg is not below mmax = {:?} kg",
                    self.mass_min, self.mass_max
                ),
                "lower `mass_min` or raise `mass_max`",
            );
        }
        if found.are_in_range(at, &["epsilon_eta", "mass_max"]) {
            self.check_epsilon_eta(at, found);
        }
    }

    /// Requires ε < 1/mmax, which keeps π(η̂) above 0: the thrust (16) divides by it.
    fn check_epsilon_eta(&self, at: &Key, found: &mut Findings) {
        let limit = 1.0 / self.mass_max;
        if self.epsilon_eta >= limit {
            found.add(
                at.then("epsilon_eta"),
                format!(
                    "ε = {:?} 1/kg is not below 1/mmax = 1/{:?} = {} 1/kg, so the projected η̂ could reach 0, by which the thrust (16) divides",
                    self.epsilon_eta,
                    self.mass_max,
                    six_digits(limit)
                ),
                format!(
                    "lower `epsilon_eta` below {} or lower `mass_max`; 0.01 is the default",
                    six_digits(limit)
                ),
            );
        }
    }
}
