//! Lyapunov function of the closed loop, for the evaluation of a flight from outside: it needs the true parameters,
//! which the law does not have.
//!
//! Vn = ½ z2ᵀz2 + (β/2) z3ᵀJz3 + ½ w̃ᵀΛw⁻¹w̃ + λm⁻¹V(η, η̃) + Σ λi⁻¹V(bi, b̃i), with V of (6), and along the
//! closed loop in continuous time, with constant parameters, dVn/dt = −k2 z2ᵀσ(z2) − k3 z3ᵀσ(z3) ≤ 0.

use nalgebra::Vector3;

use crate::adaptive::evaluation::Evaluation;
use crate::adaptive::parameter_vector::parameter_vector;
use crate::adaptive::parameters::Parameters;
use crate::signals::Estimates;

/// Parameters of the vehicle, unknown to the law.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TrueParameters {
    /// Diag(J), kg m².
    pub inertia: Vector3<f64>,
    /// η = 1/m, 1/kg.
    pub eta: f64,
    /// b in {I}, m/s².
    pub disturbance_world: Vector3<f64>,
}

/// Vn.
///
/// All gains of the estimators must be positive: an estimator that is switched off is not part of Vn.
#[must_use]
pub fn value(
    parameters: &Parameters,
    actual: &TrueParameters,
    estimates: &Estimates,
    evaluation: &Evaluation,
) -> f64 {
    let Evaluation { z2, z3, .. } = evaluation;
    let w = parameter_vector(&actual.inertia, actual.eta, &actual.disturbance_world);
    let errors = 0.5 * z2.norm_squared() + 0.5 * parameters.beta * z3.dot(&actual.inertia.component_mul(z3));
    let of_w = 0.5 * (estimates.w - w).norm_squared() / parameters.lambda_inertia;
    let of_eta = parameters.projections.eta.potential(actual.eta, estimates.eta) / parameters.lambda_mass;
    let of_disturbance = actual
        .disturbance_world
        .zip_zip_map(
            &estimates.disturbance_world,
            &parameters.lambda_disturbance,
            |b, b_hat, lambda| parameters.projections.disturbance.potential(b, b_hat) / lambda,
        )
        .sum();
    errors + of_w + of_eta + of_disturbance
}

/// dVn/dt = −k2 z2ᵀσ(z2) − k3 z3ᵀσ(z3) along the closed loop; never positive.
#[must_use]
pub fn rate(parameters: &Parameters, evaluation: &Evaluation) -> f64 {
    let Evaluation { z2, z3, .. } = evaluation;
    let sigma = &parameters.saturation;
    -parameters.k2 * z2.dot(&sigma.at(z2).value()) - parameters.k3 * z3.dot(&sigma.at(z3).value())
}
