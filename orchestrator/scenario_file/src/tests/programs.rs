//! External services.

#![expect(clippy::disallowed_methods, reason = "tests make their own files")]

use shared_types::ServiceId;

use super::*;

const PROGRAMS: &str = r#"
[programs]
controller = ["python3", "controller.py"]
"#;

#[test]
fn a_program_is_read_with_its_arguments_and_nothing_is_said_of_other_services() {
    let scenario = load_text(&(fig1() + PROGRAMS), &[]).unwrap();
    let words = scenario.program_of(ServiceId::Controller).unwrap();
    assert_eq!(words, ["python3", "controller.py"]);
    assert_eq!(scenario.program_of(ServiceId::Plant), None);
}

#[test]
fn an_argument_names_a_program_or_none() {
    let sets = ["programs.plant=[\"./plant\"]"];
    let scenario = load_text(&fig1(), &sets).unwrap();
    assert_eq!(scenario.program_of(ServiceId::Plant).unwrap(), ["./plant"]);
    let scenario = load_text(&(fig1() + PROGRAMS), &["programs={}"]).unwrap();
    assert_eq!(scenario.program_of(ServiceId::Controller), None);
}

#[test]
fn programs_lie_where_the_file_does() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("mine.toml");
    std::fs::write(&file, fig1() + PROGRAMS).unwrap();
    let folder_of = |sets: &[&str]| {
        let sets: Vec<String> = sets.iter().map(ToString::to_string).collect();
        load(&file, &sets, None)
            .unwrap()
            .programs
            .unwrap()
            .folder
            .unwrap()
    };
    assert_eq!(folder_of(&[]), folder.path());
    assert_eq!(folder_of(&["programs.folder=build"]), folder.path().join("build"));
}

#[test]
fn what_names_no_program_is_refused_at_its_line() {
    for (words, pieces) in [
        (
            "[]",
            ["it names no program", "help: give the program and its arguments"],
        ),
        (
            "\"controller.py\"",
            [
                "an array is expected here, not the string",
                "`programs.controller` is an array, each element a string",
            ],
        ),
    ] {
        let line = format!("controller = {words}");
        let text = with(
            &(fig1() + PROGRAMS),
            "controller = [\"python3\", \"controller.py\"]",
            &line,
        );
        refused_on_line(&text, line_of(&text, &line), &pieces);
    }
}

#[test]
fn the_example_can_be_flown() {
    let example = repository("examples/python_controller/hover.toml");
    let scenario = load(&example, &[], None).unwrap();
    assert!(scenario.program_of(ServiceId::Controller).is_some());
    let folder = scenario.programs.unwrap().folder.unwrap();
    assert!(folder.join("controller.py").is_file());
}
