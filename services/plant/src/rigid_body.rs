//! The rigid body, equations (1)–(4) of the paper, as a pure vector field.
//!
//! Symbols: p position in {I}; R = `world_from_body`; v and ω linear and angular velocity in {B}; m mass;
//! J = Diag(`inertia`); b disturbance, an acceleration in {I}; T thrust along −R e3; τ torque in {B}.
//! {I} has z down: gravity is +g e3.

use std::ops::{Add, Mul};

use nalgebra::{Matrix3, Vector3};
use shared_types::rotation::skew;
use shared_types::scenario::GRAVITY;

/// What the controller does not know of the vehicle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Body {
    /// m, kg.
    pub mass: f64,
    /// Diagonal of J, kg m².
    pub inertia: Vector3<f64>,
    /// b, acceleration in {I}, m/s².
    pub disturbance_world: Vector3<f64>,
}

/// Where the body is and how it moves: the state of (1)–(4).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Motion {
    /// p, position in {I}, m.
    pub position_world: Vector3<f64>,
    /// R, body to inertial.
    pub world_from_body: Matrix3<f64>,
    /// v, linear velocity in {B}, m/s.
    pub velocity_body: Vector3<f64>,
    /// ω, angular velocity in {B}, rad/s.
    pub angular_velocity_body: Vector3<f64>,
}

/// Time derivative of a [`Motion`], member by member; Ṙ is a tangent of SO(3) at R.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MotionRate {
    /// ṗ in {I}, m/s.
    pub position_world: Vector3<f64>,
    /// Ṙ, 1/s.
    pub world_from_body: Matrix3<f64>,
    /// v̇ in {B}, m/s².
    pub velocity_body: Vector3<f64>,
    /// ω̇ in {B}, rad/s².
    pub angular_velocity_body: Vector3<f64>,
}

/// What the actuators exert on the body.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Wrench {
    /// T along −R e3, N; any real number in the ideal model.
    pub thrust: f64,
    /// τ in {B}, N m.
    pub torque_body: Vector3<f64>,
}

impl Body {
    /// The vector field (1)–(4) at a motion under a wrench.
    #[must_use]
    #[inline]
    pub fn motion_rate(&self, motion: &Motion, wrench: &Wrench) -> MotionRate {
        let Self {
            mass: m,
            inertia: j,
            disturbance_world: b,
        } = self;
        let Wrench {
            thrust,
            torque_body: tau,
        } = wrench;
        let Motion {
            world_from_body: r,
            velocity_body: v,
            angular_velocity_body: omega,
            ..
        } = motion;
        let e3 = Vector3::z();
        MotionRate {
            position_world: r * v,                                                              // (1)
            world_from_body: r * skew(omega),                                                   // (2)
            velocity_body: -omega.cross(v) - e3 * (thrust / m) + r.tr_mul(&(e3 * GRAVITY + b)), // (3)
            angular_velocity_body: (tau - omega.cross(&j.component_mul(omega))).component_div(j), // (4)
        }
    }
}

impl Motion {
    /// The motion after moving along a straight line for `duration` s. R leaves SO(3) on the way.
    #[must_use]
    #[inline]
    pub fn moved(&self, rate: &MotionRate, duration: f64) -> Self {
        Self {
            position_world: self.position_world + rate.position_world * duration,
            world_from_body: self.world_from_body + rate.world_from_body * duration,
            velocity_body: self.velocity_body + rate.velocity_body * duration,
            angular_velocity_body: self.angular_velocity_body + rate.angular_velocity_body * duration,
        }
    }
}

impl Add for MotionRate {
    type Output = Self;

    #[inline]
    fn add(self, other: Self) -> Self {
        Self {
            position_world: self.position_world + other.position_world,
            world_from_body: self.world_from_body + other.world_from_body,
            velocity_body: self.velocity_body + other.velocity_body,
            angular_velocity_body: self.angular_velocity_body + other.angular_velocity_body,
        }
    }
}

impl Mul<f64> for MotionRate {
    type Output = Self;

    #[inline]
    fn mul(self, factor: f64) -> Self {
        Self {
            position_world: self.position_world * factor,
            world_from_body: self.world_from_body * factor,
            velocity_body: self.velocity_body * factor,
            angular_velocity_body: self.angular_velocity_body * factor,
        }
    }
}
