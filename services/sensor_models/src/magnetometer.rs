//! Magnetometer: the field of the earth, and of the vehicle around the sensor.
//!
//! ```text
//! z = (I + A) RᵀB + b + C u + σ n        n ~ N(0, I)
//! ```
//!
//! B field of the earth in {I}, G; A soft iron, a symmetric matrix of small numbers; b hard iron, G; C field of the motors'
//! current at full throttle in {B}, G; u throttle, from 0 to 1. A and b follow from the seed.

use nalgebra::{Matrix3, Vector3};
use shared_types::noise::{Noise, Stream};

use crate::{TurnOn, quantized};

/// Parameters of a magnetometer.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MagnetometerParameters {
    /// B in {I}, G.
    pub field_world: Vector3<f64>,
    /// σ, G.
    pub white: f64,
    /// Standard deviation of each component of b, G.
    pub hard_iron_deviation: f64,
    /// Standard deviation of each element of A.
    pub soft_iron_deviation: f64,
    /// C in {B}, G.
    pub current_body: Vector3<f64>,
    /// Step of the digital output, G; 0 for none.
    pub resolution: f64,
}

impl Default for MagnetometerParameters {
    fn default() -> Self {
        Self {
            // Central Europe, with magnetic north along x.
            field_world: Vector3::new(0.21, 0.0, 0.43),
            white: 0.003,
            hard_iron_deviation: 0.01,
            soft_iron_deviation: 0.02,
            current_body: Vector3::new(0.0, 0.0, 0.05),
            resolution: 0.001,
        }
    }
}

/// Magnetometer of a flight; it has no state.
#[derive(Clone, Debug)]
pub struct Magnetometer {
    parameters: MagnetometerParameters,
    noise: Noise,
    /// I + A.
    soft_iron: Matrix3<f64>,
    /// b, G.
    hard_iron: Vector3<f64>,
}

impl Magnetometer {
    /// Makes the magnetometer of a flight.
    #[must_use]
    pub fn new(parameters: &MagnetometerParameters, seed: u64) -> Self {
        let mut turn_on = Noise::new(seed, Stream::SensorTurnOn);
        let mut draws = turn_on.at(TurnOn::Magnetometer as u64);
        let hard_iron = draws.normal3() * parameters.hard_iron_deviation;
        let diagonal = draws.normal3() * parameters.soft_iron_deviation;
        let [xy, xz, yz]: [f64; 3] = (draws.normal3() * parameters.soft_iron_deviation).into();
        Self {
            parameters: *parameters,
            noise: Noise::new(seed, Stream::Magnetometer),
            soft_iron: Matrix3::from_diagonal(&diagonal.add_scalar(1.0))
                + Matrix3::new(0.0, xy, xz, xy, 0.0, yz, xz, yz, 0.0),
            hard_iron,
        }
    }

    /// Returns z (G) at a tick.
    pub fn sample(&mut self, tick: u64, world_from_body: &Matrix3<f64>, throttle: f64) -> Vector3<f64> {
        let parameters = &self.parameters;
        let field = self.soft_iron * world_from_body.tr_mul(&parameters.field_world)
            + self.hard_iron
            + parameters.current_body * throttle
            + self.noise.at(tick).normal3() * parameters.white;
        field.map(|component| quantized(component, parameters.resolution))
    }

    /// Returns b in {B}, G.
    #[must_use]
    pub fn hard_iron(&self) -> Vector3<f64> {
        self.hard_iron
    }
}
