//! Limits of loss that can be exceeded and can be kept.

use std::f64::consts::PI;

use super::Findings;
use crate::{Judge, Key, Scenario};

impl Scenario {
    pub(super) fn check_judge(&self, found: &mut Findings) {
        let Some(judge) = &self.judge else {
            return;
        };
        let at = Key::root().then("judge");
        judge.check(&at, found);
        if judge.impact_speed_max.is_some() && self.flight.is_none() {
            found.add(
                at.then("impact_speed_max"),
                "a flight without phases has no ground that could be touched",
                "add `[flight]`, or leave `impact_speed_max` out",
            );
        }
    }
}

impl Judge {
    fn check(&self, at: &Key, found: &mut Findings) {
        found.positive(&at.then("distance_max"), "the distance", self.distance_max);
        let tilt = at.then("tilt_max");
        if found.positive(&tilt, "the angle", self.tilt_max) && self.tilt_max > PI {
            found.add(
                tilt,
                format!("no thrust tilts by {:?} rad: upside down is π", self.tilt_max),
                "give an angle up to π = 3.141592653589793, with which no attitude counts as lost",
            );
        }
        if let Some(time) = self.steady_after {
            found.positive(&at.then("steady_after"), "the time", time);
        }
        if let Some(speed) = self.impact_speed_max {
            found.positive(&at.then("impact_speed_max"), "the speed", speed);
        }
    }
}
