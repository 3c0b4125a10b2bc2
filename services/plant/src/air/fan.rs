//! Fan: its times of operation, its place, and the fluctuation of its jet.
//!
//! The jet's force grows like 1 − e^(−t/τ) and falls like e^(−t/τ), a function of the time alone. From one stated place
//! to the next the fan moves straight at constant speed; so does its direction, normalised to length 1.

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
    /// In the order of time; the first one at 0.
    places: Vec<Place>,
    /// Of the jet's force in {I}, as a share of it.
    pub fluctuation: OrnsteinUhlenbeck,
}

#[derive(Clone, Copy, Debug)]
struct Place {
    /// Time of the fan at this place, s.
    at: f64,
    position: Vector3<f64>,
    /// Of length 1.
    direction: Vector3<f64>,
}

impl Fan {
    /// Makes the fan of a scenario, in a flight of that seed with ticks of `tick` s, at its start.
    #[must_use]
    pub fn new(stated: &scenario::Fan, seed: u64, tick: f64) -> Self {
        let first = Place::new(0.0, stated.position, stated.direction);
        let moves = stated.moves.iter();
        let later = moves.map(|to| Place::new(to.at, to.position, to.direction));
        let noise = Noise::new(seed, Stream::Fan);
        Self {
            on_at: stated.on_at,
            off_at: stated.off_at,
            run_up: Lag::new(stated.run_up),
            force: stated.force,
            reference_distance: stated.reference_distance,
            spread: libm::tan(stated.half_angle),
            places: std::iter::once(first).chain(later).collect(),
            fluctuation: OrnsteinUhlenbeck::new(stated.turbulence, stated.correlation_time, tick, noise),
        }
    }

    /// Returns its jet at a time of the flight, s, with the present fluctuation.
    #[must_use]
    pub fn jet(&self, time: f64) -> Jet {
        let place = self.place(time);
        Jet {
            nozzle_world: place.position,
            axis_world: place.direction,
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
                1.0 - self.run_up.left(time - self.on_at)
            }
        };
        match self.off_at {
            Some(off_at) if time >= off_at => risen(off_at) * self.run_up.left(time - off_at),
            _ => risen(time),
        }
    }

    fn place(&self, time: f64) -> Place {
        let left = self.places.partition_point(|place| place.at <= time);
        let from = self.places[left.saturating_sub(1)];
        match self.places.get(left) {
            None => from,
            Some(to) => from.towards(to, (time - from.at) / (to.at - from.at)),
        }
    }
}

impl Place {
    fn new(at: f64, position: scenario::Vector, direction: scenario::Vector) -> Self {
        Self {
            at,
            position: position.into(),
            direction: Vector3::from(direction).normalize(),
        }
    }

    /// Returns the place at a share of the way to another one; between two opposite directions it keeps the first until
    /// the turn is half done.
    fn towards(&self, other: &Self, share: f64) -> Self {
        let direction = self.direction.lerp(&other.direction, share);
        Self {
            at: self.at,
            position: self.position.lerp(&other.position, share),
            direction: direction.try_normalize(1e-9).unwrap_or(self.direction),
        }
    }
}
