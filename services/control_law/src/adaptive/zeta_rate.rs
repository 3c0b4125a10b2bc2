//! ζ̇ as an affine function of the unknown acceleration A = −ηT R e3 + b.
//!
//! ζ̇ = −S(ω)ζ + Rᵀ(−p⃛d + k1 σ̈(z1) + k2 σ′(z2)∘ż2 + π′(b̂)∘(Λb z2)), where A enters through
//!
//! * z̈1 = g e3 − p̈d + A in σ̈(z1) = σ″(z1)∘ż1∘ż1 + σ′(z1)∘z̈1,
//! * ż2 = g e3 − p̈d + k1 σ̇(z1) − R S(ω)δ + A,
//! * ‖z1‖¨ in γ⃛, and hence p⃛d: the timing law depends on the position error.
//!
//! Collected, ζ̇ = ζ̇known + Rᵀ M A with M = −c1 pd′ z1ᵀ/‖z1‖ + k1 diag σ′(z1) + k2 diag σ′(z2).

use nalgebra::{Matrix3, Vector3};

use crate::adaptive::errors::Errors;
use crate::adaptive::parameters::Parameters;
use crate::signals::{Measured, Reference};

/// ζ̇ = `known` + `sensitivity` A.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ZetaRate {
    /// ζ̇known, the value of ζ̇ without the unknown acceleration, in {B}, m/s³.
    pub known: Vector3<f64>,
    /// Rᵀ M, 1/s.
    pub sensitivity: Matrix3<f64>,
}

/// γ⃛ = `known` + `sensitivity`ᵀ A.
struct GammaJerk {
    known: f64,
    sensitivity: Vector3<f64>,
}

impl ZetaRate {
    /// Returns ζ̇ on the closed loop, for ζ in m/s² and the rate of π(b̂) in m/s³, in {I}.
    #[must_use]
    #[inline]
    pub fn new(
        parameters: &Parameters,
        measured: &Measured,
        reference: &Reference,
        errors: &Errors,
        zeta: &Vector3<f64>,
        disturbance_projected_rate: &Vector3<f64>,
    ) -> Self {
        let Parameters { k1, k2, .. } = *parameters;
        let omega = &measured.angular_velocity_body;
        let body_from_world = measured.world_from_body.transpose();
        let slope1 = errors.sigma_z1.slope();
        let slope2 = errors.sigma_z2.slope();

        // With A = 0:
        let z1_ddot = errors.free_acceleration;
        let sigma_z1_ddot = errors
            .sigma_z1
            .curvature()
            .component_mul(&errors.z1_dot)
            .component_mul(&errors.z1_dot)
            + slope1.component_mul(&z1_ddot);
        let z2_dot = z1_ddot + errors.sigma_z1_dot * k1 - delta_rate_world(parameters.delta, measured);
        let gamma_dddot = GammaJerk::new(reference, errors);
        let u_dot = sigma_z1_ddot * k1 + slope2.component_mul(&z2_dot) * k2 + disturbance_projected_rate
            - reference.jerk_world(gamma_dddot.known);

        let mut m = -reference.derivative1_world * gamma_dddot.sensitivity.transpose();
        for axis in 0..3 {
            m[(axis, axis)] += k1 * slope1[axis] + k2 * slope2[axis];
        }
        Self {
            known: body_from_world * u_dot - omega.cross(zeta),
            sensitivity: body_from_world * m,
        }
    }
}

impl GammaJerk {
    /// Returns γ⃛ = c0 + c1 ‖z1‖¨ with ‖z1‖¨ = (ż1ᵀż1 + z1ᵀz̈1)/‖z1‖ − (z1ᵀż1)²/‖z1‖³.
    ///
    /// With c1 = 0 nothing is divided by ‖z1‖, which may be 0 there: 0/0 would put NaN into the torque.
    #[inline]
    fn new(reference: &Reference, errors: &Errors) -> Self {
        let (c0, c1) = (reference.gamma_dddot_constant, reference.gamma_dddot_slope);
        if c1 == 0.0 {
            return Self {
                known: c0,
                sensitivity: Vector3::zeros(),
            };
        }
        let distance = errors.z1.norm();
        let direction = errors.z1 / distance;
        let distance_dot = direction.dot(&errors.z1_dot);
        let across = errors.z1_dot.norm_squared() - distance_dot * distance_dot;
        Self {
            known: c0 + c1 * (across / distance + direction.dot(&errors.free_acceleration)),
            sensitivity: direction * c1,
        }
    }
}

/// Returns R S(ω)δ, the rate of Rδ, in {I}: S(ω)δ = δ [ω2, −ω1, 0]ᵀ.
#[inline]
fn delta_rate_world(delta: f64, measured: &Measured) -> Vector3<f64> {
    let omega = &measured.angular_velocity_body;
    measured.world_from_body * Vector3::new(delta * omega.y, -delta * omega.x, 0.0)
}
