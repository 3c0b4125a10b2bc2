//! Rigid body, equations (1)–(4) of the paper, as a pure vector field.
//!
//! Symbols: p position in {I}; R = `world_from_body`; v and ω linear and angular velocity in {B}; m mass;
//! J = Diag(`inertia`); b disturbance, an acceleration in {I}; T thrust along −R e3; τ torque in {B}.
//! {I} has z down: gravity is +g e3.
//!
//! The paper states (3) in {B}. Here the velocity is kept in {I}, as Rv, because there (2) and (3) give
//!
//! ```text
//! d(Rv)/dt = R S(ω) v + R v̇ = g e3 + b − (T/m) R e3
//! ```
//!
//! without the terms −S(ω)v, Rᵀe3 and Rᵀb. The motion is the same, a step costs half as much, and the integration
//! error of a fast rotation does not enter the velocity: free fall is exact even while tumbling.
//!
//! # A centre of mass that is not the origin of {B}
//!
//! p, v and their rates are those of the centre of mass, for which (1)–(4) hold. Its position relative to the body's
//! origin is c in {B}. The origin, the point that is tracked and controlled, moves as
//!
//! ```text
//! po = p − R c        d(po)/dt = Rv − R(ω × c)        d²(po)/dt² = d(Rv)/dt − R(ω̇ × c + ω × (ω × c))
//! ```
//!
//! Thrust acts through the origin, so its torque about the centre of mass is (−c) × (−T e3) = c × T e3.

use std::borrow::Cow;
use std::ops::{Add, Mul};

use nalgebra::{Matrix3, Vector3};
use shared_types::GRAVITY;

use crate::cayley;

/// Physical parameters of the vehicle, unknown to the controller.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Body {
    /// m, kg.
    pub mass: f64,
    /// Diagonal of J, kg m².
    pub inertia: Vector3<f64>,
    /// b, acceleration in {I}, m/s².
    pub disturbance_world: Vector3<f64>,
    /// c, centre of mass relative to the body's origin in {B}, m.
    pub center_of_mass: Vector3<f64>,
}

/// Pose and velocities of the body.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Motion {
    /// p, position in {I}, m.
    pub position_world: Vector3<f64>,
    /// R, body to inertial.
    pub world_from_body: Matrix3<f64>,
    /// Rv, linear velocity in {I}, m/s.
    pub velocity_world: Vector3<f64>,
    /// ω, angular velocity in {B}, rad/s.
    pub angular_velocity_body: Vector3<f64>,
}

/// Rate of change of a [`Motion`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MotionRate {
    /// ṗ in {I}, m/s.
    pub velocity_world: Vector3<f64>,
    /// The vector of Rᵀ Ṙ, in {B}, rad/s.
    pub angular_velocity_body: Vector3<f64>,
    /// d(Rv)/dt in {I}, m/s².
    pub acceleration_world: Vector3<f64>,
    /// ω̇ in {B}, rad/s².
    pub angular_acceleration_body: Vector3<f64>,
}

/// Forces and torques of the actuators on the body.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Wrench {
    /// T along −R e3, N; any real number with ideal actuators.
    pub thrust: f64,
    /// τ in {B}, N m.
    pub torque_body: Vector3<f64>,
}

/// Returns g e3 + b in {I}, m/s²: (3) without thrust.
#[must_use]
#[inline]
pub fn free_fall(disturbance_world: &Vector3<f64>) -> Vector3<f64> {
    Vector3::z() * GRAVITY + disturbance_world
}

/// Returns d(Rv)/dt of (3) in {I}, m/s², for the specific thrust T/m (m/s²) and the acceleration without thrust
/// (`unpowered`): [`free_fall`], or less if the ground supports the vehicle.
#[must_use]
#[inline]
pub fn acceleration(
    world_from_body: &Matrix3<f64>,
    specific_thrust: f64,
    unpowered: &Vector3<f64>,
) -> Vector3<f64> {
    unpowered - world_from_body.column(2) * specific_thrust
}

/// Returns ω × Jω, the torque (N m, in {B}) that keeps ω (rad/s) constant, J = Diag(`inertia`).
#[must_use]
#[inline]
pub fn gyroscopic_torque(inertia: &Vector3<f64>, omega: &Vector3<f64>) -> Vector3<f64> {
    omega.cross(&inertia.component_mul(omega))
}

/// Returns ω̇ of (4) in {B}, rad/s², under a torque τ (N m).
#[must_use]
#[inline]
pub fn angular_acceleration(
    inertia: &Vector3<f64>,
    torque_body: &Vector3<f64>,
    omega: &Vector3<f64>,
) -> Vector3<f64> {
    (torque_body - gyroscopic_torque(inertia, omega)).component_div(inertia)
}

impl Body {
    /// Returns the vector field (1)–(4) at a motion under a wrench.
    #[must_use]
    #[inline]
    pub fn motion_rate(&self, motion: &Motion, wrench: &Wrench) -> MotionRate {
        let (r, omega) = (&motion.world_from_body, &motion.angular_velocity_body);
        let (pull, fall) = (wrench.thrust / self.mass, free_fall(&self.disturbance_world));
        MotionRate {
            velocity_world: motion.velocity_world,            // (1)
            angular_velocity_body: *omega,                    // (2)
            acceleration_world: acceleration(r, pull, &fall), // (3), in {I}
            angular_acceleration_body: angular_acceleration(&self.inertia, &wrench.torque_body, omega), // (4)
        }
    }

    /// Converts a wrench whose thrust acts through the origin to one about the centre of mass: τ + c × T e3.
    #[must_use]
    #[inline]
    pub fn about_center(&self, wrench: &Wrench) -> Wrench {
        if self.is_centered() {
            return *wrench;
        }
        Wrench {
            torque_body: wrench.torque_body + self.thrust_lever() * wrench.thrust,
            ..*wrench
        }
    }

    /// Returns c × e3, torque about the centre of mass per thrust, m.
    #[must_use]
    #[inline]
    pub fn thrust_lever(&self) -> Vector3<f64> {
        self.center_of_mass.cross(&Vector3::z())
    }

    /// Converts the motion of the centre of mass to that of the origin.
    #[must_use]
    #[inline]
    pub fn origin_of<'a>(&self, center: &'a Motion) -> Cow<'a, Motion> {
        if self.is_centered() {
            Cow::Borrowed(center)
        } else {
            Cow::Owned(center.at_point(&-self.center_of_mass))
        }
    }

    /// Converts the motion of the origin to that of the centre of mass.
    #[must_use]
    pub fn center_of(&self, origin: &Motion) -> Motion {
        if self.is_centered() {
            *origin
        } else {
            origin.at_point(&self.center_of_mass)
        }
    }

    /// Returns the origin's acceleration d²(po)/dt² in {I}, m/s², from motion and rate of the centre of mass.
    #[must_use]
    pub fn origin_acceleration(&self, center: &Motion, rate: &MotionRate) -> Vector3<f64> {
        let (c, omega) = (&self.center_of_mass, &rate.angular_velocity_body);
        let around_center = rate.angular_acceleration_body.cross(c) + omega.cross(&omega.cross(c));
        rate.acceleration_world - center.world_from_body * around_center
    }

    /// Returns whether c = 0. Conversions are skipped then: adding zero could change the sign of a zero.
    #[inline]
    fn is_centered(&self) -> bool {
        self.center_of_mass == Vector3::zeros()
    }
}

impl Motion {
    /// Returns v, linear velocity in {B}, m/s.
    #[must_use]
    #[inline]
    pub fn velocity_body(&self) -> Vector3<f64> {
        self.world_from_body.tr_mul(&self.velocity_world)
    }

    /// Returns the motion of the body's point at `arm_body` (m, in {B}) relative to this motion's point.
    #[must_use]
    pub fn at_point(&self, arm_body: &Vector3<f64>) -> Self {
        let (r, omega) = (&self.world_from_body, &self.angular_velocity_body);
        Self {
            position_world: self.position_world + r * arm_body,
            velocity_world: self.velocity_world + r * omega.cross(arm_body),
            ..*self
        }
    }

    /// Returns the motion after `duration` s at a constant rate. The Cayley map keeps R in SO(3).
    #[must_use]
    // Called four times per step. The compiler does not inline it by itself, which makes a step of the plant 50 % slower.
    #[inline(always)]
    pub fn moved(&self, rate: &MotionRate, duration: f64) -> Self {
        let turn = cayley::rotation(&(rate.angular_velocity_body * duration));
        Self {
            position_world: self.position_world + rate.velocity_world * duration,
            world_from_body: self.world_from_body * turn,
            velocity_world: self.velocity_world + rate.acceleration_world * duration,
            angular_velocity_body: self.angular_velocity_body + rate.angular_acceleration_body * duration,
        }
    }
}

impl Add for MotionRate {
    type Output = Self;

    #[inline]
    fn add(self, other: Self) -> Self {
        Self {
            velocity_world: self.velocity_world + other.velocity_world,
            angular_velocity_body: self.angular_velocity_body + other.angular_velocity_body,
            acceleration_world: self.acceleration_world + other.acceleration_world,
            angular_acceleration_body: self.angular_acceleration_body + other.angular_acceleration_body,
        }
    }
}

impl Mul<f64> for MotionRate {
    type Output = Self;

    #[inline]
    fn mul(self, factor: f64) -> Self {
        Self {
            velocity_world: self.velocity_world * factor,
            angular_velocity_body: self.angular_velocity_body * factor,
            acceleration_world: self.acceleration_world * factor,
            angular_acceleration_body: self.angular_acceleration_body * factor,
        }
    }
}
