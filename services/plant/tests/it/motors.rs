//! Motors on a battery, and motors that brake more slowly than they accelerate.

use nalgebra::Vector3;
use plant::actuators::{Drive, RateLoop};
use rc_output::RcOutputService;
use scenario::{Actuators, Battery, BatteryModel, LinkBattery, RcLink, Scenario, VoltageSource};
use shared_types::samples::{ControlCommand, RcFrame};
use shared_types::service::{ErasedService, InputView, OutputSlot};
use shared_types::{Header, Now, Operator};
use vehicle_model::integrator::Stage;
use vehicle_model::rigid_body::Body;
use zerocopy::{FromZeros, IntoBytes};

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
        voltage: None,
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

/// Returns the transmitter of a link with 16 bits.
fn transmitter(battery: Option<LinkBattery>) -> RcOutputService {
    let scenario: Scenario = toml::from_str(
        "duration = 1.0\n\
         vehicle = { mass = 0.2, inertia = [6.5e-4, 6.5e-4, 13.0e-4] }\n\
         path.curve.hover.position = [0.0, 0.0, -1.0]",
    )
    .unwrap();
    RcOutputService::new(&Scenario {
        rc_output: Some(RcLink {
            resolution: 16,
            battery,
            ..RcLink::default()
        }),
        ..scenario
    })
}

/// Returns the thrust at the end of 270 s of hover, nine tenths of the charge, with frames every 20 ms.
fn thrust_at_the_end(battery: &Battery, stated: Option<LinkBattery>) -> f64 {
    let (mut transmitter, mut motors) = (transmitter(stated), motors(Some(battery.clone()), None));
    let command = ControlCommand {
        mode: ControlCommand::MODE_RATES,
        thrust: WEIGHT,
        ..ControlCommand::new_zeroed()
    };
    for number in 0..13_500 {
        let mut sent = frame(number, 0.0);
        let now = Now {
            tick: 20 * number,
            time_ns: 20_000_000 * number,
            elapsed_ns: 20_000_000 * number.min(1),
            operator: Operator::FLYING,
        };
        let command = InputView {
            bytes: Some(command.as_bytes()),
            fresh: true,
        };
        let mut outputs = [OutputSlot {
            bytes: Some(sent.as_mut_bytes()),
        }];
        ErasedService::step(
            &mut transmitter,
            &now,
            &[command, InputView::default()],
            &mut outputs,
        );
        thrusts(&mut motors, &sent, 20);
    }
    motors.thrust()
}

#[test]
fn a_corrected_link_holds_the_thrust_over_a_charge_that_takes_a_quarter_of_it_without() {
    let battery = Battery {
        endurance: 300.0,
        fade: 0.15,
        droop: 0.03,
        voltage: None,
    };
    let stated = LinkBattery {
        source: VoltageSource::Modelled,
        calibrated: Some(8.4),
        model: Some(BatteryModel {
            full: 8.4,
            thrust: WEIGHT,
            spent: 0.0,
            endurance: battery.endurance,
            fade: battery.fade,
            droop: battery.droop,
        }),
        ..LinkBattery::default()
    };
    let without = thrust_at_the_end(&battery, None) / WEIGHT - 1.0;
    let with = thrust_at_the_end(&battery, Some(stated)) / WEIGHT - 1.0;
    assert!((-0.30..-0.22).contains(&without), "{without}");
    assert!(with.abs() < 1e-3, "{with}");
}
