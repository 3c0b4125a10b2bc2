//! Slips of people at a command line: what they meant is done, or named with the fix.

#![expect(clippy::disallowed_methods, reason = "tests make their own files")]

use command_line::exit::Exit;

use crate::common::{Place, complaint, output, said, scenario, succeed};

/// The text of a message without its line breaks and frame.
fn words(text: &str) -> String {
    let words = text.split_whitespace().filter(|word| !matches!(*word, "│" | "×"));
    words.collect::<Vec<_>>().join(" ")
}

/// A place with the shipped scenarios, as in a clone.
fn clone() -> Place {
    let place = Place::new();
    let scenarios = scenario("fig1");
    std::os::unix::fs::symlink(scenarios.parent().unwrap(), place.path("scenarios")).unwrap();
    place
}

#[test]
fn a_scenario_is_found_by_its_name_and_flown_for_less_time() {
    let place = clone();
    let flown = succeed(&mut place.gerono(&[
        "run",
        "fig1",
        "--host",
        "inprocess",
        "--out",
        "out",
        "--set",
        "duration=1",
    ]));
    assert!(
        said(&flown).contains("fig1, seed 1, inprocess: 1.000 s simulated"),
        "{}",
        said(&flown)
    );
    assert_eq!(
        words(&complaint(&flown)),
        "note: the duration of 1.0 s is that of `--set`: left out what the scenario plans after it, `vehicle.change` at 30.0 s"
    );
    let unknown = output(&mut place.gerono(&["run", "figure1"]));
    assert_eq!(unknown.status.code(), Some(i32::from(Exit::BadInput.code())));
    let shown = words(&complaint(&unknown));
    assert!(shown.contains("scenarios/circle.toml"), "{shown}");
}

#[test]
fn reports_and_figures_are_written_beside_the_log_and_over_nothing_else() {
    let place = Place::new();
    succeed(&mut place.short_flight("out", 0.5, &["--host", "inprocess", "--quiet"]));
    for _ in 0..2 {
        let report = said(&succeed(&mut place.gerono(&["report", "out"])));
        assert_eq!(report.lines().next(), Some("out/report/report.html"));
        assert_eq!(
            said(&succeed(&mut place.gerono(&["plot", "out"]))),
            "out/distance.svg\n"
        );
        assert!(place.path("out/report/report.html").exists() && place.path("out/distance.svg").exists());
    }

    let (page, figure) = (
        place.path("out/report/report.html"),
        place.path("out/distance.svg"),
    );
    std::fs::remove_file(&page).unwrap();
    std::fs::write(place.path("out/report/notes"), "mine").unwrap();
    std::fs::write(&figure, "<svg>mine</svg>").unwrap();
    for (command, reason) in [
        ("report", "it is there already and holds no report"),
        ("plot", "it is there already and is another figure"),
    ] {
        let refused = output(&mut place.gerono(&[command, "out"]));
        assert_eq!(
            refused.status.code(),
            Some(i32::from(Exit::NotWritten.code())),
            "{command}"
        );
        assert!(
            words(&complaint(&refused)).contains(reason),
            "{}",
            complaint(&refused)
        );
    }
    assert!(!page.exists());
    assert_eq!(std::fs::read_to_string(&figure).unwrap(), "<svg>mine</svg>");
}

#[test]
fn a_rule_that_applies_before_and_after_a_change_is_shown_with_the_time_of_the_change() {
    let checked = said(&succeed(&mut clone().gerono(&["check", "fig1"])));
    for row in [
        " the share of z3 that a step removes ",
        " the share of z3 that a step removes, from 30.0 s ",
        " the rate of the angular velocity loop, from 30.0 s ",
    ] {
        assert!(checked.contains(row), "{checked}");
    }
    let rules = checked
        .lines()
        .skip_while(|line| !line.contains("gains and vehicle"));
    for line in rules.take_while(|line| !line.starts_with("order")) {
        assert!(line.chars().count() <= 80, "{line}");
    }
}

#[test]
fn what_is_below_the_ground_is_named_by_check() {
    for (set, key) in [
        ("vehicle.initial.position=[0,0,1]", "`vehicle.initial.position`"),
        ("path.curve={hover={position=[0,0,1]}}", "`path.curve`"),
    ] {
        let checked = said(&succeed(&mut clone().gerono(&["check", "fig1", "--set", set])));
        let warned = checked
            .lines()
            .any(|line| line.starts_with(&format!("warning: {key}")) && line.contains("z points down"));
        assert!(warned, "{checked}");
    }
}
