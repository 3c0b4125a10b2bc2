//! `gerono-bench sweep`: vehicle steps per second of a sweep's flights, compared with the five step functions in a row and with
//! other simulators.

use std::process::{Command, Stdio};
use std::sync::Barrier;
use std::time::Instant;

use comfy_table::{Table, presets};
use flight::many;
use host::in_process::TickSink;
use scenario::Scenario;
use serde::Serialize;
use shared_types::Schedule;
use sweep::flight::Judge;

use super::in_a_row::InARow;
use super::measure::{Nowhere, Result, median, progress_of};
use crate::arguments::{BenchSweep, Peer};
use command_line::failure::Failure;
use command_line::output::{print, write_json};
use flight::failure::FlightFailure;
use flight::interrupt::Interrupt;
use flight::{Outcome, in_process};
use supervisor::RunFailure;

/// Flights of each thread in one measurement.
const FLIGHTS: u32 = 10;

/// Result of a measurement.
#[derive(Clone, Debug, Serialize)]
struct Row {
    what: String,
    threads: usize,
    /// Median of the repetitions.
    steps_per_second: Option<f64>,
    /// Median of the pairwise ratios to the five steps in a row on the same number of threads.
    ratio: Option<f64>,
}

/// Vehicle steps per second, by repetition.
struct Series {
    what: String,
    threads: usize,
    values: Vec<f64>,
}

/// `gerono-bench sweep`.
///
/// # Errors
/// [`Failure`].
pub(super) fn sweep(scenario: &Scenario, arguments: &BenchSweep) -> std::result::Result<(), Failure> {
    let rows = measure(scenario, arguments).map_err(Failure::trouble)?;
    print(format!("{}\n", table(&rows)));
    if let Some(path) = &arguments.json {
        write_json(path, &rows)?;
    }
    Ok(())
}

/// A kind of flight.
#[derive(Clone, Copy)]
enum Kind {
    InARow,
    Host,
    Judged,
}

const KINDS: [(Kind, &str); 3] = [
    (Kind::InARow, "five steps in a row"),
    (Kind::Host, "in-process, not judged"),
    (Kind::Judged, "in-process, judged: a row of a sweep"),
];

fn measure(scenario: &Scenario, arguments: &BenchSweep) -> Result<Vec<Row>> {
    let schedule = flight::schedule_of(scenario)?;
    let mut numbers = vec![1, many::cores()];
    numbers.dedup();
    let own = numbers
        .iter()
        .flat_map(|&threads| KINDS.map(|(kind, what)| (threads, kind, what)));
    let own: Vec<_> = own.collect();
    let series = |what: &str, threads| Series {
        what: what.to_owned(),
        threads,
        values: Vec::new(),
    };
    let mut all: Vec<_> = own
        .iter()
        .map(|&(threads, _, what)| series(what, threads))
        .collect();
    all.extend(
        arguments
            .beside
            .iter()
            .map(|peer| series(&peer.name, many::cores())),
    );
    let bar = progress_of("repetition", u64::from(arguments.repetitions));
    for _ in 0..arguments.repetitions {
        let (flown, peers) = all.split_at_mut(own.len());
        for (series, &(threads, kind, _)) in flown.iter_mut().zip(&own) {
            series
                .values
                .push(steps_per_second(scenario, &schedule, kind, threads)?);
        }
        for (series, peer) in peers.iter_mut().zip(&arguments.beside) {
            series.values.push(beside(peer)?);
        }
        bar.inc(1);
    }
    bar.finish_and_clear();
    let floor = |threads| all.iter().find(|series| series.threads == threads);
    Ok(all
        .iter()
        .map(|series| series.row(floor(series.threads).expect("the floor is the first")))
        .collect())
}

impl Series {
    fn row(&self, floor: &Self) -> Row {
        let pairs = self.values.iter().zip(&floor.values);
        Row {
            what: self.what.clone(),
            threads: self.threads,
            steps_per_second: median(self.values.clone()),
            ratio: median(pairs.map(|(value, floor)| value / floor).collect()),
        }
    }
}

/// Flies on `threads` threads at the same time. Returns the steps per second of all.
fn steps_per_second(scenario: &Scenario, schedule: &Schedule, kind: Kind, threads: usize) -> Result<f64> {
    let start = Barrier::new(threads + 1);
    let flown = std::thread::scope(|scope| {
        let fly = || {
            start.wait();
            (0..FLIGHTS).try_for_each(|_| fly(scenario, schedule, kind))
        };
        let threads: Vec<_> = (0..threads).map(|_| scope.spawn(fly)).collect();
        start.wait();
        let begun = Instant::now();
        for thread in threads {
            thread.join().expect("flights do not panic")?;
        }
        Ok::<_, RunFailure>(begun.elapsed().as_secs_f64())
    });
    let steps = (schedule.last_tick() + 1) * u64::from(FLIGHTS) * threads as u64;
    #[expect(clippy::cast_precision_loss, reason = "far below 2^53")]
    Ok(steps as f64 / flown?)
}

fn fly(scenario: &Scenario, schedule: &Schedule, kind: Kind) -> Result<()> {
    match kind {
        Kind::InARow => {
            let services = registry::build_all(scenario).map_err(RunFailure::setup)?;
            InARow::new(schedule, services).fly();
            Ok(())
        }
        Kind::Host => in_process(scenario, &mut Nowhere),
        Kind::Judged => in_process(scenario, &mut Judge::new(scenario, schedule)),
    }
}

fn in_process<S: TickSink>(scenario: &Scenario, sink: &mut S) -> Result<()>
where
    FlightFailure: From<S::Error>,
{
    match in_process::fly(scenario, sink, &Interrupt::never())?.outcome {
        Outcome::Completed => Ok(()),
        outcome => Err(RunFailure::setup(format!("a measurement ended early: {outcome}"))),
    }
}

/// Runs another simulator and parses the steps per second in its last line.
fn beside(peer: &Peer) -> Result<f64> {
    let output = Command::new("sh")
        .args(["-c", &peer.command])
        .stdin(Stdio::null())
        .stderr(Stdio::inherit())
        .output()
        .map_err(RunFailure::setup)?;
    let text = String::from_utf8_lossy(&output.stdout);
    let number = text.lines().last().and_then(|line| line.trim().parse().ok());
    number.filter(|_| output.status.success()).ok_or_else(|| {
        RunFailure::setup(format!(
            "`{}` ended with {} and did not print its steps per second as its last line",
            peer.command, output.status
        ))
    })
}

fn table(rows: &[Row]) -> Table {
    let mut table = Table::new();
    table.load_style(presets::UTF8_HORIZONTAL_ONLY).set_header([
        "Fig. 1 at 1 kHz",
        "threads",
        "million vehicle steps per second",
        "ratio to the steps in a row",
    ]);
    for row in rows {
        let steps = row.steps_per_second.map(|steps| format!("{:.3}", steps / 1e6));
        let ratio = row.ratio.map(|ratio| format!("{ratio:.2}"));
        table.add_row([
            row.what.clone(),
            row.threads.to_string(),
            steps.unwrap_or_default(),
            ratio.unwrap_or_default(),
        ]);
    }
    table
}
