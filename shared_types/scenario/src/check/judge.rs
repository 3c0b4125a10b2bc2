//! Checks of the limits of loss.

use super::Findings;
use crate::{Key, Scenario};

impl Scenario {
    pub(super) fn check_judge(&self, found: &mut Findings) {
        let Some(judge) = &self.judge else {
            return;
        };
        let at = Key::root().then("judge");
        if judge.impact_speed_max.is_some() && self.flight.is_none() {
            found.add(
                at.then("impact_speed_max"),
                "a flight without phases has no ground",
                "add `[flight]`, or leave `impact_speed_max` out",
            );
        }
    }
}
