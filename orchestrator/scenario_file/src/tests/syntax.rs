//! Texts that are no TOML, or whose keys and types are not those of a scenario.

use super::*;

#[test]
fn a_syntax_error_is_refused_at_its_place() {
    let text = with(&fig1(), "k2 = 4.0", "k2 = [4.0");
    refused_on_line(
        &text,
        line_of(&text, "k3 = 13.0"),
        &["this is not TOML", "help: see https://toml.io"],
    );
    let text = with(&fig1(), "k2 = 4.0", "k1 = 4.0");
    let second = text.rfind("k1 = 4.0").unwrap();
    refused_on_line(
        &text,
        text[..second].matches('\n').count() + 1,
        &["this is not TOML", "duplicate key"],
    );
}

#[test]
fn a_decimal_comma_and_a_unit_in_a_file_are_named() {
    for (written, help) in [
        ("k2 = 4,5  # 1/s", "help: the decimal sign is a point: write 4.5"),
        ("k2 = 4 s", "help: a value has no unit here: write 4"),
    ] {
        let text = with(&fig1(), "k2 = 4.0", written);
        refused_on_line(&text, line_of(&text, written), &["this is not TOML", help]);
    }
}

#[test]
fn a_text_that_ends_too_early_is_refused_at_its_end() {
    refused_on_line("duration = ", 1, &["this is not TOML"]);
    refused_on_line("duration = 1.0\n[vehicle", 2, &["this is not TOML"]);
}

#[test]
fn an_empty_text_is_refused_for_what_it_lacks() {
    let shown = refusal("", &[]);
    for piece in [
        "3 problems in flight.toml",
        "`duration` is missing",
        "`duration` is a number above 0: Length of the flight, s",
        "`path` is missing",
        "`vehicle` is missing",
        "label at line 1, column",
    ] {
        assert!(shown.contains(piece), "no `{piece}` in:\n{shown}");
    }
}

#[test]
fn a_misspelt_key_is_refused_with_the_nearest_and_all_known_ones() {
    let text = with(&fig1(), "sigma_max = 1.5", "sigmamax = 1.5");
    refused_on_line(
        &text,
        line_of(&text, "sigmamax"),
        &[
            "`controller.sigmamax` is unknown",
            "there is no key `sigmamax` here",
            "help: did you mean `sigma_max`? Known are: `baseline`, `beta`, `bounds`, `change`, `delta`",
        ],
    );
}

#[test]
fn a_key_below_the_header_of_another_table_is_refused_with_its_own_place() {
    let cases = [
        (
            "lambda_mass = 0.3",
            "`lambda_mass` belongs to `controller`: write it directly below `[controller]`",
        ),
        (
            "seed = 7",
            "`seed` belongs to no table: write it above the first `[...]` of the file",
        ),
    ];
    for (late, fix) in cases {
        let below = format!("{}\n{late}\n", fig1());
        refused_on_line(&below, below.lines().count(), &[" is unknown", fix]);
    }
}

#[test]
fn a_misspelt_table_is_refused_with_the_nearest() {
    let text = with(&fig1(), "[controller.bounds]", "[controler.bounds]");
    refused_on_line(
        &text,
        line_of(&text, "[controler.bounds]"),
        &["`controler` is unknown", "did you mean `controller`?"],
    );
}

#[test]
fn a_misspelt_key_in_a_change_is_refused_at_that_change() {
    let text = with(&fig1(), "mass = 0.245", "mas = 0.245");
    refused_on_line(
        &text,
        line_of(&text, "mas = 0.245"),
        &["`vehicle.change.0.mas` is unknown", "did you mean `mass`?"],
    );
}

#[test]
fn all_unknown_keys_and_all_wrong_values_are_reported_at_once() {
    let text = with(&fig1(), "sigma_max = 1.5", "sigmamax = 1.5");
    let text = with(&text, "mass = 0.245", "mas = 0.245");
    let text = with(&text, "k4 = 1.0", "k4 = -1.0");
    let shown = refusal(&text, &[]);
    for piece in [
        "3 problems in flight.toml",
        "`controller.sigmamax` is unknown",
        "`vehicle.change.0.mas` is unknown",
        "`path.k4` cannot be flown",
    ] {
        assert!(shown.contains(piece), "no `{piece}` in:\n{shown}");
    }
}

#[test]
fn an_unknown_curve_is_refused_with_the_known_ones() {
    let text = with(&fig1(), "[path.curve.tilted_eight]", "[path.curve.tilted_eigth]");
    refused_on_line(
        &text,
        line_of(&text, "[path.curve.tilted_eigth]"),
        &[
            "`path.curve.tilted_eigth` is none of the choices",
            "did you mean `tilted_eight`?",
            "`waypoints`",
        ],
    );
}

#[test]
fn an_unknown_mode_is_refused_with_the_known_ones() {
    let text = with(&fig1(), "mode = \"following\"", "mode = \"folowing\"");
    refused_on_line(
        &text,
        line_of(&text, "mode = "),
        &[
            "`path.mode` is none of the choices",
            "`folowing` is not known here",
            "did you mean `following`?",
        ],
    );
}

#[test]
fn two_curves_are_refused() {
    let text = fig1() + "\n[path.curve.hover]\nposition = [0.0, 0.0, -1.0]\n";
    refused_on_line(
        &text,
        line_of(&text, "[path.curve.tilted_eight]"),
        &[
            "exactly one choice is expected here",
            "state one of `tilted_eight`, `hover`",
        ],
    );
}

#[test]
fn a_missing_key_is_refused_at_its_table_with_what_it_is() {
    let text = with(&fig1(), "mass = 0.2                      # m, kg\n", "");
    refused_on_line(
        &text,
        line_of(&text, "\n[vehicle]\n") + 1,
        &[
            "`vehicle.mass` is missing",
            "must be stated here",
            "help: `vehicle.mass` is a number above 0: m, kg",
        ],
    );
    let text = with(&fig1(), "at = 30.0 ", "# ");
    refused_on_line(
        &text,
        line_of(&text, "\n[[vehicle.change]]\n") + 1,
        &[
            "`vehicle.change.0.at` is missing",
            "help: `vehicle.change.0.at` is a number of 0 or more: Time of the change, s",
        ],
    );
}

#[test]
fn a_value_of_another_type_is_refused_with_the_wanted_one() {
    for (part, replacement, key, reason) in [
        (
            "mass = 0.245",
            "mass = \"heavy\"",
            "vehicle.change.0.mass",
            "a number is expected here, not the string \"heavy\"",
        ),
        (
            "seed = 1 ",
            "seed = -1 ",
            "seed",
            "a whole number of 0 or more is expected here, not integer `-1`",
        ),
        (
            "k3 = 13.0",
            "k3 = [13.0]",
            "controller.k3",
            "a number is expected here, not an array",
        ),
        (
            "k3 = 13.0",
            "k3 = true",
            "controller.k3",
            "a number is expected here, not boolean `true`",
        ),
        (
            "k3 = 13.0",
            "k3 = 1e999",
            "controller.k3",
            "floating-point number overflowed",
        ),
        (
            "position = [0.0, 0.0, 0.0]",
            "position = [0.0, 0.0]",
            "vehicle.initial.position",
            "an array of three numbers is expected here, not one of length 2",
        ),
        (
            "position = [0.0, 0.0, 0.0]",
            "position = [0.0, 0.0, 0.0, 0.0]",
            "vehicle.initial.position",
            "3 elements are expected here, not 4",
        ),
        (
            "position = [0.0, 0.0, 0.0]",
            "position = 0.0",
            "vehicle.initial.position",
            "an array of three numbers is expected",
        ),
    ] {
        let text = with(&fig1(), part, replacement);
        let wrong = format!("`{key}` ");
        refused_on_line(&text, line_of(&text, replacement), &[&wrong, reason, "help: "]);
    }
}

/// serde reads a struct from an array in the order of its fields; nobody who writes a scenario means that.
#[test]
fn an_array_in_place_of_a_table_is_refused() {
    let text =
        "duration = 1.0\nvehicle = [0.2, [6.5e-4, 6.5e-4, 13e-4]]\npath.curve.hover.position = [0, 0, -1]\n";
    refused_on_line(
        text,
        2,
        &[
            "`vehicle` has the wrong type",
            "a table is expected here, not an array",
        ],
    );
}

#[test]
fn a_whole_number_is_a_number() {
    let text =
        "duration = 1\nvehicle = {mass = 0.2, inertia = [1, 1, 1]}\npath.curve.hover.position = [0, 0, -1]\n";
    assert_eq!(load_text(text, &[]).unwrap().vehicle.inertia, [1.0; 3]);
}

#[test]
fn numbers_may_be_written_in_every_way_that_toml_knows() {
    for (seed, value) in [
        ("1_000", 1000),
        ("0x1_f", 31),
        ("0o17", 15),
        ("0b11", 3),
        ("+5", 5),
    ] {
        let text = with(&fig1(), "seed = 1 ", &format!("seed = {seed} "));
        assert_eq!(load_text(&text, &[]).unwrap().seed, value, "{seed}");
    }
    for k3 in ["1_3.0", "13e0", "+13", "1.3E1"] {
        let text = with(&fig1(), "k3 = 13.0", &format!("k3 = {k3}"));
        assert_eq!(load_text(&text, &[]).unwrap().controller.k3, 13.0, "{k3}");
    }
}

#[test]
fn all_that_is_missing_and_of_a_wrong_type_is_told_at_once() {
    let text = with(&fig1(), "mass = 0.2                      # m, kg\n", "");
    let text = with(&text, "k3 = 13.0", "k3 = \"13\"");
    let text = with(&text, "mode = \"following\"", "mode = 1");
    let shown = refusal(&text, &[]);
    for piece in [
        "3 problems in flight.toml",
        "`vehicle.mass` is missing",
        "a number is expected here, not the string \"13\"",
        "a word is expected here, not integer `1`",
    ] {
        assert!(shown.contains(piece), "no `{piece}` in:\n{shown}");
    }
}

#[test]
fn a_text_of_nothing_but_unknown_keys_is_not_read_to_its_end() {
    let text: String = (0..10_000).map(|index| format!("key{index} = 1\n")).collect();
    let shown = refusal(&text, &[]);
    assert!(shown.contains("20 problems in flight.toml"), "{shown}");
}

/// Returns the message on a terminal about the error of a text.
fn drawn(text: &str) -> String {
    let error = load_text(text, &[]).expect_err("the scenario is wrong");
    let mut shown = String::new();
    miette::GraphicalReportHandler::new_themed(miette::GraphicalTheme::unicode_nocolor())
        .render_report(&mut shown, &error)
        .expect("the labels lie inside the source");
    shown
}

#[test]
fn of_a_long_line_the_part_around_the_place_is_shown() {
    let digits = "1".repeat(70_000);
    let text = format!("# before\nseed = \"{digits}\" nonsense\n# {digits}\n");
    let shown = drawn(&text);
    assert!(shown.len() < 4000, "{} bytes", shown.len());
    assert!(
        shown.contains("nonsense") && shown.contains("# before"),
        "{shown}"
    );
    assert!(shown.contains("[flight.toml:2:70011]"), "{shown}");
    let narrated = refusal(&text, &[]);
    assert!(narrated.contains("column 70011 of a long line"), "{narrated}");
    let sentence = format!("{:#}", load_text(&text, &[]).unwrap_err());
    assert!(sentence.starts_with("flight.toml:2:70011: "), "{sentence}");
}

#[test]
fn control_characters_of_a_file_do_not_reach_the_terminal() {
    for hostile in ["\x1b[2J", "\x1b]0;owned\x07", "\u{9b}31m", "\u{202e}", "a\rb"] {
        let text = format!("# {hostile}\nduration = 1.0 {hostile}\n\"key {hostile}\" = 1\n");
        for shown in [
            drawn(&text),
            refusal(&text, &[]),
            format!("{:#}", load_text(&text, &[]).unwrap_err()),
        ] {
            let kept = |character: &char| matches!(character, '\n');
            let all = shown.chars().filter(|character| !kept(character));
            let visible = crate::printable::printable(&all.collect::<String>()).into_owned();
            assert!(!visible.contains("\\u"), "{visible}");
        }
    }
}

#[test]
fn a_key_with_control_characters_is_told_with_their_numbers() {
    let shown = refusal("\"\\u001b[2J\" = 1\n", &[]);
    assert!(!shown.contains('\x1b') && shown.contains("u001b[2J"), "{shown}");
}
