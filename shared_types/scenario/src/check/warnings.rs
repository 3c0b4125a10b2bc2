//! What can be flown and probably should not: each with its place, the reason and the fix.

use super::{Findings, six_digits};
use crate::{GRAVITY, Key, Problem, Scenario, Vector};
use shared_types::wiring::ServiceId;

/// Share of z3 that a step may take away before a smaller J than believed makes the sampled loop diverge, at 2.
const DAMPED_A_STEP: f64 = 1.0;

/// How much slower than the attitude loop the loop inside it may be: at a quarter of its rate the two begin to swing.
const SLOWNESS: f64 = 4.0;

impl Scenario {
    /// What is dubious about a scenario without [`problems`](Self::problems).
    #[must_use]
    pub fn warnings(&self) -> Vec<Problem> {
        let mut found = Findings::default();
        if self.program_of(ServiceId::Controller).is_none() {
            self.doubt_beta(&mut found);
            self.doubt_lambda_inertia(&mut found);
        }
        found.problems
    }

    /// β serves vehicles within a range of J: see [`gains`](crate).
    fn doubt_beta(&self, found: &mut Findings) {
        let (beta, damping, step) = (self.beta(), self.controller.damping(), self.torque_step());
        let attitude_rate = GRAVITY / self.controller.delta.abs();
        for (key, [x, y, z]) in self.inertias() {
            let (least, largest) = (x.min(y).min(z), x.max(y));
            let share = step * damping / (beta * least);
            let rate = damping / (beta * largest);
            let fix = |beta: f64| {
                format!(
                    "set `controller.beta` to {beta:?}, or state such a vehicle's inertia in `controller.initial.inertia` and leave `controller.beta` out"
                )
            };
            if share > DAMPED_A_STEP {
                let reason = format!(
                    "with β = {beta:?} the angular velocity loop of J = {least:?} kg m² takes {} of its error away in a step of {step:?} s; it should be below {DAMPED_A_STEP}, and from 2 on the loop diverges",
                    six_digits(share)
                );
                found.add(key, reason, fix(self.beta_for(least)));
            } else if SLOWNESS * rate < attitude_rate {
                let reason = format!(
                    "with β = {beta:?} the angular velocity loop of J = {largest:?} kg m² has a rate of {} 1/s; it should be above a quarter of the attitude loop's g/|δ| = {} 1/s",
                    six_digits(rate),
                    six_digits(attitude_rate)
                );
                found.add(key, reason, fix(self.beta_for(least)));
            }
        }
    }

    fn doubt_lambda_inertia(&self, found: &mut Findings) {
        let (gain, limit) = (self.lambda_inertia(), self.lambda_inertia_limit());
        if gain > limit {
            let follows = self.default_lambda_inertia();
            found.add(
                Key::root().then("controller").then("lambda_inertia"),
                format!(
                    "Λw = {gain:?} is above {limit:.2e}, up to which the sampled estimator of w learns no more in a step than k3 damps; a vehicle that starts tilted may be lost"
                ),
                format!("leave it out, and {follows:?} follows from the other gains, or give at most {limit:.2e}"),
            );
        }
    }

    /// The moments of inertia that the torque acts on, and where they are stated: those of the vehicle, or with body
    /// rates those of the model whose artificial ω the torque drives.
    fn inertias(&self) -> Vec<(Key, Vector)> {
        let root = Key::root();
        if self.controller.rates.is_some() {
            let model = self.model.clone().unwrap_or_default();
            return vec![(root.then("model").then("size"), model.inertia())];
        }
        let vehicle = root.then("vehicle");
        let changes = self
            .vehicle
            .change
            .iter()
            .enumerate()
            .filter_map(|(index, change)| {
                let at = vehicle.then("change").then(index).then("inertia");
                change.inertia.map(|inertia| (at, inertia))
            });
        std::iter::once((vehicle.then("inertia"), self.vehicle.inertia))
            .chain(changes)
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::assert_only;
    use crate::tests_support::{fig1, rig};
    use crate::{Programs, Scenario};

    fn warnings(change: impl FnOnce(&mut Scenario)) -> Vec<super::Problem> {
        let mut scenario = fig1();
        scenario.vehicle.change.clear();
        change(&mut scenario);
        assert_eq!(scenario.problems(), []);
        scenario.warnings()
    }

    #[test]
    fn what_follows_from_the_rules_keeps_them() {
        assert_eq!(fig1().warnings(), []);
        assert_eq!(rig().warnings(), []);
        for factor in [0.1, 10.0] {
            let scaled = warnings(|scenario| {
                for inertia in [
                    &mut scenario.vehicle.inertia,
                    &mut scenario.controller.initial.inertia,
                ] {
                    *inertia = inertia.map(|moment| moment * factor);
                }
            });
            assert_eq!(scaled, []);
        }
    }

    #[test]
    fn a_vehicle_too_light_or_too_heavy_for_beta_is_named_with_the_gain_that_follows() {
        let light = warnings(|scenario| scenario.vehicle.inertia = [1.5e-4; 3]);
        assert_only(
            &light,
            "vehicle.inertia",
            "takes 1.3 of its error away in a step of 0.001 s",
            "set `controller.beta` to 433.0",
        );
        let heavy = warnings(|scenario| scenario.vehicle.inertia = [1e-2; 3]);
        assert_only(
            &heavy,
            "vehicle.inertia",
            "a rate of 19.5 1/s; it should be above a quarter of the attitude loop's g/|δ| = 98.1 1/s",
            "set `controller.beta` to 6.5",
        );
    }

    #[test]
    fn an_adaptation_gain_above_its_limit_is_named_with_the_one_that_follows() {
        let found = warnings(|scenario| scenario.controller.lambda_inertia = Some(1e-8));
        assert_only(
            &found,
            "controller.lambda_inertia",
            "Λw = 1e-8 is above 2.14e-10",
            "1.07e-10 follows from the other gains",
        );
    }

    #[test]
    fn with_body_rates_the_model_s_inertia_counts_and_the_vehicle_s_does_not() {
        let mut scenario = rig();
        scenario.vehicle.inertia = [1e-5; 3];
        assert_eq!(scenario.warnings(), []);
        scenario.model.as_mut().unwrap().size = [0.05; 3];
        assert_only(
            &scenario.warnings(),
            "model.size",
            "with β = 100.0",
            "set `controller.beta` to ",
        );
    }

    #[test]
    fn the_gains_of_an_external_controller_are_not_judged() {
        let programs = Programs {
            controller: Some(vec!["pilot".to_owned()]),
            ..Programs::default()
        };
        let found = warnings(|scenario| {
            scenario.controller.lambda_inertia = Some(1e-8);
            scenario.programs = Some(programs);
        });
        assert_eq!(found, []);
    }
}
