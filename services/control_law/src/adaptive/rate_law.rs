//! Adaptive law for a vehicle with commands of body rates (section VI of the paper).
//!
//! The torque (20) drives an *artificial* angular velocity by (4), with the inertia J of the cuboid that models the
//! vehicle; it is the command of the vehicle's rate loop.

use nalgebra::Vector3;
use scenario::Scenario;
use vehicle_model::rigid_body::{acceleration, angular_acceleration, free_fall};

use crate::adaptive::evaluation::{Evaluation, evaluate_composite};
use crate::adaptive::harmonics::Harmonics;
use crate::adaptive::offset::hanging_offset;
use crate::adaptive::parameters::Parameters;
use crate::adaptive::repeating::Repeating;
use crate::law::{RollOutLaw, Telemetry};
use crate::signals::{Estimates, Measured, Reference, VehicleEstimate};

/// Law with its parameters and estimates.
#[derive(Clone, Copy, Debug)]
pub struct AdaptiveLaw {
    /// Gains and bounds.
    pub parameters: Parameters,
    /// η̂, b̂ and ŵ.
    pub estimates: Estimates,
    /// Estimators of the part of b that repeats with the path; `None` without.
    pub harmonics: Option<Harmonics>,
    /// Diagonal of J of (4), kg m².
    pub inertia: Vector3<f64>,
}

impl AdaptiveLaw {
    /// Makes the law of a checked scenario, with its initial estimates.
    #[must_use]
    pub fn new(scenario: &Scenario) -> Self {
        let model = scenario.model.clone().unwrap_or_default();
        Self {
            parameters: Parameters::from(scenario),
            estimates: Estimates::from(&scenario.controller.initial),
            harmonics: Harmonics::from_scenario(scenario),
            inertia: model.inertia().into(),
        }
    }

    #[inline]
    fn repeating(&self, reference: &Reference) -> Repeating {
        self.harmonics.as_ref().map_or(Repeating::NOTHING, |harmonics| {
            harmonics.at(reference.gamma, reference.gamma_dot)
        })
    }
}

impl RollOutLaw for AdaptiveLaw {
    type Evaluation = Evaluation;

    #[inline]
    fn evaluate(&self, vehicle: &Measured, reference: &Reference, push: &Vector3<f64>) -> Evaluation {
        let offset = self.parameters.offset(&vehicle.world_from_body);
        let vehicle = Measured {
            position_world: vehicle.position_world + offset,
            ..*vehicle
        };
        let mut repeating = self.repeating(reference);
        if self.parameters.observes_disturbance {
            repeating.disturbance_world += push;
        }
        // An acceleration that the estimates do not explain is their prediction error.
        evaluate_composite(
            &self.parameters,
            &vehicle,
            reference,
            &self.estimates,
            &repeating,
            push,
        )
    }

    #[inline]
    fn thrust(&self, evaluation: &Evaluation) -> f64 {
        evaluation.thrust
    }

    /// Steps (4), on the first two components of the artificial ω, by `h` seconds.
    #[inline]
    fn turn(&self, omega: &mut Vector3<f64>, evaluation: &Evaluation, h: f64) {
        let acceleration = angular_acceleration(&self.inertia, &evaluation.torque, omega);
        omega.x += acceleration.x * h;
        omega.y += acceleration.y * h;
    }

    /// v̇ of (2), with the estimates for the unknown parameters.
    #[inline]
    fn acceleration(&self, vehicle: &Measured, reference: &Reference, thrust: f64) -> Vector3<f64> {
        let VehicleEstimate {
            eta,
            disturbance_world,
        } = self.parameters.projections.of(&self.estimates.vehicle());
        acceleration(
            &vehicle.world_from_body,
            eta * thrust,
            &free_fall(&(disturbance_world + self.repeating(reference).disturbance_world)),
        )
    }

    #[inline]
    fn telemetry(&self, evaluation: &Evaluation) -> Telemetry {
        Telemetry {
            z2: evaluation.z2,
            z3: evaluation.z3,
            zeta: evaluation.zeta,
            omega_desired: evaluation.omega_desired,
        }
    }
}

impl Parameters {
    /// Returns the position shift of the law, in {I}, m: zero unless the offset is to be removed.
    #[must_use]
    #[inline]
    pub fn offset(&self, world_from_body: &nalgebra::Matrix3<f64>) -> Vector3<f64> {
        if self.removes_offset {
            hanging_offset(self, world_from_body)
        } else {
            Vector3::zeros()
        }
    }
}
