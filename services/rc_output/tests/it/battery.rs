//! Modelled battery: the corrected channel, a restart, and the action at its end. `motors` of the plant's tests flies a whole
//! charge.

use rc_output::{RcOutputService, RcOutputState};
use scenario::{BatteryModel, LinkBattery, LowVoltageAction, RcLink, Scenario, VoltageSource};
use shared_types::Now;
use shared_types::samples::{ControlCommand, RcFrame};
use shared_types::service::{ErasedService, InputView, OutputSlot, Service};
use zerocopy::{FromZeros, IntoBytes};

const WEIGHT: f64 = 1.96;
const ENDURANCE: f64 = 300.0;
/// Period of frames, ms.
const PERIOD: u64 = 20;

fn battery() -> LinkBattery {
    LinkBattery {
        source: VoltageSource::Modelled,
        calibrated: Some(8.4),
        model: Some(BatteryModel {
            full: 8.4,
            thrust: WEIGHT,
            spent: 0.0,
            endurance: ENDURANCE,
            fade: 0.15,
            droop: 0.03,
        }),
        ..LinkBattery::default()
    }
}

fn service(battery: Option<LinkBattery>, has_phases: bool) -> RcOutputService {
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
        flight: has_phases.then(scenario::Flight::default),
        ..scenario
    })
}

fn step(service: &mut RcOutputService, number: u64, thrust: f64) -> RcFrame {
    let command = ControlCommand {
        mode: ControlCommand::MODE_RATES,
        thrust,
        ..ControlCommand::new_zeroed()
    };
    let mut frame = RcFrame::new_zeroed();
    frame.header.seq = number;
    let now = Now {
        tick: PERIOD * number,
        time_ns: PERIOD * number * 1_000_000,
        elapsed_ns: number.min(1) * PERIOD * 1_000_000,
        operator: shared_types::Operator::FLYING,
    };
    let inputs = [
        InputView {
            bytes: Some(command.as_bytes()),
            fresh: true,
        },
        InputView::default(),
    ];
    let mut outputs = [OutputSlot {
        bytes: Some(frame.as_mut_bytes()),
    }];
    ErasedService::step(service, &now, &inputs, &mut outputs);
    frame
}

#[test]
fn a_frame_says_the_commanded_thrust_and_its_channel_the_corrected_one() {
    let (mut plain, mut corrected) = (service(None, false), service(Some(battery()), false));
    for number in 0..2000 {
        let thrust = 1.0 + 0.001 * number as f64;
        let [before, after] = [&mut plain, &mut corrected].map(|service| step(service, number, thrust));
        assert_eq!(before.battery(), None);
        let factor = after.battery().unwrap().factor.unwrap();
        assert!((1.01..1.2).contains(&factor));
        let step = 2.0 * 3.138 / 65_535.0;
        assert!(
            (after.thrust - thrust).abs() <= step,
            "{} for {thrust}",
            after.thrust
        );
        let channel = 2.3071 + 3.138 * (2.0 * f64::from(after.channels[0]) / 65_535.0 - 1.0);
        assert!((channel - factor * thrust).abs() <= step);
        assert_eq!(before.channels[1..], after.channels[1..]);
    }
}

#[test]
fn a_restored_battery_continues_to_the_bit() {
    let mut first = service(Some(battery()), false);
    for number in 0..5000 {
        step(&mut first, number, WEIGHT);
    }
    let state: RcOutputState = Service::save(&first);
    let mut second = service(Some(battery()), false);
    Service::restore(&mut second, &state);
    for number in 5000..5100 {
        let [one, other] = [&mut first, &mut second].map(|service| step(service, number, WEIGHT));
        assert_eq!(one.as_bytes(), other.as_bytes());
    }
}

#[test]
fn a_battery_below_its_lowest_voltage_warns_or_demands_a_landing() {
    for (below, action) in [
        (LowVoltageAction::Warn, RcFrame::ACTION_WARN),
        (LowVoltageAction::Land, RcFrame::ACTION_LAND),
    ] {
        let stated = LinkBattery {
            lowest: Some(7.9),
            below,
            ..battery()
        };
        let mut service = service(Some(stated), true);
        let first = (0..10_000)
            .map(|number| (number, step(&mut service, number, WEIGHT)))
            .find(|(_, frame)| frame.limit != RcFrame::LIMIT_NONE);
        let (number, frame) = first.unwrap();
        // 8.4 (1 − 0.03 − 0.15 q) = 7.9 at q = 0.197.
        let time = 1e-3 * (PERIOD * number) as f64;
        assert!((58.0..60.0).contains(&time), "{time}");
        assert_eq!((frame.limit, frame.action), (RcFrame::LIMIT_BATTERY, action));
    }
}

#[test]
fn a_stopped_motor_spends_nothing() {
    let mut service = service(Some(battery()), false);
    for number in 0..1000 {
        step(&mut service, number, 0.0);
    }
    assert_eq!(Service::save(&service).pad0, 0);
}
