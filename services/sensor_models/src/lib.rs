//! Sensors of flight outdoors: from a true motion to what each of them measures.
//!
//! * [`imu`]: gyroscope and accelerometer;
//! * [`gnss`]: fixes of a satellite receiver, and the baseline of two antennas;
//! * [`barometer`]: pressure altitude;
//! * [`magnetometer`]: the field of the earth and of the vehicle;
//! * [`gauss_markov`]: slowly varying errors.
//!
//! Each module states its model: symbols, units, source. Every random number is a function of seed, stream and tick, and
//! the slow errors are a small state that [`save`](Imu::save) and [`restore`](Imu::restore) carry over: a restored sensor
//! continues bit by bit. A sample allocates nothing.
//!
//! {I} has z down, {B} is the body. A magnetic field is in gauss, as sensors and MAVLink state it; all else in SI units.

pub mod barometer;
pub mod gauss_markov;
pub mod gnss;
pub mod imu;
pub mod magnetometer;

use nalgebra::{Matrix3, Vector3};

pub use barometer::{Barometer, BarometerParameters, BarometerState};
pub use gnss::{Baseline, Fix, Gnss, GnssParameters, GnssState};
pub use imu::{Imu, ImuParameters, ImuSample, ImuState};
pub use magnetometer::{Magnetometer, MagnetometerParameters};

/// True motion of the body's origin at the time of a sample.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TrueMotion {
    /// p, position in {I}, m.
    pub position_world: Vector3<f64>,
    /// V, velocity in {I}, m/s.
    pub velocity_world: Vector3<f64>,
    /// V̇, acceleration in {I}, m/s².
    pub acceleration_world: Vector3<f64>,
    /// R, body to inertial.
    pub world_from_body: Matrix3<f64>,
    /// ω, angular velocity in {B}, rad/s.
    pub angular_velocity_body: Vector3<f64>,
    /// ω̇, its derivative in {B}, rad/s².
    pub angular_acceleration_body: Vector3<f64>,
}

impl TrueMotion {
    /// A level body at rest in the origin of {I}.
    pub const AT_REST: Self = Self {
        position_world: Vector3::new(0.0, 0.0, 0.0),
        velocity_world: Vector3::new(0.0, 0.0, 0.0),
        acceleration_world: Vector3::new(0.0, 0.0, 0.0),
        world_from_body: Matrix3::new(1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0),
        angular_velocity_body: Vector3::new(0.0, 0.0, 0.0),
        angular_acceleration_body: Vector3::new(0.0, 0.0, 0.0),
    };
}

/// Values that a sensor takes when it is switched on, each sensor with a tick of its own in their stream.
#[derive(Clone, Copy, Debug)]
#[repr(u64)]
enum TurnOn {
    Imu = 0,
    Gnss = 1,
    Barometer = 2,
    Magnetometer = 3,
}

/// Returns the multiple of `resolution` that is nearest to `value`; `value` itself for a resolution of 0.
fn quantized(value: f64, resolution: f64) -> f64 {
    if resolution > 0.0 {
        libm::round(value / resolution) * resolution
    } else {
        value
    }
}
