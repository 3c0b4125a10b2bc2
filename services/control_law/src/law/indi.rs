//! Incremental nonlinear dynamic inversion on the filter's acceleration (Smeur et al. 2016; Tal and Karaman, arXiv 1809.04048).
//!
//! The increment of the force is what the desired acceleration lacks beside the measured one. With thrust and
//! acceleration filtered alike this is the nominal loop with the residual acceleration d as the compensated
//! disturbance. Cameras alone limit its bandwidth to that of the Kalman filter. Memory: d.

use nalgebra::Vector3;

use super::Memory;
use super::baseline::{Baseline, Motion, save_vector, vector_at};

/// The last residual.
#[derive(Clone, Copy, Debug, PartialEq, Default)]
pub struct Indi {
    /// d in {I}, m/s².
    residual: Vector3<f64>,
}

impl Baseline for Indi {
    fn learn(&mut self, seen: &Motion, _elapsed: f64) {
        self.residual = seen.residual;
    }

    fn compensation(&self) -> Vector3<f64> {
        self.residual
    }

    fn save(&self, memory: &mut Memory) {
        save_vector(memory, 0, &self.residual);
    }

    fn restore(&mut self, memory: &Memory) {
        self.residual = vector_at(memory, 0);
    }
}
