//! `gerono bench latency`: latency from a capture to the radio frame, compared with four bare iceoryx2 event hops.

use std::path::Path;

use comfy_table::{Table, presets};
use runtime::deployment::{self, Scheduler};
use scenario::Scenario;
use serde::Serialize;
use serde::de::DeserializeOwned;

use super::SCENARIO;
use super::chain;
use super::measure::{FlightCommand, Load, Result, Scratch, complaint, fly_by_command, median, progress_of};
use command_line::failure::Failure;
use command_line::output::{print, write_json};
use metrics::summary::timing::Quantiles;
use supervisor::RunFailure;

/// Rounds of the bare chain per second: as many as frames.
const ROUNDS_PER_SECOND: u64 = 1000;

/// Load on the cores during a measurement.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum LoadOn {
    Nothing,
    OtherCore,
    BothCores,
}

impl LoadOn {
    const ALL: [Self; 3] = [Self::Nothing, Self::OtherCore, Self::BothCores];

    fn name(self) -> &'static str {
        match self {
            Self::Nothing => "no load",
            Self::OtherCore => "a load on another core",
            Self::BothCores => "loads on both cores",
        }
    }
}

/// Results under one load and one scheduler.
#[derive(Clone, Debug, Serialize)]
struct Row {
    load: &'static str,
    scheduler: &'static str,
    /// Latency from the publication of a capture to that of the frame computed from it.
    capture_to_frame: Option<Quantiles>,
    /// Latency of four bare hops.
    floor: Option<Quantiles>,
    /// Median of the pairwise ratios of the medians.
    ratio_p50: Option<f64>,
    /// Median of the pairwise ratios of the 99th percentiles.
    ratio_p99: Option<f64>,
    /// Steps that services skipped because their deadline had passed.
    missed_steps: u64,
    services: Vec<ServiceTimes>,
    /// Reason why there is no measurement.
    note: Option<String>,
}

/// The lateness of a service's wake-ups and the durations of its steps.
#[derive(Clone, Debug, Serialize)]
struct ServiceTimes {
    service: String,
    wake: Option<Quantiles>,
    step: Option<Quantiles>,
}

/// Results of all measurements.
#[derive(Clone, Debug, Serialize)]
struct Measured {
    /// Duration of each measurement, s.
    seconds: u32,
    repetitions: u32,
    /// The core of the services and of the chain.
    core: usize,
    /// Expected frames of all repetitions of a row: as many as rounds of the chain.
    asked: u64,
    rows: Vec<Row>,
}

/// Measures the latency from a capture to the radio frame and prints it beside the floor; also writes it as JSON to a file.
///
/// # Errors
/// [`Failure`].
pub fn latency(seconds: u32, repetitions: u32, json: Option<&Path>) -> std::result::Result<(), Failure> {
    let measured = measure(seconds, repetitions).map_err(Failure::trouble)?;
    print(format!("{}\n", table(&measured)));
    if let Some(services) = measured.rows.first().map(|row| &row.services) {
        print(format!("{}\n", table_of(services)));
    }
    print(format!(
        "Medians of {} repetitions of {} s, all on core {}. The floor: four bare iceoryx2 event hops, measured in turn with the \
         flights. `gerono bench latency --help` explains the numbers.\n",
        measured.repetitions, measured.seconds, measured.core,
    ));
    match json {
        Some(path) => write_json(path, &measured),
        None => Ok(()),
    }
}

fn measure(seconds: u32, repetitions: u32) -> Result<Measured> {
    let folder = Scratch::create()?;
    let flight = FlightCommand::write(&folder, &flight_of(seconds)?)?;
    let allowed = deployment::allowed_cores();
    let core = deployment::idlest(&allowed).unwrap_or(0);
    let setup = Setup {
        flight: &flight,
        core,
        other: allowed.into_iter().find(|&other| other != core),
        rounds: u64::from(seconds) * ROUNDS_PER_SECOND,
    };
    let fifo_refused = fifo_refused();
    let mut series: Vec<_> = [Scheduler::Fair, Scheduler::Fifo]
        .into_iter()
        .flat_map(|scheduler| LoadOn::ALL.map(|load| Series::new(load, scheduler)))
        .collect();
    for series in &mut series {
        series.note = match &fifo_refused {
            Some(reason) if series.scheduler == Scheduler::Fifo => Some(reason.clone()),
            _ if series.load != LoadOn::Nothing && setup.other.is_none() => {
                Some("there is only one core".to_owned())
            }
            _ => None,
        };
    }
    let bar = progress_of("measurement", u64::from(repetitions) * series.len() as u64);
    for repetition in 0..repetitions {
        for series in &mut series {
            if series.note.is_none() {
                series.repeat(&setup, repetition)?;
            }
            bar.inc(1);
        }
    }
    bar.finish_and_clear();
    Ok(Measured {
        seconds,
        repetitions,
        core,
        asked: setup.rounds * u64::from(repetitions),
        rows: series.into_iter().map(Series::row).collect(),
    })
}

/// Returns Fig. 1 with this duration, without changes of the vehicle.
fn flight_of(seconds: u32) -> Result<Scenario> {
    let scenario: Scenario = toml::from_str(SCENARIO).map_err(RunFailure::setup)?;
    let mut flight = Scenario {
        duration: f64::from(seconds),
        ..scenario
    };
    flight.vehicle.change.clear();
    Ok(flight)
}

/// Returns the reason why `SCHED_FIFO` is not available, if so. Tried in a temporary thread, so that this one keeps its
/// scheduler.
fn fifo_refused() -> Option<String> {
    let tried = std::thread::spawn(|| deployment::use_scheduler(Scheduler::Fifo)).join();
    let error = tried.ok()?.err()?;
    Some(format!(
        "SCHED_FIFO is not permitted here ({error}): docs/deployment.md"
    ))
}

/// Flight and cores of the measurements.
struct Setup<'a> {
    flight: &'a FlightCommand,
    core: usize,
    other: Option<usize>,
    rounds: u64,
}

impl Setup<'_> {
    fn loads(&self, load: LoadOn) -> Result<Vec<Load>> {
        let own = (load == LoadOn::BothCores).then_some(self.core);
        let other = self.other.filter(|_| load != LoadOn::Nothing);
        own.into_iter().chain(other).map(Load::on).collect()
    }

    fn floor(&self, scheduler: Scheduler) -> Result<Quantiles> {
        chain::four_hops(self.core, scheduler == Scheduler::Fifo, self.rounds).map_err(RunFailure::setup)
    }

    /// Returns the timing in the summary of a flight. If the machine stalls for too long, the vehicle may be lost; the
    /// measurement until then counts.
    fn fly(&self, scheduler: Scheduler) -> Result<serde_json::Value> {
        let core = self.core.to_string();
        let mut options = vec!["--host", "realtime", "--core", &core];
        options.extend((scheduler == Scheduler::Fifo).then_some("--fifo"));
        let (output, mut summary) = fly_by_command(self.flight, &options, |_| Ok(()))?;
        match summary["timing"].take() {
            serde_json::Value::Null => Err(complaint(&output)),
            timing => Ok(timing),
        }
    }
}

/// The measurements under one load and one scheduler, with pairs at equal indices.
struct Series {
    load: LoadOn,
    scheduler: Scheduler,
    floors: Vec<Quantiles>,
    chains: Vec<Quantiles>,
    /// Times of all services in every flight.
    services: Vec<Vec<ServiceTimes>>,
    missed_steps: u64,
    note: Option<String>,
}

impl Series {
    fn new(load: LoadOn, scheduler: Scheduler) -> Self {
        Self {
            load,
            scheduler,
            floors: Vec::new(),
            chains: Vec::new(),
            services: Vec::new(),
            missed_steps: 0,
            note: None,
        }
    }

    fn repeat(&mut self, setup: &Setup<'_>, repetition: u32) -> Result<()> {
        let _loads = setup.loads(self.load)?;
        // The order alternates, so that drift of the machine affects both alike.
        if repetition.is_multiple_of(2) {
            self.floors.push(setup.floor(self.scheduler)?);
            self.add(&setup.fly(self.scheduler)?)
        } else {
            self.add(&setup.fly(self.scheduler)?)?;
            self.floors.push(setup.floor(self.scheduler)?);
            Ok(())
        }
    }

    fn add(&mut self, timing: &serde_json::Value) -> Result<()> {
        self.chains.push(stated(&timing["capture_to_frame"])?);
        let mut services = Vec::new();
        for service in timing["services"].as_array().into_iter().flatten() {
            self.missed_steps += stated::<u64>(&service["missed_steps"])?;
            services.push(ServiceTimes {
                service: stated(&service["service"])?,
                wake: stated(&service["wake"])?,
                step: stated(&service["step"])?,
            });
        }
        self.services.push(services);
        Ok(())
    }

    fn row(self) -> Row {
        Row {
            load: self.load.name(),
            scheduler: match self.scheduler {
                Scheduler::Fifo => "SCHED_FIFO",
                _ => "ordinary",
            },
            capture_to_frame: medians(&self.chains),
            floor: medians(&self.floors),
            ratio_p50: ratio(&self.chains, &self.floors, |quantiles| quantiles.p50),
            ratio_p99: ratio(&self.chains, &self.floors, |quantiles| quantiles.p99),
            missed_steps: self.missed_steps,
            services: medians_of_services(&self.services),
            note: self.note,
        }
    }
}

/// Parses a part of a summary.
fn stated<T: DeserializeOwned>(part: &serde_json::Value) -> Result<T> {
    T::deserialize(part).map_err(|error| {
        RunFailure::setup(format!("the timing in a flight's summary is incomplete: {error}"))
    })
}

/// Returns the median of each quantile, with the total count.
fn medians(all: &[Quantiles]) -> Option<Quantiles> {
    let median_of = |quantile: fn(&Quantiles) -> f64| median(all.iter().map(quantile).collect());
    Some(Quantiles {
        count: all.iter().map(|quantiles| quantiles.count).sum(),
        p50: median_of(|quantiles| quantiles.p50)?,
        p90: median_of(|quantiles| quantiles.p90)?,
        p99: median_of(|quantiles| quantiles.p99)?,
        p999: median_of(|quantiles| quantiles.p999)?,
        max: median_of(|quantiles| quantiles.max)?,
    })
}

fn ratio(chains: &[Quantiles], floors: &[Quantiles], quantile: fn(&Quantiles) -> f64) -> Option<f64> {
    let pairs = chains.iter().zip(floors);
    median(
        pairs
            .map(|(chain, floor)| quantile(chain) / quantile(floor))
            .collect(),
    )
}

fn medians_of_services(flights: &[Vec<ServiceTimes>]) -> Vec<ServiceTimes> {
    let first = flights.first().map_or(&[][..], Vec::as_slice);
    let quantiles = |index: usize, time: fn(&ServiceTimes) -> Option<Quantiles>| {
        let all: Vec<_> = flights
            .iter()
            .filter_map(|flight| time(flight.get(index)?))
            .collect();
        medians(&all)
    };
    let services = first.iter().enumerate();
    services
        .map(|(index, times)| ServiceTimes {
            service: times.service.clone(),
            wake: quantiles(index, |times| times.wake),
            step: quantiles(index, |times| times.step),
        })
        .collect()
}

fn table(measured: &Measured) -> Table {
    let mut table = Table::new();
    table.load_style(presets::UTF8_HORIZONTAL_ONLY).set_header([
        "1 kHz, one core",
        "scheduler",
        "capture → frame, µs\np50 / p99 / p99.9 / max",
        "four bare hops, µs\np50 / p99 / p99.9 / max",
        "ratio\np50, p99",
        "missed\nsteps",
    ]);
    for row in &measured.rows {
        let ratio = row.ratio_p50.zip(row.ratio_p99);
        table.add_row([
            row.load.to_owned(),
            row.scheduler.to_owned(),
            row.note
                .clone()
                .unwrap_or_else(|| microseconds(row.capture_to_frame.as_ref())),
            microseconds(row.floor.as_ref()),
            ratio.map_or_else(String::new, |(p50, p99)| format!("{p50:.2}, {p99:.2}")),
            ratio.map_or_else(String::new, |_| row.missed_steps.to_string()),
        ]);
    }
    table
}

/// Returns the table of the services' times in the first row.
fn table_of(services: &[ServiceTimes]) -> Table {
    let mut table = Table::new();
    table.load_style(presets::UTF8_HORIZONTAL_ONLY).set_header([
        "no load, ordinary",
        "wake-up latency, µs\np50 / p99 / p99.9 / max",
        "step, µs\np50 / p99 / p99.9 / max",
    ]);
    for times in services {
        table.add_row([
            times.service.clone(),
            microseconds(times.wake.as_ref()),
            microseconds(times.step.as_ref()),
        ]);
    }
    table
}

/// Formats quantiles in µs.
pub(super) fn microseconds(quantiles: Option<&Quantiles>) -> String {
    let shown = |quantiles: &Quantiles| {
        let Quantiles {
            p50, p99, p999, max, ..
        } = quantiles;
        [p50, p99, p999, max]
            .map(|&time| format!("{:.0}", 1e6 * time))
            .join(" / ")
    };
    quantiles.map_or_else(String::new, shown)
}
