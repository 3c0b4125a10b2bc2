//! What every baseline has: it learns once a step from [`Motion`], and compensates a disturbance by its estimate.
//!
//! Its memory is a fixed record, so that a restarted controller goes on from the checkpoint and a replay repeats every
//! step.

use nalgebra::Vector3;

use super::Memory;
use super::nominal::Tracking;

/// Returns λ = 2 Kp/Kv, 1/s: the slope of the error ė + λe that integrals add up.
#[must_use]
pub fn error_slope(stated: &scenario::Baseline) -> f64 {
    2.0 * stated.position_gain / stated.velocity_gain
}

/// Motion at a step.
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
    /// n = R e3 in {I}.
    pub thrust_axis_world: Vector3<f64>,
    /// T that acts, N.
    pub thrust: f64,
}

/// Part of a law that learns.
pub trait Baseline {
    /// Learns for the time since the step before, `elapsed` s; after [`rest`](Self::rest) the motion is the first one.
    fn learn(&mut self, seen: &Motion, elapsed: f64);

    /// Drops the motion of the step before, because nothing was learned since or steps were left out.
    fn rest(&mut self) {}

    /// Returns the disturbance to compensate, in {I}, m/s².
    fn compensation(&self) -> Vector3<f64>;

    /// Returns the estimate of the mass, kg, if the baseline has one.
    fn mass(&self) -> Option<f64> {
        None
    }

    /// Returns whether all numbers of the state are finite.
    fn is_finite(&self) -> bool {
        self.compensation().iter().all(|number| number.is_finite())
    }

    /// Writes the state.
    fn save(&self, memory: &mut Memory);

    /// Restores a saved state.
    fn restore(&mut self, memory: &Memory);
}

/// Writes a vector to three numbers of a memory, from `at` on.
pub fn save_vector(memory: &mut Memory, at: usize, vector: &Vector3<f64>) {
    memory[at..at + 3].copy_from_slice(vector.as_slice());
}

/// Returns the vector that [`save_vector`] has written.
#[must_use]
pub fn vector_at(memory: &Memory, at: usize) -> Vector3<f64> {
    Vector3::from_column_slice(&memory[at..at + 3])
}
