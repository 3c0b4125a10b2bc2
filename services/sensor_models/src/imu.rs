//! Inertial measurement unit: gyroscope and accelerometer.
//!
//! ```text
//! a_imu = Rᵀ(V̇ − g) + ω̇ × r + ω × (ω × r) + v                           specific force at the unit
//! ω_m = (1 + s_g) ω + G a_imu + b_g + N_g/√h n        a_m = (1 + s_a) a_imu + b_a + N_a/√h n
//! b(t+h) = b(t) + K √h n                               n ~ N(0, I)
//! v = A₁ sin 2π(φ + φ₁) + A₂ sin 2π(2φ + φ₂)           φ̇ = f
//! ```
//!
//! h period of the samples, s; r place of the unit in {B}, m; N density of the white noise, 1/√Hz; K that of the bias walk,
//! 1/√s; s error of the scale; G sensitivity of the gyroscope to specific force, rad/s per m/s²; A₁, A₂ vibration at the
//! frequency f of the rotors (Hz) and at twice it, m/s²; none while they stand. Sampling aliases the vibration as it does in a unit without a
//! filter. The result is limited to the range of the sensor, then rounded to its resolution.
//!
//! N and K are those of an Allan deviation: N/√τ and K √(τ/3) (IEEE Std 952-1997, annex C). b(0), s and the phases follow
//! from the seed. The defaults are of a MEMS unit on a vehicle with turning rotors: its densities at rest are a fifth
//! (gyroscope) and a tenth (accelerometer) of them.

use nalgebra::Vector3;
use shared_types::GRAVITY;
use shared_types::noise::{Noise, Stream};

use crate::{TrueMotion, TurnOn, quantized};

/// Errors of three orthogonal sensors; their unit is u = rad/s or m/s².
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TriadParameters {
    /// N, density of the white noise, u/√Hz.
    pub noise_density: f64,
    /// Standard deviation of each component of b(0), u.
    pub bias_deviation: f64,
    /// K, density of the bias walk, u/√s.
    pub bias_walk: f64,
    /// Standard deviation of each component of s.
    pub scale_deviation: f64,
    /// Largest magnitude of a component, u.
    pub range: f64,
    /// Step of the digital output, u; 0 for none.
    pub resolution: f64,
}

/// Parameters of an inertial measurement unit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ImuParameters {
    pub gyroscope: TriadParameters,
    pub accelerometer: TriadParameters,
    /// G, the same for all axes, rad/s per m/s².
    pub gyroscope_sensitivity: f64,
    /// r in {B}, m.
    pub lever_arm_body: Vector3<f64>,
    /// A₁ and A₂, m/s².
    pub vibration: [f64; 2],
}

impl Default for ImuParameters {
    fn default() -> Self {
        Self {
            gyroscope: TriadParameters {
                noise_density: 2.45e-4,
                bias_deviation: 0.01,
                bias_walk: 1e-4,
                scale_deviation: 1e-3,
                // ± 2000 °/s over 16 bits.
                range: 34.906_585,
                resolution: 34.906_585 / 32_768.0,
            },
            accelerometer: TriadParameters {
                noise_density: 6.9e-3,
                bias_deviation: 0.1,
                bias_walk: 1e-3,
                scale_deviation: 1e-3,
                // ± 16 g over 16 bits.
                range: 16.0 * GRAVITY,
                resolution: 16.0 * GRAVITY / 32_768.0,
            },
            gyroscope_sensitivity: 1e-3 / GRAVITY,
            lever_arm_body: Vector3::new(0.0, 0.0, 0.0),
            vibration: [2.0, 1.0],
        }
    }
}

/// Sample of an inertial measurement unit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ImuSample {
    /// ω_m in {B}, rad/s.
    pub angular_velocity_body: Vector3<f64>,
    /// a_m in {B}, m/s².
    pub specific_force_body: Vector3<f64>,
    /// `true` if a component is at the end of its range.
    pub is_clipped: bool,
}

shared_types::sample! {
    /// State of an inertial measurement unit between samples.
    pub struct ImuState {
        /// b_g in {B}, rad/s.
        pub gyroscope_bias_body: [f64; 3],
        /// b_a in {B}, m/s².
        pub accelerometer_bias_body: [f64; 3],
        /// φ, share of a turn.
        pub vibration_phase: f64,
    }
}

/// Inertial measurement unit over the course of a flight.
#[derive(Clone, Debug)]
pub struct Imu {
    parameters: ImuParameters,
    /// h, s.
    period: f64,
    noise: Noise,
    /// s of each component.
    gyroscope_scale: Vector3<f64>,
    accelerometer_scale: Vector3<f64>,
    /// φ₁ and φ₂ of each axis, shares of a turn.
    vibration_phases: [Vector3<f64>; 2],
    gyroscope_bias: Vector3<f64>,
    accelerometer_bias: Vector3<f64>,
    vibration_phase: f64,
}

impl Imu {
    /// Makes the unit of a flight, with a sample every `period` s.
    #[must_use]
    pub fn new(parameters: &ImuParameters, seed: u64, period: f64) -> Self {
        let mut turn_on = Noise::new(seed, Stream::SensorTurnOn);
        let mut draws = turn_on.at(TurnOn::Imu as u64);
        let ImuParameters {
            gyroscope,
            accelerometer,
            ..
        } = parameters;
        let gyroscope_bias = draws.normal3() * gyroscope.bias_deviation;
        let accelerometer_bias = draws.normal3() * accelerometer.bias_deviation;
        let gyroscope_scale = draws.normal3() * gyroscope.scale_deviation;
        let accelerometer_scale = draws.normal3() * accelerometer.scale_deviation;
        let mut phases = || Vector3::from_fn(|_, _| draws.uniform());
        Self {
            parameters: *parameters,
            period,
            noise: Noise::new(seed, Stream::Imu),
            gyroscope_scale,
            accelerometer_scale,
            vibration_phases: [phases(), phases()],
            gyroscope_bias,
            accelerometer_bias,
            vibration_phase: 0.0,
        }
    }

    /// Returns the sample of a tick; `rotor_frequency` is f, Hz.
    pub fn sample(&mut self, tick: u64, motion: &TrueMotion, rotor_frequency: f64) -> ImuSample {
        let force_body = self.specific_force(motion);
        self.measured(tick, &motion.angular_velocity_body, &force_body, rotor_frequency)
    }

    /// Returns the sample of a tick from the mean rate (rad/s) and specific force (m/s²) at the unit, in {B}.
    pub fn measured(
        &mut self,
        tick: u64,
        rate_body: &Vector3<f64>,
        force_body: &Vector3<f64>,
        rotor_frequency: f64,
    ) -> ImuSample {
        let ImuParameters {
            gyroscope,
            accelerometer,
            ..
        } = self.parameters;
        let mut draws = self.noise.at(tick);
        let white = 1.0 / self.period.sqrt();
        let gyroscope_noise = draws.normal3() * (gyroscope.noise_density * white);
        let accelerometer_noise = draws.normal3() * (accelerometer.noise_density * white);
        let walk = self.period.sqrt();
        self.gyroscope_bias += draws.normal3() * (gyroscope.bias_walk * walk);
        self.accelerometer_bias += draws.normal3() * (accelerometer.bias_walk * walk);
        let turned = self.vibration_phase + rotor_frequency * self.period;
        self.vibration_phase = turned - turned.floor();

        let mut force = *force_body;
        if rotor_frequency > 0.0 {
            force += self.vibration();
        }
        let omega = rate_body;
        let rate = omega
            + omega.component_mul(&self.gyroscope_scale)
            + force * self.parameters.gyroscope_sensitivity
            + self.gyroscope_bias
            + gyroscope_noise;
        let force = force
            + force.component_mul(&self.accelerometer_scale)
            + self.accelerometer_bias
            + accelerometer_noise;
        let is_clipped = rate.amax() >= gyroscope.range || force.amax() >= accelerometer.range;
        ImuSample {
            angular_velocity_body: rate.map(|value| gyroscope.output(value)),
            specific_force_body: force.map(|value| accelerometer.output(value)),
            is_clipped,
        }
    }

    /// Returns b_g and b_a in {B}, rad/s and m/s².
    #[must_use]
    pub fn biases(&self) -> [Vector3<f64>; 2] {
        [self.gyroscope_bias, self.accelerometer_bias]
    }

    /// Returns the specific force of the motion at the unit, in {B}, m/s².
    #[must_use]
    pub fn specific_force(&self, motion: &TrueMotion) -> Vector3<f64> {
        let gravity = Vector3::new(0.0, 0.0, GRAVITY);
        let (omega, r) = (&motion.angular_velocity_body, &self.parameters.lever_arm_body);
        motion
            .world_from_body
            .tr_mul(&(motion.acceleration_world - gravity))
            + motion.angular_acceleration_body.cross(r)
            + omega.cross(&omega.cross(r))
    }

    /// Returns v in {B}, m/s².
    fn vibration(&self) -> Vector3<f64> {
        let turns = [1.0, 2.0].map(|order| order * self.vibration_phase);
        let mut sum = Vector3::zeros();
        for ((amplitude, turn), phase) in self
            .parameters
            .vibration
            .iter()
            .zip(turns)
            .zip(&self.vibration_phases)
        {
            if *amplitude > 0.0 {
                sum += phase.map(|phase| amplitude * libm::sin(std::f64::consts::TAU * (turn + phase)));
            }
        }
        sum
    }

    /// Returns the state.
    #[must_use]
    pub fn save(&self) -> ImuState {
        ImuState {
            gyroscope_bias_body: self.gyroscope_bias.into(),
            accelerometer_bias_body: self.accelerometer_bias.into(),
            vibration_phase: self.vibration_phase,
        }
    }

    /// Restores a state.
    pub fn restore(&mut self, state: &ImuState) {
        self.gyroscope_bias = state.gyroscope_bias_body.into();
        self.accelerometer_bias = state.accelerometer_bias_body.into();
        self.vibration_phase = state.vibration_phase;
    }
}

impl TriadParameters {
    /// Returns the output for a value within and beyond the range.
    fn output(&self, value: f64) -> f64 {
        quantized(value.clamp(-self.range, self.range), self.resolution)
    }
}
