//! Control law: errors, thrust, torque and the estimators' rates, equations (7) to (22).
//!
//! {I} has z down: gravity points along +e3, thrust along −R e3. All functions are pure.

use nalgebra::{Vector2, Vector3};

use crate::adaptive::errors::Errors;
use crate::adaptive::parameters::Parameters;
use crate::adaptive::regressor::{Regressor, delta_m_times};
use crate::adaptive::repeating::Repeating;
use crate::adaptive::zeta_rate::ZetaRate;
use crate::signals::{EstimateRates, Estimates, Measured, Reference};

/// All values of the law at one moment.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Evaluation {
    /// z1 = p − pd(γ), eq. (7), in {I}, m.
    pub z1: Vector3<f64>,
    /// z2, eq. (9), in {I}, m/s.
    pub z2: Vector3<f64>,
    /// z3 = ω − ωd, eq. (18), in {B}, rad/s.
    pub z3: Vector3<f64>,
    /// z4 = γ̇ − γ̇d, eq. (22), 1/s.
    pub z4: f64,
    /// ζ, the acceleration that the thrust is to give, in {B}, m/s².
    pub zeta: Vector3<f64>,
    /// ωd, the virtual angular velocity, eq. (18), in {B}, rad/s.
    pub omega_desired: Vector3<f64>,
    /// T along −R e3, eq. (16), N; any real number.
    pub thrust: f64,
    /// τ, eq. (20), in {B}, N m.
    pub torque: Vector3<f64>,
    /// z2 + κε, which drives the estimators of η, b and its harmonics, in {I}, m/s.
    pub composite_error: Vector3<f64>,
    /// Rates of the estimators, eqs. (14), (15), (21).
    pub rates: EstimateRates,
    /// W of (20).
    pub regressor: Regressor,
}

/// Evaluates the law at one moment.
#[must_use]
#[inline]
pub fn evaluate(
    parameters: &Parameters,
    measured: &Measured,
    reference: &Reference,
    estimates: &Estimates,
) -> Evaluation {
    let (repeating, error) = (Repeating::NOTHING, Vector3::zeros());
    evaluate_composite(parameters, measured, reference, estimates, &repeating, &error)
}

/// Evaluates the law with composite adaptation (not in the paper).
///
/// The prediction error ε is the measured acceleration less that of the estimates, in {I}, m/s². The estimators of η and
/// b are driven by z2 + κε instead of z2. Then V̇n = −k2 z2ᵀσ(z2) − k3 z3ᵀσ(z3) − κ‖ε‖²: one κ must serve both, or the
/// cross terms do not cancel.
///
/// `repeating` is the estimate of the part of b that repeats with the path ([`crate::adaptive::harmonics`]).
#[must_use]
#[inline]
pub fn evaluate_composite(
    parameters: &Parameters,
    measured: &Measured,
    reference: &Reference,
    estimates: &Estimates,
    repeating: &Repeating,
    prediction_error: &Vector3<f64>,
) -> Evaluation {
    let Parameters {
        k1,
        k2,
        k3,
        beta,
        delta,
        ..
    } = *parameters;
    let r = &measured.world_from_body;
    let omega = &measured.angular_velocity_body;
    let pi_b = parameters.projections.disturbance;

    let errors = Errors::new(parameters, measured, reference);
    let z2 = errors.z2;
    let z2_body = r.tr_mul(&z2);

    // Thrust (16); e3ᵀS(ω)δ = 0.
    let u = errors.free_acceleration
        + errors.sigma_z1_dot * k1
        + errors.sigma_z2.value() * k2
        + estimates.disturbance_world.map(|b| pi_b.value(b))
        + repeating.disturbance_world;
    let zeta = r.tr_mul(&u);
    let thrust = zeta.z / parameters.projections.eta.value(estimates.eta);

    // Virtual angular velocity (18).
    let omega_desired = with_third(-delta_m_times(delta, &zeta));
    let z3 = omega - omega_desired;

    // Estimators of η and b. Without κ, ε is not evaluated: it may not be finite.
    let (composite_error, composite_error_body) = if parameters.prediction_gain == 0.0 {
        (z2, z2_body)
    } else {
        let composite_error = z2 + prediction_error * parameters.prediction_gain;
        (composite_error, r.tr_mul(&composite_error))
    };
    let eta_rate = -parameters.lambda_mass * thrust * composite_error_body.z; // (14)
    let disturbance_rate = parameters.lambda_disturbance.component_mul(&composite_error); // (15)

    // Torque (20), and the estimator of w (21).
    let disturbance_projected_rate = estimates
        .disturbance_world
        .map(|b| pi_b.slope(b))
        .component_mul(&disturbance_rate)
        + composite_error * repeating.gain
        + repeating.rate_world;
    let zeta_rate = ZetaRate::new(
        parameters,
        measured,
        reference,
        &errors,
        &zeta,
        &disturbance_projected_rate,
    );
    let regressor = Regressor::new(omega, delta, &(r.column(2) * thrust), &zeta_rate);
    let coupling = Vector3::new(delta * z2_body.y, -delta * z2_body.x, 0.0); // δnᵀ Π12 Rᵀ z2
    let sigma_z3 = parameters.saturation.at(&z3).value();
    let mut w = estimates.w;
    let mut of_disturbance = w.fixed_rows_mut::<9>(6);
    of_disturbance += repeating.w;
    let torque = -regressor.times(&w) - (coupling + sigma_z3 * k3) / beta;
    let w_rate = regressor.transpose_times(&z3) * (beta * parameters.lambda_inertia);

    Evaluation {
        z1: errors.z1,
        z2,
        z3,
        z4: reference.gamma_dot - reference.gamma_dot_desired, // (22)
        zeta,
        omega_desired,
        thrust,
        torque,
        composite_error,
        rates: EstimateRates {
            eta: eta_rate,
            disturbance_world: disturbance_rate,
            w: w_rate,
        },
        regressor,
    }
}

/// Extends a vector by a third element of zero, as the third row of δm is.
#[inline]
fn with_third(y: Vector2<f64>) -> Vector3<f64> {
    Vector3::new(y.x, y.y, 0.0)
}
