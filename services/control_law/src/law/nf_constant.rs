//! Composite adaptation with constant basis functions: NF-Constant of Neural-Fly (O'Connell et al., arXiv 2205.06908).
//!
//! â̇ = (p/r) (d − â) + p (ė + λe) with λ = 2 Kp/Kv: the prediction error of the measured residual d and the tracking
//! error drive one estimate. p is constant where the source steps a covariance P(t), and its damping −λâ is left out.

use nalgebra::Vector3;
use scenario::{Baseline as Gains, Controller};

use super::baseline::{DisturbanceEstimator, Motion, error_slope};

/// Composite adaptation of a constant disturbance.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NfConstant {
    /// p, 1/s².
    tracking_gain: f64,
    /// p/r, 1/s.
    prediction_gain: f64,
    slope: f64,
    largest: f64,
}

shared_types::sample! {
    /// Estimate of the disturbance.
    pub struct NfConstantState {
        /// â in {I}, m/s².
        pub estimate_world: [f64; 3],
    }
}

impl DisturbanceEstimator for NfConstant {
    type State = NfConstantState;

    fn new(gains: &Gains, _controller: &Controller) -> Self {
        Self {
            tracking_gain: gains.composite_tracking_gain,
            prediction_gain: gains.composite_prediction_gain,
            slope: error_slope(gains),
            largest: gains.disturbance_max,
        }
    }

    fn adapt(&self, state: &mut NfConstantState, motion: &Motion, elapsed: f64) {
        let tracking = &motion.tracking;
        let share = 1.0 - libm::exp(-self.prediction_gain * elapsed);
        let before = self.compensation(state);
        let mut estimate = before + (motion.residual - before) * share;
        if !tracking.is_limited {
            let error = tracking.velocity_error + tracking.position_error * self.slope;
            estimate += error * (self.tracking_gain * elapsed);
        }
        state.estimate_world = estimate
            .map(|component| component.clamp(-self.largest, self.largest))
            .into();
    }

    fn compensation(&self, state: &NfConstantState) -> Vector3<f64> {
        state.estimate_world.into()
    }
}
