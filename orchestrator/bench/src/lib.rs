//! What this machine can do, as ratios against floors measured in the same run.
//!
//! Machines are shared and wander by tens of percent, so every figure stands beside a floor that was measured
//! in turn with it: for processes what iceoryx2 alone needs to move the same samples, for one process the five step
//! functions called in a row.

pub mod arguments;
mod bare_ports;
mod chain;
mod deaths;
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

/// The scenario that is measured: the paper's Fig. 1.
const SCENARIO: &str = include_str!("../../../scenarios/fig1.toml");

/// A figure and what it stands beside.
#[derive(Clone, Debug, Serialize)]
struct Row {
    what: &'static str,
    /// Simulated seconds per wall second, or thousand rounds per second of a ring, which compares to it at 1 kHz.
    median: Option<f64>,
    /// The best of the repetitions: a neighbour on a shared machine only ever makes it slower.
    best: Option<f64>,
    /// Median of the ratios to the floor, pair by pair.
    ratio: Option<f64>,
    floor: Option<&'static str>,
    note: Option<String>,
}

/// All that was measured.
#[derive(Clone, Debug, Serialize)]
struct Measured {
    rates: Vec<Row>,
    /// Median of the time from a service's death until another process flies in its place, ms.
    restart_milliseconds: Option<f64>,
    /// The same for services that die before the spare process is ready.
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

/// Measures all hosts in flights of `duration` s and prints their rates; writes them as JSON to a file, too.
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
    let measured = measure::all(&scenario, &flight, repetitions).map_err(Failure::trouble)?;
    print(format!("{}\n", table(&measured.rates)));
    if let (Some(restart), Some(quick)) = (measured.restart_milliseconds, measured.quick_restart_milliseconds)
    {
        print(format!(
            "A service that dies flies again {restart:.1} ms later, and {quick:.1} ms later if the spare process is not \
             ready yet (medians; a process takes its role, makes its ports and gets what it has missed).\n"
        ));
    }
    if let Some(path) = json {
        write_json(path, &measured)?;
    }
    Ok(())
}

/// The vehicle without the changes that a shorter flight does not reach.
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
