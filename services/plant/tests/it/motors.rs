//! Motors on a battery, and motors that brake more slowly than they accelerate.

use nalgebra::Vector3;
use plant::actuators::{Drive, RateLoop};
use scenario::{Actuators, Battery};
use shared_types::Header;
use shared_types::samples::RcFrame;
use vehicle_model::integrator::Stage;
use vehicle_model::rigid_body::Body;
use zerocopy::FromZeros;

const TICK: f64 = 1e-3;
const WEIGHT: f64 = 1.962;

fn frame(seq: u64, thrust: f64) -> RcFrame {
    RcFrame {
        header: Header {
            seq,
            ..Header::new_zeroed()
        },
        thrust,
        mode: RcFrame::MODE_RATES,
        ..RcFrame::new_zeroed()
    }
}

/// Thrusts at the ends of so many ticks.
fn thrusts(rate_loop: &mut RateLoop, frame: &RcFrame, ticks: usize) -> Vec<f64> {
    let body = Body {
        mass: 0.2,
        inertia: Vector3::new(6.5e-4, 6.5e-4, 13.0e-4),
        disturbance_world: Vector3::zeros(),
        center_of_mass: Vector3::zeros(),
    };
    let drive = |_| match rate_loop.drive(Some(frame), &body, &Vector3::zeros()) {
        Drive::Lagged { thrust, .. } => thrust.value(Stage::End),
        Drive::Held(_) => unreachable!("motors lag"),
    };
    (0..ticks).map(drive).collect()
}

fn squared(number: f64) -> f64 {
    number * number
}

fn motors(battery: Option<Battery>, thrust_lag_down: Option<f64>) -> RateLoop {
    let stated = Actuators {
        initial_thrust: WEIGHT,
        thrust_lag_down,
        battery,
        ..Actuators::default()
    };
    RateLoop::new(&stated, 1, TICK)
}

#[test]
fn a_battery_loses_thrust_with_the_square_of_its_voltage() {
    let battery = Battery {
        endurance: 40.0,
        fade: 0.1,
        droop: 0.05,
    };
    let flown = thrusts(&mut motors(Some(battery), None), &frame(0, WEIGHT), 40_000);
    // T = u² T0, when the lag is over.
    let first = flown[300] / WEIGHT;
    let spent = 0.3 * first / 40.0;
    assert!(
        (first - squared(1.0 - 0.1 * spent - 0.05 * first)).abs() < 3e-4,
        "{first}"
    );
    assert!(flown[300..].windows(2).all(|pair| pair[1] < pair[0]));
    // Less than one charge is spent, because the thrust falls.
    let last = flown.last().unwrap() / WEIGHT;
    let empty = squared(1.0 - 0.1 - 0.05 * last);
    assert!(last > empty && last < empty + 0.03, "{last}, {empty}");
    assert_eq!(
        thrusts(&mut motors(None, None), &frame(0, WEIGHT), 1000),
        [WEIGHT; 1000]
    );
}

#[test]
fn motors_brake_with_a_time_constant_of_their_own() {
    let mut rate_loop = motors(None, Some(0.06));
    let down = thrusts(&mut rate_loop, &frame(0, 1.0), 60);
    let left = (down[59] - 1.0) / (WEIGHT - 1.0);
    assert!((left - libm::exp(-1.0)).abs() < 1e-9, "{left}");
    let low = down[59];
    let up = thrusts(&mut rate_loop, &frame(1, 3.0), 30);
    let left = (3.0 - up[29]) / (3.0 - low);
    assert!((left - libm::exp(-1.0)).abs() < 1e-9, "{left}");
}
