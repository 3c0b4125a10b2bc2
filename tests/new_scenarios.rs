//! What `gerono new` writes is checked and flies, also if its estimates are as wrong as they may be.

use std::path::Path;
use std::sync::Arc;

use command_line::exit::Exit;
use flight::interrupt::Interrupt;
use flight::recording_sink::RecordingSink;
use flight::{Outcome, in_process};
use metrics::summary::{RunFacts, Summary};
use new_scenario::{Airframe, Surroundings, text};
use proptest::prelude::*;
use scenario::{CaptureSystem, RadioProtocol};

use crate::common::{Place, complaint, output, said, succeed};
use crate::documentation::{assert_same, read, section};

/// Options of `gerono new`: mass, size, propeller, cells.
const VEHICLES: [[&str; 4]; 4] = [
    ["0.027", "0.09", "1.8", "1"],
    ["0.2", "0.2", "5.5", "2"],
    ["0.9", "0.5", "10", "4"],
    ["2.0", "0.5", "10", "4"],
];

/// Largest steady distance from the path, root mean square, m: 0.32 cm was flown with each of these vehicles.
const STEADY: f64 = 0.004;

/// Settings with which a flight in a laboratory is simulated.
const SIMULATED: [&str; 3] = [
    "motion_capture.source=simulated",
    "flight.arm_at=2.0",
    "flight.land_at=40.0",
];

fn airframe([mass, size, propeller, cells]: [&str; 4]) -> Airframe {
    let number = |text: &str| text.parse().unwrap();
    Airframe {
        mass: number(mass),
        size: number(size),
        propeller: number(propeller),
        cells: cells.parse().unwrap(),
    }
}

fn fly(airframe: &Airframe, surroundings: Surroundings, sets: &[String]) -> Summary {
    let text = text(airframe, surroundings, "new.toml").unwrap_or_else(|error| panic!("{error}"));
    let scenario = scenario_file::load_text(Path::new("new.toml"), &text, sets, None)
        .unwrap_or_else(|error| panic!("{error:#}"));
    let schedule = flight::schedule_of(&scenario).unwrap();
    let mut sink = RecordingSink::new(&scenario, &schedule, None, Arc::default());
    let ending = in_process::fly(&scenario, &mut sink, &Interrupt::never()).unwrap();
    assert!(
        matches!(ending.outcome, Outcome::Completed),
        "{:?}",
        ending.outcome
    );
    let (summary, _) = sink.finish();
    summary.finish(RunFacts::default())
}

#[track_caller]
fn assert_near_its_path(summary: &Summary, limit: f64, what: &str) {
    assert!(summary.lost.is_none(), "{what}: {:?}", summary.lost);
    let steady = summary.steady.as_ref().expect("there is a steady state").rmse;
    assert!(steady < limit, "{what}: {steady} m");
}

fn options<'a>([mass, size, propeller, cells]: [&'a str; 4], more: &[&'a str]) -> Vec<&'a str> {
    let options = [
        "--mass",
        mass,
        "--size",
        size,
        "--propeller",
        propeller,
        "--cells",
        cells,
    ];
    [&options[..], more].concat()
}

#[test]
fn a_written_file_passes_check_and_flies_its_path() {
    let place = Place::new();
    for (index, vehicle) in VEHICLES.into_iter().enumerate() {
        let (file, out) = (format!("{index}.toml"), format!("out{index}"));
        let new = options(vehicle, &["--simulated"]);
        let new = succeed(&mut place.gerono(&[&["new", &file][..], &new].concat()));
        assert!(
            said(&new).contains(&format!("check it: gerono check {file}")),
            "{}",
            said(&new)
        );
        let checked = said(&succeed(&mut place.gerono(&["check", &file])));
        assert!(!checked.contains("warning"), "{checked}");
        let run = [
            "run",
            &file,
            "--quiet",
            "--host",
            "inprocess",
            "--out",
            &out,
            "--set",
            "duration=20.0",
        ];
        succeed(&mut place.gerono(&run));
        assert_near_its_path(
            &fly(&airframe(vehicle), Surroundings::Simulated, &[]),
            STEADY,
            &file,
        );
    }
}

#[test]
fn a_file_for_any_laboratory_passes_check_and_takes_off_and_lands_in_simulated_time() {
    let place = Place::new();
    let laboratories = CaptureSystem::ALL
        .into_iter()
        .flat_map(|cameras| RadioProtocol::ALL.map(|radio| (cameras, radio)));
    for (index, (cameras, radio)) in laboratories.enumerate() {
        let (vehicle, file) = (VEHICLES[index % VEHICLES.len()], format!("{index}.toml"));
        let new = options(vehicle, &["--radio", radio.name(), "--cameras", cameras.name()]);
        succeed(&mut place.gerono(&[&["new", &file][..], &new].concat()));
        let checked = said(&succeed(&mut place.gerono(&["check", &file])));
        assert!(!checked.contains("warning"), "{checked}");
        let sets = SIMULATED.map(str::to_owned);
        let flown = fly(
            &airframe(vehicle),
            Surroundings::Laboratory { cameras, radio },
            &sets,
        );
        assert_near_its_path(&flown, STEADY, &file);
    }
}

/// Thrust and lags as they may be, by what the scenario states: the ranges that docs/another_vehicle.md states.
const WRONG: [[f64; 2]; 4] = [[0.65, 1.5], [0.65, 0.67], [1.5, 1.5], [1.5, 0.67]];

#[test]
fn a_vehicle_flies_whose_thrust_and_lags_are_not_as_estimated() {
    for vehicle in VEHICLES {
        let airframe = airframe(vehicle);
        let estimates = new_scenario::estimates::Estimates::of(&airframe).unwrap();
        for [thrust, lag] in WRONG {
            let rate_lag = estimates.rate_lag.map(|stated| lag * stated);
            let sets = [
                format!("vehicle.actuators.thrust_factor={thrust:?}"),
                // The motors have as much thrust as they have: the weight must be left.
                format!("vehicle.actuators.thrust_max={:?}", thrust * estimates.thrust_max),
                format!("vehicle.actuators.thrust_lag={:?}", lag * estimates.thrust_lag),
                format!("vehicle.actuators.rate_lag={rate_lag:?}"),
            ];
            let what = format!("{vehicle:?}: thrust {thrust}, lags {lag}");
            assert_near_its_path(&fly(&airframe, Surroundings::Simulated, &sets), 0.015, &what);
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 50, ..ProptestConfig::default() })]

    #[test]
    fn a_written_file_of_any_plausible_vehicle_flies(
        magnitude in 0.0..1.0_f64,
        density in 0.6..1.6_f64,
        share in 0.5..1.0_f64,
        cells in 1..=6_u32,
    ) {
        // From 0.02 kg and 0.08 m to 10 kg and 1.1 m: the published vehicles have some 0.5 to 1.5 kg by the square root of the cube.
        let size = 0.08 * libm::pow(14.0, magnitude);
        let airframe = Airframe {
            mass: (density * 0.02 * libm::pow(500.0, magnitude)).clamp(0.02, 10.0),
            size,
            propeller: share * size / std::f64::consts::SQRT_2 / 0.0254,
            cells,
        };
        prop_assume!(text(&airframe, Surroundings::Simulated, "new.toml").is_ok());
        let summary = fly(&airframe, Surroundings::Simulated, &["duration=20.0".to_owned()]);
        prop_assert!(summary.lost.is_none(), "{:?}", summary.lost);
        let steady = summary.steady.unwrap().rmse;
        prop_assert!(steady < 1.5 * STEADY, "{steady} m");
    }
}

#[test]
fn no_file_is_overwritten_and_contradictions_are_refused() {
    let place = Place::new();
    let new = [&["new", "mine.toml"][..], &options(VEHICLES[3], &["--simulated"])].concat();
    succeed(&mut place.gerono(&new));
    let again = output(&mut place.gerono(&new));
    assert_eq!(again.status.code(), Some(i32::from(Exit::NotWritten.code())));
    assert!(
        complaint(&again).contains("exists already"),
        "{}",
        complaint(&again)
    );

    let touching = ["0.9", "0.3", "10", "4"];
    let refused = [&["new", "other.toml"][..], &options(touching, &["--simulated"])].concat();
    let refused = output(&mut place.gerono(&refused));
    assert_eq!(refused.status.code(), Some(i32::from(Exit::BadInput.code())));
    assert!(
        complaint(&refused).contains("touch each other"),
        "{}",
        complaint(&refused)
    );
    assert!(!place.path("other.toml").exists());
}

#[test]
fn the_rules_of_the_pages_are_those_of_the_program() {
    for (page, name, table) in [
        (
            "docs/another_vehicle.md",
            "estimates",
            new_scenario::estimates::table(),
        ),
        (
            "docs/tuning.md",
            "gains",
            scenario_file::gain_rules::table_of_gains(),
        ),
    ] {
        assert_same(page, section(&read(page), name), &table);
    }
}
