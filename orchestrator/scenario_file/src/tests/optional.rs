//! Sections that a scenario may have: their keys, types and values are checked as those of the others.

use super::*;

#[test]
fn a_scenario_of_the_laboratory_is_read_as_it_is_written() {
    let scenario = load_text(LABORATORY, &[]).unwrap();
    let cameras = scenario.cameras.unwrap();
    assert_eq!((cameras.jitter, cameras.occlusion[1].lasts), (0.002, 0.5));
    assert_eq!(scenario.vehicle.fan.unwrap().moves[0].position, [-1.5, 0.0, -1.2]);
    assert_eq!(scenario.rc_output.unwrap().resolution, 12);
    assert!(!scenario.estimator.unwrap().kalman.prediction);
    assert_eq!(scenario.model.unwrap().capture_latency, Some(0.004));
}

#[test]
fn a_scenario_as_flown_is_read_back_as_it_was() {
    for text in [fig1(), LABORATORY.to_owned()] {
        let scenario = load_text(&text, &[]).unwrap();
        let json = serde_json::to_string(&scenario).unwrap();
        assert_eq!(serde_json::from_str::<Scenario>(&json).unwrap(), scenario);
    }
}

#[test]
fn an_ideal_scenario_has_none_of_them_and_does_not_mention_them() {
    let json = serde_json::to_value(load_text(&fig1(), &[]).unwrap()).unwrap();
    for pointer in [
        "/cameras",
        "/estimator",
        "/motion_capture",
        "/rc_output",
        "/model",
        "/flight",
        "/envelope",
        "/vehicle/actuators",
        "/vehicle/drag",
        "/vehicle/turbulence",
        "/vehicle/fan",
        "/vehicle/center_of_mass",
        "/vehicle/change/0/center_of_mass",
        "/path/yaw_step",
        "/controller/rates",
        "/controller/observer_gain",
    ] {
        assert_eq!(json.pointer(pointer), None, "{pointer}");
    }
}

#[test]
fn a_misspelt_key_is_refused_with_the_nearest() {
    for (part, replacement, key, nearest) in [
        ("jitter = 0.002", "jiter = 0.002", "cameras.jiter", "jitter"),
        (
            "prediction = false",
            "predict = false",
            "estimator.kalman.predict",
            "prediction",
        ),
        ("off_at = 25.0", "of_at = 25.0", "vehicle.fan.of_at", "off_at"),
        (
            "yaw_kp = 3.0",
            "yaw_pk = 3.0",
            "controller.rates.yaw_pk",
            "yaw_kp",
        ),
        (
            "at = 12.0, lasts",
            "at = 12.0, last",
            "cameras.occlusion.1.last",
            "lasts",
        ),
        ("[rc_output]", "[rc_ouput]", "rc_ouput", "rc_output"),
        (
            "[vehicle.actuators]",
            "[vehicle.actuator]",
            "vehicle.actuator",
            "actuators",
        ),
    ] {
        let shown = refusal(&with(LABORATORY, part, replacement), &[]);
        for piece in [
            &format!("`{key}` is unknown"),
            &format!("did you mean `{nearest}`?"),
        ] {
            assert!(shown.contains(piece), "no `{piece}` in:\n{shown}");
        }
    }
}

#[test]
fn a_value_of_another_type_is_refused_with_the_wanted_one() {
    for (part, replacement, key, reason) in [
        (
            "prediction = false",
            "prediction = 0",
            "estimator.kalman.prediction",
            "`true` or `false` is expected here, not integer `0`",
        ),
        (
            "resolution = 12",
            "resolution = 12.5",
            "rc_output.resolution",
            "a whole number of 0 or more is expected here, not floating point `12.5`",
        ),
        (
            "resolution = 12",
            "resolution = -12",
            "rc_output.resolution",
            "a whole number of 0 or more is expected here, not integer `-12`",
        ),
        (
            "thrust_range = [-1.0, 1.0]",
            "thrust_range = [-1.0]",
            "rc_output.thrust_range",
            "an array of two numbers is expected here, not one of length 1",
        ),
        (
            "thrust_range = [-1.0, 1.0]",
            "thrust_range = [-1.0, 0.0, 1.0]",
            "rc_output.thrust_range",
            "2 elements are expected here, not 3",
        ),
        (
            "off_at = 25.0",
            "off_at = \"never\"",
            "vehicle.fan.off_at",
            "a number is expected here, not the string \"never\"",
        ),
        (
            "drag = [0.05, 0.05, 0.0]",
            "drag = 0.05",
            "vehicle.drag",
            "an array of three numbers is expected here, not floating point `0.05`",
        ),
    ] {
        let text = with(LABORATORY, part, replacement);
        let wrong = format!("`{key}` has the wrong type");
        refused_on_line(&text, line_of(&text, replacement), &[&wrong, reason, "help: "]);
    }
}

/// The zeros of a vector stand for "none" and are not part of the scenario as flown: what is too much is found all
/// the same.
#[test]
fn a_fourth_number_after_three_zeros_is_refused() {
    let text = with(
        LABORATORY,
        "drag = [0.05, 0.05, 0.0]",
        "drag = [0.0, 0.0, 0.0, 0.1]",
    );
    refused_on_line(
        &text,
        line_of(&text, "drag = "),
        &[
            "`vehicle.drag` has the wrong type",
            "3 elements are expected here, not 4",
        ],
    );
}

#[test]
fn something_else_in_place_of_a_table_is_refused_with_what_the_table_holds() {
    let ideal = fig1();
    for (set, key, reason) in [
        (
            "cameras=true",
            "cameras",
            "a table is expected here, not boolean `true`",
        ),
        (
            "estimator=kalman",
            "estimator",
            "a table is expected here, not the string \"kalman\"",
        ),
        (
            "model=[0.2, [0.1, 0.1, 0.1]]",
            "model",
            "a table is expected here, not an array",
        ),
        (
            "vehicle.fan=1",
            "vehicle.fan",
            "a table is expected here, not integer `1`",
        ),
    ] {
        let shown = refusal(&ideal, &[set]);
        for piece in [
            &format!("`{key}` has the wrong type"),
            reason,
            &format!("`{key}` is a table that holds `"),
        ] {
            assert!(shown.contains(piece), "no `{piece}` in:\n{shown}");
        }
    }
}

#[test]
fn a_missing_key_is_refused_with_what_it_is() {
    let shown = refusal(&with(LABORATORY, "reference_distance = 1.5\n", ""), &[]);
    for piece in [
        "`vehicle.fan.reference_distance` is missing",
        "`vehicle.fan.reference_distance` is a number above 0: Distance from the fan for which `force` is stated, m",
    ] {
        assert!(shown.contains(piece), "no `{piece}` in:\n{shown}");
    }
    let shown = refusal(&fig1(), &["estimator={}"]);
    assert!(shown.contains("`estimator.kalman` is missing"), "{shown}");
}

#[test]
fn an_argument_makes_a_table_that_the_file_does_not_have() {
    let without = with(
        LABORATORY,
        "[vehicle.turbulence]\ndeviation = 0.05\ncorrelation_time = 1.0\n",
        "",
    );
    let sets = [
        "vehicle.turbulence.deviation=0.1",
        "vehicle.turbulence.correlation_time=2",
        "cameras.occlusion.2.at=14",
        "cameras.occlusion.2.lasts=1.0",
        "path.yaw_step.0.at=3",
        "path.yaw_step.0.yaw=0.5",
    ];
    let scenario = load_text(&without, &sets).unwrap_or_else(|error| panic!("{}", narrated(&error)));
    assert_eq!(scenario.vehicle.turbulence.unwrap().deviation, 0.1);
    assert_eq!(scenario.cameras.unwrap().occlusion[2].at, 14.0);
    assert_eq!(scenario.path.yaw_step[0].yaw, 0.5);
}

#[test]
fn an_empty_table_is_a_section_with_its_defaults() {
    let empty = with(LABORATORY, "resolution = 12\nthrust_range = [-1.0, 1.0]\n", "");
    let scenario = load_text(&empty, &[]).unwrap();
    assert_eq!(scenario.rc_output, Some(scenario::RcLink::default()));
}

#[test]
fn an_argument_takes_the_place_of_a_value_in_an_optional_table() {
    let sets = [
        "cameras.jitter=0.003",
        "rc_output.thrust_range.0=-0.5",
        "estimator.kalman.prediction=true",
    ];
    let scenario = load_text(LABORATORY, &sets).unwrap();
    assert_eq!(scenario.cameras.unwrap().jitter, 0.003);
    assert_eq!(scenario.rc_output.unwrap().thrust_range, [-0.5, 1.0]);
    assert!(scenario.estimator.unwrap().kalman.prediction);
    let shown = refusal(LABORATORY, &["cameras.frame_loss=1.5"]);
    for piece in ["Begin snippet for --set", "frame_loss = 1.5 is not below 1"] {
        assert!(shown.contains(piece), "no `{piece}` in:\n{shown}");
    }
}

#[test]
fn a_value_that_cannot_be_flown_is_refused_at_its_line() {
    for (part, replacement, reason) in [
        ("jitter = 0.002", "jitter = 0.02", "but their period is 0.01 s"),
        ("off_at = 25.0", "off_at = 4.0", "but not on before 5.0 s"),
        (
            "{ at = 12.0, lasts = 0.5 }",
            "{ at = 8.1, lasts = 0.5 }",
            "before the one at 8.0 s ends at 8.3 s",
        ),
        (
            "thrust_range = [-1.0, 1.0]",
            "thrust_range = [0.0, 1.0]",
            "N must be commanded to hold the vehicle in the air",
        ),
        (
            "radio_latency = 0.006",
            "radio_latency = 0.3",
            "radio_latency = 0.3 is above 0.2",
        ),
    ] {
        let text = with(LABORATORY, part, replacement);
        refused_on_line(&text, line_of(&text, replacement), &[reason, "help: "]);
    }
}

/// A section that another one needs is shown where the need arises.
#[test]
fn a_section_that_lacks_another_is_refused_at_its_table() {
    let text = with(
        LABORATORY,
        "[model]\nradio_latency = 0.006\ncapture_latency = 0.004\n",
        "",
    );
    refused_on_line(
        &text,
        line_of(&text, "[controller.rates]"),
        &[
            "by a model of the vehicle, but there is none",
            "help: add `[model]`",
        ],
    );
}

/// Phases and an envelope for fig1.toml, which flies in the air.
const PHASES: &str = r#"
[flight]
arm_at = 1.0                    # s
landing_speed = 0.2             # m/s

[envelope]
tilt = { max = 0.8, action = "kill" }
estimate = { position_sigma = 0.05, action = "land" }
"#;

#[test]
fn phases_and_an_envelope_are_read_as_they_are_written() {
    let text = fig1() + PHASES;
    let scenario = load_text(&text, &[]).unwrap();
    assert_eq!(scenario.flight.unwrap().landing_speed, 0.2);
    let envelope = scenario.envelope.unwrap();
    assert_eq!(envelope.tilt.unwrap().action, scenario::Action::Kill);
    assert_eq!(envelope.land_within, 20.0);
}

#[test]
fn mistakes_in_phases_and_envelope_are_shown_where_they_are() {
    for (part, replacement, pieces) in [
        (
            "arm_at = 1.0",
            "armat = 1.0",
            ["`flight.armat` is unknown", "did you mean `arm_at`?"],
        ),
        (
            "arm_at = 1.0",
            "arm_at = 99.0",
            ["after the end of the flight", "raise `duration`"],
        ),
        ("\"kill\"", "\"stop\"", ["`stop` is not known here", "`kill`"]),
        ("max = 0.8", "max = 4.0", ["upside down is π", "below π"]),
        (
            "landing_speed = 0.2",
            "landing_speed = 0.0",
            ["is below 0.01", "give a number from 0.01 to 3; in m/s"],
        ),
    ] {
        let text = with(&(fig1() + PHASES), part, replacement);
        refused_on_line(&text, line_of(&text, replacement), &pieces);
    }
}
