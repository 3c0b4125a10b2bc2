//! Alignment, and flights with sensors without errors.

use inertial_navigation::{Altitude, Field, Fix, ImuSample, InertialFilter, Parameters, Pose, Source};
use nalgebra::Vector3;
use proptest::prelude::*;
use shared_types::GRAVITY;
use shared_types::gnss::FixKind;
use shared_types::rotation::{angle_between, from_roll_pitch_yaw};

use super::rig::{Flight, Flown, H_NS, unchanged};

#[test]
fn with_perfect_sensors_fixes_of_any_latency_leave_no_error() {
    for latency in [0.0, 0.06, 0.11] {
        let flight = Flight::perfect(latency);
        let flown = Flown::new(&flight, &flight.parameters(), unchanged);
        let [position, velocity, attitude] = flown.largest(30.0, 110.0);
        assert!(
            position < 1e-4 && velocity < 1e-4 && attitude < 1e-5,
            "{position} {velocity} {attitude}"
        );
        let while_flying = &flown.innovations[..Source::ZeroVelocity as usize];
        assert!(while_flying.iter().all(|innovations| innovations.len() > 1_000));
    }
}

proptest! {
    #[test]
    fn the_alignment_finds_any_attitude_at_rest(
        roll in -0.5..0.5f64, pitch in -0.5..0.5f64, yaw in -3.1..3.1f64, declination in -0.5..0.5f64,
    ) {
        let truth = from_roll_pitch_yaw([roll, pitch, yaw]);
        let parameters = Parameters {
            field_world: from_roll_pitch_yaw([0.0, 0.0, declination]) * Vector3::new(0.2, 0.0, 0.4),
            ..Parameters::default()
        };
        let mut filter = InertialFilter::new(&parameters);
        for tick in 1..=300 {
            let time_ns = tick * H_NS;
            filter.add_field(&Field { time_ns, field_body: truth.transpose() * parameters.field_world });
            filter.add_altitude(&Altitude { time_ns, altitude: 7.0 });
            filter.add_fix(&Fix {
                time_ns,
                kind: FixKind::RtkFixed,
                position_world: Vector3::new(1.0, 2.0, -7.0),
                velocity_world: Vector3::zeros(),
                accuracies: [0.0; 3],
            });
            filter.add_imu(&ImuSample {
                time_ns,
                rate_body: Vector3::new(0.01, -0.01, 0.005),
                force_body: truth.transpose() * Vector3::new(0.0, 0.0, -GRAVITY),
                is_clipped: false,
            });
        }
        let motion = filter.motion().unwrap();
        prop_assert!(angle_between(&motion.world_from_body, &truth) < 1e-6);
        prop_assert!((motion.position_world - Vector3::new(1.0, 2.0, -7.0)).norm() < 1e-6);
        prop_assert!((filter.unbiased().unwrap().rate_body).norm() < 1e-9);
    }
}

#[test]
fn a_vehicle_that_turns_is_not_aligned() {
    let mut filter = InertialFilter::new(&Parameters::default());
    for tick in 1..=2_000 {
        let time_ns = tick * H_NS;
        filter.add_field(&Field {
            time_ns,
            field_body: Vector3::new(0.2, 0.0, 0.4),
        });
        filter.add_imu(&ImuSample {
            time_ns,
            rate_body: Vector3::new(0.0, 0.0, 0.5),
            force_body: Vector3::new(0.0, 0.0, -GRAVITY),
            is_clipped: false,
        });
    }
    assert!(!filter.is_aligned());
}

#[test]
fn a_vehicle_whose_motors_turn_is_not_aligned() {
    // In hover against wind, the mean specific force is along the body's z axis whatever the tilt.
    let parameters = Parameters::default();
    let truth = from_roll_pitch_yaw([0.3, 0.0, 0.0]);
    let mut filter = InertialFilter::new(&parameters);
    filter.set_motors(0, true, true);
    let step = |filter: &mut InertialFilter, tick: u64, force_body: Vector3<f64>| {
        let time_ns = tick * H_NS;
        filter.add_field(&Field {
            time_ns,
            field_body: truth.transpose() * parameters.field_world,
        });
        filter.add_imu(&ImuSample {
            time_ns,
            rate_body: Vector3::zeros(),
            force_body,
            is_clipped: false,
        });
    };
    for tick in 1..=500 {
        step(&mut filter, tick, Vector3::new(0.0, 0.0, -GRAVITY));
        assert!(!filter.is_aligned(), "at tick {tick}");
    }
    // Motors stop, and a second later the vehicle rests: a second of that is averaged, and nothing from before.
    filter.set_motors(500 * H_NS, false, false);
    for tick in 501..=1010 {
        step(
            &mut filter,
            tick,
            truth.transpose() * Vector3::new(0.0, 0.0, -GRAVITY),
        );
        assert!(tick > 990 || !filter.is_aligned(), "at tick {tick}");
    }
    let motion = filter.motion().unwrap();
    assert!(angle_between(&motion.world_from_body, &truth) < 1e-6);
}

/// Indoors, where iron bends the field by a radian, and where there is no magnetometer at all.
#[test]
fn where_cameras_see_the_vehicle_its_heading_is_theirs() {
    let truth = from_roll_pitch_yaw([0.1, -0.2, 2.5]);
    for has_field in [true, false] {
        let parameters = Parameters::default();
        let mut filter = InertialFilter::new(&parameters);
        for tick in 1..=300 {
            let time_ns = tick * H_NS;
            if has_field {
                let bent = from_roll_pitch_yaw([0.0, 0.0, 1.0]) * parameters.field_world;
                filter.add_field(&Field {
                    time_ns,
                    field_body: truth.transpose() * bent,
                });
            }
            filter.add_pose(&Pose {
                time_ns,
                position_world: Some(Vector3::new(1.0, 2.0, -7.0)),
                world_from_body: Some(truth),
            });
            filter.add_imu(&ImuSample {
                time_ns,
                rate_body: Vector3::new(0.01, -0.01, 0.005),
                force_body: truth.transpose() * Vector3::new(0.0, 0.0, -GRAVITY),
                is_clipped: false,
            });
        }
        let motion = filter.motion().unwrap();
        assert!(angle_between(&motion.world_from_body, &truth) < 1e-6);
        assert!((motion.position_world - Vector3::new(1.0, 2.0, -7.0)).norm() < 1e-6);
    }
}
