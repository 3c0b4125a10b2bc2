//! Sensors of flight outdoors inside the plant, as hosts see them.

use nalgebra::Vector3;
use plant::PlantService;
use scenario::{GRAVITY, Scenario};
use shared_types::Now;
use shared_types::geodesy::Geodetic;
use shared_types::samples::{
    BaroAltitude, GnssBaseline, GnssFix, ImuSample, MagField, RcFrame, VehicleTruth,
};
use shared_types::service::{ErasedService, InputView, OutputSlot};
use zerocopy::{FromZeros, IntoBytes};

const TICK_NS: u64 = 1_000_000;

/// A vehicle of 0.5 kg in the air, with sensors every 4, 100, 40 and 20 ms.
fn scenario(sections: &str) -> Scenario {
    toml::from_str(&format!(
        "duration = 100.0\n\
         path.curve.hover.position = [0.0, 0.0, -1.0]\n\
         datum = {{ latitude = 48.1, longitude = 11.5, height = 500.0, azimuth = 0.6 }}\n\
         vehicle = {{ mass = 0.5, inertia = [2e-3, 2e-3, 4e-3], initial = {{ position = [3.0, 4.0, -5.0] }} }}\n\
         [schedule.period]\n\
         \"imu/sample\" = 0.004\n\
         \"gnss/fix\" = 0.1\n\
         \"baro/altitude\" = 0.04\n\
         \"mag/field\" = 0.02\n\
         {sections}"
    ))
    .unwrap()
}

const EXACT: &str = "[sensors.imu]\n\
     gyroscope_noise = 0.0\ngyroscope_bias = 0.0\ngyroscope_walk = 0.0\ngyroscope_scale = 0.0\n\
     gyroscope_sensitivity = 0.0\naccelerometer_noise = 0.0\naccelerometer_bias = 0.0\naccelerometer_walk = 0.0\n\
     accelerometer_scale = 0.0\nvibration = [0.0, 0.0]\n\
     [sensors.barometer]\nwhite = 0.0\nslow = 0.0\nairspeed_factor = 0.0\nground_effect = 0.0\nresolution = 0.0\n\
     [sensors.magnetometer]\nwhite = 0.0\nhard_iron = 0.0\nsoft_iron = 0.0\ncurrent = [0.0, 0.0, 0.0]\nresolution = 0.0\n";

/// Samples of a step.
#[derive(Clone, Copy)]
struct Measured {
    truth: VehicleTruth,
    imu: ImuSample,
    fix: GnssFix,
    altitude: BaroAltitude,
    field: MagField,
    baseline: GnssBaseline,
}

fn step(service: &mut PlantService, tick: u64, frame: &RcFrame) -> Measured {
    let now = Now {
        tick,
        time_ns: tick * TICK_NS,
        elapsed_ns: tick.min(1) * TICK_NS,
        operator: shared_types::Operator::FLYING,
    };
    let mut measured = Measured {
        truth: VehicleTruth::new_zeroed(),
        imu: ImuSample::new_zeroed(),
        fix: GnssFix::new_zeroed(),
        altitude: BaroAltitude::new_zeroed(),
        field: MagField::new_zeroed(),
        baseline: GnssBaseline::new_zeroed(),
    };
    let due = |period: u64, bytes| tick.is_multiple_of(period).then_some(bytes);
    let bytes = [
        Some(measured.truth.as_mut_bytes()),
        None,
        due(4, measured.imu.as_mut_bytes()),
        due(100, measured.fix.as_mut_bytes()),
        due(40, measured.altitude.as_mut_bytes()),
        due(20, measured.field.as_mut_bytes()),
        due(100, measured.baseline.as_mut_bytes()),
    ];
    let mut outputs = bytes.map(|bytes| OutputSlot { bytes });
    let inputs = [InputView {
        bytes: Some(frame.as_bytes()),
        fresh: tick > 0,
    }];
    ErasedService::step(service, &now, &inputs, &mut outputs);
    measured
}

/// A frame that lets the vehicle climb and tumble.
fn frame() -> RcFrame {
    RcFrame {
        thrust: 0.6 * GRAVITY,
        torque_body: [1e-4, -2e-4, 1e-4],
        ..RcFrame::new_zeroed()
    }
}

fn saved(service: &PlantService) -> Vec<u8> {
    let mut state = vec![0; service.state_size()];
    ErasedService::save(service, &mut state);
    state
}

#[test]
fn restored_at_any_tick_its_sensors_continue_to_the_bit() {
    let scenario = scenario("[sensors.gnss]\nbaseline = [0.8, 0.0, 0.1]\n");
    let mut service = PlantService::new(&scenario);
    for tick in 0..1000 {
        let before = saved(&service);
        let expected = step(&mut service, tick, &frame());
        let mut restarted = PlantService::new(&scenario);
        ErasedService::restore(&mut restarted, &before);
        let got = step(&mut restarted, tick, &frame());
        assert_eq!(got.truth.as_bytes(), expected.truth.as_bytes(), "at {tick}");
        assert_eq!(got.imu.as_bytes(), expected.imu.as_bytes(), "at {tick}");
        assert_eq!(got.fix.as_bytes(), expected.fix.as_bytes(), "at {tick}");
        assert_eq!(got.altitude.as_bytes(), expected.altitude.as_bytes(), "at {tick}");
        assert_eq!(got.field.as_bytes(), expected.field.as_bytes(), "at {tick}");
        assert_eq!(got.baseline.as_bytes(), expected.baseline.as_bytes(), "at {tick}");
        assert_eq!(saved(&restarted), saved(&service), "at {tick}");
    }
}

#[test]
fn the_vehicle_flies_the_same_with_and_without_sensors() {
    let mut with = PlantService::new(&scenario("[sensors]\n"));
    let mut without = PlantService::new(&scenario(""));
    for tick in 0..500 {
        let [with, without] = [&mut with, &mut without].map(|service| step(service, tick, &frame()));
        assert_eq!(with.truth.as_bytes(), without.truth.as_bytes());
        assert!(!without.imu.measured.is_set() && !without.fix.measured.is_set());
    }
}

#[test]
fn exact_inertial_samples_integrate_to_the_motion() {
    let mut service = PlantService::new(&scenario(EXACT));
    let mut velocity = Vector3::<f64>::zeros();
    let mut attitude = nalgebra::Matrix3::<f64>::identity();
    for tick in 0..=2000 {
        let measured = step(&mut service, tick, &frame());
        let truth = &measured.truth;
        if tick > 0 && measured.imu.measured.is_set() {
            let turn = Vector3::from(measured.imu.angular_velocity_body) * 0.004;
            let middle = attitude * shared_types::rotation::exp(&(turn * 0.5));
            velocity += (middle * Vector3::from(measured.imu.specific_force_body)
                + Vector3::new(0.0, 0.0, GRAVITY))
                * 0.004;
            attitude = middle * shared_types::rotation::exp(&(turn * 0.5));
            let flown = shared_types::rotation::from_row_major(&truth.world_from_body)
                * Vector3::from(truth.velocity_body);
            // The output of the accelerometer has steps of 5 mm/s².
            let rounded = 0.0025 * tick as f64 * 1e-3;
            assert!(
                (flown - velocity).norm() < 1e-3 + 2.0 * rounded,
                "at {tick}: {flown} {velocity}"
            );
        }
    }
}

#[test]
fn fixes_altitudes_and_fields_are_those_of_the_place() {
    let scenario = scenario(EXACT);
    let datum = scenario.datum.clone().unwrap();
    let mut service = PlantService::new(&scenario);
    for tick in 0..1000 {
        let measured = step(&mut service, tick, &frame());
        let position = Vector3::from(measured.truth.position_world);
        if measured.fix.measured.is_set() {
            let fix = &measured.fix;
            let place = Geodetic {
                latitude: fix.latitude,
                longitude: fix.longitude,
                height: fix.height,
            };
            assert_eq!(
                (fix.kind, fix.valid_ns),
                (GnssFix::KIND_RTK_FIXED, tick * TICK_NS)
            );
            assert!((datum.frame().to_world(place) - position).norm() < 0.08);
        }
        if measured.altitude.measured.is_set() {
            assert!((measured.altitude.altitude + position.z).abs() < 1e-9);
        }
        if measured.field.measured.is_set() {
            let r = shared_types::rotation::from_row_major(&measured.truth.world_from_body);
            let field = r.tr_mul(&Vector3::from(datum.field_world()));
            assert!((field - Vector3::from(measured.field.field_body)).norm() < 1e-12);
        }
    }
}

#[test]
fn what_the_receiver_solves_and_false_satellites_follow_the_plan() {
    let planned = "[[sensors.gnss.change]]\nat = 0.5\nkind = \"single_point\"\n\
         [[sensors.gnss.spoofing]]\nat = 0.2\nlasts = 0.2\nvelocity = [100.0, 0.0, 0.0]\n";
    let mut service = PlantService::new(&scenario(planned));
    let mut kinds = Vec::new();
    let mut accuracies = Vec::new();
    for tick in 0..800 {
        let fix = step(&mut service, tick, &frame()).fix;
        if fix.measured.is_set() {
            kinds.push(fix.kind);
            accuracies.push(fix.horizontal_accuracy);
            let speed = Vector3::from(fix.velocity_ned).norm();
            assert_eq!(speed > 90.0, (200..400).contains(&tick), "{tick}");
        }
    }
    assert_eq!(kinds, [2, 2, 2, 2, 2, 0, 0, 0]);
    assert!(accuracies[0] < 0.02 && accuracies[7] > 1.0);
}

#[test]
fn a_touch_down_is_in_the_inertial_samples() {
    let mut service = PlantService::new(&scenario(&format!("{EXACT}[flight]\n")));
    let mut velocity = 0.0;
    let mut has_flown = false;
    let mut clipped = false;
    for tick in 0..=2000 {
        let thrust = if tick < 100 { 0.6 * GRAVITY } else { 0.0 };
        let frame = RcFrame {
            thrust,
            ..RcFrame::new_zeroed()
        };
        let measured = step(&mut service, tick, &frame);
        has_flown |= measured.truth.velocity_body[2] < -0.15;
        clipped |= measured.imu.clipped.is_set();
        if tick > 0 && measured.imu.measured.is_set() {
            velocity += (measured.imu.specific_force_body[2] + GRAVITY) * 0.004;
        }
    }
    assert!(has_flown && !clipped);
    assert!(velocity.abs() < 0.02, "{velocity}");
}

/// Its errors are those of a fix without the slow ones, in a frame that is turned against north; one antenna measures none.
#[test]
fn the_baseline_of_two_antennas_is_that_of_the_attitude_where_carrier_waves_are_solved() {
    let planned = "[sensors.gnss]\nbaseline = [0.8, 0.3, 0.1]\n\
         [[sensors.gnss.change]]\nat = 0.5\nkind = \"rtk_float\"\n\
         [[sensors.gnss.change]]\nat = 1.0\nkind = \"single_point\"\n";
    let scenario = scenario(planned);
    let mut service = PlantService::new(&scenario);
    let frame_of_datum = scenario.datum.clone().unwrap().frame();
    let mut solved = Vec::new();
    for tick in 0..1500 {
        let measured = step(&mut service, tick, &frame());
        if tick % 100 != 0 {
            continue;
        }
        let baseline = &measured.baseline;
        solved.push(u8::from(baseline.measured.is_set()) + u8::from(baseline.fixed.is_set()));
        if baseline.fixed.is_set() {
            assert_eq!(baseline.valid_ns, tick * TICK_NS);
            assert_eq!(baseline.accuracies_ned, [0.008, 0.008, 0.012]);
            let r = shared_types::rotation::from_row_major(&measured.truth.world_from_body);
            let world = frame_of_datum.world_from_ned() * Vector3::from(baseline.baseline_ned);
            let error = (world - r * Vector3::new(0.8, 0.3, 0.1)).norm();
            assert!(error > 1e-4 && error < 0.05, "{error}");
        }
    }
    assert_eq!(solved, [2, 2, 2, 2, 2, 1, 1, 1, 1, 1, 0, 0, 0, 0, 0]);
    let mut without = PlantService::new(&self::scenario("[sensors]\n"));
    assert!((0..300).all(|tick| !step(&mut without, tick, &frame()).baseline.measured.is_set()));
}
