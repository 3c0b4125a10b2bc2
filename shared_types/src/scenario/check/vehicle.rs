//! A vehicle that can exist, and changes of it that happen in flight, one after the other.

use super::{Findings, six_digits};
use crate::scenario::{InitialState, Key, Vector, Vehicle, VehicleChange};

/// Relative excess over the triangle inequality that rounding explains: a flat body has J1 + J2 = J3 exactly,
/// but its decimals may not.
const TRIANGLE_TOLERANCE: f64 = 1e-9;

impl Vehicle {
    pub(super) fn check(&self, duration: f64, at: &Key, found: &mut Findings) {
        found.positive(&at.then("mass"), "m", self.mass);
        check_inertia(&self.inertia, &at.then("inertia"), found);
        found.vector(&at.then("disturbance"), &self.disturbance);
        self.initial.check(&at.then("initial"), found);
        for (index, change) in self.change.iter().enumerate() {
            change.check(&at.then("change").then(index), found);
        }
        self.check_times(duration, &at.then("change"), found);
    }

    fn check_times(&self, duration: f64, at: &Key, found: &mut Findings) {
        for (index, change) in self.change.iter().enumerate() {
            if change.at > duration {
                found.add(
                    at.then(index).then("at"),
                    format!(
                        "the change at {:?} s comes after the end of the flight at {duration:?} s",
                        change.at
                    ),
                    "let it happen earlier, leave it out or raise `duration`",
                );
            }
        }
        for (index, pair) in self.change.windows(2).enumerate() {
            let [earlier, later] = [pair[0].at, pair[1].at];
            if later < earlier {
                found.add(
                    at.then(index + 1).then("at"),
                    format!("the change at {later:?} s stands behind the one at {earlier:?} s"),
                    "put the changes in the order of their times",
                );
            } else if later == earlier {
                found.add(
                    at.then(index + 1).then("at"),
                    format!("two changes happen at {later:?} s"),
                    "make one change of the two, or move one of them",
                );
            }
        }
    }
}

impl InitialState {
    fn check(&self, at: &Key, found: &mut Findings) {
        found.vector(&at.then("position"), &self.position);
        found.vector(&at.then("roll_pitch_yaw"), &self.roll_pitch_yaw);
        found.vector(&at.then("velocity_body"), &self.velocity_body);
        found.vector(&at.then("angular_velocity_body"), &self.angular_velocity_body);
    }
}

impl VehicleChange {
    /// All but the time, which the schedule checks.
    fn check(&self, at: &Key, found: &mut Findings) {
        if let Some(mass) = self.mass {
            found.positive(&at.then("mass"), "m", mass);
        }
        if let Some(inertia) = &self.inertia {
            check_inertia(inertia, &at.then("inertia"), found);
        }
        if let Some(disturbance) = &self.disturbance {
            found.vector(&at.then("disturbance"), disturbance);
        }
        if self.mass.is_none() && self.inertia.is_none() && self.disturbance.is_none() {
            found.add(
                at.clone(),
                "the change changes nothing",
                "state a new `mass`, `inertia` or `disturbance`, or leave the change out",
            );
        }
    }
}

/// J is that of a body: each moment above 0 and none larger than the sum of the other two.
pub(super) fn check_inertia(inertia: &Vector, key: &Key, found: &mut Findings) {
    let mut good = true;
    for (axis, &moment) in inertia.iter().enumerate() {
        good &= found.positive(&key.then(axis), &format!("J{}", axis + 1), moment);
    }
    if !good {
        return;
    }
    let sum: f64 = inertia.iter().sum();
    for (axis, &moment) in inertia.iter().enumerate() {
        let others = sum - moment;
        if moment > others * (1.0 + TRIANGLE_TOLERANCE) {
            found.add(
                key.then(axis),
                format!(
                    "J{} = {moment:?} kg m² is larger than the other two moments together, {} kg m²: no body is like that",
                    axis + 1,
                    six_digits(others)
                ),
                "check the moments; each is at most the sum of the other two",
            );
        }
    }
}
