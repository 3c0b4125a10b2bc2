//! Control laws for a vehicle with a rate loop, as the control supervisor flies them.
//!
//! The supervisor surrounds every law with input validation, failsafe stages, dead reckoning, bumpless transfer, the
//! yaw law, limits and the roll-out over the hold of a command. A law is an evaluation at one moment ([`Law`]) and, for
//! the baselines, what it learns from hold to hold ([`baseline::Baseline`]).
//!
//! * [`baseline`]: the trait of the baselines;
//! * [`baseline_law`]: the baseline of a flight;
//! * [`nominal`]: the loop that all baselines have in common;
//! * [`geometric_pid`], [`l1`], [`indi`], [`nf_constant`], [`px4`]: one baseline each.

pub mod baseline;
pub mod baseline_law;
pub mod geometric_pid;
pub mod indi;
pub mod l1;
pub mod nf_constant;
pub mod nominal;
pub mod px4;

use nalgebra::Vector3;

use crate::signals::{EstimateRates, Measured, Reference};

/// A law in the roll-out over the hold of a command ([`crate::rates`]).
pub trait Law {
    /// Values of the law at one moment.
    type Evaluation: Copy;

    /// Evaluates the law at one moment, with `push` (in {I}, m/s²) as the acceleration that its model does not explain.
    fn evaluate(&self, vehicle: &Measured, reference: &Reference, push: &Vector3<f64>) -> Self::Evaluation;

    /// Returns T, N; any real number.
    fn thrust(&self, evaluation: &Self::Evaluation) -> f64;

    /// Moves the first two components of ω (rad/s) to where the law has them after `h` seconds.
    fn turn(&self, omega: &mut Vector3<f64>, evaluation: &Self::Evaluation, h: f64);

    /// Returns the vehicle's acceleration under a thrust (N) by the law's model, in {I}, m/s².
    fn acceleration(&self, vehicle: &Measured, thrust: f64) -> Vector3<f64>;

    /// Returns what is recorded of an evaluation.
    fn telemetry(&self, evaluation: &Self::Evaluation) -> Telemetry;
}

/// Recorded values of a law; those that a law does not have are zero.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Telemetry {
    /// Velocity error, in {I}, m/s: z2 of (9), or ė + λe.
    pub z2: Vector3<f64>,
    /// ω − ωd in {B}, rad/s.
    pub z3: Vector3<f64>,
    /// Acceleration that the thrust is to give, in {B}, m/s².
    pub zeta: Vector3<f64>,
    /// Desired angular velocity, in {B}, rad/s.
    pub omega_desired: Vector3<f64>,
    /// Rates of the adaptive law's estimates.
    pub rates: EstimateRates,
}
