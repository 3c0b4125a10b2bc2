//! PD with an estimate of the mass by immersion and invariance, in the style of the paper's ref. \[30\].
//!
//! The nominal loop with the mass of the [observer](crate::observer), which explains everything along the thrust axis by
//! the mass; nothing compensates a disturbance.

use nalgebra::Vector3;
use scenario::{Baseline as Gains, Controller};

use super::baseline::{DisturbanceEstimator, Motion};
use crate::observer::{ObserverSample, ObserverState};

/// Estimator of the mass alone.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ImmersionMass {
    /// γ, 1/(N² s).
    gain: f64,
    prior_mass: f64,
    /// Range of θ̂, 1/kg.
    range: [f64; 2],
}

impl DisturbanceEstimator for ImmersionMass {
    type State = ObserverState;

    fn new(gains: &Gains, controller: &Controller) -> Self {
        let bounds = &controller.bounds;
        Self {
            gain: gains.immersion_gain,
            prior_mass: controller.initial.mass,
            range: [1.0 / bounds.mass_max, 1.0 / bounds.mass_min],
        }
    }

    fn initial(&self) -> ObserverState {
        ObserverState::new(self.prior_mass)
    }

    fn adapt(&self, state: &mut ObserverState, motion: &Motion, elapsed: f64) {
        let sample = ObserverSample {
            velocity_world: motion.velocity_world.into(),
            thrust_axis_world: motion.thrust_axis_world.into(),
            thrust: motion.thrust,
        };
        state.step(self.gain, &sample, elapsed);
        state.theta = state.theta.clamp(self.range[0], self.range[1]);
    }

    fn interrupt(&self, state: &mut ObserverState) {
        state.interrupt();
    }

    fn compensation(&self, _state: &ObserverState) -> Vector3<f64> {
        Vector3::zeros()
    }

    fn mass(&self, state: &ObserverState) -> Option<f64> {
        Some(1.0 / state.theta)
    }
}
