//! Warnings about valid scenarios in which the vehicle probably does not return safely.

use scenario::{Gnss, Key, Navigation, OrchestratorLoss, Problem, Scenario, Vector};
use shared_types::flight_phase::DESCENT;
use shared_types::path_stop::{BRAKE, BRAKE_AFTER};
use shared_types::{ServiceId, Topic};

use crate::gain_rules::{self, digits};
use crate::units;

/// Depth below the ground without a warning, m: the points of a path are rounded.
const WITHIN: f64 = 1e-3;

/// Returns all warnings about a checked scenario along the points of its path, in {I}, m: first those of a value in another
/// unit, which breaks rules whose advice is about other keys.
#[must_use]
pub fn all(scenario: &Scenario, path: &[[f32; 3]]) -> Vec<Problem> {
    let rules = gain_rules::warnings(scenario);
    [units::warnings(scenario), rules, of_flight(scenario, path)].concat()
}

/// Returns the warnings about the flight of a checked scenario along the points of its path, in {I}, m.
fn of_flight(scenario: &Scenario, path: &[[f32; 3]]) -> Vec<Problem> {
    path_warnings(scenario, path)
        .chain(fence_warning(scenario, path))
        .chain(duration_warning(scenario, path))
        .chain(landing_warning(scenario, path))
        .chain(tracking_loss_warning(scenario))
        .chain(mass_warning(scenario))
        .chain(descent_warning(scenario, path))
        .chain(lever_arm_warnings(scenario))
        .chain(fix_latency_warning(scenario))
        .chain(yaw_test_warning(scenario))
        .chain(estimate_warning(scenario))
        .chain(unmeasured_warning(scenario, path))
        .chain(speed_warning(scenario))
        .collect()
}

/// Radii of gyration of multicopters, m: a Crazyflie has 0.022 m, one with arms of a metre 0.4 m.
const GYRATION: [f64; 2] = [0.008, 0.6];

/// Warns of an inertia in another unit.
pub fn inertia_warnings(scenario: &Scenario) -> impl Iterator<Item = Problem> {
    let (vehicle, law) = (&scenario.vehicle, &scenario.controller.initial);
    let stated = [
        (
            ["vehicle", "inertia"].into_iter().collect(),
            vehicle.mass,
            vehicle.inertia,
        ),
        (
            ["controller", "initial", "inertia"].into_iter().collect(),
            law.mass,
            law.inertia,
        ),
    ];
    stated
        .into_iter()
        .filter_map(|(at, mass, inertia): (Key, f64, Vector)| {
            let [least, most] = GYRATION;
            let radii = inertia.map(|inertia| (inertia / mass).sqrt());
            let far = radii
                .into_iter()
                .find(|radius| !(least..=most).contains(radius))?;
            let reason = format!("the mass of {mass:?} kg would be {far:.3} m from the axis");
            Some(Problem::new(
                at,
                reason,
                "the unit is kg m²: 1 g cm² is 1e-7, and 1 kg mm² is 1e-6",
            ))
        })
}

/// Ratio of two believed masses of a vehicle above which one of them is probably another vehicle's.
const MASSES_DIFFER: f64 = 1.2;

/// Warns of a laboratory in which estimator and law believe in different masses. The unknown mass of a simulation is an experiment.
fn mass_warning(scenario: &Scenario) -> Option<Problem> {
    scenario.capture_system()?;
    let (law, estimator) = (scenario.controller.initial.mass, scenario.model.as_ref()?.mass);
    (law.max(estimator) > MASSES_DIFFER * law.min(estimator)).then(|| {
        let reason = format!(
            "the law starts with {law:?} kg, and the estimator believes {estimator:?} kg (`model.mass`)"
        );
        let at = ["controller", "initial", "mass"].into_iter().collect();
        Problem::new(at, reason, "state the weighed mass in both")
    })
}

/// Warns of a limit of the speed that take-off or landing exceeds.
fn speed_warning(scenario: &Scenario) -> Option<Problem> {
    let flight = scenario.flight.as_ref()?;
    let limit = scenario.envelope.as_ref()?.speed.as_ref()?.max;
    let led = flight.takeoff_speed.max(flight.landing_speed);
    (limit <= led).then(|| {
        let reason = format!("take-off and landing are led at up to {led:?} m/s");
        let at = ["envelope", "speed", "max"].into_iter().collect();
        Problem::new(
            at,
            reason,
            "it is in m/s: give it twice the largest speed of the flight",
        )
    })
}

/// Fix for points below the ground, which often have the sign of another frame.
const UPWARDS: &str = "z points down: points above the ground have a smaller z";

/// Warns of a vehicle or a path below the ground, and of a path that starts far from the vehicle.
fn path_warnings(scenario: &Scenario, points: &[[f32; 3]]) -> impl Iterator<Item = Problem> + use<> {
    let [.., z] = scenario.vehicle.initial.position;
    let at = Key::root().then("path").then("curve");
    // Without `[flight]` the vehicle may start in the air; the ground is then assumed at z = 0.
    let ground = if scenario.flight.is_some() { z } else { z.max(0.0) };
    let lowest = points
        .iter()
        .map(|point| f64::from(point[2]))
        .fold(ground, f64::max);
    let below = (lowest > ground + WITHIN).then(|| {
        let reason = format!(
            "the path goes down to z = {lowest:.2} m, {:.2} m below the ground",
            lowest - ground
        );
        Problem::new(at.clone(), reason, UPWARDS)
    });
    let starts_below = (scenario.flight.is_none() && z > WITHIN).then(|| {
        let at = ["vehicle", "initial", "position"].into_iter().collect();
        let reason = format!("the vehicle starts at z = {z:.2} m, below the ground, which is at z = 0");
        Problem::new(at, reason, UPWARDS)
    });
    let start = top_of_rise(scenario);
    let away = points.first().map_or(0.0, |first| {
        let way: [f64; 3] = std::array::from_fn(|axis| f64::from(first[axis]) - start[axis]);
        way.map(|way| way * way).iter().sum::<f64>().sqrt()
    });
    let limit = scenario.path.alpha2;
    let far = (away > limit && !scenario.measures_a_vehicle()).then(|| {
        let reason =
            format!("the path starts {away:.2} m from the vehicle, farther away than α2 = {limit:?} m");
        let fix = "start the vehicle closer by `vehicle.initial.position`, or move the curve";
        Problem::new(at, reason, fix)
    });
    starts_below.into_iter().chain(below).chain(far)
}

/// Returns the position of a simulated vehicle after its climb, in {I}, m.
fn top_of_rise(scenario: &Scenario) -> Vector {
    let [x, y, z] = scenario.vehicle.initial.position;
    let flight = scenario.flight.as_ref();
    [x, y, z - flight.map_or(0.0, |flight| flight.takeoff_height)]
}

/// Warns of a path, or of a simulated start, outside of the box of the envelope.
fn fence_warning(scenario: &Scenario, path: &[[f32; 3]]) -> Option<Problem> {
    let fence = scenario.envelope.as_ref()?.r#box.as_ref()?;
    // In a laboratory the start position is not known.
    let is_simulated = !scenario.measures_a_vehicle();
    let start = [scenario.vehicle.initial.position, top_of_rise(scenario)];
    let start = start.into_iter().filter(|_| is_simulated);
    let positions = path.iter().map(|point| point.map(f64::from)).chain(start);
    let beyond = |position: &Vector| {
        let by = |axis: usize| (fence.min[axis] - position[axis]).max(position[axis] - fence.max[axis]);
        by(0).max(by(1)).max(by(2))
    };
    let farthest = positions.max_by(|one, other| beyond(one).total_cmp(&beyond(other)))?;
    (beyond(&farthest) > WITHIN).then(|| {
        let [x, y, z] = farthest;
        let reason = format!(
            "the flight leads to [{x:.2}, {y:.2}, {z:.2}], {:.2} m outside of the box",
            beyond(&farthest)
        );
        let at = Key::root().then("envelope").then("box");
        Problem::new(
            at,
            reason,
            "z points down: `min` is an upper corner; widen the box, or move the path",
        )
    })
}

/// Warns of a flight whose `duration` ends before the vehicle has landed.
fn duration_warning(scenario: &Scenario, points: &[[f32; 3]]) -> Option<Problem> {
    let flight = scenario.flight.as_ref()?;
    let duration = scenario.duration;
    let warning = |reason| {
        let fix = "state a longer `duration`, or an earlier `flight.land_at`";
        Some(Problem::new(Key::root().then("duration"), reason, fix))
    };
    if scenario.measures_a_vehicle() {
        let needed = flight.shortest_time();
        if duration < needed {
            return warning(format!(
                "take-off and landing take {needed:.0} s: the vehicle will not be armed"
            ));
        }
        let after_loss = scenario.real_time.unwrap_or_default().orchestrator_loss;
        return (after_loss == OrchestratorLoss::Continue).then(|| {
            let at = Key::root().then("real_time").then("orchestrator_loss");
            let reason = "without an orchestrator the vehicle does not land before the end of `duration`, \
                          which stops its motors in the air";
            Problem::new(
                at,
                reason,
                "leave it out, or take the flight over in time: `gerono attach`",
            )
        });
    }
    if flight.arm_at.is_none() || flight.kill_at.is_some() {
        return None;
    }
    let Some(land_at) = flight.land_at else {
        return warning("no landing is requested: the vehicle flies at the end".to_owned());
    };
    let needed = longest_landing(scenario, points)?;
    (duration < land_at + needed)
        .then(|| {
            format!("a landing at {land_at:?} s takes up to {needed:.0} s: the vehicle may fly at the end")
        })
        .and_then(warning)
}

/// Warns of a landing that takes longer than the envelope permits.
fn landing_warning(scenario: &Scenario, points: &[[f32; 3]]) -> Option<Problem> {
    let land_within = scenario.envelope.as_ref()?.land_within;
    let needed = longest_landing(scenario, points)?;
    (land_within < needed).then(|| {
        let reason = format!(
            "a landing takes up to {needed:.0} s: when the envelope requests one, the vehicle may be killed in the air after {land_within:?} s"
        );
        let at = Key::root().then("envelope").then("land_within");
        Problem::new(at, reason, "state a longer time, or a larger `flight.landing_speed`")
    })
}

/// Returns the maximum duration of a landing from a point of the path, s.
fn longest_landing(scenario: &Scenario, points: &[[f32; 3]]) -> Option<f64> {
    let height = largest_height(scenario, points)?;
    Some(scenario.flight.as_ref()?.landing_time(height))
}

/// Returns the maximum height above the ground, m.
fn largest_height(scenario: &Scenario, points: &[[f32; 3]]) -> Option<f64> {
    let flight = scenario.flight.as_ref()?;
    let ground = scenario.vehicle.initial.position[2];
    let heights = points.iter().map(|point| ground - f64::from(point[2]));
    Some(heights.fold(flight.takeoff_height, f64::max))
}

/// Warns of motors that stop before a vehicle without a state has come down from the highest point of the path. Without `descend` it
/// falls from there.
fn descent_warning(scenario: &Scenario, points: &[[f32; 3]]) -> Option<Problem> {
    let safety = scenario.safety_of(Topic::VehicleState, ServiceId::Controller)?;
    let failsafe = safety.failsafe?;
    let height = largest_height(scenario, points)?;
    let needed = (2.0 * height / DESCENT).sqrt();
    let descends_for = safety.descend.map_or(0.0, |descend| failsafe - descend);
    (descends_for < needed).then(|| {
        let reason = format!(
            "without a state the vehicle descends for {descends_for:.1} s before the motors stop, and from {height:.1} m it needs {needed:.1} s or \
             more"
        );
        let at = Key::root().then("safety").then("vehicle/state -> controller").then("failsafe");
        let fix = safety.descend.map_or_else(
            || format!("add `descend`, and raise `failsafe` {needed:.1} s above it"),
            |descend| format!("raise it above {:.1}", descend + needed),
        );
        Problem::new(at, reason, fix)
    })
}

/// Distance between two stated places of the antenna above which they differ, m.
const SAME_PLACE: f64 = 1e-3;

/// Largest distance of a sensor from the centre of mass without a warning, m.
const LARGEST_LEVER_ARM: f64 = 2.0;

/// Warns of sensors far away from the vehicle, and of an antenna that is not where the estimator assumes it.
fn lever_arm_warnings(scenario: &Scenario) -> Vec<Problem> {
    let length = |arm: &Vector| arm.iter().map(|part| part * part).sum::<f64>().sqrt();
    let key = |names: &[&str]| names.iter().copied().collect::<Key>();
    let navigation = scenario.navigation.as_ref();
    let stated = navigation.map(|navigation| (key(&["navigation", "antenna"]), navigation.antenna));
    let sensors = scenario.sensors.as_ref();
    let simulated = sensors.map(|sensors| {
        let antenna = (key(&["sensors", "gnss", "antenna"]), sensors.gnss.antenna);
        [
            antenna,
            (key(&["sensors", "imu", "lever_arm"]), sensors.imu.lever_arm),
        ]
    });
    let arms = stated.iter().chain(simulated.iter().flatten());
    let far = arms.filter(|(_, arm)| length(arm) > LARGEST_LEVER_ARM);
    let in_another_unit =
        |at, reason| Problem::new(at, reason, "lengths are in m, along the axes of the body");
    let mut warnings: Vec<_> = far
        .map(|(at, arm)| {
            let reason = format!("it is {:.2} m away from the centre of mass", length(arm));
            in_another_unit(at.clone(), reason)
        })
        .collect();
    let true_baseline = sensors.and_then(|sensors| sensors.gnss.baseline);
    let baselines = [
        (key(&["navigation", "baseline"]), scenario.baseline()),
        (key(&["sensors", "gnss", "baseline"]), true_baseline),
    ];
    for (at, baseline) in baselines {
        let apart = baseline.map_or(0.0, |baseline| length(&baseline));
        if apart > LARGEST_LEVER_ARM {
            warnings.push(in_another_unit(
                at,
                format!("the two antennas are {apart:.2} m apart"),
            ));
        }
    }
    if let (Some((at, assumed)), Some([(true_at, antenna), _])) = (stated, simulated) {
        let apart = length(&std::array::from_fn(|axis| assumed[axis] - antenna[axis]));
        if apart > SAME_PLACE {
            let reason = format!("it is {apart:.3} m away from the simulated antenna, `{true_at}`");
            let fix = "give both the same place, unless a wrong lever arm is what you test";
            warnings.push(Problem::new(at, reason, fix));
        }
    }
    if let (Some(assumed), Some(baseline)) = (scenario.baseline(), true_baseline) {
        let apart = length(&std::array::from_fn(|axis| assumed[axis] - baseline[axis]));
        if apart > SAME_PLACE {
            let reason =
                format!("it differs by {apart:.3} m from the simulated one, `sensors.gnss.baseline`");
            let fix = "give both the same, unless a wrong baseline is what you test";
            warnings.push(Problem::new(key(&["navigation", "baseline"]), reason, fix));
        }
    }
    warnings
}

/// Time in which no satellite receiver computes a fix and sends it, s.
const NO_FIX_WITHIN: f64 = 0.02;

/// Warns of fixes that are stated to be younger than those of any receiver: the position would be wrong by speed × time.
fn fix_latency_warning(scenario: &Scenario) -> Option<Problem> {
    let latency = scenario.real_receivers()?.fix_latency;
    (latency < NO_FIX_WITHIN).then(|| {
        let at = Key::root().then("receivers").then("fix_latency");
        let reason = format!(
            "no receiver computes and sends a fix in {latency:?} s; each 0.01 s too little are 1 cm at 1 m/s"
        );
        Problem::new(
            at,
            reason,
            "state the least age that `gerono gnss probe` prints, in s; 0.05 to 0.12 are usual",
        )
    })
}

/// Warns of a real vehicle whose yaw is not tested at lift-off: a slow one with a wrong sign is never noticed.
fn yaw_test_warning(scenario: &Scenario) -> Option<Problem> {
    scenario.radio_link()?;
    scenario.flight.as_ref()?.yaw_test.is_none().then(|| {
        let at = Key::root().then("flight").then("yaw_test");
        let reason =
            "a yaw with the wrong sign shows only when the vehicle is high, or never where yaw is slow";
        Problem::new(at, reason, "state 0.2 (rad): a turn at lift-off and back")
    })
}

/// Limit of the standard deviation of the position with accurate fixes, m.
const POSITION_SIGMA: f64 = 0.5;

/// Warns of inertial navigation whose position drifts until it counts as lost, because nothing limits its standard deviation.
fn estimate_warning(scenario: &Scenario) -> Option<Problem> {
    let navigation = scenario.navigation.as_ref()?;
    let coast = navigation.coast;
    let envelope = scenario.envelope.as_ref();
    envelope.and_then(|envelope| envelope.estimate.as_ref()).is_none().then(|| {
        let reason = format!("without fixes the vehicle flies on for {coast:?} s (`navigation.coast`), while its position drifts");
        let fix = format!(
            "add `envelope.estimate = {{ position_sigma = {}, action = \"land\" }}`: it lands while velocity and height are known",
            digits(advised_sigma(scenario, navigation))
        );
        Problem::new(Key::root().then("envelope").then("estimate"), reason, fix)
    })
}

/// Returns the limit (m) of the standard deviation of the position that is advised: with fixes alone it is not exceeded.
fn advised_sigma(scenario: &Scenario, navigation: &Navigation) -> f64 {
    let gnss = scenario.sensors.as_ref().map(|sensors| &sensors.gnss);
    let kind = gnss.and_then(Gnss::least_accurate);
    POSITION_SIGMA.max(2.0 * navigation.attainable_sigma(kind))
}

/// Warns of a place of the flight at which neither simulated fixes nor poses measure the position.
fn unmeasured_warning(scenario: &Scenario, path: &[[f32; 3]]) -> Option<Problem> {
    let fuses_poses = scenario.fuses_poses()?;
    let gnss = &scenario.sensors.as_ref()?.gnss;
    let volume = scenario
        .cameras
        .as_ref()
        .and_then(|cameras| cameras.volume.as_ref());
    let has_fixes = |place: &Vector| {
        let building = gnss.building.as_ref();
        gnss.least_accurate().is_some() && !building.is_some_and(|building| building.contains(place))
    };
    let has_poses = |place: &Vector| fuses_poses && volume.is_none_or(|volume| volume.contains(place));
    let is_unmeasured = |place: &Vector| !has_fixes(place) && !has_poses(place);
    let start = scenario.vehicle.initial.position;
    let (place, then) = if is_unmeasured(&start) {
        (start, "where the vehicle starts, so that it is never armed")
    } else {
        let places =
            std::iter::once(top_of_rise(scenario)).chain(path.iter().map(|point| point.map(f64::from)));
        (places.into_iter().find(is_unmeasured)?, "where the flight leads")
    };
    let [x, y, z] = place;
    let reason = format!("neither fixes nor poses measure the position at [{x:.2}, {y:.2}, {z:.2}], {then}");
    let (at, fix) = if fuses_poses {
        (
            ["cameras", "volume"],
            "widen the volume, or move the path or `sensors.gnss.building`",
        )
    } else {
        (
            ["navigation", "poses"],
            "state `[navigation.poses]`, so that cameras measure it, or move the path or `sensors.gnss.building`",
        )
    };
    Some(Problem::new(at.into_iter().collect(), reason, fix))
}

/// Warns of a law that levels the vehicle before the path has decelerated: without tracking the vehicle keeps its velocity.
fn tracking_loss_warning(scenario: &Scenario) -> Option<Problem> {
    scenario.flight.as_ref()?;
    let coast = scenario.estimator.as_ref()?.kalman.coast;
    let safety = scenario.safety_of(Topic::VehicleState, ServiceId::Controller)?;
    safety.level.or(safety.descend)?;
    let (continues_for, needed) = (coast + safety.max_age, BRAKE_AFTER + 0.5 * BRAKE);
    (continues_for < needed - 1e-9).then(|| {
        let reason = format!(
            "with `estimator.kalman.coast` the law continues for {continues_for:.2} s without tracking, and the vehicle then \
             keeps its velocity: halving it takes {needed:.2} s"
        );
        let at = Key::root().then("safety").then("vehicle/state -> controller").then("max_age");
        Problem::new(at, reason, "state longer times, as far as the estimate permits")
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn keys(name: &str, sets: &[&str], path: &[[f32; 3]]) -> Vec<String> {
        let file =
            std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("../../scenarios/{name}.toml"));
        let sets: Vec<_> = sets.iter().map(ToString::to_string).collect();
        let scenario = crate::load(&file, &sets, None).unwrap();
        let warnings = [units::warnings(&scenario), of_flight(&scenario, path)].concat();
        warnings.iter().map(|warning| warning.key.to_string()).collect()
    }

    #[test]
    fn a_sensor_far_away_or_not_where_the_estimator_assumes_it_is_a_warning() {
        let keys = |sets: &[&str]| keys("outdoor_rtk", sets, &[]);
        assert_eq!(keys(&[]), [""; 0]);
        assert_eq!(
            keys(&["navigation.antenna=[0.2,0.0,-0.05]"]),
            ["navigation.antenna"]
        );
        let stated = [
            "sensors.gnss.baseline=[0.8,0.0,0.0]",
            "schedule.period.'gnss/baseline'=0.1",
            "schedule.latency.'gnss/baseline -> estimator'=0.1",
        ];
        let far = ["navigation.baseline", "sensors.gnss.baseline"];
        let both = far.map(|key| format!("{key}=[800.0,0.0,0.0]"));
        let sets: Vec<_> = stated[1..]
            .iter()
            .copied()
            .chain(both.iter().map(String::as_str))
            .collect();
        assert_eq!(keys(&sets), far);
        for (baseline, warned) in [(0.8, &[][..]), (0.81, &["navigation.baseline"])] {
            let assumed = format!("navigation.baseline=[{baseline},0.0,0.0]");
            let sets: Vec<_> = stated.into_iter().chain([assumed.as_str()]).collect();
            assert_eq!(keys(&sets), warned);
        }
        let both = [
            "navigation.antenna=[5.0,0.0,-5.0]",
            "sensors.gnss.antenna=[5.0,0.0,-5.0]",
        ];
        assert_eq!(keys(&both), ["navigation.antenna", "sensors.gnss.antenna"]);
        assert_eq!(
            keys(&["sensors.imu.lever_arm=[3.0,0.0,0.0]"]),
            ["sensors.imu.lever_arm"]
        );
    }

    #[test]
    fn a_fix_that_is_younger_than_any_is_a_warning() {
        for (latency, warned) in [(0.0, true), (0.08, false)] {
            let set = format!("receivers.fix_latency={latency:?}");
            let found = keys("laboratory_outdoor", &[&set], &[]);
            assert_eq!(
                found.iter().any(|key| key == "receivers.fix_latency"),
                warned,
                "{found:?}"
            );
        }
    }

    #[test]
    fn a_real_vehicle_without_a_test_of_its_yaw_is_a_warning() {
        let file = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../scenarios/laboratory.toml");
        let text = std::fs::read_to_string(&file).unwrap();
        let untested = text.replace("\nyaw_test", "\n# yaw_test");
        for (text, warned) in [(&text, false), (&untested, true)] {
            let scenario = crate::load_from(&file, text, &[], None).unwrap();
            let found = of_flight(&scenario, &[]);
            let is_warned = found
                .iter()
                .any(|warning| warning.key.to_string() == "flight.yaw_test");
            assert_eq!(is_warned, warned);
        }
        assert!(!keys("takeoff_and_land", &[], &[]).contains(&"flight.yaw_test".to_owned()));
    }

    #[test]
    fn a_calibration_an_envelope_or_a_box_that_nobody_has_is_a_warning() {
        let keys = |sets: &[&str]| keys("laboratory", sets, &[]);
        let without = keys(&[]);
        for (set, key) in [
            ("rc_output.thrust_slope=800.0", "rc_output.thrust_slope"),
            ("envelope.speed.max=0.3", "envelope.speed.max"),
            ("envelope.box.max=[1500.0,1.5,0.5]", "envelope.box"),
        ] {
            let found = keys(&[set]);
            assert!(found.iter().any(|found| found == key), "{set}: {found:?}");
            assert!(!without.iter().any(|found| found == key), "{without:?}");
        }
    }

    #[test]
    fn a_place_at_which_nothing_measures_the_position_is_a_warning() {
        let is_warned = |name: &str, sets: &[&str], path: &[[f32; 3]], key: &str| {
            keys(name, sets, path).iter().any(|found| found == key)
        };
        // Within the cameras' volume, deep in the hall behind them, and on the field.
        for (place, warned) in [
            ([0.4, 0.0, -1.0], false),
            ([-11.0, 0.0, -1.0], true),
            ([9.0, 0.0, -1.0], false),
        ] {
            assert_eq!(
                is_warned("indoor_outdoor", &[], &[place], "cameras.volume"),
                warned,
                "{place:?}"
            );
        }
        let around = ["sensors.gnss.building={min=[-9.0,-9.0,-9.0],max=[9.0,9.0,9.0]}"];
        assert!(is_warned("outdoor_rtk", &around, &[], "navigation.poses"));
        let elsewhere = ["sensors.gnss.building={min=[90.0,-9.0,-9.0],max=[99.0,9.0,9.0]}"];
        assert_eq!(keys("outdoor_rtk", &elsewhere, &[]), [""; 0]);
    }

    #[test]
    fn motors_that_stop_before_a_blind_vehicle_is_down_are_a_warning() {
        // √(2h/a) from 54 m is 19 s, and the motors stop 19 s after the descent begins. Without one it falls.
        let falls = "safety={'vehicle/state -> controller'={max_age=0.2,level=0.3,failsafe=5.0}}";
        let descends = "envelope.land_within=300.0";
        for (z, set, warned) in [
            (-54.0, descends, false),
            (-54.5, descends, true),
            (-54.0, falls, true),
        ] {
            let found = keys(
                "outdoor_rtk",
                &["duration=300.0", "envelope.land_within=300.0", set],
                &[[0.3, 0.2, z]],
            );
            let key = "safety.\"vehicle/state -> controller\".failsafe";
            assert_eq!(
                found.iter().any(|found| found == key),
                warned,
                "{z} {set}: {found:?}"
            );
        }
    }

    #[test]
    fn inertial_navigation_without_a_limit_of_its_estimate_is_a_warning() {
        let mut outdoors = keys("outdoor_rtk", &[], &[]);
        assert!(outdoors.is_empty());
        let file = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../scenarios/outdoor_rtk.toml");
        let mut scenario = crate::load(&file, &[], None).unwrap();
        scenario.envelope = None;
        outdoors.extend(
            of_flight(&scenario, &[])
                .iter()
                .map(|warning| warning.key.to_string()),
        );
        assert_eq!(outdoors, ["envelope.estimate"]);
    }

    #[test]
    fn the_advised_limit_of_the_estimate_is_above_what_its_fixes_attain() {
        let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../scenarios");
        let outdoors = [
            ("indoor_outdoor", "0.5"),
            ("laboratory_indoor_outdoor", "0.5"),
            ("laboratory_outdoor", "0.5"),
            ("outdoor_50m", "0.5"),
            ("outdoor_events", "3"),
            ("outdoor_rtk", "0.5"),
            ("outdoor_single_point", "3"),
        ];
        for (name, advised) in outdoors {
            let file = folder.join(format!("{name}.toml"));
            let mut scenario = crate::load(&file, &[], None).unwrap();
            scenario.envelope = None;
            let fix = estimate_warning(&scenario).unwrap().to_string();
            assert!(
                fix.contains(&format!("position_sigma = {advised},")),
                "{name}: {fix}"
            );
            let navigation = scenario.navigation.as_ref().unwrap();
            let kind = scenario.sensors.as_ref().unwrap().gnss.least_accurate();
            let advised: f64 = advised.parse().unwrap();
            assert!(advised > navigation.attainable_sigma(kind), "{name}");
        }
    }
}
