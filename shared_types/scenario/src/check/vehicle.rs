//! Checks of the vehicle and its changes.

use super::{Findings, six_digits};
use crate::{Key, Vector, Vehicle, VehicleChange};

/// Relative tolerance of the triangle inequality: a flat body has J1 + J2 = J3 exactly, but its rounded decimals may not.
const TRIANGLE_TOLERANCE: f64 = 1e-9;

/// Maximum plausible distance of the centre of mass from the body's origin, m.
const MAX_CENTER_DISTANCE: f64 = 0.5;

impl Vehicle {
    pub(super) fn check(&self, duration: f64, at: &Key, found: &mut Findings) {
        check_inertia(&self.inertia, &at.then("inertia"), found);
        for (index, change) in self.change.iter().enumerate() {
            change.check(&at.then("change").then(index), found);
        }
        let times: Vec<_> = self.change.iter().map(|change| change.at).collect();
        found.check_events(["change", "changes"], &at.then("change"), &times, duration);
        check_center_of_mass(&self.center_of_mass, &at.then("center_of_mass"), found);
        self.check_rig(duration, at, found);
    }

    /// Checks the parts that an ideal vehicle does not have.
    fn check_rig(&self, duration: f64, at: &Key, found: &mut Findings) {
        if let Some(wind) = &self.wind {
            wind.check(&at.then("wind"), found);
            if self.drag == [0.0; 3] && self.parasitic_drag == 0.0 {
                found.add(
                    at.then("wind"),
                    "the wind has no effect on a vehicle without drag",
                    "state `vehicle.drag`, such as `[0.06, 0.06, 0.02]` for the paper's vehicle",
                );
            }
        }
        if let Some(actuators) = &self.actuators {
            actuators.check(&at.then("actuators"), found);
        }
        if let Some(fan) = &self.fan {
            fan.check(duration, &at.then("fan"), found);
        }
    }
}

impl VehicleChange {
    /// Checks everything except the time, which the schedule checks.
    fn check(&self, at: &Key, found: &mut Findings) {
        if let Some(inertia) = &self.inertia {
            check_inertia(inertia, &at.then("inertia"), found);
        }
        if let Some(center_of_mass) = &self.center_of_mass {
            check_center_of_mass(center_of_mass, &at.then("center_of_mass"), found);
        }
        let keeps_body = self.mass.is_none() && self.inertia.is_none() && self.center_of_mass.is_none();
        if keeps_body && self.disturbance.is_none() {
            found.add(
                at.clone(),
                "the change changes nothing",
                "state a new `mass`, `inertia`, `center_of_mass` or `disturbance`, or leave the change out",
            );
        }
    }
}

/// Requires a plausible centre of mass.
pub(super) fn check_center_of_mass(center_of_mass: &Vector, key: &Key, found: &mut Findings) {
    let distance = center_of_mass.iter().map(|c| c * c).sum::<f64>().sqrt();
    if distance >= MAX_CENTER_DISTANCE {
        found.add(
            key.clone(),
            format!(
                "the centre of mass lies {} m from the origin of {{B}}, outside of any such vehicle",
                six_digits(distance)
            ),
            format!("give a point less than {MAX_CENTER_DISTANCE:?} m away"),
        );
    }
}

/// Requires a physical J: no moment is larger than the sum of the other two.
pub(super) fn check_inertia(inertia: &Vector, key: &Key, found: &mut Findings) {
    if !found.is_in_range(key) {
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
