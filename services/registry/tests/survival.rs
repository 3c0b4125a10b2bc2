//! Survival of flights from any attitude and at ordinary speeds: with the gains that follow from the estimated inertia
//! none is lost. Flights in laboratories that are not as stated: see [`laboratory`].
//!
//! The draws are functions of their number, so a lost flight is lost again.

use std::convert::Infallible;
use std::path::Path;

use host::in_process::{InProcess, TickSink};
use nalgebra::{Quaternion, UnitQuaternion, Vector3};
use registry::build_all;
use scenario::Scenario;
use shared_types::Topic;
use shared_types::noise::{Draws, Noise, Stream};
use shared_types::rotation::roll_pitch_yaw;
use shared_types::samples::ControlErrors;
use zerocopy::FromBytes;

#[path = "survival/laboratory.rs"]
mod laboratory;

/// Largest magnitude of each component of the initial velocity, m/s.
const SPEED: f64 = 1.5;

/// Duration of a flight, s: losses come within the first tenth of a second, swings show within a second.
const DURATION: f64 = 1.5;

/// A committed scenario.
fn committed(name: &str) -> Scenario {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../scenarios");
    let text = std::fs::read_to_string(folder.join(format!("{name}.toml"))).unwrap();
    let table: toml::Table = text.parse().unwrap();
    table.try_into().unwrap()
}

/// Fig. 1 without its step, which begins 1.2 m from the path, with no gain stated that follows from others.
fn fig1() -> Scenario {
    let mut scenario = committed("fig1");
    scenario.duration = DURATION;
    scenario.vehicle.change.clear();
    scenario.controller.beta = None;
    scenario.controller.lambda_inertia = None;
    scenario
}

/// A number from `least` to `most`, evenly spread over its logarithm.
fn log_uniform(draws: &mut Draws<'_>, least: f64, most: f64) -> f64 {
    least * libm::pow(most / least, draws.uniform())
}

/// Any attitude of SO(3), all equally likely, and a velocity of up to [`SPEED`] along each axis.
fn any_start(scenario: &mut Scenario, draws: &mut Draws<'_>) {
    let [[w, x], [y, z]] = [draws.normal_pair(), draws.normal_pair()];
    let attitude = UnitQuaternion::from_quaternion(Quaternion::new(w, x, y, z));
    let world_from_body = attitude.to_rotation_matrix().into_inner();
    scenario.vehicle.initial.roll_pitch_yaw = roll_pitch_yaw(&world_from_body);
    scenario.vehicle.initial.velocity_body = [0; 3].map(|_| SPEED * (2.0 * draws.uniform() - 1.0));
}

/// Largest ‖z1‖, m.
#[derive(Default)]
struct Distance(f64);

impl TickSink for Distance {
    type Error = Infallible;

    fn sample(&mut self, topic: Topic, bytes: &[u8]) -> Result<(), Infallible> {
        if topic == Topic::ControlErrors {
            let z1 = Vector3::from(ControlErrors::read_from_bytes(bytes).unwrap().z1);
            self.0 = self.0.max(z1.norm());
        }
        Ok(())
    }
}

/// Returns the largest distance of the vehicle from its path, m; `None` if a service computed a number that is not
/// finite.
fn fly(scenario: &Scenario) -> Option<f64> {
    assert_eq!(scenario.problems(), []);
    let mut distance = Distance::default();
    let mut host = InProcess::new(scenario.schedule().unwrap(), build_all(scenario).unwrap());
    host.fly(&mut distance).ok().map(|()| distance.0)
}

/// Returns the number of draws: a hundred, or the value of `GERONO_DRAWS`.
fn draws() -> u64 {
    let stated = std::env::var("GERONO_DRAWS").ok();
    stated.map_or(100, |count| count.parse().expect("GERONO_DRAWS is a number"))
}

/// Flies draws of a scenario, each made by `change`, and asserts that none is farther than `bound` (m) from its path at
/// any time.
#[track_caller]
fn assert_survive(count: u64, bound: f64, mut change: impl FnMut(&mut Scenario, &mut Draws<'_>)) {
    let mut noise = Noise::new(1, Stream::Turbulence);
    for number in 0..count {
        let mut scenario = fig1();
        change(&mut scenario, &mut noise.at(number));
        let Some(distance) = fly(&scenario) else {
            panic!("draw {number} was lost: {scenario:?}");
        };
        assert!(distance < bound, "draw {number}: {distance} m, {scenario:?}");
    }
}

#[test]
fn fig_1_s_vehicle_survives_any_attitude_and_ordinary_speeds() {
    assert_survive(draws(), 2.5, any_start);
}

/// Real vehicles have radii of gyration of centimetres, whatever their mass. A scale and a ruler give the mass to a
/// factor of 2 and the inertia to one of 3.
#[test]
fn vehicles_of_a_hundred_grams_to_kilograms_survive_with_the_gains_that_follow() {
    assert_survive(draws(), 5.0, |scenario, draws| {
        any_start(scenario, draws);
        let mass = log_uniform(draws, 0.1, 2.5);
        let radius = log_uniform(draws, 0.03, 0.1);
        let inertia = [1.0, 1.0, 1.8].map(|axis| axis * mass * radius * radius);
        (scenario.vehicle.mass, scenario.vehicle.inertia) = (mass, inertia);
        let believed = log_uniform(draws, 1.0 / 3.0, 3.0);
        scenario.controller.initial.inertia = inertia.map(|moment| moment * believed);
        scenario.controller.initial.mass = mass * log_uniform(draws, 0.5, 2.0);
        scenario.controller.bounds.mass_min = 0.05;
        scenario.controller.bounds.mass_max = 5.0;
    });
}

type Change = fn(&mut Scenario);

/// Gains and ticks around the paper's.
const AROUND: [Change; 12] = [
    |scenario| scenario.schedule.tick = 5e-4,
    |scenario| scenario.schedule.tick = 2e-3,
    |scenario| scenario.controller.delta = 0.05,
    |scenario| scenario.controller.delta = 0.25,
    |scenario| scenario.controller.delta = -0.1,
    |scenario| scenario.controller.beta = Some(50.0),
    |scenario| scenario.controller.beta = Some(200.0),
    |scenario| scenario.controller.k3 = 26.0,
    |scenario| scenario.controller.sigma_max = 1.0,
    |scenario| scenario.controller.sigma_max = 3.0,
    |scenario| scenario.controller.k1 = 8.0,
    |scenario| scenario.controller.k2 = 8.0,
];

/// With a Λw of so many times its limit.
fn at_limit(scenario: &mut Scenario, times: f64) {
    scenario.controller.lambda_inertia = Some(times * scenario.lambda_inertia_limit());
}

#[test]
fn at_its_limit_the_gain_of_the_estimator_of_w_loses_no_flight_whatever_the_other_gains_are() {
    for change in AROUND {
        assert_survive(10, 4.0, |scenario, draws| {
            any_start(scenario, draws);
            change(scenario);
            at_limit(scenario, 1.0);
        });
    }
}

#[test]
fn far_above_its_limit_it_loses_some_whatever_the_other_gains_are() {
    for (place, change) in AROUND.into_iter().enumerate() {
        let mut noise = Noise::new(1, Stream::Turbulence);
        let survived = (0..10).all(|number| {
            let mut scenario = fig1();
            any_start(&mut scenario, &mut noise.at(number));
            change(&mut scenario);
            at_limit(&mut scenario, 64.0);
            fly(&scenario).is_some()
        });
        assert!(!survived, "the limit is far too low with change {place}");
    }
}
