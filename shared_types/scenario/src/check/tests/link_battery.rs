//! Battery as the transmitter knows it.

use super::assert_only;
use crate::tests_support::rig;
use crate::{
    BatteryModel, Flight, LinkBattery, LowVoltageAction, Problem, RadioProtocol, Scenario, Transmitter,
    VoltageSource,
};

/// The problems of a flight in the laboratory with a battery on a link.
fn problems(link: RadioProtocol, battery: LinkBattery) -> Vec<Problem> {
    let is_serial = link.properties().serial;
    let mut scenario: Scenario = rig();
    let stated = scenario.rc_output.as_mut().unwrap();
    stated.battery = Some(battery);
    if !link.is_simulated() {
        stated.link = link;
        stated.transmitter = Some(Transmitter {
            device: is_serial.then(|| "/dev/ttyUSB0".to_owned()),
            uri: (!is_serial).then(|| "radio://0/80/2M/E7E7E7E7E7".to_owned()),
            ..Transmitter::default()
        });
    }
    scenario.problems()
}

fn modelled() -> LinkBattery {
    LinkBattery {
        source: VoltageSource::Modelled,
        calibrated: Some(8.0),
        model: Some(BatteryModel {
            full: 8.4,
            thrust: 1.96,
            spent: 0.0,
            endurance: 300.0,
            fade: 0.15,
            droop: 0.03,
        }),
        ..LinkBattery::default()
    }
}

#[test]
fn a_voltage_is_measured_on_links_that_send_something_back_and_modelled_on_all() {
    for link in RadioProtocol::ALL {
        let measured = problems(link, LinkBattery::default());
        if link.has_telemetry() {
            assert_eq!(measured, []);
        } else {
            let (key, fix) = (
                "rc_output.battery.source",
                "crsf, msp, mavlink and crazyflie have telemetry",
            );
            assert_only(&measured, key, "sends nothing back", fix);
        }
        if link != RadioProtocol::Crazyflie {
            assert_eq!(problems(link, modelled()), []);
        }
    }
    assert_eq!(problems(RadioProtocol::Simulated, modelled()), []);
}

#[test]
fn what_contradicts_itself_is_refused_with_the_fix() {
    let of = |link, change: &dyn Fn(&mut LinkBattery)| {
        let mut battery = modelled();
        change(&mut battery);
        problems(link, battery)
    };
    let (crsf, crazyflie) = (RadioProtocol::Crsf, RadioProtocol::Crazyflie);
    for (found, key, reason) in [
        (
            of(crsf, &|battery| battery.model = None),
            "",
            "the model is not stated",
        ),
        (
            of(crsf, &|battery| battery.source = VoltageSource::Measured),
            ".model",
            "nothing uses the model",
        ),
        (of(crazyflie, &|_| {}), ".calibrated", "would be corrected twice"),
        (
            of(crsf, &|battery| battery.factor = [1.1, 1.5]),
            ".factor",
            "not a range around 1",
        ),
    ] {
        assert_only(&found, &format!("rc_output.battery{key}"), reason, "");
    }
}

#[test]
fn a_low_battery_lands_a_flight_with_phases_below_a_stated_voltage() {
    let with = |has_phases: bool, lowest| {
        let mut scenario = rig();
        scenario.flight = has_phases.then(Flight::default);
        scenario.rc_output.as_mut().unwrap().battery = Some(LinkBattery {
            lowest,
            below: LowVoltageAction::Land,
            ..modelled()
        });
        let problems = scenario.problems().into_iter();
        problems
            .filter(|problem| problem.key.to_string() == "rc_output.battery.below")
            .count()
    };
    assert_eq!(with(true, Some(7.0)), 0);
    assert_eq!(with(false, Some(7.0)), 1);
    assert_eq!(with(true, None), 1);
}

#[test]
fn only_a_modelled_battery_is_part_of_the_experiment() {
    for (battery, stays) in [(LinkBattery::default(), false), (modelled(), true)] {
        let mut scenario = rig();
        scenario.rc_output.as_mut().unwrap().battery = Some(battery);
        let experiment = scenario.experiment();
        assert_eq!(experiment.rc_output.unwrap().battery.is_some(), stays);
    }
}
