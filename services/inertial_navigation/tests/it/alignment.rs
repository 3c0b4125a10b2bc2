//! Alignment, and flights with sensors without errors.

use inertial_navigation::{
    Altitude, Baseline, Field, Fix, ImuSample, InertialFilter, Parameters, Pose, Source,
};
use nalgebra::{Matrix3, Vector3};
use proptest::prelude::*;
use shared_types::GRAVITY;
use shared_types::gnss::FixKind;
use shared_types::rotation::{angle_between, from_roll_pitch_yaw, log};

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

/// One pose with swapped markers at any time of the second of rest: the next one shows that it is wrong.
#[test]
fn a_wrong_pose_at_the_alignment_makes_it_begin_again() {
    let truth = from_roll_pitch_yaw([0.1, -0.2, 2.5]);
    let parameters = Parameters::default();
    for wrong in [1, 100, 249, 250] {
        let mut filter = InertialFilter::new(&parameters);
        for tick in 1..=600 {
            let swapped = from_roll_pitch_yaw([0.0, 0.0, 1.0]) * truth;
            let seen = if tick == wrong { swapped } else { truth };
            rest(&mut filter, tick, &truth, &seen);
            assert!(tick >= wrong + 250 || !filter.is_aligned(), "{wrong}: {tick}");
        }
        let motion = filter.motion().unwrap();
        assert!(angle_between(&motion.world_from_body, &truth) < 1e-6, "{wrong}");
    }
}

#[test]
fn a_pose_that_gravity_contradicts_does_not_align_the_vehicle() {
    let truth = from_roll_pitch_yaw([0.1, -0.2, 2.5]);
    let mut filter = InertialFilter::new(&Parameters::default());
    for tick in 1..=600 {
        rest(
            &mut filter,
            tick,
            &truth,
            &(from_roll_pitch_yaw([0.2, 0.0, 0.0]) * truth),
        );
        assert!(!filter.is_aligned());
    }
    for tick in 601..=1200 {
        rest(&mut filter, tick, &truth, &truth);
    }
    assert!(filter.is_aligned());
}

/// Markers that are swapped for the whole alignment: the heading is accepted again after 7 s, while the motors are stopped; an
/// attitude that gravity contradicts is not.
#[test]
fn at_rest_a_refused_heading_is_accepted_again() {
    let truth = from_roll_pitch_yaw([0.1, -0.2, 0.3]);
    for (error, motors_turn) in [
        ([0.0, 0.0, 1.0], false),
        ([0.0, 0.0, std::f64::consts::PI], false),
        ([0.0, 0.0, 1.0], true),
    ] {
        let mut filter = InertialFilter::new(&Parameters::default());
        let wrong = from_roll_pitch_yaw(error) * truth;
        for tick in 1..=2500 {
            if tick == 300 {
                filter.set_motors(tick * H_NS, motors_turn, false);
            }
            rest(
                &mut filter,
                tick,
                &truth,
                if tick <= 300 { &wrong } else { &truth },
            );
        }
        let motion = filter.motion().unwrap();
        let is_right = angle_between(&motion.world_from_body, &truth) < 1e-3;
        assert_eq!(is_right, !motors_turn, "{error:?}");
    }
    let mut filter = InertialFilter::new(&Parameters::default());
    for tick in 1..=2500 {
        let tilted = from_roll_pitch_yaw([0.5, 0.0, 0.0]) * truth;
        rest(
            &mut filter,
            tick,
            &truth,
            if tick <= 300 { &truth } else { &tilted },
        );
    }
    let motion = filter.motion().unwrap();
    assert!(angle_between(&motion.world_from_body, &truth) < 1e-3);
}

/// Gives the samples of a tick of a vehicle at rest whose pose is `seen`.
fn rest(filter: &mut InertialFilter, tick: u64, truth: &Matrix3<f64>, seen: &Matrix3<f64>) {
    let time_ns = tick * H_NS;
    filter.add_pose(&Pose {
        time_ns,
        position_world: Some(Vector3::zeros()),
        world_from_body: Some(*seen),
    });
    filter.add_imu(&ImuSample {
        time_ns,
        rate_body: Vector3::zeros(),
        force_body: truth.transpose() * Vector3::new(0.0, 0.0, -GRAVITY),
        is_clipped: false,
    });
}

/// Parameters of a filter with two antennas.
fn two_antennas() -> Parameters {
    Parameters {
        baseline_body: Some(Vector3::new(0.8, -0.3, 0.1)),
        ..Parameters::default()
    }
}

/// Gives the samples of a tick of a vehicle at rest, whose baseline is measured 10 times a second as if its attitude were `measured`,
/// and its field as if it were `bent`.
fn rest_with_antennas(
    filter: &mut InertialFilter,
    tick: u64,
    truth: &Matrix3<f64>,
    measured: &Matrix3<f64>,
    bent: &Matrix3<f64>,
) {
    let time_ns = tick * H_NS;
    let parameters = two_antennas();
    filter.add_field(&Field {
        time_ns,
        field_body: bent.transpose() * parameters.field_world,
    });
    if tick.is_multiple_of(25) {
        filter.add_baseline(&Baseline {
            time_ns,
            baseline_world: measured * parameters.baseline_body.unwrap(),
            accuracies: [0.0; 2],
        });
    }
    filter.add_imu(&ImuSample {
        time_ns,
        rate_body: Vector3::zeros(),
        force_body: truth.transpose() * Vector3::new(0.0, 0.0, -GRAVITY),
        is_clipped: false,
    });
}

/// A field that iron bends a little is within its gate at first, and may turn the heading by what it is uncertain by: the deviation at
/// the alignment is 19 mrad. After 20 s most of the bend is that of the vehicle's own field: 8 mrad are left of 0.5 rad.
#[test]
fn where_two_antennas_measure_their_baseline_the_heading_is_theirs() {
    for bend in [0.0, 0.2, 0.5, 1.0, 3.0] {
        let truth = from_roll_pitch_yaw([0.1, -0.2, 2.5]);
        let bent = from_roll_pitch_yaw([0.0, 0.0, bend]) * truth;
        let mut filter = InertialFilter::new(&two_antennas());
        let (mut first, mut last, mut largest) = (None, 0.0, 0.0_f64);
        for tick in 1..=5000 {
            rest_with_antennas(&mut filter, tick, &truth, &truth, &bent);
            if let Some(motion) = filter.motion() {
                last = log(&(motion.world_from_body * truth.transpose())).z.abs();
                first = first.or(Some(last));
                largest = largest.max(last);
            }
        }
        println!("bent by {bend} rad: {first:?}, {largest} at most, {last} rad at the end");
        assert!(first.is_some_and(|first| first < 1e-6), "{bend}: {first:?}");
        assert!(largest < 2.0 * 0.019 && last < 0.01, "{bend}: {largest} {last}");
        let status = filter.source(Source::Baseline);
        assert!(status.refused < 5 && status.resets == 0, "{bend}: {status:?}");
    }
}

/// A receiver that reports 50 mm in place of 8 mm at a baseline of 0.85 m: the heading is as uncertain as it says. One that reports
/// 0.5 m knows no heading.
#[test]
fn the_heading_by_two_antennas_is_as_accurate_as_the_receiver_reports() {
    let truth = from_roll_pitch_yaw([0.0, 0.0, 1.0]);
    let heading_deviation = |accuracies: [f64; 2]| {
        let mut filter = InertialFilter::new(&two_antennas());
        for tick in 1..=300 {
            let time_ns = tick * H_NS;
            filter.add_baseline(&Baseline {
                time_ns,
                baseline_world: truth * two_antennas().baseline_body.unwrap(),
                accuracies,
            });
            filter.add_imu(&ImuSample {
                time_ns,
                rate_body: Vector3::zeros(),
                force_body: Vector3::new(0.0, 0.0, -GRAVITY),
                is_clipped: false,
            });
            if filter.is_aligned() {
                return Some(filter.horizon().unwrap().covariance[(8, 8)].sqrt());
            }
        }
        None
    };
    let length = Vector3::new(0.8, -0.3, 0.0).norm();
    let close =
        |found: Option<f64>, expected: f64| found.is_some_and(|found| (found / expected - 1.0).abs() < 0.05);
    let (fine, coarse) = (heading_deviation([0.0; 2]), heading_deviation([0.05, 0.08]));
    assert!(
        close(fine, 2.0 * 0.008 / length) && close(coarse, 2.0 * 0.05 / length),
        "{fine:?} {coarse:?}"
    );
    assert_eq!(heading_deviation([0.5, 0.5]), None);
}

/// Of another length, at another angle to gravity, or contradicting the one before.
#[test]
fn a_baseline_that_is_not_that_of_the_vehicle_does_not_align_it() {
    let truth = from_roll_pitch_yaw([0.1, -0.2, 2.5]);
    let turned = |turn: [f64; 3]| from_roll_pitch_yaw(turn) * truth;
    let spoilt: [&dyn Fn(u64) -> Matrix3<f64>; 3] =
        [&|_| truth * 1.3, &|_| turned([0.0, 0.4, 0.0]), &|tick| {
            turned([0.0, 0.0, if tick % 50 == 0 { 0.3 } else { 0.0 }])
        }];
    for (number, spoil) in spoilt.into_iter().enumerate() {
        let mut filter = InertialFilter::new(&two_antennas());
        for tick in 1..=1200 {
            let measured = if tick <= 600 { spoil(tick) } else { truth };
            rest_with_antennas(&mut filter, tick, &truth, &measured, &truth);
            assert!(tick > 600 || !filter.is_aligned(), "{number}: {tick}");
        }
        let motion = filter.motion().unwrap();
        assert!(angle_between(&motion.world_from_body, &truth) < 1e-6);
    }
}

/// An alignment without baselines beside a magnet: they are refused for 7 s, and then give the heading, by half a turn too. One of
/// another length never does, and none does while motors turn.
#[test]
fn baselines_that_contradict_the_heading_are_accepted_again_if_they_are_those_of_the_vehicle() {
    let truth = from_roll_pitch_yaw([0.1, -0.2, 0.3]);
    for (bend, length, motors_turn) in [
        (2.0, 1.0, false),
        (std::f64::consts::PI, 1.0, false),
        (std::f64::consts::PI, 1.0, true),
        (2.0, 1.3, false),
    ] {
        let bent = from_roll_pitch_yaw([0.0, 0.0, bend]) * truth;
        let mut filter = InertialFilter::new(&two_antennas());
        for tick in 1..=4000 {
            if tick == 300 {
                filter.set_motors(tick * H_NS, motors_turn, false);
            }
            if tick <= 300 {
                rest(&mut filter, tick, &truth, &bent);
            } else {
                rest_with_antennas(&mut filter, tick, &truth, &(truth * length), &bent);
            }
        }
        let motion = filter.motion().unwrap();
        let error = angle_between(&motion.world_from_body, &truth);
        let is_accepted = length == 1.0 && !motors_turn;
        assert_eq!(error < 0.01, is_accepted, "{bend}: {error}");
        let status = filter.source(Source::Baseline);
        assert_eq!(status.resets, u32::from(is_accepted), "{status:?}");
    }
}
