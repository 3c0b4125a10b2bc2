//! Benchmarks, as ratios to floors measured in the same run.
//!
//! Shared machines drift by tens of percent, so every figure is compared with a floor that is measured in turn with it: for
//! processes the transport of the same samples by iceoryx2 alone, for one process the five step functions called in a row.

pub mod arguments;
mod chain;
mod deaths;
mod estimator_step;
mod in_a_row;
mod laboratory;
mod latency;
mod measure;
pub mod member;
mod recorder;
mod ring;
mod sweep;

use comfy_table::{Table, presets};
use scenario::Scenario;
use serde::Serialize;

use std::path::Path;

use crate::arguments::{GeronoBench, Measurement};
use command_line::failure::Failure;
use command_line::output::{print, write_json};

pub use latency::latency;

/// The measured scenario: the paper's Fig. 1.
const SCENARIO: &str = include_str!("../../../scenarios/fig1.toml");

/// A figure with its floor.
#[derive(Clone, Debug, Serialize)]
struct Row {
    what: &'static str,
    /// Simulated seconds per wall second, or thousand rounds per second of a ring, which is comparable at 1 kHz.
    median: Option<f64>,
    /// Best of the repetitions: other users of a shared machine only slow it down.
    best: Option<f64>,
    /// Median of the pairwise ratios to the floor.
    ratio: Option<f64>,
    floor: Option<&'static str>,
    note: Option<String>,
}

/// Results of all measurements.
#[derive(Clone, Debug, Serialize)]
struct Measured {
    rates: Vec<Row>,
    /// Median time from a service's crash to the first step of the new process, ms.
    restart_milliseconds: Option<f64>,
    /// Median restart time of services that crash before the standby process is ready, ms.
    quick_restart_milliseconds: Option<f64>,
}

/// Fig. 1.
fn scenario() -> Result<Scenario, Failure> {
    toml::from_str(SCENARIO).map_err(Failure::trouble)
}

/// `gerono-bench`.
///
/// # Errors
/// [`Failure`].
pub fn bench(arguments: &GeronoBench) -> Result<(), Failure> {
    match &arguments.measurement {
        Measurement::Deaths(arguments) => deaths::deaths(arguments),
        Measurement::Laboratory(arguments) => laboratory::laboratory(arguments),
        Measurement::Recorder(arguments) => recorder::recorder(&scenario()?, arguments),
        Measurement::Sweep(arguments) => sweep::sweep(&scenario()?, arguments),
    }
}

/// Measures all hosts in flights of `duration` s and prints their rates; also writes them as JSON to a file.
///
/// # Errors
/// [`Failure`].
pub fn throughput(repetitions: u32, duration: f64, json: Option<&Path>) -> Result<(), Failure> {
    let scenario = scenario()?;
    let flight = Scenario {
        duration,
        ..scenario.clone()
    };
    let flight = Scenario {
        vehicle: clipped(&flight),
        ..flight
    };
    if let Some(problem) = flight.problems().first() {
        return Err(Failure::bad_input(format!("--duration: {problem}")));
    }
    let measured = measure::all(&scenario, &flight, repetitions).map_err(Failure::trouble)?;
    print(format!("{}\n", table(&measured.rates)));
    if let (Some(restart), Some(quick)) = (measured.restart_milliseconds, measured.quick_restart_milliseconds)
    {
        print(format!(
            "Restart of a crashed service: {restart:.1} ms, and {quick:.1} ms if the standby process is not ready yet (medians; \
             the process takes the role, opens its ports and receives the recorded inputs).\n"
        ));
    }
    if let Some(path) = json {
        write_json(path, &measured)?;
    }
    Ok(())
}

/// Returns the vehicle without changes beyond the flight's duration.
fn clipped(scenario: &Scenario) -> scenario::Vehicle {
    let mut vehicle = scenario.vehicle.clone();
    vehicle.change.retain(|change| change.at <= scenario.duration);
    vehicle
}

fn table(rows: &[Row]) -> Table {
    let mut table = Table::new();
    table.load_style(presets::UTF8_HORIZONTAL_ONLY).set_header([
        "Fig. 1 at 1 kHz",
        "simulated s per wall s",
        "best",
        "ratio",
        "to",
        "note",
    ]);
    for row in rows {
        let rate = |value: Option<f64>| value.map_or_else(|| "–".to_owned(), |value| format!("{value:.1}"));
        table.add_row([
            row.what.to_owned(),
            rate(row.median),
            rate(row.best),
            row.ratio.map_or_else(String::new, |value| format!("{value:.2}")),
            row.floor.unwrap_or_default().to_owned(),
            row.note.clone().unwrap_or_default(),
        ]);
    }
    table
}
