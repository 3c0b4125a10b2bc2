//! What every baseline has: it learns once a hold from [`Motion`], and compensates a disturbance by its estimate.
//!
//! Its memory is a fixed record, so that a restarted controller goes on from the checkpoint and a replay repeats every
//! step.

use nalgebra::Vector3;

use super::nominal::Tracking;

/// Numbers of a baseline's memory.
pub const MEMORY: usize = 9;

/// State of a baseline from hold to hold; each baseline says what its numbers are.
pub type Memory = [f64; MEMORY];

/// Returns λ = 2 Kp/Kv, 1/s: the slope of the error ė + λe that integrals add up.
#[must_use]
pub fn error_slope(stated: &scenario::Baseline) -> f64 {
    2.0 * stated.position_gain / stated.velocity_gain
}

/// Motion at the beginning of a hold.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Motion {
    /// Errors against the reference.
    pub tracking: Tracking,
    /// V in {I}, m/s.
    pub velocity_world: Vector3<f64>,
    /// g e3 − η0 T n in {I}, m/s²: the acceleration by gravity and thrust at the prior mass.
    pub modelled_acceleration: Vector3<f64>,
    /// d in {I}, m/s²: the acceleration that the estimator sees, less the modelled one.
    pub residual: Vector3<f64>,
    /// Third component of the thrust axis n.
    pub thrust_axis_z: f64,
    /// T that acts, N.
    pub thrust: f64,
}

/// Part of a law that learns.
pub trait Baseline {
    /// Learns over the coming hold of `h` seconds.
    fn learn(&mut self, seen: &Motion, h: f64);

    /// Prepares for a hold without learning: the vehicle or the link cannot follow, or no measurement arrived.
    fn rest(&mut self) {}

    /// Returns the disturbance to compensate, in {I}, m/s².
    fn compensation(&self) -> Vector3<f64>;

    /// Returns the estimate of the mass, kg, if the baseline has one.
    fn mass(&self) -> Option<f64> {
        None
    }

    /// Returns the state.
    fn memory(&self) -> Memory;

    /// Restores a saved state.
    fn restore(&mut self, memory: &Memory);
}

/// Returns the memory of a baseline that keeps one vector.
#[must_use]
pub fn memory_of(vector: &Vector3<f64>) -> Memory {
    let mut memory = [0.0; MEMORY];
    memory[..3].copy_from_slice(vector.as_slice());
    memory
}

/// Returns the vector that [`memory_of`] has kept.
#[must_use]
pub fn vector_of(memory: &Memory) -> Vector3<f64> {
    Vector3::from_column_slice(&memory[..3])
}
