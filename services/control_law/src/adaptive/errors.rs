//! Errors of position and velocity, equations (7) and (9).

use nalgebra::Vector3;
use scenario::GRAVITY;

use crate::adaptive::parameters::Parameters;
use crate::adaptive::saturation::Saturated;
use crate::signals::{Measured, Reference};

/// Errors of position and velocity, with the terms that follow from them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Errors {
    /// z1 = p − pd(γ), eq. (7), in {I}, m.
    pub z1: Vector3<f64>,
    /// ż1 = R v − ṗd in {I}, m/s.
    pub z1_dot: Vector3<f64>,
    /// σ at z1.
    pub sigma_z1: Saturated,
    /// dσ(z1)/dt = σ′(z1)∘ż1.
    pub sigma_z1_dot: Vector3<f64>,
    /// z2 = ż1 + k1 σ(z1) − Rδ, eq. (9), in {I}, m/s.
    pub z2: Vector3<f64>,
    /// σ at z2.
    pub sigma_z2: Saturated,
    /// g e3 − p̈d in {I}, m/s²: z̈1 but for the unknown acceleration A = −ηT R e3 + b.
    pub free_acceleration: Vector3<f64>,
}

impl Errors {
    /// Returns the errors of a measured state against a reference.
    #[must_use]
    #[inline]
    pub fn new(parameters: &Parameters, measured: &Measured, reference: &Reference) -> Self {
        let Parameters {
            k1,
            delta,
            saturation: sigma,
            ..
        } = parameters;
        let r = &measured.world_from_body;
        let z1 = measured.position_world - reference.position_world; // (7)
        let z1_dot = measured.velocity_world() - reference.velocity_world();
        let sigma_z1 = sigma.at(&z1);
        let z2 = z1_dot + sigma_z1.value() * *k1 - r.column(2) * *delta; // (9)
        Self {
            z1,
            z1_dot,
            sigma_z1,
            sigma_z1_dot: sigma_z1.slope().component_mul(&z1_dot),
            z2,
            sigma_z2: sigma.at(&z2),
            free_acceleration: Vector3::new(0.0, 0.0, GRAVITY) - reference.acceleration_world(),
        }
    }
}
