//! The `--set` arguments.

use super::*;

#[track_caller]
fn flown(sets: &[&str]) -> Scenario {
    match load_text(&fig1(), sets) {
        Ok(scenario) => scenario,
        Err(error) => panic!("{}", narrated(&error)),
    }
}

/// The argument is refused, shown itself at this column, with each of these pieces.
#[track_caller]
fn refused(argument: &str, column: usize, pieces: &[&str]) {
    let error = load_text(&fig1(), &[argument]).expect_err("the argument is wrong");
    let (line, shown) = (format!("{error:#}"), narrated(&error));
    assert!(
        line.starts_with(&format!("--set:1:{column}: ")),
        "not in column {column}: {line}"
    );
    assert!(
        shown.contains(&format!(
            "snippet line 1: {}",
            argument.lines().next().unwrap_or_default()
        )),
        "{shown}"
    );
    for piece in pieces {
        assert!(shown.contains(piece), "no `{piece}` in:\n{shown}");
    }
}

#[test]
fn a_value_takes_the_place_of_the_files() {
    let before = flown(&[]);
    let after = flown(&[
        "controller.k1=5",
        "vehicle.change.0.at = 31.5",
        "vehicle.inertia=[1e-3, 1e-3, 2e-3]",
    ]);
    assert_eq!(after.controller.k1, 5.0);
    assert_eq!(after.vehicle.change[0].at, 31.5);
    assert_eq!(after.vehicle.inertia, [1e-3, 1e-3, 2e-3]);
    assert_eq!(after.path, before.path);
    assert_eq!(after.vehicle.change[0].mass, before.vehicle.change[0].mass);
}

#[test]
fn a_component_of_a_vector_can_be_set() {
    assert_eq!(
        flown(&["vehicle.initial.position.2=-3"]).vehicle.initial.position,
        [0.0, 0.0, -3.0]
    );
}

#[test]
fn the_last_of_equal_arguments_counts() {
    assert_eq!(flown(&["controller.k1=5", "controller.k1=6"]).controller.k1, 6.0);
}

#[test]
fn a_word_needs_no_quotes() {
    use scenario::PathMode;
    assert_eq!(
        flown(&["path.mode=trajectory_tracking"]).path.mode,
        PathMode::TrajectoryTracking
    );
    assert_eq!(
        flown(&["path.mode=\"trajectory_tracking\""]).path.mode,
        PathMode::TrajectoryTracking
    );
    assert_eq!(flown(&["description=a second try"]).description, "a second try");
    assert_eq!(flown(&["description=Übung"]).description, "Übung");
    for path in [
        "..",
        "../build",
        "./build",
        "/home/me/build",
        "0.0.0.0",
        "10.0.0.1:1510",
        "::1",
    ] {
        assert_eq!(flown(&[&format!("description={path}")]).description, path);
    }
}

#[test]
fn missing_tables_are_made() {
    let scenario = flown(&[
        "schedule.latency.\"rc/frame -> plant\"=0.005",
        "schedule.period.rc_output=0.022",
    ]);
    assert_eq!(scenario.schedule.latency["rc/frame -> plant"], 0.005);
    assert_eq!(scenario.schedule.period["rc_output"], 0.022);
}

#[test]
fn a_change_can_be_added() {
    let scenario = flown(&[
        "vehicle.change.1.at=45",
        "vehicle.change.1.disturbance=[0.0, 0.0, 0.0]",
    ]);
    assert_eq!(scenario.vehicle.change.len(), 2);
    assert_eq!(scenario.vehicle.change[1].disturbance, Some([0.0; 3]));
    let near = std::fs::read_to_string(repository("scenarios/fig2_near.toml")).unwrap();
    let sets = ["vehicle.change.0.at=45", "vehicle.change.0.mass=0.3"];
    assert_eq!(load_text(&near, &sets).unwrap().vehicle.change[0].mass, Some(0.3));
}

#[test]
fn a_whole_table_takes_the_place_of_the_files() {
    use scenario::{Curve, Hover};
    let scenario = flown(&["path.curve={hover = {position = [0.0, 0.0, -1.0]}}"]);
    assert_eq!(
        scenario.path.curve,
        Curve::Hover(Hover {
            position: [0.0, 0.0, -1.0]
        })
    );
}

#[test]
fn an_argument_without_a_sign_is_refused() {
    refused(
        "controller.k1",
        1,
        &["there is no `=`", "such as `controller.k1=5`"],
    );
}

#[test]
fn an_argument_without_a_key_is_refused() {
    refused("=5", 1, &["this is not a key", "write names separated by dots"]);
    refused("controller k1=5", 12, &["this is not a key"]);
    refused("controller.=5", 12, &["this is not a key"]);
}

#[test]
fn an_argument_without_a_value_is_refused() {
    refused("controller.k1=", 14, &["there is no value"]);
    refused("controller.k1= ", 15, &["there is no value"]);
}

#[test]
fn a_topic_or_an_edge_without_quotes_is_named_with_its_key() {
    for (argument, column, key) in [
        (
            "schedule.latency.rc/frame=0.01",
            20,
            "`schedule.latency.\"rc/frame -> plant\"` or",
        ),
        (
            "schedule.latency.mocap/pose=0.01",
            23,
            "`schedule.latency.\"mocap/pose -> estimator\"`",
        ),
        (
            "schedule.period.mocap/pose=0.01",
            22,
            "`schedule.period.\"mocap/pose\"`",
        ),
    ] {
        refused(
            argument,
            column,
            &["this is not a key", "help: put the name in quotes: ", key],
        );
    }
}

#[test]
fn a_decimal_comma_and_a_unit_are_named() {
    refused(
        "vehicle.mass=0,19",
        14,
        &[
            "this is not a number",
            "help: the decimal sign is a point: write 0.19",
        ],
    );
    refused(
        "duration=60s",
        10,
        &[
            "this is not a number",
            "help: the value is in s, without the unit: write 60",
        ],
    );
    refused(
        "vehicle.mass=190 g",
        14,
        &[
            "this is not a number",
            "help: the value is in kg, without the unit: write 0.19",
        ],
    );
    refused(
        "duration=\"60 s\"",
        10,
        &[
            "`duration` has the wrong type",
            "help: the value is in s, without the unit: write 60",
        ],
    );
}

#[test]
fn a_value_that_toml_does_not_know_is_refused() {
    refused(
        "vehicle.inertia=[1, 2",
        17,
        &["this is not a TOML value", "help: write a number"],
    );
    refused("duration=60x", 10, &["this is not a TOML value"]);
    refused("duration=60\nseed=2", 10, &["more than a value"]);
}

#[test]
fn an_unknown_key_is_refused_as_in_a_file() {
    refused(
        "controller.sigmamax=2",
        12,
        &["`controller.sigmamax` is unknown", "did you mean `sigma_max`?"],
    );
    refused(
        "controler.k1=2",
        1,
        &["`controler` is unknown", "did you mean `controller`?"],
    );
}

#[test]
fn a_value_of_another_type_is_refused_as_in_a_file() {
    refused(
        "controller.k1=many",
        15,
        &["a number is expected here, not the string \"many\""],
    );
    refused(
        "vehicle.change=3",
        16,
        &["`vehicle.change` has the wrong type", "an array is expected here"],
    );
}

#[test]
fn a_value_that_cannot_be_flown_is_shown_in_its_argument() {
    refused(
        "controller.sigma_max=0.02",
        22,
        &["σmax = 0.02 is not above", "help: raise `sigma_max`"],
    );
    refused(
        "vehicle.inertia=[6.5e-4, 6.5e-4, 1.0]",
        34,
        &["J3 = 1.0 kg m²", "help: check the moments"],
    );
}

#[test]
fn the_inside_of_a_number_is_refused() {
    refused(
        "duration.minutes=1",
        10,
        &["`duration` is one value", "set `duration` itself"],
    );
}

#[test]
fn an_element_that_is_not_there_is_refused() {
    refused(
        "vehicle.change.2.at=40",
        16,
        &[
            "`vehicle.change` has 1 element, and `2` is none of its positions",
            "choose a position from 0 to 1",
        ],
    );
    refused(
        "vehicle.change.first.at=40",
        16,
        &["`first` is none of its positions"],
    );
}

#[test]
fn all_wrong_arguments_are_reported_at_once() {
    let shown = refusal(&fig1(), &["controller.k1", "duration=", "vehicle.change.7.at=1"]);
    for piece in [
        "3 problems in flight.toml",
        "there is no `=`",
        "there is no value",
        "`7` is none of its positions",
    ] {
        assert!(shown.contains(piece), "no `{piece}` in:\n{shown}");
    }
}

#[test]
fn a_gain_of_a_law_that_does_not_fly_is_refused_also_in_a_table() {
    let path = std::path::Path::new("flight.toml");
    for argument in [
        "controller.baseline.integral_gain=9.0",
        "controller={baseline = {integral_gain = 9.0}}",
    ] {
        let refused = crate::load_text(path, &fig1(), &[argument.to_owned()], None).unwrap_err();
        let shown = format!("{refused:#}");
        assert!(
            shown.contains("the law `adaptive` flies, and does not use it"),
            "{shown}"
        );
    }
    // A gain in the file is for the laws of the day that use it.
    assert!(flown(&["controller.law=immersion_inertia"]).controller.k1 > 0.0);
}

/// A value of an argument may be what makes a value of the file wrong: that is where the problem is shown.
#[test]
fn what_an_argument_makes_wrong_in_the_file_is_shown_in_the_file() {
    let text = fig1();
    let shown = refusal(&text, &["duration=20"]);
    assert!(shown.contains("Begin snippet for flight.toml"), "{shown}");
    assert!(
        shown.contains(&format!("at line {}, column", line_of(&text, "at = 30.0"))),
        "{shown}"
    );
    assert!(
        shown.contains("comes after the end of the flight at 20.0 s"),
        "{shown}"
    );
}

/// A scenario of the repository with a duration from an argument, and the note about what was left out.
fn shortened(name: &str, sets: &[&str]) -> Result<(Scenario, Option<String>), ScenarioError> {
    let sets: Vec<String> = sets.iter().map(|&set| set.to_owned()).collect();
    load_shortened(&repository(&format!("scenarios/{name}.toml")), &sets, None)
}

#[test]
fn a_shorter_flight_by_an_argument_leaves_out_what_the_file_plans_after_it() {
    let (flight, note) = shortened("fig1", &["duration=5"]).unwrap();
    assert_eq!(flight.vehicle.change, []);
    assert_eq!(
        note.unwrap(),
        "the duration of 5.0 s is that of `--set`: left out what the scenario plans after it, `vehicle.change` at 30.0 s"
    );
    let faults = format!(
        "{LABORATORY}\n[[fault]]\nat = 4.0\nservice = \"estimator\"\nkind = \"off\"\nfor = 0.2\n\n[[fault]]\nat = 12.0\n\
         service = \"controller\"\nkind = \"off\"\nfor = 0.2\n"
    );
    let mut note = None;
    let sets = ["duration=9.0".to_owned()];
    let flight = scenario_from_text("flight.toml", &faults, &sets, None, &[], Some(&mut note)).unwrap();
    assert_eq!(flight.fault.len(), 1);
    let fan = flight.vehicle.fan.unwrap();
    assert_eq!((fan.moves.len(), fan.off_at), (0, None));
    assert_eq!(
        note.unwrap(),
        "the duration of 9.0 s is that of `--set`: left out what the scenario plans after it, `cameras.occlusion` at 12.0 s, \
         `fault` at 12.0 s, `vehicle.fan.moves` at 10.0 s, `vehicle.fan.off_at` at 25.0 s"
    );
    let (flight, note) = shortened("takeoff_and_land", &["duration=20.0"]).unwrap();
    assert_eq!(flight.flight.unwrap().land_at, None);
    assert!(note.unwrap().contains("`flight.land_at` at 25.0 s"));
    let (flight, note) = shortened("fig7", &["duration=20.0"]).unwrap();
    assert_eq!(flight.vehicle.fan, None);
    assert!(note.unwrap().contains("`vehicle.fan` at 30.0 s"));
}

#[test]
fn nothing_is_left_out_of_a_flight_that_is_long_enough_or_of_the_arguments() {
    for sets in [&[][..], &["duration=30.0"], &["controller.k1=5"]] {
        let (flight, note) = shortened("fig1", sets).unwrap();
        assert_eq!((flight.vehicle.change.len(), note), (1, None), "{sets:?}");
    }
    let both = shortened("fig1", &["duration=5", "vehicle.change.0.at=20.0"]).unwrap_err();
    assert!(
        format!("{both:#}").contains("the change at 20.0 s comes after the end"),
        "{both:#}"
    );
    let drawn = load(
        &repository("scenarios/fig1.toml"),
        &["duration=5".to_owned()],
        None,
    )
    .unwrap_err();
    assert!(
        format!("{drawn:#}").contains("the change at 30.0 s comes after the end"),
        "{drawn:#}"
    );
}
