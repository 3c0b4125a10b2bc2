//! Mean of the filter, and its propagation by the inertial measurement unit.
//!
//! ```text
//! a = R exp(½ ω h) (a_m − b_a) + g        ω = ω_m − b_g
//! p⁺ = p + V h + ½ a h²        V⁺ = V + a h        R⁺ = R exp(ω h)
//! ```
//!
//! h step, s; a_m and ω_m means over it. The force acts at the attitude in the middle of the step, as it turns meanwhile:
//! with that at its beginning, a turn of 1 rad/s and steps of 4 ms would err by 2 cm/s².

use nalgebra::{Matrix3, Vector3};
use shared_types::GRAVITY;
use shared_types::rotation::{exp, orthonormalized};

/// Motion of the body's origin.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Kinematics {
    /// p, position in {I}, m.
    pub position_world: Vector3<f64>,
    /// V, velocity in {I}, m/s.
    pub velocity_world: Vector3<f64>,
    /// R, body to inertial.
    pub world_from_body: Matrix3<f64>,
}

/// Slow errors of the sensors.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Biases {
    /// b_g in {B}, rad/s.
    pub gyroscope_body: Vector3<f64>,
    /// b_a in {B}, m/s².
    pub accelerometer_body: Vector3<f64>,
    /// b_m in {B}, G.
    pub field_body: Vector3<f64>,
    /// e_p, slow error of the positions of fixes in {I}, m.
    pub fix_position_world: Vector3<f64>,
    /// e_V, slow error of the velocities of fixes in {I}, m/s.
    pub fix_velocity_world: Vector3<f64>,
    /// b_h, slow error of the altitude, m.
    pub altitude: f64,
}

/// Rate and specific force of a step, without their biases.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Unbiased {
    /// ω in {B}, rad/s.
    pub rate_body: Vector3<f64>,
    /// a_m − b_a in {B}, m/s².
    pub force_body: Vector3<f64>,
}

impl Kinematics {
    /// A level vehicle at rest in the origin of {I}.
    pub const AT_REST: Self = Self {
        position_world: Vector3::new(0.0, 0.0, 0.0),
        velocity_world: Vector3::new(0.0, 0.0, 0.0),
        world_from_body: Matrix3::new(1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0),
    };

    /// Returns a in {I}, m/s², at the attitude `world_from_body`.
    #[must_use]
    #[inline]
    pub fn acceleration(world_from_body: &Matrix3<f64>, force_body: &Vector3<f64>) -> Vector3<f64> {
        world_from_body * force_body + Vector3::new(0.0, 0.0, GRAVITY)
    }

    /// Returns the motion `h` s later.
    #[must_use]
    pub fn advanced(&self, unbiased: &Unbiased, h: f64) -> Self {
        let half_turn = exp(&(unbiased.rate_body * (0.5 * h)));
        let middle = self.world_from_body * half_turn;
        let change = Self::acceleration(&middle, &unbiased.force_body) * h;
        Self {
            position_world: self.position_world + (self.velocity_world + change * 0.5) * h,
            velocity_world: self.velocity_world + change,
            world_from_body: orthonormalized(&(middle * half_turn)),
        }
    }
}

impl Biases {
    /// No error of any sensor.
    pub const NONE: Self = Self {
        gyroscope_body: Vector3::new(0.0, 0.0, 0.0),
        accelerometer_body: Vector3::new(0.0, 0.0, 0.0),
        field_body: Vector3::new(0.0, 0.0, 0.0),
        fix_position_world: Vector3::new(0.0, 0.0, 0.0),
        fix_velocity_world: Vector3::new(0.0, 0.0, 0.0),
        altitude: 0.0,
    };

    /// Returns a measured rate (rad/s) and specific force (m/s²) without their biases.
    #[must_use]
    #[inline]
    pub fn removed_from(&self, rate_body: &Vector3<f64>, force_body: &Vector3<f64>) -> Unbiased {
        Unbiased {
            rate_body: rate_body - self.gyroscope_body,
            force_body: force_body - self.accelerometer_body,
        }
    }
}
