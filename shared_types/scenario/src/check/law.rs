//! Checks of the sections that a control law needs or does not use.

use super::Findings;
use crate::{Controller, Key, Scenario};

impl Scenario {
    /// Requires a periodic path for harmonics.
    pub(super) fn check_harmonics(&self, found: &mut Findings) {
        if self.controller.harmonics.is_some() && self.path.curve.frequency().is_none_or(|w| w == 0.0) {
            found.add(
                Key::root().then("controller").then("harmonics"),
                "the path is not periodic, so no disturbance repeats with it",
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
        if self.prediction_gain.is_some() && !predicts {
            found.add(
                at.then("prediction_gain"),
                "the prediction error is available only with commands of body rates and `rates.unexplained`",
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
        if self.harmonics.is_some() && !self.law.is_adaptive() {
            found.add(
                at.then("harmonics"),
                "a baseline has no harmonics",
                "leave them out, or fly the adaptive law",
            );
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::assert_only;
    use crate::LawKind;
    use crate::tests_support::{fig1, rig};

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
    fn a_baseline_needs_body_rates() {
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
    }
}
