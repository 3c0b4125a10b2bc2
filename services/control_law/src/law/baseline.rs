//! Estimator of a baseline: it steps once a command on the [`Motion`], and estimates the disturbance to compensate.
//!
//! Its state is a fixed record, so that a restarted controller continues from the checkpoint and a replay repeats every
//! step.

use std::fmt::Debug;

use nalgebra::Vector3;
use scenario::{Baseline as Gains, Controller};
use shared_types::sample::Record;
use zerocopy::FromZeros;

use super::nominal::{Nominal, Tracking};

/// Returns λ = 2 Kp/Kv, 1/s: the slope of the error ė + λe that integrals add up.
#[must_use]
pub fn error_slope(gains: &Gains) -> f64 {
    2.0 * gains.position_gain / gains.velocity_gain
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
    /// d in {I}, m/s²: the measured acceleration less the modelled one.
    pub residual: Vector3<f64>,
    /// n = R e3 in {I}.
    pub thrust_axis_world: Vector3<f64>,
    /// T that acts, N.
    pub thrust: f64,
}

/// Estimator of the disturbance, and of the mass, with its gains.
pub trait DisturbanceEstimator: Debug + Send {
    /// State from step to step.
    type State: Record + Debug + Send;

    /// Makes the estimator of a checked scenario.
    fn new(gains: &Gains, controller: &Controller) -> Self;

    /// Returns the nominal loop around the estimator.
    #[must_use]
    fn nominal(gains: &Gains) -> Nominal {
        Nominal::new(gains)
    }

    /// Returns the state at the start of a flight; zero unless stated.
    fn initial(&self) -> Self::State {
        Self::State::new_zeroed()
    }

    /// Steps over the `elapsed` seconds since the previous motion; after [`interrupt`](Self::interrupt) the motion is the
    /// first one.
    fn adapt(&self, state: &mut Self::State, motion: &Motion, elapsed: f64);

    /// Drops the previous motion: steps were left out, or the estimates may not adapt to the present one.
    fn interrupt(&self, _state: &mut Self::State) {}

    /// Returns the disturbance to compensate, in {I}, m/s².
    fn compensation(&self, state: &Self::State) -> Vector3<f64>;

    /// Returns the estimate of the mass, kg; `None` for an estimator without.
    fn mass(&self, _state: &Self::State) -> Option<f64> {
        None
    }
}
