//! The scenarios, the schema and the documentation that the repository holds.

#![expect(clippy::disallowed_methods, reason = "tests make their own files")]

use std::ffi::OsStr;

use scenario::{Curve, VehicleChange};

use super::*;

/// The line that every scenario file begins with, so that editors complete and check it.
const SCHEMA_LINE: &str = "#:schema scenario.schema.json\n";

fn scenario_files() -> Vec<PathBuf> {
    let entries = std::fs::read_dir(repository("scenarios")).unwrap();
    let files: Vec<PathBuf> = entries.map(|entry| entry.unwrap().path()).collect();
    files
        .into_iter()
        .filter(|file| file.extension() == Some(OsStr::new("toml")))
        .collect()
}

fn load_committed(name: &str) -> Scenario {
    load(&repository(&format!("scenarios/{name}.toml")), &[], None).unwrap()
}

#[test]
fn every_committed_scenario_can_be_flown() {
    let files = scenario_files();
    assert!(files.len() >= 7, "{files:?}");
    for file in files {
        if let Err(error) = load(&file, &[], None) {
            panic!("{}", narrated(&error));
        }
    }
}

#[test]
fn every_committed_scenario_names_its_schema_and_says_what_it_is_for() {
    for file in scenario_files() {
        let text = std::fs::read_to_string(&file).unwrap();
        assert!(text.starts_with(SCHEMA_LINE), "{}", file.display());
        let scenario = load(&file, &[], None).unwrap();
        assert!(!scenario.description.is_empty(), "{}", file.display());
    }
}

/// fig1.toml shows every parameter.
#[test]
fn the_first_scenario_states_every_parameter_but_the_transport() {
    let text = fig1();
    let written: toml::Table = text.parse().unwrap();
    let mut read = serde_json::to_value(load_committed("fig1")).unwrap();
    for table in ["period", "phase", "latency"] {
        read["schedule"].as_object_mut().unwrap().remove(table);
    }
    read["vehicle"]["change"][0]
        .as_object_mut()
        .unwrap()
        .remove("disturbance");
    assert_eq!(serde_json::to_value(written).unwrap(), read);
}

#[test]
fn the_first_scenario_has_the_defaults_where_there_are_any() {
    let scenario = load_committed("fig1");
    let unstated = scenario::Scenario {
        controller: scenario::Controller::default(),
        ..scenario.clone()
    };
    assert_eq!(scenario.beta(), unstated.beta());
    assert_eq!(scenario.lambda_inertia(), unstated.lambda_inertia());
    assert_eq!(scenario.controller.beta, Some(unstated.beta()));
    assert_eq!(unstated.experiment().controller, scenario.controller);
    assert_eq!(scenario.schedule, scenario::Timing::default());
    assert_eq!(
        scenario.path.curve,
        Curve::TiltedEight(scenario::TiltedEight::default())
    );
    assert_eq!(scenario.path, load_committed("fig2_near").path);
}

/// Fig. 2 of the paper.
#[test]
fn the_second_figures_start_as_far_away_as_the_paper_says() {
    for (name, distance, added_mass) in [
        ("fig2_near", 8.15, 0.0),
        ("fig2_middle", 26.58, 0.1),
        ("fig2_far", 51.40, 0.2),
    ] {
        let scenario = load_committed(name);
        let Curve::TiltedEight(eight) = &scenario.path.curve else {
            panic!("{name} is not the tilted eight")
        };
        // pd(0) = Rx(tilt) [0, 0, −height]ᵀ
        let (sine, cosine) = libm::sincos(eight.tilt);
        let path = [0.0, -eight.height * sine, -eight.height * cosine];
        let position = scenario.vehicle.initial.position;
        let squares = position.iter().zip(path).map(|(p, pd)| (p - pd) * (p - pd));
        let z1 = squares.sum::<f64>().sqrt();
        assert!((z1 - distance).abs() < 0.005, "{name}: {z1}");

        let masses: Vec<f64> = scenario
            .vehicle
            .change
            .iter()
            .filter_map(|change| change.mass)
            .collect();
        let mass = masses.last().unwrap_or(&scenario.vehicle.mass);
        assert!(
            (mass - scenario.vehicle.mass - added_mass).abs() < 1e-12,
            "{name}"
        );
    }
}

/// J grows with m, within the two decimals to which the paper gives it.
#[test]
fn the_moments_of_inertia_grow_with_the_mass() {
    for name in ["fig1", "fig2_middle", "fig2_far"] {
        let vehicle = load_committed(name).vehicle;
        let [
            VehicleChange {
                at,
                mass: Some(mass),
                inertia: Some(inertia),
                ..
            },
        ] = vehicle.change.as_slice()
        else {
            panic!("{name} changes mass and inertia once")
        };
        assert_eq!(*at, 30.0, "{name}");
        for (before, after) in vehicle.inertia.iter().zip(inertia) {
            let scaled = before * mass / vehicle.mass;
            assert!(
                (after - scaled).abs() < 0.005e-4 * 1.01,
                "{name}: {after} for {scaled}"
            );
        }
    }
}

/// A committed file is what the code makes of it, or is made so on request.
fn assert_generated(path: &str, should_be: &str) {
    let path = repository(path);
    if std::fs::read_to_string(&path).unwrap() == should_be {
        return;
    }
    assert!(
        std::env::var_os("GERONO_BLESS").is_some(),
        "{} is out of date: set GERONO_BLESS=1 to write it",
        path.display()
    );
    std::fs::write(&path, should_be).unwrap();
}

#[test]
fn the_committed_schema_is_that_of_the_code() {
    assert_generated("scenarios/scenario.schema.json", &json_schema());
}

/// A key, its unit and its default are described once, in the code; the documentation shows what is there.
#[test]
fn the_documented_keys_are_those_of_the_code() {
    let documentation = std::fs::read_to_string(repository("docs/scenarios.md")).unwrap();
    let mut updated = String::new();
    let mut rest = documentation.as_str();
    let mut sections = Vec::new();
    while let Some((before, after)) = rest.split_once("<!-- keys:") {
        let (section, after) = after.split_once(" -->\n").unwrap();
        let (_, after) = after.split_once("<!-- end of keys -->").unwrap();
        let section = section.trim();
        sections.push(section.to_owned());
        updated += &format!(
            "{before}<!-- keys: {section} -->\n\n{}\n<!-- end of keys -->",
            key_table(section)
        );
        rest = after;
    }
    updated += rest;
    sections.sort();
    let mut tables: Vec<String> =
        serde_json::from_str::<serde_json::Value>(&json_schema()).unwrap()["properties"]
            .as_object()
            .unwrap()
            .keys()
            .filter(|name| !key_table(name).ends_with("| --- |\n"))
            .cloned()
            .collect();
    tables.push(String::new());
    tables.sort();
    assert_eq!(sections, tables, "every section of a scenario is documented once");
    assert_generated("docs/scenarios.md", &updated);
}
