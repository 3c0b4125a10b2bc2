//! Geometric PID on SE(3): the nominal loop with an integral (Goodarzi, Lee and Leok, ECC 2013).
//!
//! İ = ki (ė + λe) with λ = 2 Kp/Kv, each component within a bound. The source's integral of the attitude error has no
//! place behind commands of body rates. Memory: I.

use nalgebra::Vector3;
use scenario::Baseline as Stated;

use super::Memory;
use super::baseline::{Baseline, Motion, error_slope, save_vector, vector_at};

/// Integral of the errors.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GeometricPid {
    gain: f64,
    slope: f64,
    largest: f64,
    /// I in {I}, m/s².
    integral: Vector3<f64>,
}

impl GeometricPid {
    /// Makes the integral of a scenario.
    #[must_use]
    pub fn new(stated: &Stated) -> Self {
        Self {
            gain: stated.integral_gain,
            slope: error_slope(stated),
            largest: stated.disturbance_max,
            integral: Vector3::zeros(),
        }
    }
}

impl Baseline for GeometricPid {
    fn learn(&mut self, seen: &Motion, elapsed: f64) {
        let tracking = &seen.tracking;
        if tracking.is_limited {
            return;
        }
        let error = tracking.velocity_error + tracking.position_error * self.slope;
        let grown = self.integral + error * (self.gain * elapsed);
        self.integral = grown.map(|component| component.clamp(-self.largest, self.largest));
    }

    /// The integral of an error is the disturbance that would cause it.
    fn compensation(&self) -> Vector3<f64> {
        self.integral
    }

    fn save(&self, memory: &mut Memory) {
        save_vector(memory, 0, &self.integral);
    }

    fn restore(&mut self, memory: &Memory) {
        self.integral = vector_at(memory, 0);
    }
}
