//! Control laws, as the control supervisor flies them.
//!
//! The supervisor surrounds every law with input validation, failsafe stages, dead reckoning, bumpless transfer and
//! limits; [`FlightLaw`](flight_law::FlightLaw) is its only interface to a law, and [`registry`] the only list of laws.
//! A law for a vehicle with a rate loop is an evaluation at one moment ([`RollOutLaw`]), which the roll-out repeats over
//! the hold of a command; a baseline adds an estimator that steps once a command
//! ([`baseline::DisturbanceEstimator`]).
//!
//! * [`flight_law`]: the interface of a law, and its state in a checkpoint;
//! * [`registry`]: the constructor of each law;
//! * [`baseline`]: the estimator of a baseline;
//! * [`baseline_law`]: a baseline, the nominal loop with an estimator;
//! * [`nominal`]: the loop that the baselines have in common;
//! * [`geometric_pid`], [`l1`], [`indi`], [`nf_constant`], [`px4`], [`immersion_mass`]: one estimator each;
//! * [`immersion_inertia`]: a baseline that commands torque;
//! * [`nmpc`]: model predictive control, which plans the hold itself.

pub mod baseline;
pub mod baseline_law;
pub mod flight_law;
pub mod geometric_pid;
pub mod immersion_inertia;
pub mod immersion_mass;
pub mod indi;
pub mod l1;
pub mod nf_constant;
pub mod nmpc;
pub mod nominal;
pub mod px4;
pub mod registry;

use nalgebra::Vector3;

use crate::signals::{Acting, Commanded, Measured, Reference};

/// A law in the roll-out over the hold of a command ([`crate::rates`]).
pub trait RollOutLaw {
    /// Values of the law at one moment.
    type Evaluation: Copy;

    /// Evaluates the law at one moment, with `push` (in {I}, m/s²) as the acceleration that its model does not explain.
    fn evaluate(&self, vehicle: &Measured, reference: &Reference, push: &Vector3<f64>) -> Self::Evaluation;

    /// Returns T, N; any real number.
    fn thrust(&self, evaluation: &Self::Evaluation) -> f64;

    /// Moves the first two components of ω (rad/s) to where the law has them after `h` seconds.
    fn turn(&self, omega: &mut Vector3<f64>, evaluation: &Self::Evaluation, h: f64);

    /// Returns the vehicle's acceleration under a thrust (N) by the law's model, in {I}, m/s².
    fn acceleration(&self, vehicle: &Measured, reference: &Reference, thrust: f64) -> Vector3<f64>;

    /// Returns the recorded values of an evaluation.
    fn telemetry(&self, evaluation: &Self::Evaluation) -> Telemetry;
}

/// Inputs of a law at a step.
#[derive(Clone, Copy, Debug)]
pub struct Moment<'a> {
    /// The measured state, or the predicted one.
    pub measured: Measured,
    /// Thrust and acceleration that act on the vehicle.
    pub acting: Acting,
    /// The reference.
    pub reference: &'a Reference,
    /// ψd, rad.
    pub yaw: f64,
    /// Time since the previous step, s, which is longer than usual where steps were left out; at the first the usual one.
    pub elapsed: f64,
    /// `true` if the estimates may adapt to the motion: it is measured, and the vehicle is airborne.
    pub may_adapt: bool,
}

/// Command of a law.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LawOutput {
    /// The command.
    pub command: Commanded,
    /// T as the link will carry it, N.
    pub limited_thrust: f64,
    /// Recorded values of the law.
    pub telemetry: Telemetry,
    /// `true` if the vehicle can follow the command, so that the estimates may adapt to its motion.
    pub is_feasible: bool,
}

impl LawOutput {
    /// Makes the output of a law that commands thrust (N) and torque (N m), which the vehicle follows at once.
    #[must_use]
    pub fn of_torque(thrust: f64, torque_body: Vector3<f64>, telemetry: Telemetry) -> Self {
        Self {
            command: Commanded {
                thrust,
                torque_body: torque_body.into(),
                ..Commanded::NOTHING
            },
            limited_thrust: thrust,
            telemetry,
            is_feasible: true,
        }
    }
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
}
