//! Gains and bounds of the law, in the law's form.

use nalgebra::Vector3;
use scenario::{Bounds, Scenario};
use shared_types::Gains;

use crate::adaptive::projection::Projection;
use crate::adaptive::saturation::Saturation;
use crate::signals::VehicleEstimate;

/// Gains and bounds of the law, with the paper's symbols.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Parameters {
    /// k1, gain on the position error, 1/s.
    pub k1: f64,
    /// k2, gain on the velocity error, 1/s.
    pub k2: f64,
    /// k3, gain on the angular velocity error.
    pub k3: f64,
    /// β, weight of the angular velocity error in the Lyapunov function; positive.
    pub beta: f64,
    /// δ, the value to which the velocity error is driven along the thrust axis, m/s; not 0.
    pub delta: f64,
    /// σ, with σmax above δ/k1.
    pub saturation: Saturation,
    /// λm, gain of the estimator of η (14).
    pub lambda_mass: f64,
    /// Diagonal of Λb, gains of the estimator of b (15).
    pub lambda_disturbance: Vector3<f64>,
    /// Λw is this times the identity, gain of the estimator of w (21).
    pub lambda_inertia: f64,
    /// κ, weight of the prediction error beside z2 in the estimators of η and b, s; 0 in the paper.
    pub prediction_gain: f64,
    /// `true` if the law uses the measured acceleration that the estimates do not explain as a part of b at once.
    pub observes_disturbance: bool,
    /// π for η̂ and b̂.
    pub projections: Projections,
    /// `true` if the law is shifted so that the vehicle hangs on the path and not below it.
    pub removes_offset: bool,
}

/// Projections (5) of the estimates of η and b.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Projections {
    /// π for η̂, 1/kg.
    pub eta: Projection,
    /// π for each component of b̂, m/s².
    pub disturbance: Projection,
}

impl From<&Bounds> for Projections {
    fn from(bounds: &Bounds) -> Self {
        Self {
            eta: Projection {
                minimum: 1.0 / bounds.mass_max,
                maximum: 1.0 / bounds.mass_min,
                epsilon: bounds.epsilon_eta,
            },
            disturbance: Projection {
                minimum: -bounds.disturbance,
                maximum: bounds.disturbance,
                epsilon: bounds.epsilon_disturbance,
            },
        }
    }
}

impl Projections {
    /// Returns π(η̂) and π(b̂).
    #[must_use]
    #[inline]
    pub fn of(&self, estimate: &VehicleEstimate) -> VehicleEstimate {
        VehicleEstimate {
            eta: self.eta.value(estimate.eta),
            disturbance_world: estimate.disturbance_world.map(|b| self.disturbance.value(b)),
        }
    }
}

impl From<&Scenario> for Parameters {
    fn from(scenario: &Scenario) -> Self {
        let controller = &scenario.controller;
        let gains = scenario.gains();
        Self {
            k1: gains.k1,
            k2: gains.k2,
            k3: gains.k3,
            beta: gains.beta,
            delta: controller.delta,
            saturation: Saturation {
                level: controller.sigma_max,
            },
            lambda_mass: gains.lambda_mass,
            lambda_disturbance: Vector3::from(gains.lambda_disturbance),
            lambda_inertia: gains.lambda_inertia,
            prediction_gain: gains.prediction_gain,
            observes_disturbance: controller.disturbance_observer,
            projections: Projections::from(&controller.bounds),
            removes_offset: controller.remove_offset,
        }
    }
}

impl Parameters {
    /// Returns the parameters with other gains.
    #[must_use]
    pub fn with_gains(&self, gains: &Gains) -> Self {
        let Gains {
            k1,
            k2,
            k3,
            beta,
            lambda_mass,
            lambda_disturbance,
            lambda_inertia,
            prediction_gain,
        } = *gains;
        Self {
            k1,
            k2,
            k3,
            beta,
            lambda_mass,
            lambda_disturbance: lambda_disturbance.into(),
            lambda_inertia,
            prediction_gain,
            ..*self
        }
    }
}
