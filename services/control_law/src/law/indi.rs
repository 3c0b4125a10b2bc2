//! Incremental nonlinear dynamic inversion on the filter's acceleration (Smeur et al. 2016; Tal and Karaman, arXiv 1809.04048).
//!
//! The increment of the force is what the desired acceleration lacks beside the measured one. With thrust and
//! acceleration filtered alike this is the nominal loop with the residual acceleration d as the compensated
//! disturbance. Cameras alone limit its bandwidth to that of the Kalman filter.

use nalgebra::Vector3;
use scenario::{Baseline as Gains, Controller};

use super::baseline::{DisturbanceEstimator, Motion};

/// The residual acceleration as the disturbance.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Indi;

shared_types::sample! {
    /// The last residual.
    pub struct IndiState {
        /// d in {I}, m/s².
        pub residual_world: [f64; 3],
    }
}

impl DisturbanceEstimator for Indi {
    type State = IndiState;

    fn new(_gains: &Gains, _controller: &Controller) -> Self {
        Self
    }

    fn adapt(&self, state: &mut IndiState, motion: &Motion, _elapsed: f64) {
        state.residual_world = motion.residual.into();
    }

    fn compensation(&self, state: &IndiState) -> Vector3<f64> {
        state.residual_world.into()
    }
}
