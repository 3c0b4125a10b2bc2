//! Barometer: the altitude that a static pressure means.
//!
//! ```text
//! z = −p_z + σ_w n + σ_s x + C |V − w|² − E (1 − a/a_E)⁺        n ~ N(0, 1)
//! ```
//!
//! x Gauss–Markov process of unit variance with correlation time τ (weather and temperature); C error by the flow around
//! the sensor, m per (m/s)²; a altitude above the ground, m. Below a_E the downwash of turning rotors raises the pressure,
//! and the altitude reads E too low at the ground.

use nalgebra::Vector3;
use shared_types::noise::{Noise, Stream};

use crate::gauss_markov::advanced;
use crate::{TurnOn, quantized};

/// Parameters of a barometer.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BarometerParameters {
    /// σ_w, m.
    pub white: f64,
    /// σ_s, m.
    pub slow: f64,
    /// τ, s.
    pub slow_time: f64,
    /// C, m per (m/s)².
    pub airspeed_factor: f64,
    /// E, m.
    pub ground_effect: f64,
    /// a_E, m.
    pub ground_effect_altitude: f64,
    /// Step of the digital output, m; 0 for none.
    pub resolution: f64,
}

impl Default for BarometerParameters {
    fn default() -> Self {
        Self {
            white: 0.1,
            slow: 0.3,
            slow_time: 100.0,
            airspeed_factor: 0.02,
            ground_effect: 1.0,
            ground_effect_altitude: 0.5,
            resolution: 0.01,
        }
    }
}

/// Surroundings of a barometer at the time of a sample.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Surroundings {
    /// −p_z, altitude above the origin of {I}, m.
    pub altitude: f64,
    /// a, altitude above the ground, m.
    pub above_ground: f64,
    /// |V − w|, speed through the air, m/s.
    pub airspeed: f64,
    /// `true` if the rotors turn.
    pub rotors_turn: bool,
}

shared_types::sample! {
    /// State of a barometer between samples.
    pub struct BarometerState {
        /// x.
        pub slow: f64,
    }
}

/// Barometer over the course of a flight.
#[derive(Clone, Debug)]
pub struct Barometer {
    parameters: BarometerParameters,
    /// Time between samples, s.
    period: f64,
    noise: Noise,
    slow: f64,
}

impl Barometer {
    /// Makes the barometer of a flight, with a sample every `period` s.
    #[must_use]
    pub fn new(parameters: &BarometerParameters, seed: u64, period: f64) -> Self {
        let mut turn_on = Noise::new(seed, Stream::SensorTurnOn);
        Self {
            parameters: *parameters,
            period,
            noise: Noise::new(seed, Stream::Barometer),
            slow: turn_on.at(TurnOn::Barometer as u64).normal_pair()[0],
        }
    }

    /// Returns the altitude (m) that the barometer measures at a tick.
    pub fn sample(&mut self, tick: u64, surroundings: &Surroundings) -> f64 {
        let parameters = &self.parameters;
        let [white, walk] = self.noise.at(tick).normal_pair();
        let slow = Vector3::new(self.slow, 0.0, 0.0);
        self.slow = advanced(
            slow,
            parameters.slow_time,
            self.period,
            Vector3::new(walk, 0.0, 0.0),
        )
        .x;
        let nearness = 1.0 - surroundings.above_ground.max(0.0) / parameters.ground_effect_altitude;
        let ground_effect = if surroundings.rotors_turn && nearness > 0.0 {
            parameters.ground_effect * nearness
        } else {
            0.0
        };
        let altitude = surroundings.altitude
            + white * parameters.white
            + self.slow * parameters.slow
            + parameters.airspeed_factor * surroundings.airspeed * surroundings.airspeed
            - ground_effect;
        quantized(altitude, parameters.resolution)
    }

    /// Returns the state.
    #[must_use]
    pub fn save(&self) -> BarometerState {
        BarometerState { slow: self.slow }
    }

    /// Restores a state.
    pub fn restore(&mut self, state: &BarometerState) {
        self.slow = state.slow;
    }
}
