//! Hand-made samples with known errors.

use std::f64::consts::PI;

use proptest::prelude::*;
use scenario::{Path, Vehicle, VehicleChange, YawStep};
use shared_types::rotation::{from_roll_pitch_yaw, to_row_major};
use shared_types::samples::PathReference;
use zerocopy::{FromZeros, IntoBytes};

use super::*;

/// 40 s along the line p = [γ, 0, 0] at 1 kHz.
fn scenario() -> Scenario {
    let line = scenario::Line {
        start: [0.0; 3],
        direction: [1.0, 0.0, 0.0],
    };
    Scenario::new(
        40.0,
        Vehicle::new(0.2, [1e-3; 3]),
        Path::new(scenario::Curve::Line(line)),
    )
}

fn truth(tick: u64) -> VehicleTruth {
    let mut truth = VehicleTruth {
        mass: 0.2,
        world_from_body: to_row_major(&nalgebra::Matrix3::identity()),
        ..VehicleTruth::new_zeroed()
    };
    truth.header.tick = tick;
    truth.header.stamp_ns = tick * 1_000_000;
    truth
}

/// γ = t, once every 22 ms and 5 ms ahead, as the rig does it.
fn reference(tick: u64) -> PathReference {
    let mut reference = PathReference {
        reference_time_ns: (tick + 5) * 1_000_000,
        gamma: (tick + 5) as f64 * 1e-3,
        gamma_dot: 1.0,
        position_world: [(tick + 5) as f64 * 1e-3, 0.0, 0.0],
        derivative1_world: [1.0, 0.0, 0.0],
        ..PathReference::new_zeroed()
    };
    reference.header.tick = tick;
    reference.header.stamp_ns = tick * 1_000_000;
    reference
}

/// Flies by hand: the vehicle where `truth_at` says, the path at γ = t, the estimates as `adaptation_at` says.
fn measure(
    scenario: &Scenario,
    truth_at: impl Fn(u64) -> VehicleTruth,
    adaptation_at: impl Fn(u64) -> ControlAdaptation,
) -> Measured {
    let mut meter = Meter::new(scenario, &scenario.schedule().unwrap());
    for tick in 0..=40_000 {
        meter
            .sample(Topic::VehicleTruth, truth_at(tick).as_bytes())
            .unwrap();
        if tick % 22 == 0 {
            meter
                .sample(Topic::PathReference, reference(tick).as_bytes())
                .unwrap();
            meter
                .sample(Topic::ControlAdaptation, adaptation_at(tick).as_bytes())
                .unwrap();
        }
        let _ = meter.end_tick(tick).unwrap();
    }
    meter.finish().unwrap()
}

fn no_adaptation(_: u64) -> ControlAdaptation {
    ControlAdaptation::new_zeroed()
}

/// On the path and `across` beside it, m.
fn beside(tick: u64, across: f64) -> VehicleTruth {
    VehicleTruth {
        position_world: [tick as f64 * 1e-3, across, 0.0],
        ..truth(tick)
    }
}

#[test]
fn a_vehicle_on_the_path_has_no_error_also_between_references() {
    let measured = measure(&scenario(), |tick| beside(tick, 0.0), no_adaptation);
    assert!(measured.error_ever.max() < 1e-12, "{}", measured.error_ever.max());
    assert_eq!(measured.error.count(), 20_001);
    assert!((measured.progress - 1.0).abs() < 1e-12);
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 8, ..ProptestConfig::default() })]

    #[test]
    fn a_known_error_has_its_rmse_deviation_and_maximum(offset in 0.01..0.1f64, swing in 0.0..0.01f64) {
        // Whole periods of 1 s in the judged part.
        let error = |tick: u64| offset + swing * libm::sin(2.0 * PI * tick as f64 * 1e-3);
        let measured = measure(&scenario(), |tick| beside(tick, error(tick)), no_adaptation);
        let rmse = (offset * offset + 0.5 * swing * swing).sqrt();
        prop_assert!((measured.error.rmse() - rmse).abs() < 1e-6);
        prop_assert!((measured.error.deviation() - swing / 2.0_f64.sqrt()).abs() < 1e-6);
        prop_assert!((measured.error.max() - (offset + swing)).abs() < 1e-6);
    }

    #[test]
    fn a_vehicle_that_lags_behind_the_path_has_that_way_as_error(lag in 0.001..0.2f64) {
        let behind = |tick| VehicleTruth { position_world: [tick as f64 * 1e-3 - lag, 0.0, 0.0], ..truth(tick) };
        let measured = measure(&scenario(), behind, no_adaptation);
        prop_assert!((measured.error.rmse() - lag).abs() < 1e-9);
    }
}

#[test]
fn errors_count_for_the_part_of_the_flight_in_which_they_are() {
    let mut scenario = scenario();
    scenario.vehicle.change = vec![VehicleChange {
        at: 10.0,
        mass: None,
        inertia: None,
        disturbance: None,
        center_of_mass: None,
    }];
    let error = |tick| match tick {
        0..5_000 => 0.5,
        5_000..=10_000 => 0.01,
        10_001..20_000 => 0.06,
        20_000..35_000 => 0.004,
        _ => 0.002,
    };
    let measured = measure(&scenario, |tick| beside(tick, error(tick)), no_adaptation);
    let close = |value: f64, wanted: f64| assert!((value - wanted).abs() < 1e-12, "{value} is not {wanted}");
    close(measured.error_ever.max(), 0.5);
    close(measured.error_before.rmse(), 0.01);
    close(measured.error_transient.max(), 0.06);
    close(measured.error.max(), 0.004);
    close(measured.error_ultimate.rmse(), 0.002);
}

#[test]
fn a_path_that_stands_still_makes_no_progress() {
    let mut meter = Meter::new(&scenario(), &scenario().schedule().unwrap());
    for tick in 0..=40_000 {
        meter.sample(Topic::VehicleTruth, truth(tick).as_bytes()).unwrap();
        let still = PathReference {
            gamma: 0.0,
            gamma_dot: 0.0,
            position_world: [0.0; 3],
            ..reference(tick)
        };
        meter.sample(Topic::PathReference, still.as_bytes()).unwrap();
        let _ = meter.end_tick(tick).unwrap();
    }
    let measured = meter.finish().unwrap();
    assert_eq!(measured.progress, 0.0);
    assert_eq!(measured.error.rmse(), 0.0);
}

#[test]
fn yaw_is_compared_across_the_wrap_and_only_where_it_is_steady() {
    let mut scenario = scenario();
    scenario.path.yaw_step = vec![YawStep { at: 20.0, yaw: 1.0 }];
    // ψd = γ in these references is wrong by far but for the wrap: set ψ to π − 0.002 against ψd = −π + 0.001.
    let mut meter = Meter::new(&scenario, &scenario.schedule().unwrap());
    for tick in 0..=40_000 {
        let yaw = if (20_000..30_000).contains(&tick) {
            0.0
        } else {
            PI - 0.002
        };
        let turned = VehicleTruth {
            world_from_body: to_row_major(&from_roll_pitch_yaw([0.1, 0.2, yaw])),
            position_world: [tick as f64 * 1e-3, 0.0, 0.0],
            ..truth(tick)
        };
        meter.sample(Topic::VehicleTruth, turned.as_bytes()).unwrap();
        let demanded = PathReference {
            yaw: -PI + 0.001,
            ..reference(tick)
        };
        meter.sample(Topic::PathReference, demanded.as_bytes()).unwrap();
        let _ = meter.end_tick(tick).unwrap();
    }
    let measured = meter.finish().unwrap();
    assert!((measured.yaw_error.rmse() - 0.003).abs() < 1e-9);
    assert_eq!(measured.yaw_error.count(), 10_000 + 10_001);
    assert_eq!(measured.error_while_yawing.count(), 10_000);
    assert!((measured.roll.mean() - 0.1).abs() < 1e-12);
}

#[test]
fn estimates_are_compared_with_the_truth() {
    let truth_at = |tick| VehicleTruth {
        disturbance_world: [0.1, 0.9, -0.2],
        ..beside(tick, 0.0)
    };
    let adaptation_at = |_| ControlAdaptation {
        mass_estimate: 0.203,
        observer_mass_estimate: 0.21,
        disturbance_projected_world: [0.0, 0.95, 0.0],
        ..ControlAdaptation::new_zeroed()
    };
    let mut observed = scenario();
    observed.controller.observer_gain = Some(1.0);
    let measured = measure(&observed, truth_at, adaptation_at);
    let close = |value: f64, wanted: f64| assert!((value - wanted).abs() < 1e-12, "{value} is not {wanted}");
    close(measured.mass_error.rmse(), 0.003);
    close(measured.observer_mass_error.rmse(), 0.01);
    close(measured.mass_estimate.mean(), 0.203);
    close(measured.disturbance[1].mean(), 0.9);
    close(measured.disturbance_estimate[1].mean(), 0.95);
    let without = measure(&scenario(), truth_at, adaptation_at);
    assert!(
        without.observer_mass_error.rmse().is_nan(),
        "no observer, no error"
    );
}

#[test]
fn saturated_frames_are_counted_and_peaks_kept() {
    let mut meter = Meter::new(&scenario(), &scenario().schedule().unwrap());
    let mut frame = RcFrame::new_zeroed();
    for is_saturated in [true, false, true] {
        frame.saturated = is_saturated.into();
        meter.sample(Topic::RcFrame, frame.as_bytes()).unwrap();
    }
    let busy = VehicleTruth {
        thrust: 4.0,
        angular_velocity_body: [3.0, 4.0, 0.0],
        ..truth(0)
    };
    meter.sample(Topic::VehicleTruth, busy.as_bytes()).unwrap();
    let _ = meter.end_tick(0).unwrap();
    let measured = meter.finish().unwrap();
    assert_eq!(measured.saturated_frames, 2);
    assert_eq!((measured.thrust.max(), measured.rate_ever.max()), (4.0, 5.0));
}

proptest! {
    #[test]
    fn a_wrapped_angle_is_the_same_direction_and_in_range(angle in -50.0..50.0f64) {
        let wrapped = shorter_way(angle);
        prop_assert!(-PI < wrapped && wrapped <= PI);
        let turns = (angle - wrapped) / (2.0 * PI);
        prop_assert!((turns - turns.round()).abs() < 1e-9);
    }
}
