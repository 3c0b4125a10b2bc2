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
    /// Shortest and longest latency, s.
    pub latency: [f64; 2],
}

impl Default for GnssParameters {
    fn default() -> Self {
        Self {
            errors: FixErrors::TYPICAL,
            antenna_body: Vector3::new(0.0, 0.0, 0.0),
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
