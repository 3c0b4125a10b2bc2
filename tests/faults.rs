//! `gerono faults` as a user runs it: what it writes, that it writes the same again, that processes fly the same, and what
//! it refuses.

#![expect(clippy::disallowed_methods, reason = "tests make their own files")]

use crate::common;

use std::collections::BTreeMap;
use std::process::{Command, Stdio};

use common::{Place, complaint, output, scenario, succeed};

/// `gerono faults` with Fig. 1's vehicle in hover, begun where it hovers, to the folder `out`.
fn faults(place: &Place, out: &str, more: &[&str]) -> Command {
    let fig1 = scenario("fig1");
    let mut arguments = vec!["faults", fig1.to_str().unwrap(), "--out", out];
    for setting in [
        "duration=4.0",
        "vehicle.change=[]",
        "path.curve={hover={position=[0.0, 0.0, -1.2]}}",
        "vehicle.initial.position=[0.0, 0.0, -1.2]",
    ] {
        arguments.extend(["--set", setting]);
    }
    arguments.extend(more);
    place.gerono(&arguments)
}

fn files(place: &Place, out: &str) -> BTreeMap<String, String> {
    let entries = std::fs::read_dir(place.path(out)).unwrap().map(Result::unwrap);
    entries
        .map(|entry| {
            let name = entry.file_name().into_string().unwrap();
            (name, std::fs::read_to_string(entry.path()).unwrap())
        })
        .collect()
}

fn json(place: &Place, out: &str) -> serde_json::Value {
    serde_json::from_str(&files(place, out)["faults.json"]).unwrap()
}

#[test]
fn faults_are_flown_judged_and_told_and_the_same_again() {
    let place = Place::new();
    let narrowed = [
        "--moments",
        "2.0,1.0",
        "--after",
        "1.0",
        "--fault",
        "off,delay",
        "--service",
        "controller",
        "--edge",
        "rc/frame -> plant",
    ];
    let printed = ["first", "second"].map(|out| {
        let printed = succeed(&mut faults(&place, out, &narrowed)).stdout;
        String::from_utf8(printed).unwrap()
    });
    for part in [
        "fig1, seed 1: faults of 0.1 s at 1, 2 s",
        "undisturbed",
        "off-warm",
        "off-cold",
        "rc/frame -> plant",
        "survived",
        "6 faults: ",
        "results: first",
    ] {
        assert!(printed[0].contains(part), "no `{part}` in\n{}", printed[0]);
    }
    let first = files(&place, "first");
    assert_eq!(first, files(&place, "second"));
    assert_eq!(
        first.keys().collect::<Vec<_>>(),
        ["faults.json", "faults.md", "flights.rows"]
    );
    assert!(first["faults.md"].contains("| controller | off-cold | "));

    let report = json(&place, "first");
    let rows = report["rows"].as_array().unwrap();
    let names: Vec<_> = rows
        .iter()
        .map(|row| (row["target"].as_str(), row["fault"].as_str()))
        .collect();
    let controller = Some("controller");
    let expected = [
        (None, None),
        (controller, Some("off-warm")),
        (controller, Some("off-cold")),
        (Some("rc/frame -> plant"), Some("delay")),
    ];
    assert_eq!(names, expected);
    for row in rows {
        let cells = row["cells"].as_array().unwrap();
        assert_eq!(cells.len(), 2, "one for every moment");
        for (cell, begins) in cells.iter().zip([1.0, 2.0]) {
            assert_eq!(cell["moment"], begins);
            assert_eq!(cell["report"]["begins"], begins);
            assert_eq!(cell["report"]["watched_until"], begins + 1.1);
            assert!(cell["report"]["peak_error"].as_f64().unwrap() < 0.5);
        }
    }
    assert_eq!(place.leftovers(), Vec::<String>::new());
}

#[test]
fn a_matrix_that_is_killed_resumes_and_ends_with_the_same_bytes() {
    let place = Place::new();
    let all_at_once = ["--moments", "1.0", "--after", "0.3"];
    succeed(&mut faults(&place, "whole", &all_at_once));

    let partial = place.path("killed/flights.rows.partial");
    let mut command = faults(&place, "killed", &all_at_once);
    let mut child = command
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    while std::fs::metadata(&partial).map_or(0, |metadata| metadata.len()) < 4096 {
        assert!(
            child.try_wait().unwrap().is_none(),
            "it ended before it was killed"
        );
        std::thread::yield_now();
    }
    child.kill().unwrap();
    child.wait().unwrap();
    assert!(partial.exists(), "it was killed too late");

    let other = output(&mut faults(
        &place,
        "killed",
        &["--moments", "1.0", "--after", "0.4"],
    ));
    assert_eq!(other.status.code(), Some(2));
    assert!(complaint(&other).contains("it is of other flights"), "{other:?}");
    succeed(&mut faults(&place, "killed", &all_at_once));
    assert_eq!(files(&place, "killed"), files(&place, "whole"));
    assert_eq!(place.leftovers(), Vec::<String>::new());
}

#[test]
fn processes_that_really_die_fly_every_cell_with_the_same_bytes() {
    let place = Place::new();
    let narrowed = [
        "--moments",
        "0.5",
        "--after",
        "0.4",
        "--fault",
        "off-cold,freeze",
        "--service",
        "controller,estimator",
        "--processes",
    ];
    let printed = succeed(&mut faults(&place, "processes", &narrowed)).stdout;
    let printed = String::from_utf8(printed).unwrap();
    assert!(printed.contains("every flight had the same bytes"), "{printed}");
    let report = json(&place, "processes");
    assert_eq!(report["compared_with_processes"], true);
    assert_eq!(report["differences"], serde_json::json!([]));
    assert_eq!(report["rows"].as_array().unwrap().len(), 5);
    assert_eq!(place.leftovers(), Vec::<String>::new());
}

#[test]
fn to_lose_the_vehicle_is_a_result_and_no_error() {
    let place = Place::new();
    let blind = [
        "--moments",
        "1.0",
        "--for",
        "2.0",
        "--after",
        "1.0",
        "--service",
        "rc_output",
        "--fault",
        "freeze",
        "--set",
        "vehicle.disturbance=[3.0, 0.0, 0.0]",
    ];
    succeed(&mut faults(&place, "lost", &blind));
    let report = json(&place, "lost");
    assert_eq!(report["rows"][0]["worst"], "survived", "without a fault");
    assert_eq!(report["rows"][1]["worst"], "lost");
    assert_eq!(report["counts"]["lost"], 1);
}

#[test]
fn what_cannot_be_flown_is_refused_with_what_to_do_and_nothing_is_written() {
    let place = Place::new();
    let planned = "fault=[{at=1.0, service=\"controller\", kind=\"off\", for=0.1}]";
    for (arguments, piece) in [
        (&["--set", planned][..], "--set fault=[]"),
        (&["--service", "plant"], "cannot fail"),
        (&["--service", "controler"], "did you mean `controller`?"),
        (
            &["--edge", "mocap/pose -> estimatr"],
            "did you mean `mocap/pose -> estimator`",
        ),
        (&["--fault", "dealy"], "did you mean `delay`"),
        (
            &["--service", "controller", "--fault", "delay"],
            "no case is left",
        ),
        (&["--moments", "4.5"], "before the end of the flight"),
        (&["--moments", "1.0005"], "whole number of base ticks"),
        (&["--for", "0"], "give 0.000001 to"),
        (&["--moments", "1.0", "--quick"], "cannot be used with"),
    ] {
        let refused = output(&mut faults(&place, "refused", arguments));
        let errors = complaint(&refused);
        assert_eq!(refused.status.code(), Some(2), "{errors}");
        assert!(errors.contains(piece), "{piece} is not in {errors}");
        assert!(!place.path("refused").exists(), "{piece}");
    }
    std::fs::create_dir(place.path("mine")).unwrap();
    std::fs::write(place.path("mine/notes"), "keep me").unwrap();
    assert_eq!(output(&mut faults(&place, "mine", &[])).status.code(), Some(4));
}
