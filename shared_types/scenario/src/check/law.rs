//! Gains of the baselines, and what they need.

use super::Findings;
use crate::{Baseline, Controller, Harmonics, Key, Scenario};

impl Scenario {
    /// Harmonics of a path that repeats.
    pub(super) fn check_harmonics(&self, found: &mut Findings) {
        if self.controller.harmonics.is_some() && self.path.curve.frequency().is_none_or(|w| w == 0.0) {
            found.add(
                Key::root().then("controller").then("harmonics"),
                "the path does not repeat, so that no disturbance repeats with it",
                "leave them out, or fly a figure of eight, a circle, a closed course, or a Lissajous figure with a common period",
            );
        }
    }
}

impl Controller {
    pub(super) fn check_law(&self, at: &Key, found: &mut Findings) {
        if self.law.commands_torque() && self.rates.is_some() {
            found.add(
                at.then("law"),
                "this law commands torque, but the controller commands body rates",
                "leave `[controller.rates]` out, as in scenarios/fig1.toml, or choose another law",
            );
        }
        if !self.law.is_adaptive() && !self.law.commands_torque() && self.rates.is_none() {
            found.add(
                at.then("law"),
                "this law commands body rates, but the controller commands torque",
                "add `[controller.rates]`, as in scenarios/fig3_6.toml, or leave `law` out",
            );
        }
        let predicts = self.rates.as_ref().is_some_and(|rates| rates.unexplained);
        if let Some(gain) = self.prediction_gain
            && found.not_negative(&at.then("prediction_gain"), "κ", gain)
            && !predicts
        {
            found.add(
                at.then("prediction_gain"),
                "the prediction error is known with commands of body rates and `rates.unexplained` only",
                "set `controller.rates.unexplained` to true, or leave `prediction_gain` out",
            );
        }
        if self.disturbance_observer && !(predicts && self.law.is_adaptive()) {
            found.add(
                at.then("disturbance_observer"),
                "only the adaptive law with commands of body rates and `rates.unexplained` has it",
                "leave it out, or fly `law = \"adaptive\"` with `rates.unexplained = true`",
            );
        }
        if let Some(harmonics) = &self.harmonics {
            let at = at.then("harmonics");
            found.not_negative(&at.then("gain"), "λa", harmonics.gain);
            found.positive(&at.then("within"), "the distance", harmonics.within);
            if !(1..=Harmonics::MOST).contains(&harmonics.count) {
                let fix = format!("give a number from 1 to {}", Harmonics::MOST);
                found.add(at.then("count"), "there are too many, or none", fix);
            }
            if !self.law.is_adaptive() {
                found.add(
                    at,
                    "a baseline has no harmonics",
                    "leave them out, or fly the adaptive law",
                );
            }
        }
        if let Some(baseline) = &self.baseline {
            baseline.check(&at.then("baseline"), found);
        }
    }
}

impl Baseline {
    fn check(&self, at: &Key, found: &mut Findings) {
        let positive = [
            ("position_gain", self.position_gain),
            ("velocity_gain", self.velocity_gain),
            ("attitude_gain", self.attitude_gain),
            ("error_limit", self.error_limit.unwrap_or(1.0)),
            ("disturbance_max", self.disturbance_max),
            ("l1_leak", self.l1_leak),
            ("l1_bandwidth", self.l1_bandwidth),
            ("cascade_scale", self.cascade_scale),
            ("rate_gain", self.rate_gain),
            ("nmpc_rate_weight", self.nmpc_rate_weight),
        ];
        for (name, value) in positive {
            found.positive(&at.then(name), name, value);
        }
        let not_negative = [
            ("integral_gain", self.integral_gain),
            ("immersion_gain", self.immersion_gain),
            ("inertia_gain", self.inertia_gain),
            ("composite_tracking_gain", self.composite_tracking_gain),
            ("composite_prediction_gain", self.composite_prediction_gain),
        ];
        for (name, value) in not_negative {
            found.not_negative(&at.then(name), name, value);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::assert_only;
    use crate::tests_support::{fig1, rig};
    use crate::{Baseline, LawKind};

    #[test]
    fn composite_adaptation_needs_a_prediction_error() {
        let mut scenario = fig1();
        scenario.controller.prediction_gain = Some(1.0);
        assert_only(
            &scenario.problems(),
            "controller.prediction_gain",
            "with commands of body rates",
            "rates.unexplained",
        );
    }

    #[test]
    fn a_baseline_needs_body_rates_and_gains_that_can_be() {
        let mut scenario = fig1();
        scenario.controller.law = LawKind::Indi;
        assert_only(
            &scenario.problems(),
            "controller.law",
            "commands body rates",
            "add `[controller.rates]`",
        );
        let mut scenario = rig();
        scenario.controller.law = LawKind::L1;
        assert_eq!(scenario.problems(), []);
        scenario.controller.baseline = Some(Baseline {
            l1_bandwidth: 0.0,
            ..Baseline::default()
        });
        assert_only(
            &scenario.problems(),
            "controller.baseline.l1_bandwidth",
            "is not above 0",
            "give a number above 0",
        );
    }
}
