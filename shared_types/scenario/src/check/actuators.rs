//! Motors and a rate loop that can exist.

use super::Findings;
use crate::{Actuators, Key};

impl Actuators {
    pub(super) fn check(&self, at: &Key, found: &mut Findings) {
        if self.battery.is_some() && self.initial_thrust == 0.0 {
            found.add(
                at.then("battery"),
                "it is stated by the thrust at the start, which is 0 N",
                "set `initial_thrust` to the vehicle's weight",
            );
        }
        let keys = ["thrust_max", "initial_thrust"];
        if self.initial_thrust > self.thrust_max && found.are_in_range(at, &keys) {
            found.add(
                at.then("initial_thrust"),
                format!(
                    "the thrust at the start, {:?} N, is above the largest, {:?} N",
                    self.initial_thrust, self.thrust_max
                ),
                "lower `initial_thrust` or raise `thrust_max`",
            );
        }
    }
}
