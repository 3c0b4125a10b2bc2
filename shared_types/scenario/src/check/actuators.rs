//! Motors and a rate loop that can exist.

use super::Findings;
use crate::{Actuators, Battery, Key};

impl Actuators {
    pub(super) fn check(&self, at: &Key, found: &mut Findings) {
        found.not_negative(&at.then("thrust_lag"), "the time constant", self.thrust_lag);
        if let Some(down) = self.thrust_lag_down {
            found.not_negative(&at.then("thrust_lag_down"), "the time constant", down);
        }
        if let Some(battery) = &self.battery {
            battery.check(&at.then("battery"), found);
            if self.initial_thrust == 0.0 {
                found.add(
                    at.then("battery"),
                    "it is stated by the thrust at the start, which is 0 N",
                    "set `initial_thrust` to the vehicle's weight",
                );
            }
        }
        found.positive(&at.then("thrust_factor"), "the factor", self.thrust_factor);
        for axis in 0..3 {
            let of_axis = |name| at.then(name).then(axis);
            found.not_negative(&of_axis("rate_lag"), "the time constant", self.rate_lag[axis]);
            found.positive(&of_axis("rate_max"), "the largest rate", self.rate_max[axis]);
            found.positive(&of_axis("rate_factor"), "the factor", self.rate_factor[axis]);
        }
        found.vector(&at.then("rate_bias"), &self.rate_bias);
        found.share(&at.then("frame_loss"), self.frame_loss);
        let most_is_good = found.positive(&at.then("thrust_max"), "the largest thrust", self.thrust_max);
        let key = at.then("initial_thrust");
        let initial_is_good = found.not_negative(&key, "the thrust", self.initial_thrust);
        if most_is_good && initial_is_good && self.initial_thrust > self.thrust_max {
            found.add(
                key,
                format!(
                    "the thrust at the start, {:?} N, is above the largest, {:?} N",
                    self.initial_thrust, self.thrust_max
                ),
                "lower `initial_thrust` or raise `thrust_max`",
            );
        }
    }
}

impl Battery {
    fn check(&self, at: &Key, found: &mut Findings) {
        found.positive(&at.then("endurance"), "the time", self.endurance);
        found.share(&at.then("fade"), self.fade);
        found.share(&at.then("droop"), self.droop);
    }
}
