//! `gerono bench latency` and `gerono-bench` measure what they say, as often as they were asked to, and leave nothing behind.
//!
//! How long anything takes is not looked at: the machine is shared.

mod common;

use std::process::Command;
use std::sync::{Mutex, MutexGuard, PoisonError};

use common::{Place, succeed};
use serde_json::Value;

/// The lock of a test that measures, which must be alone.
static ALONE: Mutex<()> = Mutex::new(());

impl Place {
    fn gerono_bench(&self, arguments: &[&str]) -> Command {
        self.program(env!("CARGO_BIN_EXE_gerono-bench"), arguments)
    }
}

fn alone() -> MutexGuard<'static, ()> {
    ALONE.lock().unwrap_or_else(PoisonError::into_inner)
}

fn number(value: &Value) -> f64 {
    value.as_f64().unwrap_or_else(|| panic!("no number: {value}"))
}

/// A time in its quantiles, of which there are some and no more than were asked for.
fn assert_plausible(times: &Value, asked: u64) {
    let count = times["count"].as_u64().unwrap();
    assert!((1..=asked).contains(&count), "{times}");
    let quantiles = ["p50", "p90", "p99", "p999", "max"].map(|name| number(&times[name]));
    assert!(quantiles[0] > 0.0 && quantiles.is_sorted(), "{times}");
}

#[test]
fn the_latency_of_flights_stands_beside_its_floor_and_nothing_is_left_behind() {
    let _alone = alone();
    let place = Place::new();
    let arguments = [
        "bench",
        "latency",
        "--seconds",
        "1",
        "--repetitions",
        "1",
        "--json",
        "latency.json",
    ];
    let output = succeed(&mut place.gerono(&arguments));
    assert_eq!(place.leftovers(), Vec::<String>::new());

    let text = std::fs::read_to_string(place.path("latency.json")).unwrap();
    let measured: Value = serde_json::from_str(&text).unwrap();
    assert_eq!(measured["asked"], 1000);
    let rows = measured["rows"].as_array().unwrap();
    let named = |row: &Value| ["load", "scheduler"].map(|key| row[key].as_str().unwrap().to_owned());
    let conditions: Vec<_> = rows.iter().map(named).collect();
    let schedulers = ["ordinary", "SCHED_FIFO"];
    let loads = ["no load", "a load on another core", "loads on both cores"];
    let expected: Vec<_> = schedulers
        .iter()
        .flat_map(|scheduler| loads.map(|load| [load, scheduler].map(str::to_owned)))
        .collect();
    assert_eq!(conditions, expected);

    let shown = String::from_utf8(output.stdout).unwrap();
    for row in rows {
        assert!(shown.contains(row["load"].as_str().unwrap()), "{shown}");
        if row["note"].is_null() {
            assert_plausible(&row["floor"], 1000);
            // A flight of 1 s has the ticks 0 to 1000.
            assert_plausible(&row["capture_to_frame"], 1001);
            for ratio in [&row["ratio_p50"], &row["ratio_p99"]] {
                assert!(number(ratio).is_finite() && number(ratio) > 0.0, "{row}");
            }
            assert_eq!(row["services"].as_array().unwrap().len(), 5);
        } else {
            assert!(
                row["floor"].is_null() && row["capture_to_frame"].is_null(),
                "{row}"
            );
        }
    }
    assert!(rows[0]["note"].is_null(), "without a load everyone may measure");
}

#[test]
fn the_recorder_stands_beside_the_library_and_nothing_is_left_behind() {
    let _alone = alone();
    let place = Place::new();
    let json = ["--json", "recorder.json"];
    let output = succeed(
        place
            .gerono_bench(&["recorder", "--repetitions", "2", "--minutes", "0.5"])
            .args(json),
    );
    assert_eq!(place.leftovers(), Vec::<String>::new());

    let text = std::fs::read_to_string(place.path("recorder.json")).unwrap();
    let measured: Value = serde_json::from_str(&text).unwrap();
    // Of a flight of 2 s at 1 kHz, 8 samples a tick; 15 times in a measurement, and as often as makes half a minute.
    let samples = 8 * 2001;
    assert_eq!(measured["samples"], 15 * samples);
    assert_eq!(measured["memory"]["samples"], 15 * samples);
    for name in [
        "ratio",
        "recorder_cpu_seconds_per_sample",
        "library_cpu_seconds_per_sample",
        "recorder_samples_per_second",
        "library_samples_per_second",
    ] {
        let value = number(&measured[name]);
        assert!(value.is_finite() && value > 0.0, "{name}: {value}");
    }
    let memory = ["peak_of_first_tenth", "peak"].map(|name| number(&measured["memory"][name]));
    assert!(memory[0] > 0.0 && memory.is_sorted(), "{memory:?}");
    let shown = String::from_utf8(output.stdout).unwrap();
    assert!(shown.contains("library alone"), "{shown}");
}

#[test]
fn a_measurement_of_nothing_is_refused() {
    let place = Place::new();
    for nothing in [["--seconds", "0"], ["--repetitions", "0"]] {
        let output = common::output(&mut place.gerono(&["bench", "latency", nothing[0], nothing[1]]));
        let reason = String::from_utf8(output.stderr).unwrap();
        assert!(
            !output.status.success() && reason.contains(nothing[0]),
            "{reason}"
        );
    }
}

#[test]
fn what_deaths_cost_is_counted_and_nothing_is_left_behind() {
    let _alone = alone();
    let place = Place::new();
    let output = succeed(&mut place.gerono_bench(&["deaths", "--deaths", "5", "--json", "deaths.json"]));
    assert_eq!(place.leftovers(), Vec::<String>::new());
    let text = std::fs::read_to_string(place.path("deaths.json")).unwrap();
    let measured: Value = serde_json::from_str(&text).unwrap();
    assert_eq!([&measured["deaths"], &measured["restarts"]], [5, 5]);
    assert_plausible(&measured["back_after"], 5);
    let services = measured["services"].as_array().unwrap();
    assert_eq!(services.len(), 5);
    for service in services {
        assert!(number(&service["near"]["p50"]) > 0.0 && number(&service["elsewhere"]["p50"]) > 0.0);
    }
    let shown = String::from_utf8(output.stdout).unwrap();
    assert!(shown.contains("5 processes killed themselves"), "{shown}");
}

#[test]
fn frames_that_answer_packets_stand_beside_the_bare_hops_and_nothing_is_left_behind() {
    let _alone = alone();
    let place = Place::new();
    let asked = ["laboratory", "--seconds", "2", "--json", "laboratory.json"];
    let output = succeed(&mut place.gerono_bench(&asked));
    assert_eq!(place.leftovers(), Vec::<String>::new());
    let text = std::fs::read_to_string(place.path("laboratory.json")).unwrap();
    let measured: Value = serde_json::from_str(&text).unwrap();
    let [answers, hops] = ["packet_to_frame", "four_hops"].map(|what| number(&measured[what]["p50"]));
    assert!(answers > hops && hops > 0.0, "{measured:#}");
    let tilts = number(&measured["packet_to_frame"]["count"]) + number(&measured["unanswered"]);
    assert!((10.0..=20.0).contains(&tilts), "{measured:#}");
    for hop in ["socket_hop", "serial_hop"] {
        assert_plausible(&measured[hop], 3000);
    }
    let shown = String::from_utf8(output.stdout).unwrap();
    assert!(shown.contains("tilts of the vehicle were answered"), "{shown}");
}
