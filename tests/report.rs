//! `gerono report`: a page that needs nothing else and shows what the logs hold, whatever became of them.

#![expect(clippy::disallowed_methods, reason = "tests make their own files")]

use crate::common;

use std::path::{Path, PathBuf};

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use common::{Place, output, scenario, succeed};
use metrics::tracker::Tracker;
use run_log::LogReader;
use serde_json::Value;

/// The largest size of a page that shows a flight of a minute at 1 kHz, bytes.
const LARGEST_PAGE: usize = 5_000_000;

/// Writes the report of these logs and reads the page.
fn report(place: &Place, logs: &[&str]) -> String {
    report_with_code(place, logs, 0)
}

/// As [`report`], of logs with which the command ends with this exit code.
fn report_with_code(place: &Place, logs: &[&str], code: i32) -> String {
    let mut arguments = vec!["report"];
    arguments.extend(logs);
    arguments.extend(["-o", "report"]);
    let written = output(&mut place.gerono(&arguments));
    assert_eq!(written.status.code(), Some(code), "{written:?}");
    std::fs::read_to_string(place.path("report/report.html")).unwrap()
}

/// Returns the data of the page, as its own script reads it.
fn data_of(page: &str) -> Value {
    let (_, rest) = page
        .split_once("<script id=\"data\" type=\"application/json\">")
        .unwrap();
    let (json, _) = rest.split_once("</script>").unwrap();
    serde_json::from_str(json).unwrap()
}

/// The values of a channel of a flight.
fn channel(flight: &Value, topic: &str, name: &str) -> Vec<f32> {
    let find = |list: &Value, key: &str, wanted: &str| {
        let found = list.as_array().unwrap().iter().find(|entry| entry[key] == wanted);
        found.unwrap_or_else(|| panic!("no {wanted}")).clone()
    };
    let table = find(&flight["tables"], "topic", topic);
    let series = find(&table["series"], "name", name);
    let bytes = STANDARD.decode(series["values"].as_str().unwrap()).unwrap();
    let (words, _) = bytes.as_chunks();
    words.iter().map(|&word| f32::from_le_bytes(word)).collect()
}

/// The true distance from the path at every tick of a log, m.
fn logged_distances(log: &Path) -> Vec<f64> {
    let mut reader = LogReader::open(log).unwrap();
    let schedule = reader.manifest().scenario.schedule().unwrap();
    let mut distances = Vec::new();
    let followed =
        Tracker::new(&schedule, false).follow(&mut reader, |moment| distances.push(moment.distance.unwrap()));
    followed.unwrap();
    distances
}

fn extremes(values: impl Iterator<Item = f64>) -> (f64, f64) {
    values.fold((f64::INFINITY, f64::NEG_INFINITY), |(least, greatest), value| {
        (least.min(value), greatest.max(value))
    })
}

/// Everything in the page by which a browser would be told to fetch something.
fn references(page: &str) -> Vec<&'static str> {
    const NAME_OF_THE_LIBRARY: &str = "/*! https://github.com/leeoniya/uPlot (v1.6.32) */";
    assert!(
        page.contains(NAME_OF_THE_LIBRARY),
        "its licence asks for its name"
    );
    let page = page.replace(NAME_OF_THE_LIBRARY, "");
    let all = [
        "http:",
        "https:",
        "src=\"",
        "href=\"",
        "url(",
        "@import",
        "fetch(",
        "XMLHttpRequest",
        "WebSocket",
        "import(",
    ];
    all.into_iter()
        .filter(|reference| page.contains(reference))
        .collect()
}

#[test]
fn the_page_stands_alone_and_holds_the_log_s_extremes() {
    let place = Place::new();
    let arguments = [
        "--host",
        "inprocess",
        "--set",
        "description='</script><script>alert(1)</script>'",
    ];
    succeed(&mut place.short_flight("flight", 9.0, &arguments));
    let page = report(&place, &["flight"]);
    assert!(page.len() < LARGEST_PAGE, "{} bytes", page.len());
    assert_eq!(references(&page), Vec::<&str>::new());
    assert_eq!(
        page.matches("</script").count(),
        5,
        "nothing of a log ends an element"
    );

    let data = data_of(&page);
    let flight = &data["flights"][0];
    assert_eq!(flight["description"], "</script><script>alert(1)</script>");
    assert_eq!(flight["label"], "flight");
    assert_eq!(flight["broken"], Value::Null);
    assert!(flight["scenario"].as_str().unwrap().contains("tilted_eight"));

    let logged = logged_distances(&place.path("flight/run.mcap"));
    let shown = channel(flight, "vehicle/truth", "error");
    assert!(shown.len() < 2 * logged.len(), "{} values", shown.len());
    let (least, greatest) = extremes(logged.into_iter());
    assert_eq!(
        extremes(shown.into_iter().map(f64::from)),
        (f64::from(least as f32), f64::from(greatest as f32))
    );
}

#[test]
fn several_logs_are_laid_over_each_other_with_what_happened_in_them() {
    let place = Place::new();
    let logs = ["one", "two", "three", "four"];
    for log in logs {
        succeed(&mut place.rig_flight(log, 1.0, &["--host", "inprocess"]));
    }
    let data = data_of(&report(&place, &logs));
    let labels: Vec<_> = data["flights"]
        .as_array()
        .unwrap()
        .iter()
        .map(|flight| &flight["label"])
        .collect();
    assert_eq!(labels, logs);
    let marks = data["flights"][0]["marks"].as_array().unwrap();
    for text in ["mass", "fan is switched on", "ψd steps"] {
        let has_text = |mark: &Value| mark["text"].as_str().unwrap().contains(text);
        assert!(marks.iter().any(has_text), "{text}: {marks:?}");
    }
}

#[test]
fn a_flight_of_the_paper_is_drawn_as_the_paper_s_figure() {
    let place = Place::new();
    let path = scenario("fig1");
    let arguments = [
        "run",
        path.to_str().unwrap(),
        "--set",
        "duration=31",
        "--host",
        "inprocess",
        "--out",
        "flight",
    ];
    succeed(&mut place.gerono(&arguments));
    let data = data_of(&report(&place, &["flight/run.mcap"]));
    let drawing = std::fs::read_to_string(place.path("report/fig1.svg")).unwrap();
    assert!(drawing.contains("Fig. 1") && drawing.contains("ts"));
    let shown = STANDARD
        .decode(data["figures"][0]["svg"].as_str().unwrap())
        .unwrap();
    assert_eq!(shown, drawing.as_bytes());
}

#[test]
fn of_a_log_that_was_never_completed_what_is_whole_is_shown() {
    let place = Place::new();
    succeed(&mut place.short_flight("flight", 3.0, &["--host", "inprocess"]));
    let whole = place.path("flight/run.mcap");
    let bytes = std::fs::read(&whole).unwrap();
    std::fs::remove_file(&whole).unwrap();
    std::fs::write(place.path("flight/run.mcap.partial"), &bytes[..bytes.len() / 2]).unwrap();

    let data = data_of(&report_with_code(&place, &["flight"], 10));
    let flight = &data["flights"][0];
    let reason = flight["broken"].as_str().unwrap();
    assert!(reason.contains("never completed"), "{reason}");
    let flown = flight["flown"].as_f64().unwrap();
    assert!(flown > 0.5 && flown < 2.5, "{flown}");
}

#[test]
fn what_is_no_log_or_holds_nothing_is_refused_with_its_name() {
    let place = Place::new();
    let nothing: PathBuf = place.path("nothing.mcap");
    std::fs::write(&nothing, "no log").unwrap();
    let output = output(&mut place.gerono(&["report", "nothing.mcap", "-o", "report"]));
    assert_eq!(output.status.code(), Some(1));
    let message = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(message.contains("nothing.mcap"), "{message}");
    assert!(!place.path("report").exists(), "nothing is written");
}
