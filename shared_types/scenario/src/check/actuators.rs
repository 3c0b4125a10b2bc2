//! Checks of the actuators.

use super::Findings;
use crate::{Actuators, Key};

impl Actuators {
    pub(super) fn check(&self, at: &Key, found: &mut Findings) {
        if self.battery.is_some() && self.initial_thrust == 0.0 {
            found.add(
                at.then("battery"),
                "its values refer to the initial thrust, which is 0 N",
                "set `initial_thrust` to the vehicle's weight",
            );
        }
        let keys = ["thrust_max", "initial_thrust"];
        if self.initial_thrust > self.thrust_max && found.are_in_range(at, &keys) {
            found.add(
                at.then("initial_thrust"),
                format!(
                    "the initial thrust of {:?} N is above the maximum of {:?} N",
                    self.initial_thrust, self.thrust_max
                ),
                "lower `initial_thrust` or raise `thrust_max`",
            );
        }
    }
}
