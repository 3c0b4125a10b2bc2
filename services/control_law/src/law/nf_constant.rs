//! Composite adaptation with constant basis functions: NF-Constant of Neural-Fly (O'Connell et al., arXiv 2205.06908).
//!
//! â̇ = (p/r) (d − â) + p (ė + λe) with λ = 2 Kp/Kv: the prediction error of the measured residual d and the tracking
//! error drive one estimate. p is constant where the source steps a covariance P(t), and its damping −λâ is left out.
//! Memory: â.

use nalgebra::Vector3;
use scenario::Baseline as Stated;

use super::Memory;
use super::baseline::{Baseline, Motion, error_slope, save_vector, vector_at};

/// Estimate of the disturbance.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NfConstant {
    /// p, 1/s².
    tracking_gain: f64,
    /// p/r, 1/s.
    prediction_gain: f64,
    slope: f64,
    largest: f64,
    /// â in {I}, m/s².
    estimate: Vector3<f64>,
}

impl NfConstant {
    /// Makes the adaptation of a scenario.
    #[must_use]
    pub fn new(stated: &Stated) -> Self {
        Self {
            tracking_gain: stated.composite_tracking_gain,
            prediction_gain: stated.composite_prediction_gain,
            slope: error_slope(stated),
            largest: stated.disturbance_max,
            estimate: Vector3::zeros(),
        }
    }
}

impl Baseline for NfConstant {
    fn learn(&mut self, seen: &Motion, elapsed: f64) {
        let tracking = &seen.tracking;
        let share = 1.0 - libm::exp(-self.prediction_gain * elapsed);
        let mut estimate = self.estimate + (seen.residual - self.estimate) * share;
        if !tracking.is_limited {
            let error = tracking.velocity_error + tracking.position_error * self.slope;
            estimate += error * (self.tracking_gain * elapsed);
        }
        self.estimate = estimate.map(|component| component.clamp(-self.largest, self.largest));
    }

    fn compensation(&self) -> Vector3<f64> {
        self.estimate
    }

    fn save(&self, memory: &mut Memory) {
        save_vector(memory, 0, &self.estimate);
    }

    fn restore(&mut self, memory: &Memory) {
        self.estimate = vector_at(memory, 0);
    }
}
