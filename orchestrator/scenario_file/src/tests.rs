//! The messages about scenarios that are right, and about every kind that is wrong.

mod arguments;
mod committed;
mod curve_file;
mod files;
mod machine;
mod motion_capture;
mod mutations;
mod optional;
mod outdoors;
mod programs;
mod radio_link;
mod semantics;
mod syntax;
mod units;

use std::path::{Path, PathBuf};

use miette::{Diagnostic, NarratableReportHandler};

use super::*;

/// A file of the repository.
fn repository(path: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..").join(path)
}

fn fig1() -> String {
    std::fs::read_to_string(repository("scenarios/fig1.toml")).unwrap()
}

/// A flight with every section that a scenario may have.
const LABORATORY: &str = r#"
duration = 30.0

[schedule.period]
"mocap/pose" = 0.01
"vehicle/state" = 0.022
path_generator = 0.022
controller = 0.022
rc_output = 0.022

[schedule.latency]
"mocap/pose -> estimator" = 0.005
"rc/frame -> plant" = 0.005

[vehicle]
mass = 0.2
inertia = [6.5e-4, 6.5e-4, 13.0e-4]
drag = [0.05, 0.05, 0.0]

[vehicle.actuators]
initial_thrust = 1.962

[vehicle.turbulence]
deviation = 0.05
correlation_time = 1.0

[vehicle.fan]
on_at = 5.0
off_at = 25.0
position = [0.0, -1.5, -1.2]
direction = [0.0, 1.0, 0.0]
force = 0.18
reference_distance = 1.5
moves = [{ at = 10.0, position = [-1.5, 0.0, -1.2], direction = [1.0, 0.0, 0.0] }]

[cameras]
jitter = 0.002
occlusion = [{ at = 8.0, lasts = 0.3 }, { at = 12.0, lasts = 0.5 }]

[estimator.kalman]
prediction = false

[rc_output]
resolution = 12
thrust_range = [-1.0, 1.0]

[model]
radio_latency = 0.006
capture_latency = 0.004

[path.curve.hover]
position = [0.0, 0.0, -1.2]

[controller.rates]
yaw_kp = 3.0
"#;

/// The text with one occurrence of a part replaced.
#[track_caller]
fn with(text: &str, part: &str, replacement: &str) -> String {
    assert_eq!(text.matches(part).count(), 1, "{part} is to occur once");
    text.replace(part, replacement)
}

/// Line of the one occurrence of a part.
#[track_caller]
fn line_of(text: &str, part: &str) -> usize {
    assert_eq!(text.matches(part).count(), 1, "{part} is to occur once");
    text[..text.find(part).unwrap()].matches('\n').count() + 1
}

fn narrated(diagnostic: &dyn Diagnostic) -> String {
    let mut text = String::new();
    NarratableReportHandler::new()
        .render_report(&mut text, diagnostic)
        .expect("the labels lie inside the source");
    text
}

fn load_text(text: &str, sets: &[&str]) -> Result<Scenario, ScenarioError> {
    let sets: Vec<String> = sets.iter().map(|&set| set.to_owned()).collect();
    scenario_from_text("flight.toml", text, &sets, None, &[], None)
        .map_err(|findings| ScenarioError::refused(Path::new("flight.toml"), findings))
}

/// Returns the message without a terminal about the error of a text.
#[track_caller]
fn refusal(text: &str, sets: &[&str]) -> String {
    narrated(&load_text(text, sets).expect_err("the scenario is wrong"))
}

/// The text is refused for one reason, on this line, and the report has each of these pieces.
#[track_caller]
fn refused_on_line(text: &str, line: usize, pieces: &[&str]) {
    let shown = refusal(text, &[]);
    let place = format!("label at line {line}, column");
    let starts_there =
        shown.contains(&place) || shown.contains(&format!("label starting at line {line}, column"));
    assert!(starts_there, "not on line {line}:\n{shown}");
    assert!(shown.contains("Begin snippet for flight.toml"), "{shown}");
    for piece in pieces {
        assert!(shown.contains(piece), "no `{piece}` in:\n{shown}");
    }
    let ScenarioError::Refused { findings, .. } = load_text(text, &[]).unwrap_err() else {
        panic!("{shown}")
    };
    assert_eq!(findings.len(), 1, "{shown}");
}

#[test]
fn a_report_of_one_finding_is_that_finding() {
    let text = with(&fig1(), "sigma_max = 1.5", "sigma_max = 0.02");
    let error = load_text(&text, &[]).unwrap_err();
    assert_eq!(error.to_string(), "`controller.sigma_max` cannot be flown");
    assert!(error.related().is_none());
    assert_eq!(error.labels().unwrap().count(), 1);
    assert!(error.help().is_some());
}

#[test]
fn a_report_of_several_findings_holds_all_of_them() {
    let text = with(&fig1(), "sigma_max = 1.5", "sigma_max = 0.02");
    let text = with(&text, "k4 = 1.0", "k4 = 0.0");
    let error = load_text(&text, &[]).unwrap_err();
    assert_eq!(error.to_string(), "2 problems in flight.toml");
    assert_eq!(error.related().unwrap().count(), 2);
    assert!(error.labels().is_none());
    let shown = narrated(&error);
    for piece in [
        "`controller.sigma_max` cannot be flown",
        "`path.k4` cannot be flown",
    ] {
        assert!(shown.contains(piece), "{shown}");
    }
}

#[test]
fn the_long_display_is_one_line_a_finding_with_place_reason_and_fix() {
    let text = with(&fig1(), "k2 = 4.0", "k2 = -4.0");
    let text = with(&text, "k4 = 1.0", "k4 = 0.0");
    let (k2, k4) = (line_of(&text, "k2 = -4.0"), line_of(&text, "k4 = 0.0"));
    let error = load_text(&text, &[]).unwrap_err();
    assert_eq!(
        format!("{error:#}"),
        format!(
            "flight.toml:{k4}:6: `path.k4` cannot be flown: k4 = 0.0 is not above 0; give a number above 0\n\
             flight.toml:{k2}:6: `controller.k2` cannot be flown: k2 = -4.0 is not above 0; give a number above 0"
        )
    );
}

#[test]
fn the_graphical_report_points_at_the_value() {
    let text = with(&fig1(), "mass = 0.245", "mass = 0.9");
    let line = line_of(&text, "mass = 0.9");
    let mut shown = String::new();
    miette::GraphicalReportHandler::new_themed(miette::GraphicalTheme::none())
        .render_report(&mut shown, &load_text(&text, &[]).unwrap_err())
        .unwrap();
    for piece in [
        &format!("[flight.toml:{line}:8]"),
        "mass = 0.9",
        "new mass of 0.9 kg lies outside the controller's bounds",
        "help: raise `controller.bounds.mass_max` to 0.9 or more",
    ] {
        assert!(shown.contains(piece), "no `{piece}` in:\n{shown}");
    }
}
