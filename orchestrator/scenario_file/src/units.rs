//! Warnings about values that are probably in another unit: in g, mm, cm, ms or degrees.
//!
//! A value beyond which nothing is sensible is refused by the range of its key. These are values that another vehicle, a
//! flight outdoors or another section could have.

use std::f64::consts::PI;

use scenario::{Envelope, Fence, Key, Problem, Scenario, Vector};
use shared_types::GRAVITY;

use crate::gain_rules::digits;
use crate::warnings::inertia_warnings;

/// Returns the warnings about a checked scenario, which come before all others: they advise on other keys.
#[must_use]
pub fn warnings(scenario: &Scenario) -> Vec<Problem> {
    inertia_warnings(scenario)
        .chain(link_warnings(scenario))
        .chain(limit_warnings(scenario))
        .chain(height_warnings(scenario))
        .chain(camera_limit_warnings(scenario))
        .chain(frame_warnings(scenario))
        .chain(camera_noise_warnings(scenario))
        .chain(schedule_warnings(scenario))
        .collect()
}

fn warning(at: &str, reason: String, fix: &str) -> Problem {
    Problem::new(at.split('.').collect(), reason, fix)
}

/// Returns the warning about a value above what is sensible.
fn above(at: &str, value: f64, most: f64, unit: &str, why: &str, fix: &str) -> Option<Problem> {
    (value > most).then(|| warning(at, format!("{} {unit} {why}", digits(value)), fix))
}

/// Thrust over weight above which a calibration is wrong: racing quadcopters have up to 15.
const MOST_LIFT: f64 = 20.0;

/// Body rate that the full stick of every vehicle exceeds, rad/s: 57 °/s.
const LEAST_RATE: f64 = 1.0;

/// Largest body rate of a multicopter, rad/s: gyroscopes measure up to 35 rad/s, some 70 rad/s.
const MOST_RATE: f64 = 100.0;

/// Fix for body rates in degrees.
const RATES: &str = "it is in rad/s: 1000 °/s are 17.45";

/// Returns the weight that the vehicle is believed to have, N.
fn weight(scenario: &Scenario) -> f64 {
    let believed = scenario.model.as_ref().map(|model| model.mass);
    believed.unwrap_or(scenario.vehicle.mass) * GRAVITY
}

/// Warns of a radio link that carries another thrust or turn than any multicopter has.
fn link_warnings(scenario: &Scenario) -> impl Iterator<Item = Problem> + use<> {
    let weight = weight(scenario);
    let mass = weight / GRAVITY;
    let lift = scenario.rc_output.as_ref().and_then(|link| {
        let [_, thrust] = link.thrust_limits();
        let lift = thrust / weight;
        let name = if link.thrust_offset > link.thrust_slope.abs() {
            "rc_output.thrust_offset"
        } else {
            "rc_output.thrust_slope"
        };
        let reason = format!(
            "the full stick would lift {lift:.0} times the weight of {} kg",
            digits(mass)
        );
        let fix = "offset and slope are in N, 1 N carries 102 g: measure them (`gerono rc identify`)";
        (lift > MOST_LIFT).then(|| warning(name, reason, fix))
    });
    let push = scenario.rc_output.as_ref().and_then(|link| {
        let ends = link
            .thrust_range
            .map(|travel| link.thrust_offset + link.thrust_slope * travel);
        let push = -ends[0].min(ends[1]) / weight;
        let reason = format!(
            "at the end of its travel the stick would push down with {} times the weight of {} kg",
            digits(push),
            digits(mass)
        );
        let fix = "it is the thrust in N at the middle of the stick: measure it (`gerono rc identify`)";
        (push > 1.0).then(|| warning("rc_output.thrust_offset", reason, fix))
    });
    let turn = scenario.rc_output.as_ref().and_then(|link| {
        let fastest = link.rate_limits().into_iter().fold(0.0, f64::max);
        let reason = format!(
            "the full stick would turn the vehicle with {} rad/s, which is {:.0} °/s",
            digits(fastest),
            fastest.to_degrees()
        );
        (fastest < LEAST_RATE).then(|| warning("rc_output.rate_slope", reason, RATES))
    });
    lift.into_iter().chain(push).chain(turn)
}

/// Tilt that every flight exceeds, rad: 3°.
const LEAST_TILT: f64 = PI / 60.0;

/// Largest speed of a multicopter, m/s: 360 km/h.
const MOST_SPEED: f64 = 100.0;

/// Warns of limits of the envelope that nothing reaches, or that every flight exceeds.
fn limit_warnings(scenario: &Scenario) -> impl Iterator<Item = Problem> + use<> {
    let weight = weight(scenario);
    let mass = weight / GRAVITY;
    let of_envelope = |envelope: &Envelope| {
        let max = |limit: &Option<scenario::Limit>| limit.as_ref().map(|limit| limit.max);
        let tilt = max(&envelope.tilt).filter(|tilt| *tilt < LEAST_TILT).map(|tilt| {
            let reason = format!("every flight tilts by more than {} rad", digits(tilt));
            warning("envelope.tilt.max", reason, "it is in rad: 45° are 0.785")
        });
        let speed = max(&envelope.speed).and_then(|speed| {
            let fix = "it is in m/s: 250 cm/s are 2.5; give it twice the largest speed of the flight";
            above(
                "envelope.speed.max",
                speed,
                MOST_SPEED,
                "m/s",
                "are no limit to a multicopter",
                fix,
            )
        });
        let thrust = max(&envelope.thrust)
            .filter(|thrust| !(weight..=MOST_LIFT * weight).contains(thrust))
            .map(|thrust| {
                let lift = digits(thrust / weight);
                let reason = format!(
                    "commands are limited to {lift} times the weight of {} kg",
                    digits(mass)
                );
                warning("envelope.thrust.max", reason, "it is in N: 1 N carries 102 g")
            });
        let rates = envelope.rates.as_ref().and_then(|limit| {
            let fastest = limit.max.into_iter().fold(0.0, f64::max);
            let reason = format!(
                "commands are limited to {} rad/s, which is {:.0} °/s",
                digits(fastest),
                fastest.to_degrees()
            );
            let is_usual = (LEAST_RATE..=MOST_RATE).contains(&fastest);
            (!is_usual).then(|| warning("envelope.rates.max", reason, RATES))
        });
        [tilt, speed, thrust, rates]
    };
    let found = scenario.envelope.as_ref().map(of_envelope);
    found.into_iter().flatten().flatten()
}

/// Longest side of the box of a flight by cameras, m.
const LONGEST_SIDE: f64 = 100.0;

/// Largest standard deviation of a position that cameras measure, m; that of a limit in flight is larger, because it grows
/// while they see nothing.
const CAMERA_SIGMA: [f64; 2] = [0.2, 0.5];

/// Largest distance from the ground by cameras at which a vehicle stands on it, m.
const ON_THE_GROUND: f64 = 0.5;

/// Largest distance of the ground from the origin of {I}, along z, m.
const FARTHEST_GROUND: f64 = 20.0;

/// Largest speed of a body in the volume of cameras, m/s.
const FASTEST_BODY: f64 = 50.0;

/// Returns the box of the envelope.
fn fence(scenario: &Scenario) -> Option<&Fence> {
    scenario.envelope.as_ref()?.r#box.as_ref()
}

/// Warns of a ground and of a climb that are outside of the box, or of a ground far from the origin.
fn height_warnings(scenario: &Scenario) -> impl Iterator<Item = Problem> + use<> {
    let flight = scenario.flight.as_ref();
    let ground = flight.and_then(|flight| flight.ground).and_then(|ground| {
        let fix = "it is z in {I} in m, and z points down: 2 cm below the origin is 0.02";
        let reason = match fence(scenario) {
            Some(fence) if !(fence.min[2]..=fence.max[2]).contains(&ground) => {
                format!("the ground at z = {ground:?} m is outside of `envelope.box`")
            }
            None if ground.abs() > FARTHEST_GROUND => {
                format!("the ground is {ground:?} m from the origin of {{I}}")
            }
            _ => return None,
        };
        Some(warning("flight.ground", reason, fix))
    });
    let climb = flight.zip(fence(scenario)).and_then(|(flight, fence)| {
        let (climb, height) = (flight.takeoff_height, fence.max[2] - fence.min[2]);
        let reason = format!(
            "a climb of {climb:?} m leaves `envelope.box`, which is {} m high",
            digits(height)
        );
        (climb > height).then(|| warning("flight.takeoff_height", reason, "it is in m: 80 cm are 0.8"))
    });
    ground.into_iter().chain(climb)
}

/// Warns of limits of a flight by cameras, to which the metres of a flight outdoors are no limit.
fn camera_limit_warnings(scenario: &Scenario) -> Vec<Problem> {
    let mut found = Vec::new();
    if scenario.navigation.is_some() {
        return found;
    }
    let [arming, flying] = CAMERA_SIGMA;
    let by_cameras = "are no limit to a pose of cameras";
    if let Some(flight) = &scenario.flight {
        let sigma = "it is in m: 1 cm is 0.01";
        let (at, value) = ("flight.position_sigma_max", flight.position_sigma_max);
        found.extend(above(at, value, arming, "m", by_cameras, sigma));
        let [_, tolerance] = flight.ground_or_floor();
        let (at, why) = (
            "flight.ground_tolerance",
            "above the ground a vehicle does not stand on it",
        );
        found.extend(above(
            at,
            tolerance,
            ON_THE_GROUND,
            "m",
            why,
            "it is in m: 5 cm are 0.05",
        ));
    }
    if let Some(fence) = fence(scenario) {
        let sides: Vector = std::array::from_fn(|axis| fence.max[axis] - fence.min[axis]);
        let longest = sides.into_iter().fold(0.0, f64::max);
        if longest > LONGEST_SIDE {
            let reason = format!("a side of the box is {longest:.0} m long, farther than cameras see");
            let fix = "lengths are in m: state the volume of the cage";
            found.push(warning("envelope.box", reason, fix));
        }
    }
    if let Some(limit) = scenario
        .envelope
        .as_ref()
        .and_then(|envelope| envelope.estimate.as_ref())
    {
        let (at, fix) = ("envelope.estimate.position_sigma", "it is in m: 5 cm are 0.05");
        found.extend(above(at, limit.position_sigma, flying, "m", by_cameras, fix));
    }
    if let Some(cameras) = &scenario.motion_capture {
        let (at, fix) = ("motion_capture.max_speed", "it is in m/s: 600 cm/s are 6.0");
        found.extend(above(
            at,
            cameras.max_speed,
            FASTEST_BODY,
            "m/s",
            "are no speed in front of cameras",
            fix,
        ));
    }
    found
}

/// Largest distance of the markers' frame from the body's, m.
const FARTHEST_MARKERS: f64 = 2.0;

/// Warns of frames of cameras that are farther apart than any.
fn frame_warnings(scenario: &Scenario) -> Vec<Problem> {
    let cameras = scenario.motion_capture.as_ref();
    let frames = cameras.map(|cameras| {
        [
            (
                "motion_capture.world_from_capture.position",
                &cameras.world_from_capture,
                LONGEST_SIDE,
            ),
            (
                "motion_capture.body_from_markers.position",
                &cameras.body_from_markers,
                FARTHEST_MARKERS,
            ),
        ]
    });
    let stated = frames.into_iter().flatten();
    let far = stated.filter_map(|(at, frame, most)| {
        let position = frame.as_ref()?.position;
        let farthest = position.into_iter().map(f64::abs).fold(0.0, f64::max);
        let why = "are no distance between these frames";
        above(at, farthest, most, "m", why, "it is in m: 1500 mm are 1.5")
    });
    far.collect()
}

/// Largest standard deviations of a pose that cameras measure: position, m; attitude, rad.
const CAMERA_NOISE: [f64; 2] = [0.02, 0.1];

/// Warns of cameras that are worse than any: simulated ones, and those that a filter believes in.
fn camera_noise_warnings(scenario: &Scenario) -> impl Iterator<Item = Problem> + use<> {
    let cameras = scenario.cameras.as_ref();
    let filter = scenario.estimator.as_ref().map(|estimator| &estimator.kalman);
    let poses = scenario
        .navigation
        .as_ref()
        .and_then(|navigation| navigation.poses.as_ref());
    let stated = [
        cameras.map(|noise| ("cameras", noise.position_deviation, noise.attitude_deviation)),
        filter.map(|noise| {
            (
                "estimator.kalman",
                noise.position_deviation,
                noise.attitude_deviation,
            )
        }),
        poses.map(|noise| {
            (
                "navigation.poses",
                noise.position_deviation,
                noise.attitude_deviation,
            )
        }),
    ];
    stated
        .into_iter()
        .flatten()
        .flat_map(|(section, position, attitude)| {
            let [largest, widest] = CAMERA_NOISE;
            let why = "are the noise of no cameras";
            let [position_at, attitude_at] =
                ["position", "attitude"].map(|what| format!("{section}.{what}_deviation"));
            let fix = "it is in m: 0.3 mm are 3e-4";
            let far = above(&position_at, position, largest, "m", why, fix);
            let fix = "it is in rad: 0.1° are 1.7e-3";
            [far, above(&attitude_at, attitude, widest, "rad", why, fix)]
        })
        .flatten()
}

/// Longest period of a service or topic of a real vehicle, and the latest first step, s.
const LONGEST_PERIOD: f64 = 1.0;

/// Warns of services that are slow or begin late in a laboratory. In a simulation they are an experiment.
fn schedule_warnings(scenario: &Scenario) -> Vec<Problem> {
    let (period, phase) = (&scenario.schedule.period, &scenario.schedule.phase);
    let stated = [("period", period), ("phase", phase)].into_iter();
    let times = stated.flat_map(|(table, times)| times.iter().map(move |(name, time)| (table, name, *time)));
    times
        .filter(|(_, _, time)| scenario.measures_a_vehicle() && *time > LONGEST_PERIOD)
        .map(|(table, name, time)| {
            let at = Key::root().then("schedule").then(table).then(name);
            let reason = format!("{time:?} s are longer than a vehicle can be flown with");
            Problem::new(at, reason, "it is in s: 22 ms are 0.022")
        })
        .collect()
}
