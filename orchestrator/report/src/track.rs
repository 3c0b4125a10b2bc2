//! Track of the vehicle and of its reference point in space.

use nalgebra::Vector3;
use serde::Serialize;
use shared_types::Schedule;
use shared_types::rotation::{from_row_major, roll_pitch_yaw};
use shared_types::service::seconds;

use super::encoding::base64;
use metrics::tracker::{Moment, StateSource};

/// Maximum number of points of the track.
const MAX_POINTS: u64 = 2_000;

/// Numbers of a point: time (s), p (m), pd (m; NaN if unknown), roll, pitch and yaw (rad).
const NUMBERS: usize = 10;

/// Collects every `stride`-th moment of the flight.
pub(super) struct Track {
    is_estimated: bool,
    stride: u64,
    seen: u64,
    numbers: Vec<f32>,
}

/// The track as the page reads it.
#[derive(Serialize)]
pub(super) struct PageTrack {
    /// `true` if the track is the estimator's: a laboratory flight has no truth.
    is_estimated: bool,
    numbers_per_place: usize,
    /// Little-endian f32 in base 64.
    places: String,
}

impl Track {
    pub(super) fn new(schedule: &Schedule) -> Self {
        let source = StateSource::of(schedule);
        let samples = schedule.sample_count(source.topic());
        Self {
            is_estimated: source == StateSource::Estimate,
            stride: samples.div_ceil(MAX_POINTS).max(1),
            seen: 0,
            numbers: Vec::new(),
        }
    }

    /// Adds a moment.
    pub(super) fn add(&mut self, Moment { vehicle, path, .. }: &Moment) {
        if self.seen.is_multiple_of(self.stride) {
            let position = Vector3::from(vehicle.position_world);
            let desired = path.map_or(Vector3::repeat(f64::NAN), |path| {
                Vector3::from(path.position_world)
            });
            let attitude = roll_pitch_yaw(&from_row_major(&vehicle.world_from_body));
            let time = seconds(vehicle.time_ns);
            let point = std::iter::once(time)
                .chain(position.iter().copied())
                .chain(desired.iter().copied())
                .chain(attitude);
            self.numbers.extend(point.map(|number| number as f32));
        }
        self.seen += 1;
    }

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
    use crate::encoding::decoded;
    use metrics::path_clock::Demand;
    use metrics::tracker::Vehicle;
    use run_log::test_flight::scenario;
    use shared_types::FlightPhase;

    #[test]
    fn a_place_is_where_the_vehicle_was_and_should_have_been() {
        let schedule = scenario(0.001, 10.0).schedule().unwrap();
        let mut track = Track::new(&schedule);
        for tick in 0..=10_000 {
            let vehicle = Vehicle {
                tick,
                time_ns: schedule.time_ns(tick),
                position_world: [tick as f64, 1.0, -2.0],
                world_from_body: [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
                velocity_body: [0.0; 3],
                angular_velocity_body: [0.0; 3],
                thrust: 0.0,
            };
            let path = Demand {
                position_world: [0.5, 0.0, -1.0],
                gamma: 0.0,
                yaw: 0.0,
                phase: FlightPhase::Fly,
            };
            track.add(&Moment {
                vehicle,
                path: (tick > 0).then_some(path),
                distance: None,
            });
        }
        let page = track.finish();
        let numbers = decoded(&page.places);
        let places: Vec<_> = numbers.chunks_exact(page.numbers_per_place).collect();
        assert!(numbers.len() == NUMBERS * places.len() && places.len() as u64 <= MAX_POINTS);
        assert!(places[0][4].is_nan());
        let second = places[1];
        assert!((1000.0 * second[0] - second[1]).abs() < 1e-3);
        assert_eq!(second[2..], [1.0, -2.0, 0.5, 0.0, -1.0, 0.0, 0.0, 0.0]);
    }
}
