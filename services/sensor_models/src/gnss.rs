//! Satellite receiver: position and velocity of its antenna, late, with an error that is white and slow.
//!
//! ```text
//! z_p = p + R l + σ_w n + σ_s x        z_V = V + R(ω × l) + ς_w n + ς_s y        n ~ N(0, I)
//! ```
//!
//! l place of the antenna in {B}, m; x, y Gauss–Markov processes of unit variance with correlation times τ and τ_V
//! ([`gauss_markov`](crate::gauss_markov)). Vertical errors of the position are larger by a factor. All of them depend on
//! what the receiver has solved ([`FixKind`]); x and y continue when that changes, so that the position jumps by the change
//! of σ_s. A fix states the time at which it is valid, and arrives later by a latency that is even between its limits.
//!
//! A second antenna measures its place from the first, b in {B}. With known numbers of carrier waves the error is the white one of
//! a fix, for the slow errors are those of both antennas and cancel: 8 mm, or 0.5° of heading at a baseline of 1 m. With unknown
//! numbers it is the whole error of such a fix, white; from codes alone there is no baseline.
//!
//! ```text
//! z_b = R b + σ_w n
//! ```
//!
//! The stated accuracies are those that u-blox receivers report (`NAV-PVT`): hAcc over both horizontal directions, vAcc of
//! the height, sAcc of a component of the velocity, each one standard deviation of the whole error.

use nalgebra::Vector3;
use shared_types::gnss::{FixErrors, FixKind};
use shared_types::noise::{Noise, Stream};

use crate::gauss_markov::advanced;
use crate::{TrueMotion, TurnOn};

/// Parameters of a receiver.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GnssParameters {
    /// Errors of each [`FixKind`].
    pub errors: [FixErrors; 3],
    /// l in {B}, m.
    pub antenna_body: Vector3<f64>,
    /// b in {B}, m; `None` without a second antenna.
    pub baseline_body: Option<Vector3<f64>>,
    /// Shortest and longest latency, s.
    pub latency: [f64; 2],
}

impl Default for GnssParameters {
    fn default() -> Self {
        Self {
            errors: FixErrors::TYPICAL,
            antenna_body: Vector3::new(0.0, 0.0, 0.0),
            baseline_body: None,
            latency: [0.06, 0.11],
        }
    }
}

/// Fix of a receiver.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Fix {
    pub kind: FixKind,
    /// Position of the antenna in {I}, m.
    pub position_world: Vector3<f64>,
    /// Velocity of the antenna in {I}, m/s.
    pub velocity_world: Vector3<f64>,
    /// hAcc, m.
    pub horizontal_accuracy: f64,
    /// vAcc, m.
    pub vertical_accuracy: f64,
    /// sAcc, m/s.
    pub speed_accuracy: f64,
    /// Time from the validity of the fix to its arrival, s.
    pub latency: f64,
}

/// Baseline of two antennas.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Baseline {
    /// z_b in {I}, m.
    pub baseline_world: Vector3<f64>,
    /// Its standard deviations along the axes of {I}, m.
    pub accuracies: Vector3<f64>,
    /// `true` if the numbers of carrier waves are known.
    pub is_fixed: bool,
}

shared_types::sample! {
    /// State of a receiver between fixes.
    pub struct GnssState {
        /// x, in {I}.
        pub slow_position: [f64; 3],
        /// y, in {I}.
        pub slow_velocity: [f64; 3],
    }
}

/// Receiver over the course of a flight.
#[derive(Clone, Debug)]
pub struct Gnss {
    parameters: GnssParameters,
    /// Time between fixes, s.
    period: f64,
    noise: Noise,
    baseline_noise: Noise,
    slow_position: Vector3<f64>,
    slow_velocity: Vector3<f64>,
}

impl Gnss {
    /// Makes the receiver of a flight, with a fix every `period` s.
    #[must_use]
    pub fn new(parameters: &GnssParameters, seed: u64, period: f64) -> Self {
        let mut turn_on = Noise::new(seed, Stream::SensorTurnOn);
        let mut draws = turn_on.at(TurnOn::Gnss as u64);
        Self {
            parameters: *parameters,
            period,
            noise: Noise::new(seed, Stream::Gnss),
            baseline_noise: Noise::new(seed, Stream::GnssBaseline),
            slow_position: draws.normal3(),
            slow_velocity: draws.normal3(),
        }
    }

    /// Returns the fix that is valid at a tick.
    pub fn sample(&mut self, tick: u64, motion: &TrueMotion, kind: FixKind) -> Fix {
        let errors = self.parameters.errors[kind as usize];
        let mut draws = self.noise.at(tick);
        let (white_position, white_velocity) = (draws.normal3(), draws.normal3());
        self.slow_position = advanced(
            self.slow_position,
            errors.position_time,
            self.period,
            draws.normal3(),
        );
        self.slow_velocity = advanced(
            self.slow_velocity,
            errors.velocity_time,
            self.period,
            draws.normal3(),
        );
        let share = draws.uniform();

        let antenna = &self.parameters.antenna_body;
        let r = &motion.world_from_body;
        let vertical = Vector3::new(1.0, 1.0, errors.vertical_factor);
        let position_error =
            white_position * errors.position_white + self.slow_position * errors.position_slow;
        let velocity_error =
            white_velocity * errors.velocity_white + self.slow_velocity * errors.velocity_slow;
        let [horizontal, height, speed] = errors.deviations();
        let [shortest, longest] = self.parameters.latency;
        Fix {
            kind,
            position_world: motion.position_world + r * antenna + position_error.component_mul(&vertical),
            velocity_world: motion.velocity_world
                + r * motion.angular_velocity_body.cross(antenna)
                + velocity_error,
            horizontal_accuracy: std::f64::consts::SQRT_2 * horizontal,
            vertical_accuracy: height,
            speed_accuracy: speed,
            latency: shortest + (longest - shortest) * share,
        }
    }

    /// Returns the baseline that is valid at a tick; `None` without a second antenna, or without carrier waves.
    pub fn baseline(&mut self, tick: u64, motion: &TrueMotion, kind: FixKind) -> Option<Baseline> {
        let baseline_body = self.parameters.baseline_body?;
        let errors = self.parameters.errors[kind as usize];
        let [whole, ..] = errors.deviations();
        let (deviation, is_fixed) = match kind {
            FixKind::SinglePoint => return None,
            FixKind::RtkFloat => (whole, false),
            FixKind::RtkFixed => (errors.position_white, true),
        };
        let accuracies = Vector3::new(1.0, 1.0, errors.vertical_factor) * deviation;
        let error = self.baseline_noise.at(tick).normal3().component_mul(&accuracies);
        Some(Baseline {
            baseline_world: motion.world_from_body * baseline_body + error,
            accuracies,
            is_fixed,
        })
    }

    /// Returns the state.
    #[must_use]
    pub fn save(&self) -> GnssState {
        GnssState {
            slow_position: self.slow_position.into(),
            slow_velocity: self.slow_velocity.into(),
        }
    }

    /// Restores a state.
    pub fn restore(&mut self, state: &GnssState) {
        self.slow_position = state.slow_position.into();
        self.slow_velocity = state.slow_velocity.into();
    }
}
