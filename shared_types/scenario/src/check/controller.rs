//! Gains, bounds and initial estimates with which the laws are defined and the theorem holds.

use super::events::Events;
use super::vehicle::check_inertia;
use super::{Findings, six_digits};
use crate::{Bounds, Controller, ControllerChange, InitialEstimates, Key, RateCommand};

impl Controller {
    pub(super) fn check(&self, at: &Key, found: &mut Findings) {
        let k1_is_good = found.positive(&at.then("k1"), "k1", self.k1);
        found.positive(&at.then("k2"), "k2", self.k2);
        found.positive(&at.then("k3"), "k3", self.k3);
        if let Some(beta) = self.beta {
            found.positive(&at.then("beta"), "β", beta);
        }
        let sigma_max_is_good = found.positive(&at.then("sigma_max"), "σmax", self.sigma_max);
        let delta_is_good = self.check_delta(&at.then("delta"), found);
        if k1_is_good && sigma_max_is_good && delta_is_good {
            self.check_saturation(&at.then("sigma_max"), found);
        }
        // An adaptation gain of 0 is a choice: the estimate then stays where it begins.
        found.not_negative(&at.then("lambda_mass"), "λm", self.lambda_mass);
        for (axis, &gain) in self.lambda_disturbance.iter().enumerate() {
            found.not_negative(&at.then("lambda_disturbance").then(axis), "Λb", gain);
        }
        if let Some(gain) = self.lambda_inertia {
            found.not_negative(&at.then("lambda_inertia"), "Λw", gain);
        }
        self.bounds.check(&at.then("bounds"), found);
        self.initial.check(&at.then("initial"), found);
        if let Some(rates) = &self.rates {
            rates.check(&at.then("rates"), found);
        }
        if let Some(gain) = self.observer_gain {
            found.positive(&at.then("observer_gain"), "γ", gain);
        }
    }

    /// Changes of gains in a flight of `duration` s.
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
            let is_good = change.check(&at, found);
            if let Some(k1) = change.k1.filter(|_| is_good) {
                let changed = Self { k1, ..self.clone() };
                changed.check_saturation(&at.then("k1"), found);
            }
        }
        let changes = Events {
            one: "change",
            several: "changes",
            at,
            times: self.change.iter().map(|change| change.at).collect(),
        };
        changes.check(duration, found);
    }

    fn check_delta(&self, key: &Key, found: &mut Findings) -> bool {
        let good = found.number(key, self.delta) && self.delta != 0.0;
        if self.delta == 0.0 {
            found.add(
                key.clone(),
                "δ is 0, but the angular velocity (18) divides by it",
                "give a number other than 0; the paper uses 0.1",
            );
        }
        good
    }

    /// σmax > ‖δ‖/k1, the condition of the theorem: else no position error balances δ.
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
                    "raise `sigma_max` above {}, raise `k1` or bring `delta` nearer to 0; the paper uses 1.5, 4 and 0.1",
                    six_digits(least)
                ),
            );
        }
    }
}

impl ControllerChange {
    /// Returns whether the gains of the law are above 0.
    fn check(&self, at: &Key, found: &mut Findings) -> bool {
        let gains = [
            ("k1", "k1", self.k1),
            ("k2", "k2", self.k2),
            ("k3", "k3", self.k3),
            ("beta", "β", self.beta),
        ];
        let mut is_good = true;
        for (name, symbol, gain) in gains {
            if let Some(gain) = gain {
                is_good &= found.positive(&at.then(name), symbol, gain);
            }
        }
        let learning = [
            ("lambda_mass", "λm", self.lambda_mass),
            ("lambda_inertia", "Λw", self.lambda_inertia),
            ("prediction_gain", "κ", self.prediction_gain),
        ];
        for (name, symbol, gain) in learning {
            if let Some(gain) = gain {
                found.not_negative(&at.then(name), symbol, gain);
            }
        }
        for (axis, gain) in self.lambda_disturbance.into_iter().flatten().enumerate() {
            found.not_negative(&at.then("lambda_disturbance").then(axis), "Λb", gain);
        }
        is_good
    }
}

impl Bounds {
    fn check(&self, at: &Key, found: &mut Findings) {
        let least_is_good = found.positive(&at.then("mass_min"), "mmin", self.mass_min);
        let most_is_good = found.positive(&at.then("mass_max"), "mmax", self.mass_max);
        if least_is_good && most_is_good && self.mass_min >= self.mass_max {
            found.add(
                at.then("mass_min"),
                format!(
                    "mmin = {:?} kg is not below mmax = {:?} kg",
                    self.mass_min, self.mass_max
                ),
                "lower `mass_min` or raise `mass_max`",
            );
        }
        let epsilon_is_good = found.positive(&at.then("epsilon_eta"), "ε of η̂", self.epsilon_eta);
        if epsilon_is_good && most_is_good {
            self.check_epsilon_eta(at, found);
        }
        found.positive(&at.then("disturbance"), "bmax", self.disturbance);
        found.positive(
            &at.then("epsilon_disturbance"),
            "ε of b̂",
            self.epsilon_disturbance,
        );
    }

    /// ε < 1/mmax, which keeps π(η̂) above 0: the thrust (16) divides by it.
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

impl RateCommand {
    /// All but the roll-out, which depends on the schedule. A gain of 0 is a choice, as of the estimators.
    fn check(&self, at: &Key, found: &mut Findings) {
        found.not_negative(&at.then("yaw_kp"), "kp", self.yaw_kp);
        found.not_negative(&at.then("yaw_ki"), "ki", self.yaw_ki);
        found.not_negative(
            &at.then("yaw_integral_max"),
            "the largest integral term",
            self.yaw_integral_max,
        );
    }
}

impl InitialEstimates {
    fn check(&self, at: &Key, found: &mut Findings) {
        found.positive(&at.then("mass"), "initial mass estimate", self.mass);
        check_inertia(&self.inertia, &at.then("inertia"), found);
        found.vector(&at.then("disturbance"), &self.disturbance);
    }
}
