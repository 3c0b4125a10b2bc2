//! `gerono reproduce` as a user runs it: what it writes, that it writes the same again, and how it ends.

#![expect(clippy::disallowed_methods, reason = "tests make their own files")]

use crate::common;

use std::collections::BTreeMap;
use std::path::Path;

use common::{Place, complaint, output, succeed};

/// The contents of a folder, and of the folders in it, by name.
fn files(folder: &Path) -> BTreeMap<String, Vec<u8>> {
    let mut files = BTreeMap::new();
    for entry in std::fs::read_dir(folder).unwrap().map(Result::unwrap) {
        let name = entry.file_name().into_string().unwrap();
        if entry.path().is_dir() {
            let inner = self::files(&entry.path()).into_iter();
            files.extend(inner.map(|(inner, bytes)| (format!("{name}/{inner}"), bytes)));
        } else {
            files.insert(name, std::fs::read(entry.path()).unwrap());
        }
    }
    files
}

#[test]
fn a_figure_is_flown_judged_and_drawn_and_the_same_again() {
    let place = Place::new();
    let printed = ["first", "second"].map(|out| {
        let arguments = ["reproduce", "--figures", "11", "--seeds", "2", "--out", out];
        String::from_utf8(succeed(&mut place.gerono(&arguments)).stdout).unwrap()
    });
    let first = files(&place.path("first"));
    assert_eq!(first, files(&place.path("second")));
    let names: Vec<_> = first.keys().map(String::as_str).collect();
    let flight = "flight-11/report.html";
    assert_eq!(
        names,
        [
            "fig11.svg",
            "figures.md",
            flight,
            "flights.rows",
            "index.html",
            "reproduce.json"
        ]
    );
    let gallery = String::from_utf8_lossy(&first["index.html"]);
    assert!(
        gallery.contains(&format!("href=\"{flight}\"")),
        "the gallery leads to the flight"
    );
    let page = String::from_utf8_lossy(&first[flight]);
    assert!(page.contains("flight-11"), "the page shows its flight");

    for part in [
        "seeds 101 to 102",
        "yaw RMSE, steady, mrad",
        "reached",
        "results: first",
    ] {
        assert!(printed[0].contains(part), "no `{part}` in\n{}", printed[0]);
    }
    let report: serde_json::Value = serde_json::from_slice(&first["reproduce.json"]).unwrap();
    let cells = report["figures"][0]["rows"][0]["cells"].as_array().unwrap();
    assert_eq!(cells.len(), 3, "a cell for every laboratory");
    for cell in cells {
        assert_eq!(cell["verdict"], "reached");
        assert_eq!(
            cell["values"].as_array().unwrap().len(),
            2,
            "a value for every seed"
        );
    }
    // What a process that was killed within its last result leaves.
    let kept = &first["flights.rows"];
    let torn = &kept[..kept.len() - 200];
    std::fs::remove_dir_all(place.path("second")).unwrap();
    std::fs::create_dir(place.path("second")).unwrap();
    std::fs::write(place.path("second/flights.rows.partial"), torn).unwrap();
    let arguments = ["reproduce", "--figures", "11", "--seeds", "2", "--out", "second"];
    succeed(&mut place.gerono(&arguments));
    assert_eq!(first, files(&place.path("second")), "a resumed campaign");
    let other = ["reproduce", "--figures", "11", "--seeds", "3", "--out", "second"];
    let refused = output(&mut place.gerono(&other));
    assert!(
        complaint(&refused).contains("it is of other flights"),
        "{refused:?}"
    );
    assert_eq!(first, files(&place.path("second")), "nothing is lost");
    assert_eq!(place.leftovers(), Vec::<String>::new());
}

#[test]
fn what_is_no_figure_and_a_folder_in_use_are_refused() {
    let place = Place::new();
    let unknown = output(&mut place.gerono(&["reproduce", "--figures", "12"]));
    assert_eq!(unknown.status.code(), Some(2));
    assert!(String::from_utf8_lossy(&unknown.stderr).contains("there is no such figure"));

    std::fs::create_dir(place.path("mine")).unwrap();
    std::fs::write(place.path("mine/notes"), "keep me").unwrap();
    let in_use = output(&mut place.gerono(&["reproduce", "--figures", "1", "--out", "mine"]));
    assert_eq!(in_use.status.code(), Some(4));
    assert_eq!(
        files(&place.path("mine")).len(),
        1,
        "nothing was written beside it"
    );
}
