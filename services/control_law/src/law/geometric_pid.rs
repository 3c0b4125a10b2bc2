//! Geometric PID on SE(3): the nominal loop with an integral (Goodarzi, Lee and Leok, ECC 2013).
//!
//! İ = ki (ė + λe) with λ = 2 Kp/Kv, each component within a bound. The source's integral of the attitude error has no
//! equivalent behind commands of body rates.

use nalgebra::Vector3;
use scenario::{Baseline as Gains, Controller};

use super::baseline::{DisturbanceEstimator, Motion, error_slope};

/// Integral of the errors: the disturbance that would cause them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GeometricPid {
    gain: f64,
    slope: f64,
    largest: f64,
}

shared_types::sample! {
    /// State of the integral.
    pub struct GeometricPidState {
        /// I in {I}, m/s².
        pub integral_world: [f64; 3],
    }
}

impl DisturbanceEstimator for GeometricPid {
    type State = GeometricPidState;

    fn new(gains: &Gains, _controller: &Controller) -> Self {
        Self {
            gain: gains.integral_gain,
            slope: error_slope(gains),
            largest: gains.disturbance_max,
        }
    }

    fn adapt(&self, state: &mut GeometricPidState, motion: &Motion, elapsed: f64) {
        let tracking = &motion.tracking;
        if tracking.is_limited {
            return;
        }
        let error = tracking.velocity_error + tracking.position_error * self.slope;
        let grown = self.compensation(state) + error * (self.gain * elapsed);
        state.integral_world = grown
            .map(|component| component.clamp(-self.largest, self.largest))
            .into();
    }

    fn compensation(&self, state: &GeometricPidState) -> Vector3<f64> {
        state.integral_world.into()
    }
}
