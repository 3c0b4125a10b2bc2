//! Files that are not there, and files that are no text.

#![expect(clippy::disallowed_methods, reason = "tests make their own files")]

use super::*;

fn load_error(path: &Path) -> String {
    narrated(&load(path, &[], None).expect_err("the file is wrong"))
}

#[test]
fn a_missing_file_is_refused_with_the_nearest_scenario() {
    let shown = load_error(&repository("scenarios/fig1x.toml"));
    assert!(shown.contains("there is no such file"), "{shown}");
    assert!(
        shown.contains("help: did you mean") && shown.contains("fig1.toml?"),
        "{shown}"
    );
}

#[test]
fn a_scenario_named_without_folder_or_ending_is_found_in_the_scenarios_folder() {
    let shown = load_error(&repository("fig2_far"));
    assert!(shown.contains("did you mean"), "{shown}");
    assert!(shown.contains("scenarios/fig2_far.toml?"), "{shown}");
}

#[test]
fn a_name_that_no_scenario_has_is_refused_with_all_names() {
    let advice = crate::read::nearest_scenario(Path::new("fig1x"), &[repository("scenarios")]);
    assert!(
        advice.starts_with("did you mean ")
            && advice.contains("fig1.toml? There are another_vehicle, circle, "),
        "{advice}"
    );
}

#[test]
fn a_missing_file_unlike_any_other_is_refused_with_all_that_there_are() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("loop.toml"), "").unwrap();
    std::fs::write(folder.path().join("notes.txt"), "").unwrap();
    let shown = load_error(&folder.path().join("entirely_different.toml"));
    assert!(
        shown.contains("help: there are") && shown.contains("loop.toml"),
        "{shown}"
    );
    assert!(!shown.contains("notes.txt"), "{shown}");
}

#[test]
fn a_missing_file_where_there_are_no_scenarios_is_refused_with_an_example() {
    let folder = tempfile::tempdir().unwrap();
    let shown = load_error(&folder.path().join("nowhere/fig1.toml"));
    assert!(shown.contains("such as scenarios/fig1.toml"), "{shown}");
}

#[test]
fn a_folder_is_refused_with_the_scenarios_in_it() {
    let shown = load_error(&repository("scenarios"));
    assert!(shown.contains("it is a folder"), "{shown}");
    assert!(
        shown.contains("there are") && shown.contains("fig1.toml"),
        "{shown}"
    );
}

#[test]
fn a_file_that_is_not_utf8_is_refused_at_its_first_bad_byte() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("latin1.toml");
    std::fs::write(&path, b"duration = 60.0\n# 10 \xb5s of latency\n").unwrap();
    let shown = load_error(&path);
    for piece in [
        "label at line 2, column 6",
        "byte 0xb5 at offset 21 is not UTF-8 text",
        "help: save the file as UTF-8",
    ] {
        assert!(shown.contains(piece), "no `{piece}` in:\n{shown}");
    }
}

#[test]
fn a_file_of_another_kind_is_called_so_and_not_shown() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("program.toml");
    std::fs::write(&path, b"\x7fELF\x02\x01\x01\0\x1b[2J\xff").unwrap();
    let shown = load_error(&path);
    assert!(shown.contains("it is not text: byte 7 is 0"), "{shown}");
    assert!(!shown.contains("ELF"), "{shown}");
}

#[test]
fn a_file_longer_than_any_scenario_is_not_read_to_its_end() {
    let shown = load_error(Path::new("/dev/zero"));
    assert!(shown.contains("it is longer than 1048576 bytes"), "{shown}");
}

#[test]
fn a_seed_takes_the_place_of_the_files() {
    let fig1 = repository("scenarios/fig1.toml");
    assert_eq!(load(&fig1, &[], Some(u64::MAX)).unwrap().seed, u64::MAX);
    assert_eq!(load(&fig1, &["seed=7".to_owned()], None).unwrap().seed, 7);
    assert_eq!(load(&fig1, &["seed=7".to_owned()], Some(8)).unwrap().seed, 8);
}

#[test]
fn a_problem_of_the_use_of_a_scenario_is_shown_at_its_key() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("fig1.toml");
    let text = fig1();
    std::fs::write(&path, &text).unwrap();
    let problem = Problem::new(path_of("duration").unwrap(), "too long for this", "shorten it");
    let error = crate::refusal(&path, &[], &problem);
    let place = format!("fig1.toml:{}:", line_of(&text, "\nduration = ") + 1);
    let shown = format!("{error:#}");
    assert!(
        shown.contains(&place) && shown.contains("too long for this; shorten it"),
        "{shown}"
    );
    let set = crate::refusal(&path, &["duration=61.0".to_owned()], &problem);
    assert!(format!("{set:#}").contains("--set:1:"), "{set:#}");
}
