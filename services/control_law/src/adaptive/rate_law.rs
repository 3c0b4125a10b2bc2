//! Adaptive law for a vehicle with commands of body rates (section VI of the paper).
//!
//! The torque (20) drives an *artificial* angular velocity by (4), with the inertia J of the cuboid that models the
//! vehicle; it is the command of the vehicle's rate loop.

use nalgebra::Vector3;
use vehicle_model::rigid_body::{acceleration, angular_acceleration, free_fall};

use crate::adaptive::evaluation::{Evaluation, evaluate_composite};
use crate::adaptive::harmonics::Harmonics;
use crate::adaptive::offset::hanging_offset;
use crate::adaptive::parameters::Parameters;
use crate::adaptive::repeating::Repeating;
use crate::law::{Law, Telemetry};
use crate::signals::{Estimates, Measured, ProjectedEstimates, Reference};

/// The law with what it uses over a hold.
#[derive(Clone, Copy, Debug)]
pub struct AdaptiveLaw<'a> {
    /// Gains and bounds.
    pub parameters: &'a Parameters,
    /// The estimates.
    pub estimates: &'a Estimates,
    /// Estimates of what repeats with the path, if there are any.
    pub harmonics: Option<&'a Harmonics>,
    /// Diagonal of J of (4), kg m².
    pub inertia: Vector3<f64>,
}

impl AdaptiveLaw<'_> {
    #[inline]
    fn repeating(&self, reference: &Reference) -> Repeating {
        self.harmonics.map_or(Repeating::NOTHING, |harmonics| {
            harmonics.at(reference.gamma, reference.gamma_dot)
        })
    }
}

impl Law for AdaptiveLaw<'_> {
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
            self.parameters,
            &vehicle,
            reference,
            self.estimates,
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
        let ProjectedEstimates {
            eta,
            disturbance_world,
        } = self.estimates.projected(self.parameters);
        acceleration(
            &vehicle.world_from_body,
            eta * thrust,
            &free_fall(&(disturbance_world + self.repeating(reference).disturbance_world)),
        )
    }

    fn telemetry(&self, evaluation: &Evaluation) -> Telemetry {
        Telemetry::from(evaluation)
    }
}

impl From<&Evaluation> for Telemetry {
    #[inline]
    fn from(evaluation: &Evaluation) -> Self {
        Self {
            z2: evaluation.z2,
            z3: evaluation.z3,
            zeta: evaluation.zeta,
            omega_desired: evaluation.omega_desired,
            rates: evaluation.rates,
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
