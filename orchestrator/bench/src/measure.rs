//! The measurements of `gerono bench`.

use std::convert::Infallible;
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::sync::Arc;

use host::in_process::TickSink;
use indicatif::{ProgressBar, ProgressStyle};
use runtime::deployment;
use scenario::Scenario;
use shared_types::{ServiceId, Topic};

use super::estimator_step;
use super::in_a_row::InARow;
use super::ring::Members;
use super::{Measured, Row, ring};
use crate::member::{self, RingWait};
use command_line::exit::Exit;
use command_line::failure::Failure;
use flight::interrupt::Interrupt;
use flight::recording_sink::RecordingSink;
use flight::{Ending, Outcome, in_process};
use run_client::run_root::RunRoot;
use run_log::{Compression, Manifest, RunLogWriter};
use supervisor::RunFailure;

pub(super) type Result<T> = std::result::Result<T, RunFailure>;

/// Rounds of a ring in one measurement.
const RING_ROUNDS: u64 = 20_000;

/// Consecutive flights in one process: each takes some hundredths of a second.
const IN_PROCESS_FLIGHTS: u32 = 5;

/// Ticks per simulated second in the measured scenario.
const TICKS_PER_SECOND: u64 = 1000;

/// Ticks between two crashes, some hundredths of a second of wall time: the standby process is ready by then, as it is when
/// services are killed by hand.
const DEATHS_APART: u64 = 1000;

/// Ticks between two crashes, some milliseconds: the standby process has only just been started.
const QUICK_DEATHS_APART: u64 = 100;

/// Makes all measurements in turn, `repetitions` times.
pub(super) fn all(whole: &Scenario, flight: &Scenario, repetitions: u32) -> Result<Measured> {
    let folder = Scratch::create()?;
    let command = FlightCommand::write(&folder, flight)?;
    let mut series = Series::default();
    let bar = progress_of("repetition", u64::from(repetitions));
    let core = deployment::idlest(&deployment::allowed_cores()).unwrap_or(0);
    for _ in 0..repetitions {
        series.repeat(whole, &command, core)?;
        bar.inc(1);
    }
    bar.finish_and_clear();
    Ok(Measured {
        restart_milliseconds: median(series.restart_milliseconds.clone()),
        quick_restart_milliseconds: median(series.quick_restart_milliseconds.clone()),
        rates: series.rows(),
    })
}

/// Returns a progress bar that counts to `number`.
pub(super) fn progress_of(what: &str, number: u64) -> ProgressBar {
    let bar = ProgressBar::new(number);
    bar.set_style(
        ProgressStyle::with_template(&format!("{what} {{pos}} of {{len}} {{wide_bar}} {{elapsed}}"))
            .expect("the template is well-formed"),
    );
    bar.tick();
    bar
}

/// The measurements, a list for each row, with pairs at equal indices.
#[derive(Default)]
struct Series {
    yield_ring: Vec<f64>,
    fifo_ring: Vec<f64>,
    eventfd_ring: Vec<f64>,
    lock_step: Vec<f64>,
    lock_step_fifo: Vec<f64>,
    lock_step_blocking: Vec<f64>,
    lock_step_loaded: Vec<f64>,
    in_a_row: Vec<f64>,
    in_process: Vec<f64>,
    in_process_recorded: Vec<f64>,
    inertial_steps: Vec<f64>,
    capture_steps: Vec<f64>,
    restart_milliseconds: Vec<f64>,
    quick_restart_milliseconds: Vec<f64>,
    fifo_refused: Option<String>,
}

impl Series {
    fn repeat(&mut self, whole: &Scenario, flight: &FlightCommand, core: usize) -> Result<()> {
        self.yield_ring.push(bare(RingWait::Yield, false, core)?);
        self.lock_step.push(fly_processes(flight, &[])?);
        self.eventfd_ring.push(bare(RingWait::Eventfd, false, core)?);
        self.lock_step_blocking
            .push(fly_processes(flight, &["--no-yield"])?);
        if self.fifo_refused.is_none() {
            match ring::thousand_rounds_per_second(RingWait::Yield, true, core, RING_ROUNDS) {
                Ok(rate) => {
                    self.fifo_ring.push(rate);
                    self.lock_step_fifo.push(fly_processes(flight, &["--fifo"])?);
                }
                Err(error) => self.fifo_refused = Some(format!("SCHED_FIFO is not permitted here: {error}")),
            }
        }
        {
            let _load = Load::on(core)?;
            self.lock_step_loaded
                .push(fly_processes(flight, &["--core", &core.to_string()])?);
        }
        self.restart_milliseconds.extend(restarts(flight, DEATHS_APART)?);
        self.quick_restart_milliseconds
            .extend(restarts(flight, QUICK_DEATHS_APART)?);
        let schedule = flight::schedule_of(whole)?;
        for _ in 0..IN_PROCESS_FLIGHTS {
            let services = registry::build_all(whole).map_err(RunFailure::setup)?;
            self.in_a_row.push(InARow::new(&schedule, services).fly());
            let ending = in_process::fly(whole, &mut Nowhere, &Interrupt::never())?;
            self.in_process.push(rate(&ending)?);
        }
        let [outdoors, indoors] = estimator_step::scenarios()?;
        self.inertial_steps
            .push(estimator_step::thousand_steps_per_second(&outdoors)?);
        self.capture_steps
            .push(estimator_step::thousand_steps_per_second(&indoors)?);
        self.in_process_recorded
            .push(recorded(whole, &flight.folder, |sink| {
                Ok(in_process::fly(whole, sink, &Interrupt::never())?)
            })?);
        Ok(())
    }

    fn rows(self) -> Vec<Row> {
        let row = |what, values: &[f64], floor: Option<(&'static str, &[f64])>, note| Row {
            what,
            median: median(values.to_vec()),
            best: values.iter().copied().max_by(f64::total_cmp),
            ratio: floor
                .and_then(|(_, floor)| median(values.iter().zip(floor).map(|(a, b)| a / b).collect())),
            floor: floor.map(|(name, _)| name),
            note,
        };
        let yield_ring = ("iceoryx2 alone", &*self.yield_ring);
        let in_a_row = ("five steps in a row", &*self.in_a_row);
        vec![
            row("iceoryx2 alone", &self.yield_ring, None, None),
            row("the same, always sleeping", &self.eventfd_ring, None, None),
            row(
                "the same, SCHED_FIFO",
                &self.fifo_ring,
                None,
                self.fifo_refused.clone(),
            ),
            row(
                "lock-step, six processes, recorded",
                &self.lock_step,
                Some(yield_ring),
                None,
            ),
            row(
                "the same, always sleeping",
                &self.lock_step_blocking,
                Some(("iceoryx2 alone, always sleeping", &self.eventfd_ring)),
                None,
            ),
            row(
                "the same, SCHED_FIFO",
                &self.lock_step_fifo,
                Some(("iceoryx2 alone, SCHED_FIFO", &self.fifo_ring)),
                self.fifo_refused.clone(),
            ),
            row(
                "the same, another load on the services' core",
                &self.lock_step_loaded,
                Some(yield_ring),
                None,
            ),
            row("five steps in a row", &self.in_a_row, None, None),
            row("in-process, not recorded", &self.in_process, Some(in_a_row), None),
            row(
                "in-process, recorded, uncompressed",
                &self.in_process_recorded,
                Some(in_a_row),
                None,
            ),
            row(
                "step of the estimator, motion capture",
                &self.capture_steps,
                None,
                None,
            ),
            row(
                "step of the estimator, inertial",
                &self.inertial_steps,
                Some(("motion capture", &self.capture_steps)),
                Some("at 250 Hz; wanted: at least 0.33".to_owned()),
            ),
        ]
    }
}

fn bare(wait: RingWait, fifo: bool, core: usize) -> Result<f64> {
    ring::thousand_rounds_per_second(wait, fifo, core, RING_ROUNDS).map_err(RunFailure::setup)
}

/// Flies in lock-step. Returns the real-time factor.
fn fly_processes(flight: &FlightCommand, options: &[&str]) -> Result<f64> {
    summary_of_flight(flight, options)?["real_time_factor"]
        .as_f64()
        .ok_or_else(|| RunFailure::setup("the summary states no real-time factor".to_owned()))
}

/// Crashes each service in turn some times, `ticks_apart` ticks apart. Returns the restart times, ms.
fn restarts(flight: &FlightCommand, ticks_apart: u64) -> Result<Vec<f64>> {
    let count = 4 * ServiceId::ALL.len() as u64;
    let deaths = ServiceId::ALL.iter().cycle().zip(1..=count);
    let ticks = (count + 1) * ticks_apart;
    let duration = format!(
        "duration={}.{:03}",
        ticks / TICKS_PER_SECOND,
        ticks % TICKS_PER_SECOND
    );
    let mut options = ["--set", "vehicle.change=[]", "--set", &duration]
        .map(str::to_owned)
        .to_vec();
    options.extend(deaths.flat_map(|(service, number)| {
        [
            "--crash".to_owned(),
            format!("{service}@{}:after-step", number * ticks_apart),
        ]
    }));
    let options: Vec<_> = options.iter().map(String::as_str).collect();
    let summary = summary_of_flight(flight, &options)?;
    let restarts = summary["restarts"].as_array().into_iter().flatten();
    Ok(restarts
        .filter_map(|restart| restart["lost_seconds"].as_f64())
        .map(|seconds| 1e3 * seconds)
        .collect())
}

/// Flies in lock-step in a separate process, since a process can take part in one run only. Returns the summary.
fn summary_of_flight(flight: &FlightCommand, options: &[&str]) -> Result<serde_json::Value> {
    let (output, summary) = fly_by_command(flight, options, |_| Ok(()))?;
    if Exit::is_flown(output.status.code()) {
        Ok(summary)
    } else {
        Err(complaint(&output))
    }
}

/// Flies in a separate process, calls `read` with the folder of the results, and returns the output and the summary, for any
/// outcome of the flight.
pub(super) fn fly_by_command(
    flight: &FlightCommand,
    options: &[&str],
    read: impl FnOnce(&Path) -> Result<()>,
) -> Result<(Output, serde_json::Value)> {
    let out = flight.folder.join("flight");
    let output = gerono()?
        .args(["run", "--quiet", "--out"])
        .arg(&out)
        .args(options)
        .arg(&flight.scenario)
        .stdin(Stdio::null())
        .output()
        .map_err(RunFailure::setup)?;
    let Ok(text) = std::fs::read_to_string(out.join("summary.json")) else {
        return Err(complaint(&output));
    };
    let read = read(&out);
    std::fs::remove_dir_all(&out).map_err(RunFailure::setup)?;
    read?;
    Ok((output, serde_json::from_str(&text).map_err(RunFailure::setup)?))
}

/// Returns the command of the program that flies: this program, even if its file was renamed or replaced; for `gerono-bench`, the
/// `gerono` beside it.
pub(super) fn gerono() -> Result<Command> {
    let own = std::env::current_exe().map_err(RunFailure::setup)?;
    let name = own.file_name().unwrap_or_default();
    if !name.as_encoded_bytes().starts_with(b"gerono-bench") {
        return Ok(Command::new("/proc/self/exe"));
    }
    let beside = own.with_file_name("gerono");
    if beside.is_file() {
        Ok(Command::new(beside))
    } else {
        let reason = format!(
            "there is no {}: build it with `cargo build --release`",
            beside.display()
        );
        Err(RunFailure::setup(reason))
    }
}

/// Returns the error message of a failed command.
pub(super) fn complaint(output: &Output) -> RunFailure {
    RunFailure::setup(String::from_utf8_lossy(&output.stderr).into_owned())
}

/// The measured flight.
pub(super) struct FlightCommand {
    folder: PathBuf,
    scenario: PathBuf,
}

impl FlightCommand {
    /// Returns the path of the scenario.
    pub(super) fn scenario(&self) -> &Path {
        &self.scenario
    }

    /// Writes the scenario of a flight to a folder.
    pub(super) fn write(folder: &Scratch, flight: &Scenario) -> Result<Self> {
        let command = Self {
            folder: folder.path(),
            scenario: folder.path().join("fig1.toml"),
        };
        let text = scenario_file::to_toml(flight).map_err(RunFailure::setup)?;
        result_file::write(&command.scenario, text, &[]).map_err(RunFailure::setup)?;
        Ok(command)
    }
}

fn recorded(
    scenario: &Scenario,
    folder: &Path,
    fly: impl FnOnce(&mut RecordingSink<'_>) -> Result<Ending>,
) -> Result<f64> {
    let schedule = flight::schedule_of(scenario)?;
    let path = folder.join("run.mcap");
    let log = RunLogWriter::create(&path, &Manifest::new(scenario), Compression::None)?;
    let mut sink = RecordingSink::new(scenario, &schedule, Some(log), Arc::default());
    let ending = fly(&mut sink)?;
    sink.finish().1?;
    // A leftover is overwritten by the next measurement.
    let _ = std::fs::remove_file(path);
    rate(&ending)
}

/// Returns the simulated seconds per wall second.
fn rate(ending: &Ending) -> Result<f64> {
    match &ending.outcome {
        Outcome::Completed =>
        {
            #[expect(clippy::cast_precision_loss, reason = "few ticks")]
            Ok(ending.ticks as f64 / 1000.0 / ending.wall_time.as_secs_f64())
        }
        outcome => Err(RunFailure::setup(format!("a measurement ended early: {outcome}"))),
    }
}

pub(super) fn median(mut values: Vec<f64>) -> Option<f64> {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied()
}

/// A sink that discards all samples.
pub(super) struct Nowhere;

impl TickSink for Nowhere {
    type Error = Infallible;

    fn sample(&mut self, _topic: Topic, bytes: &[u8]) -> std::result::Result<(), Infallible> {
        std::hint::black_box(bytes);
        Ok(())
    }

    fn end_tick(&mut self, _tick: u64) -> std::result::Result<ControlFlow<()>, Infallible> {
        Ok(ControlFlow::Continue(()))
    }
}

/// A folder for the logs of measurements, in shared memory if possible, since a disk's write-back would be measured
/// otherwise. It is cleaned up like a run's shared memory if this process is killed.
pub(super) struct Scratch {
    root: RunRoot,
}

impl Scratch {
    pub(super) fn create() -> Result<Self> {
        let root = RunRoot::create().map_err(RunFailure::setup)?;
        let scratch = Self { root };
        std::fs::create_dir_all(scratch.path()).map_err(RunFailure::setup)?;
        Ok(scratch)
    }

    pub(super) fn path(&self) -> PathBuf {
        self.root.shared_memory("bench")
    }
}

/// A busy process on a core, until dropped.
pub(super) struct Load {
    _process: Members,
}

impl Load {
    pub(super) fn on(core: usize) -> Result<Self> {
        let child = member::command().args(["load", &core.to_string()]).spawn();
        child
            .map(|child| Self {
                _process: Members(vec![child]),
            })
            .map_err(RunFailure::setup)
    }
}

/// Keeps a core busy until its parent ends.
///
/// # Errors
/// [`Failure`] if the system does not permit it.
pub(super) fn load(core: usize) -> std::result::Result<(), Failure> {
    deployment::die_with_parent().map_err(Failure::trouble)?;
    deployment::pin_to(&[core]).map_err(Failure::trouble)?;
    loop {
        std::hint::spin_loop();
    }
}
