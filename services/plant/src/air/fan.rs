//! Fan: its times of operation, its pose, and the fluctuation of its jet.
//!
//! The jet's force grows as 1 − e^(−t/τ) and falls as e^(−t/τ), a function of time alone. Between waypoints, position and
//! direction are interpolated linearly; the direction is normalised.

use nalgebra::Vector3;
use shared_types::noise::{Noise, Stream};
use vehicle_model::lag::Lag;

use crate::air::jet::Jet;
use crate::air::ornstein_uhlenbeck::OrnsteinUhlenbeck;

/// A fan over the course of a flight.
#[derive(Clone, Debug)]
pub struct Fan {
    on_at: f64,
    off_at: Option<f64>,
    run_up: Lag,
    /// Force at full speed on the axis at the reference distance, N.
    force: f64,
    reference_distance: f64,
    /// Tangent of half the opening angle.
    spread: f64,
    /// In chronological order; the first at time 0.
    waypoints: Vec<Waypoint>,
    /// Fluctuation of the jet's force in {I}, as a share of it.
    pub fluctuation: OrnsteinUhlenbeck,
}

#[derive(Clone, Copy, Debug)]
struct Waypoint {
    /// Time at which the fan is here, s.
    at: f64,
    position: Vector3<f64>,
    /// Unit vector.
    direction: Vector3<f64>,
}

impl Fan {
    /// Makes the fan of a scenario at the start of the flight, with ticks of `tick` s.
    #[must_use]
    pub fn new(config: &scenario::Fan, seed: u64, tick: f64) -> Self {
        let first = Waypoint::new(0.0, config.position, config.direction);
        let moves = config.moves.iter();
        let later = moves.map(|to| Waypoint::new(to.at, to.position, to.direction));
        let noise = Noise::new(seed, Stream::Fan);
        Self {
            on_at: config.on_at,
            off_at: config.off_at,
            run_up: Lag::new(config.run_up),
            force: config.force,
            reference_distance: config.reference_distance,
            spread: libm::tan(config.half_angle),
            waypoints: std::iter::once(first).chain(later).collect(),
            fluctuation: OrnsteinUhlenbeck::new(config.turbulence, config.correlation_time, tick, noise),
        }
    }

    /// Returns the jet at a flight time, s, with the current fluctuation.
    #[must_use]
    pub fn jet(&self, time: f64) -> Jet {
        let waypoint = self.waypoint_at(time);
        Jet {
            nozzle_world: waypoint.position,
            axis_world: waypoint.direction,
            force: self.force * self.strength(time),
            reference_distance: self.reference_distance,
            spread: self.spread,
            fluctuation_world: self.fluctuation.value(),
        }
    }

    /// Returns the share of the full force at a time, s: 0 to 1.
    #[must_use]
    pub fn strength(&self, time: f64) -> f64 {
        let risen = |time: f64| {
            if time < self.on_at {
                0.0
            } else {
                1.0 - self.run_up.remaining(time - self.on_at)
            }
        };
        match self.off_at {
            Some(off_at) if time >= off_at => risen(off_at) * self.run_up.remaining(time - off_at),
            _ => risen(time),
        }
    }

    fn waypoint_at(&self, time: f64) -> Waypoint {
        let index = self.waypoints.partition_point(|waypoint| waypoint.at <= time);
        let from = self.waypoints[index.saturating_sub(1)];
        match self.waypoints.get(index) {
            None => from,
            Some(to) => from.interpolate(to, (time - from.at) / (to.at - from.at)),
        }
    }
}

impl Waypoint {
    fn new(at: f64, position: scenario::Vector, direction: scenario::Vector) -> Self {
        Self {
            at,
            position: position.into(),
            direction: Vector3::from(direction).normalize(),
        }
    }

    /// Interpolates to another waypoint. Half-way between opposite directions, where the mean vanishes, it returns the
    /// first direction.
    fn interpolate(&self, other: &Self, share: f64) -> Self {
        let direction = self.direction.lerp(&other.direction, share);
        Self {
            at: self.at,
            position: self.position.lerp(&other.position, share),
            direction: direction.try_normalize(1e-9).unwrap_or(self.direction),
        }
    }
}
