//! Nominal loop of the baselines: geometric tracking on SE(3) with commands of thrust and body rates.
//!
//! With e = p − pd(γ), V = R v, n = R e3 and z down,
//!
//! ```text
//!     a  = p̈d − Kv ė − Kp e                    desired acceleration
//!     f  = g e3 − a + c                        c: disturbance that the baseline compensates
//!     T  = m̂ nᵀf
//!     nd = l/‖l‖,  l = f, but l_z ≥ 0.3 g
//!     ṅd = (I − nd ndᵀ) l̇/‖l‖,  ḟ = −p⃛d + Kv (v̇ − p̈d) + Kp ė
//!     ω  = Rᵀ(kR θ + nd × ṅd),  θ = (n × nd)/‖n × nd‖ · angle(n, nd)
//! ```
//!
//! A force of no size has no direction, and one that points down that of a vehicle on its back. On the ground, where thrust
//! winds down against an error that stays, the law would command the vehicle to turn over.
//!
//! To first order in θ this is the law of Lee, Leok and McClamroch (CDC 2010) at the level of rates: ω = RᵀRd ωd − kR eR.

use nalgebra::Vector3;
use scenario::{Baseline as Gains, GRAVITY};

use super::Telemetry;
use crate::signals::{Measured, Reference};

/// Least vertical component of the force whose direction the vehicle takes, as a share of the weight.
const LEAST_LIFT: f64 = 0.3;

/// Gains of the nominal loop.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Nominal {
    /// Kp for each axis of {I}, 1/s².
    pub position_gain: Vector3<f64>,
    /// Kv for each axis of {I}, 1/s.
    pub velocity_gain: Vector3<f64>,
    /// kR, 1/s.
    pub attitude_gain: f64,
    /// Largest ‖e‖ that the loop acts on, m; infinite without a limit.
    pub error_limit: f64,
}

/// Errors against the reference.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tracking {
    /// e in {I}, m, within the limit.
    pub position_error: Vector3<f64>,
    /// ė in {I}, m/s.
    pub velocity_error: Vector3<f64>,
    /// `true` if the position error was limited.
    pub is_limited: bool,
}

/// Values of the loop at one moment.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Command {
    /// Errors.
    pub tracking: Tracking,
    /// f in {B}, m/s².
    pub force: Vector3<f64>,
    /// T, N.
    pub thrust: f64,
    /// ω in {B}, rad/s; its third component is zero.
    pub omega: Vector3<f64>,
}

impl Nominal {
    /// Makes the loop with the gains of a scenario.
    #[must_use]
    pub fn new(gains: &Gains) -> Self {
        Self {
            position_gain: Vector3::repeat(gains.position_gain),
            velocity_gain: Vector3::repeat(gains.velocity_gain),
            attitude_gain: gains.attitude_gain,
            error_limit: gains.error_limit.unwrap_or(f64::INFINITY),
        }
    }

    /// Returns the errors of a state against a reference.
    #[must_use]
    pub fn tracking(&self, vehicle: &Measured, reference: &Reference) -> Tracking {
        let error = vehicle.position_world - reference.position_world;
        let distance = error.norm();
        let is_limited = distance > self.error_limit;
        Tracking {
            position_error: if is_limited {
                error * (self.error_limit / distance)
            } else {
                error
            },
            velocity_error: vehicle.velocity_world() - reference.velocity_world(),
            is_limited,
        }
    }

    /// Returns thrust and angular velocity for a vehicle of a mass (kg) that a push (m/s²) and the compensated
    /// disturbance (m/s²) act on, both in {I}. The push is that on a vehicle of this mass.
    #[must_use]
    pub fn command(
        &self,
        vehicle: &Measured,
        reference: &Reference,
        mass: f64,
        compensation: &Vector3<f64>,
        push: &Vector3<f64>,
    ) -> Command {
        let tracking = self.tracking(vehicle, reference);
        let gravity = Vector3::z() * GRAVITY;
        let axis: Vector3<f64> = vehicle.world_from_body.column(2).into();
        let desired = reference.acceleration_world()
            - self.velocity_gain.component_mul(&tracking.velocity_error)
            - self.position_gain.component_mul(&tracking.position_error);
        let force = gravity - desired + compensation;
        let thrust = mass * axis.dot(&force);

        let acceleration = gravity - axis * (thrust / mass) + push;
        let acceleration_error = acceleration - reference.acceleration_world();
        // Where the error is limited, its motion does not move the command.
        let position_share = if tracking.is_limited { 0.0 } else { 1.0 };
        let force_rate = -reference.jerk_world(reference.gamma_dddot_constant)
            + self.velocity_gain.component_mul(&acceleration_error)
            + self.position_gain.component_mul(&tracking.velocity_error) * position_share;
        Command {
            tracking,
            force: vehicle.world_from_body.tr_mul(&force),
            thrust,
            omega: self.angular_velocity(vehicle, &axis, &force, &force_rate),
        }
    }

    /// Returns the recorded values of a command.
    #[must_use]
    pub fn telemetry(&self, command: &Command) -> Telemetry {
        let Command { tracking, omega, .. } = command;
        let slowness = self.velocity_gain.map(|gain| 2.0 / gain);
        Telemetry {
            z2: tracking.velocity_error
                + self
                    .position_gain
                    .component_mul(&slowness)
                    .component_mul(&tracking.position_error),
            z3: Vector3::zeros(),
            zeta: command.force,
            omega_desired: *omega,
        }
    }

    /// Returns ω, in {B}, that turns the thrust axis onto the force and along with it.
    fn angular_velocity(
        &self,
        vehicle: &Measured,
        axis: &Vector3<f64>,
        force: &Vector3<f64>,
        force_rate: &Vector3<f64>,
    ) -> Vector3<f64> {
        let least = LEAST_LIFT * GRAVITY;
        let (mut lift, mut lift_rate) = (*force, *force_rate);
        if lift.z < least {
            (lift.z, lift_rate.z) = (least, 0.0);
        }
        let size = lift.norm();
        let desired = lift / size;
        let desired_rate = (lift_rate - desired * desired.dot(&lift_rate)) / size;
        let across = axis.cross(&desired);
        let (sine, cosine) = (across.norm(), axis.dot(&desired));
        // Upside down every way around is as long; any tilt of the next step decides.
        let turn = if sine > 0.0 {
            across * (libm::atan2(sine, cosine) / sine)
        } else {
            Vector3::zeros()
        };
        let omega_world = turn * self.attitude_gain + desired.cross(&desired_rate);
        let omega = vehicle.world_from_body.tr_mul(&omega_world);
        Vector3::new(omega.x, omega.y, 0.0)
    }
}
