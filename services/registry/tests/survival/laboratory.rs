//! Laboratory of Figs. 3 to 6 with cameras noisier than stated, and with all parameters different from the model.

use std::convert::Infallible;

use host::in_process::{InProcess, TickSink};
use nalgebra::Vector3;
use registry::build_all;
use scenario::Scenario;
use shared_types::Topic;
use shared_types::noise::{Draws, Noise, Stream};
use shared_types::samples::{PathReference, VehicleTruth};
use shared_types::service::seconds;
use zerocopy::FromBytes;

use super::{committed, draws};

/// Time from which the distance counts, s: the flight begins 0.68 m from the path.
const ARRIVED: f64 = 10.0;

/// Duration, s: until the effect of the coins at 30 s has ended.
const DURATION: f64 = 40.0;

/// Largest permitted distance from the path, m. Without errors of the model the coins make it 5.6 cm.
const BOUND: f64 = 0.1;

/// Largest true distance from the reference, m.
#[derive(Default)]
struct Distance {
    reference: Vector3<f64>,
    largest: f64,
}

impl TickSink for Distance {
    type Error = Infallible;

    fn sample(&mut self, topic: Topic, bytes: &[u8]) -> Result<(), Infallible> {
        match topic {
            Topic::PathReference => {
                self.reference = PathReference::read_from_bytes(bytes)
                    .unwrap()
                    .position_world
                    .into();
            }
            Topic::VehicleTruth => {
                let truth = VehicleTruth::read_from_bytes(bytes).unwrap();
                let stamp_ns = truth.header.stamp_ns;
                if seconds(stamp_ns) > ARRIVED {
                    let error = Vector3::from(truth.position_world) - self.reference;
                    self.largest = self.largest.max(error.norm());
                }
            }
            _ => {}
        }
        Ok(())
    }
}

/// Flies draws of the laboratory, each made by `change`, and asserts that all stay within [`BOUND`].
#[track_caller]
fn assert_stay_on_the_path(mut change: impl FnMut(&mut Scenario, &mut Draws<'_>)) {
    let mut noise = Noise::new(2, Stream::Turbulence);
    // A flight of the laboratory takes some ten times as long as one of the other tests.
    for number in 0..draws().div_ceil(10) {
        let mut scenario = committed("fig3_6");
        scenario.duration = DURATION;
        scenario.seed = 1000 + number;
        change(&mut scenario, &mut noise.at(number));
        assert_eq!(scenario.problems(), []);
        let mut distance = Distance::default();
        let mut host = InProcess::new(scenario.schedule().unwrap(), build_all(&scenario).unwrap());
        host.fly(&mut distance).unwrap();
        let largest = distance.largest;
        assert!(largest < BOUND, "draw {number}: {largest} m, {scenario:?}");
    }
}

#[test]
fn noise_of_ten_times_the_stated_keeps_the_vehicle_on_its_path() {
    assert_stay_on_the_path(|scenario, _| {
        let cameras = scenario.cameras.as_mut().unwrap();
        cameras.position_deviation *= 10.0;
        cameras.attitude_deviation *= 10.0;
    });
}

/// A factor from 0.7 to 1.3.
fn wrong(draws: &mut Draws<'_>) -> f64 {
    0.7 + 0.6 * draws.uniform()
}

/// Returns a modelled latency of 5 ms that is wrong by up to 30 %, in whole ticks, rounded away from the truth.
fn modelled_latency(draws: &mut Draws<'_>) -> f64 {
    let ticks = 5.0 * wrong(draws);
    let whole = if ticks < 5.0 { ticks.floor() } else { ticks.ceil() };
    1e-3 * whole
}

#[test]
fn a_laboratory_that_differs_in_everything_by_30_percent_keeps_the_vehicle_on_its_path() {
    assert_stay_on_the_path(|scenario, draws| {
        let vehicle = &mut scenario.vehicle;
        let (mass, inertia) = (wrong(draws), wrong(draws));
        vehicle.mass *= mass;
        vehicle.inertia = vehicle.inertia.map(|moment| moment * inertia);
        for change in &mut vehicle.change {
            change.mass = change.mass.map(|stated| stated * mass);
            change.inertia = change.inertia.map(|stated| stated.map(|moment| moment * inertia));
        }
        let actuators = vehicle.actuators.as_mut().unwrap();
        actuators.initial_thrust *= mass;
        actuators.thrust_factor *= wrong(draws);
        actuators.thrust_lag *= wrong(draws);
        actuators.rate_factor = actuators.rate_factor.map(|factor| factor * wrong(draws));
        actuators.rate_lag = actuators.rate_lag.map(|lag| lag * wrong(draws));
        vehicle.turbulence.as_mut().unwrap().deviation *= wrong(draws);
        let cameras = scenario.cameras.as_mut().unwrap();
        cameras.position_deviation *= wrong(draws);
        cameras.attitude_deviation *= wrong(draws);
        let model = scenario.model.as_mut().unwrap();
        model.radio_latency = modelled_latency(draws);
        model.capture_latency = Some(modelled_latency(draws));
    });
}
