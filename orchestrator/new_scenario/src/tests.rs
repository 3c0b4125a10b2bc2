//! Whatever `gerono new` writes is a scenario without a warning.

use std::path::Path;

use proptest::prelude::*;
use scenario::{GRAVITY, Scenario};

use scenario_file::{gain_rules, units};

use super::estimates::Estimates;
use super::*;

fn all_surroundings() -> Vec<Surroundings> {
    let laboratories = CaptureSystem::ALL
        .into_iter()
        .flat_map(|cameras| RadioProtocol::ALL.map(|radio| Surroundings::Laboratory { cameras, radio }));
    std::iter::once(Surroundings::Simulated)
        .chain(laboratories)
        .collect()
}

#[track_caller]
fn read(text: &str) -> Scenario {
    scenario_file::load_text(Path::new("new.toml"), text, &[], None)
        .unwrap_or_else(|error| panic!("{error:#}\n{text}"))
}

/// A vehicle that a person may have: a propeller that nearly touches the next one, or is smaller.
fn airframes() -> impl Strategy<Value = Airframe> {
    let within = |[least, most]: [f64; 2]| {
        (0.0..1.0_f64).prop_map(move |share| least * libm::pow(most / least, share))
    };
    let (mass, size) = (within(MASS), within(SIZE));
    (mass, size, 0.4..1.0_f64, CELLS[0]..=CELLS[1]).prop_map(|(mass, size, share, cells)| Airframe {
        mass,
        size,
        propeller: (share * size / std::f64::consts::SQRT_2 / 0.0254).clamp(PROPELLER[0], PROPELLER[1]),
        cells,
    })
}

proptest! {
    #[test]
    fn a_written_scenario_is_read_and_keeps_all_rules(airframe in airframes()) {
        for surroundings in all_surroundings() {
            let Ok(text) = text(&airframe, surroundings, "new.toml") else {
                continue;
            };
            let scenario = read(&text);
            prop_assert_eq!(gain_rules::warnings(&scenario), []);
            prop_assert_eq!(units::warnings(&scenario), []);
            prop_assert_eq!(scenario.vehicle.mass, airframe.mass);
        }
    }
}

#[test]
fn every_estimated_value_says_how_to_measure_it() {
    let airframe = Airframe {
        mass: 0.9,
        size: 0.5,
        propeller: 10.0,
        cells: 4,
    };
    for surroundings in all_surroundings() {
        let text = text(&airframe, surroundings, "new.toml").unwrap();
        let believed = text.split("# --- The vehicle of a simulation").next().unwrap();
        for way in [
            "thrust stand",
            "`gerono rc identify`",
            "`gerono identify`",
            "bifilar pendulum",
            "scales",
        ] {
            assert!(believed.contains(way), "{way}: {text}");
        }
    }
}

/// J in 1e-5 kg m², largest thrust in N, and lag of the thrust in s of known vehicles.
const KNOWN: [(&str, Airframe, [f64; 2], f64, f64); 4] = [
    (
        "Crazyflie",
        airframe(0.03, 0.092, 1.8, 1),
        [1.43, 2.89],
        0.575,
        0.072,
    ),
    (
        "the paper's",
        airframe(0.2, 0.2, 5.5, 2),
        [65.0, 130.0],
        5.5,
        0.03,
    ),
    (
        "Hummingbird",
        airframe(0.5, 0.34, 8.0, 3),
        [366.0, 703.0],
        20.0,
        0.02,
    ),
    (
        "X500",
        airframe(2.0, 0.495, 10.0, 4),
        [2167.0, 4000.0],
        34.2,
        0.05,
    ),
];

const fn airframe(mass: f64, size: f64, propeller: f64, cells: u32) -> Airframe {
    Airframe {
        mass,
        size,
        propeller,
        cells,
    }
}

#[test]
fn a_crazyflie_has_the_thrust_of_its_firmware_unless_it_is_too_heavy_for_it() {
    let written = |mass, radio| {
        let surroundings = Surroundings::Laboratory {
            cameras: CaptureSystem::Vrpn,
            radio,
        };
        let scenario = read(&text(&airframe(mass, 0.092, 1.8, 1), surroundings, "new.toml").unwrap());
        let thrust_max = scenario.vehicle.actuators.unwrap().thrust_max;
        (scenario.rc_output.unwrap(), thrust_max)
    };
    let (link, thrust_max) = written(0.031, RadioProtocol::Crazyflie);
    assert_eq!(
        (link.thrust_offset, link.thrust_slope, thrust_max),
        (0.24, 0.24, 0.48)
    );
    // With a deck.
    for (mass, thrust) in [(0.04, 0.48), (0.042, 0.72), (0.061, 0.72), (0.062, 0.8)] {
        assert_eq!(written(mass, RadioProtocol::Crazyflie).1, thrust, "{mass}");
    }
    assert_eq!(link.resolution, 16);
    assert_eq!(link.battery.unwrap().lowest, Some(3.2));
    for (mass, radio) in [(0.07, RadioProtocol::Crazyflie), (0.031, RadioProtocol::Crsf)] {
        let (_, thrust_max) = written(mass, radio);
        assert!(
            (thrust_max / (2.0 * mass * GRAVITY) - 1.0).abs() < 0.01,
            "{thrust_max}"
        );
    }
}

#[test]
fn estimates_are_near_the_values_of_known_vehicles() {
    for (name, airframe, [across, along], thrust, lag) in KNOWN {
        let estimates = Estimates::of(&airframe).unwrap();
        let [x, _, z] = estimates.inertia;
        let is_near = |value: f64, known: f64, factor: f64| (known / factor..known * factor).contains(&value);
        assert!(is_near(x, 1e-5 * across, 1.4), "{name}: {x}");
        assert!(is_near(z, 1e-5 * along, 1.6), "{name}: {z}");
        assert!(
            is_near(estimates.thrust_max, thrust, 1.6),
            "{name}: {estimates:?}"
        );
        assert!(is_near(estimates.thrust_lag, lag, 2.01), "{name}: {estimates:?}");
    }
}

#[test]
fn numbers_that_contradict_each_other_are_refused_with_the_fix() {
    let touching = text(&airframe(0.9, 0.3, 10.0, 4), Surroundings::Simulated, "new.toml").unwrap_err();
    assert_eq!(
        touching.to_string(),
        "propellers of 10 inch touch each other: with a diagonal of 0.3 m neighbouring motors are 0.212 m apart; give the \
         diagonal from motor to motor, at least 0.36 m with these propellers, and their diameter in inch"
    );
    let heavy = text(&airframe(9.0, 0.5, 5.0, 4), Surroundings::Simulated, "new.toml").unwrap_err();
    assert_eq!(
        heavy.to_string(),
        "four propellers of 5 inch with 4 cells have about 11.61 N, 0.13 times the weight of 9 kg; give the mass with battery \
         in kg, the diameter of a propeller in inch, and the cells in series"
    );
}

#[test]
fn propellers_that_do_not_lift_the_vehicle_by_the_rule_are_doubted() {
    let doubt = |mass, propeller, surroundings| {
        let airframe = airframe(mass, 0.5, propeller, 4);
        Estimates::within(&airframe, surroundings).unwrap().doubt()
    };
    let simulated = Surroundings::Simulated;
    assert_eq!(doubt(2.0, 10.0, simulated), None);
    let said = doubt(1.85, 5.0, simulated).unwrap();
    assert!(
        said.starts_with("by the rule the propellers lift 0.64 times the weight"),
        "{said}"
    );
}
