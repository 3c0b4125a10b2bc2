//! Assumption 1 of the paper: the unknown parameters, and so the initial estimates, lie within bounds known to the
//! controller. The theorem does not hold outside of them.

use super::Findings;
use crate::{Bounds, Key, Scenario, Vector};

impl Scenario {
    pub(super) fn check_assumption_1(&self, found: &mut Findings) {
        let bounds = &self.controller.bounds;
        let vehicle = Key::root().then("vehicle");
        bounds.check_mass(self.vehicle.mass, "the vehicle's mass", &vehicle, found);
        bounds.check_disturbance(&self.vehicle.disturbance, "the disturbance", &vehicle, found);
        for (index, change) in self.vehicle.change.iter().enumerate() {
            let at = vehicle.then("change").then(index);
            if let Some(mass) = change.mass {
                bounds.check_mass(mass, "the vehicle's new mass", &at, found);
            }
            if let Some(disturbance) = &change.disturbance {
                bounds.check_disturbance(disturbance, "the new disturbance", &at, found);
            }
        }
        if let Some(model) = &self.model {
            bounds.check_mass(model.mass, "the model's mass", &Key::root().then("model"), found);
        }
        let initial = &self.controller.initial;
        let at = Key::root().then("controller").then("initial");
        bounds.check_mass(initial.mass, "the initial estimate of the mass", &at, found);
        bounds.check_disturbance(
            &initial.disturbance,
            "the initial estimate of the disturbance",
            &at,
            found,
        );
    }
}

/// Grams per kilogram.
const GRAMS: f64 = 1000.0;

impl Bounds {
    /// Requires a mass within the bounds, if mass and bounds are valid by themselves.
    fn check_mass(&self, mass: f64, what: &str, at: &Key, found: &mut Findings) {
        let is_checkable = mass > 0.0 && mass.is_finite() && self.mass_min < self.mass_max;
        if is_checkable && !(self.mass_min..=self.mass_max).contains(&mass) {
            let in_kilograms = mass / GRAMS;
            let bound = if mass > self.mass_max && in_kilograms > 0.5 * self.mass_min {
                format!(
                    "masses are in kg: give {in_kilograms:?} if {mass:?} g are meant, else raise `controller.bounds.mass_max`"
                )
            } else if mass < self.mass_min {
                format!("lower `controller.bounds.mass_min` to {mass:?} or less")
            } else {
                format!("raise `controller.bounds.mass_max` to {mass:?} or more")
            };
            found.add(
                at.then("mass"),
                format!(
                    "{what} of {mass:?} kg lies outside the controller's bounds from {:?} kg to {:?} kg (Assumption 1)",
                    self.mass_min, self.mass_max
                ),
                format!("{bound}, or choose another mass"),
            );
        }
    }

    /// Requires each component of an acceleration within the bounds, if both are valid by themselves.
    fn check_disturbance(&self, disturbance: &Vector, what: &str, at: &Key, found: &mut Findings) {
        for (axis, &component) in disturbance.iter().enumerate() {
            let is_checkable = component.is_finite() && self.disturbance > 0.0;
            if is_checkable && component.abs() > self.disturbance {
                found.add(
                    at.then("disturbance").then(axis),
                    format!(
                        "{what} of {component:?} m/s² lies outside the controller's bounds of ±{:?} m/s² (Assumption 1)",
                        self.disturbance
                    ),
                    format!(
                        "raise `controller.bounds.disturbance` to {:?} or more, or choose another disturbance",
                        component.abs()
                    ),
                );
            }
        }
    }
}
