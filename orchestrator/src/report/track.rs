//! The way of the vehicle through space, and of the point of the path that it follows.

use nalgebra::Vector3;
use serde::Serialize;
use shared_types::rotation::{from_row_major, roll_pitch_yaw};
use shared_types::samples::{VehicleState, VehicleTruth};
use shared_types::scenario::Vector;
use shared_types::service::seconds;
use shared_types::{Schedule, Topic};

use super::encoding::base64;

/// How many points of the way are kept.
const MOST_PLACES: u64 = 2_000;

/// Numbers of a place: time (s), p (m), pd (m; NaN where it is not known), roll, pitch and yaw (rad).
const NUMBERS: usize = 10;

/// Where the vehicle was.
pub(super) struct Place {
    time_ns: u64,
    position_world: Vector,
    world_from_body: [f64; 9],
}

impl From<&VehicleTruth> for Place {
    fn from(truth: &VehicleTruth) -> Self {
        Self {
            time_ns: truth.header.stamp_ns,
            position_world: truth.position_world,
            world_from_body: truth.world_from_body,
        }
    }
}

impl From<&VehicleState> for Place {
    fn from(state: &VehicleState) -> Self {
        Self {
            time_ns: state.state_time_ns,
            position_world: state.position_world,
            world_from_body: state.world_from_body,
        }
    }
}

/// Gathers every so manieth place.
pub(super) struct Track {
    is_estimated: bool,
    stride: u64,
    seen: u64,
    numbers: Vec<f32>,
}

/// The way as the page reads it.
#[derive(Serialize)]
pub(super) struct PageTrack {
    /// Whether it is where the estimator believed the vehicle to be: in a laboratory nobody knows more.
    is_estimated: bool,
    numbers_per_place: usize,
    /// Little-endian f32 in base 64.
    places: String,
}

impl Track {
    /// For a flight of this schedule.
    pub(super) fn new(schedule: &Schedule) -> Self {
        let is_estimated = !schedule.simulates_the_world();
        let topic = if is_estimated {
            Topic::VehicleState
        } else {
            Topic::VehicleTruth
        };
        let samples = schedule.sample_count(topic);
        Self {
            is_estimated,
            stride: samples.div_ceil(MOST_PLACES).max(1),
            seen: 0,
            numbers: Vec::new(),
        }
    }

    /// Takes a place into account, with pd at its time if that is known.
    pub(super) fn add(&mut self, place: &Place, desired: Option<Vector>) {
        if self.seen.is_multiple_of(self.stride) {
            let position = Vector3::from(place.position_world);
            let desired = desired.map_or(Vector3::repeat(f64::NAN), Vector3::from);
            let attitude = roll_pitch_yaw(&from_row_major(&place.world_from_body));
            let time = seconds(place.time_ns);
            let place = std::iter::once(time)
                .chain(position.iter().copied())
                .chain(desired.iter().copied())
                .chain(attitude);
            self.numbers.extend(place.map(|number| number as f32));
        }
        self.seen += 1;
    }

    /// For the page.
    pub(super) fn finish(&self) -> PageTrack {
        PageTrack {
            is_estimated: self.is_estimated,
            numbers_per_place: NUMBERS,
            places: base64(&self.numbers),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::log::test_flight::scenario;
    use crate::report::encoding::decoded;
    use zerocopy::FromZeros;

    #[test]
    fn a_place_is_where_the_vehicle_was_and_should_have_been() {
        let schedule = scenario(0.001, 10.0).schedule().unwrap();
        let mut track = Track::new(&schedule);
        for tick in 0..=10_000 {
            let mut truth = VehicleTruth::new_zeroed();
            truth.header = schedule.header(Topic::VehicleTruth, tick);
            truth.position_world = [tick as f64, 1.0, -2.0];
            truth.world_from_body = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0];
            track.add(&Place::from(&truth), (tick > 0).then_some([0.5, 0.0, -1.0]));
        }
        let page = track.finish();
        let numbers = decoded(&page.places);
        let places: Vec<_> = numbers.chunks_exact(page.numbers_per_place).collect();
        assert!(numbers.len() == NUMBERS * places.len() && places.len() as u64 <= MOST_PLACES);
        assert!(places[0][4].is_nan());
        let second = places[1];
        assert!((1000.0 * second[0] - second[1]).abs() < 1e-3);
        assert_eq!(second[2..], [1.0, -2.0, 0.5, 0.0, -1.0, 0.0, 0.0, 0.0]);
    }
}
