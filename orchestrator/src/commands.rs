//! The commands of `gerono`, one module each.

pub mod attach;
pub mod bench;
pub mod check;
mod conclusion;
pub mod doctor;
pub mod faults;
pub mod logs;
pub mod mocap;
pub mod operate;
pub mod postmortem;
pub mod rc;
pub mod replay;
pub mod report;
pub mod reproduce;
pub mod run;
pub mod small;
pub mod top;
pub mod truth;
pub mod world;

use std::io::Write;
use std::path::{Path, PathBuf};

use miette::Report;
use serde::Serialize;
use shared_types::Schedule;
use shared_types::scenario::Scenario;

use crate::cli::{RecordingArguments, ScenarioArguments};
use crate::exit::Exit;
use crate::flight;
use crate::host_record::HostRecord;
use crate::log::{HostLogWriter, LogError, LogReader, Manifest, RunLogWriter, make_anew, partial_path};
use crate::run_folder::{RunFolder, log_meant_by};
use crate::scenario_file;
use crate::terminal::printable_lines;

/// What ends a command early: what to tell the user and the exit code.
#[derive(Debug)]
pub struct Failure {
    /// What to tell the user.
    pub report: Report,
    /// The exit code.
    pub exit: Exit,
}

impl Failure {
    fn new(exit: Exit, error: impl std::fmt::Display) -> Self {
        Self {
            report: report_of(&error),
            exit,
        }
    }
}

/// Loads the scenario that the command line asks for.
fn load(arguments: &ScenarioArguments) -> Result<Scenario, Failure> {
    scenario_file::load(&arguments.scenario, &arguments.sets, arguments.seed).map_err(|error| Failure {
        report: error.into(),
        exit: Exit::BadInput,
    })
}

/// Begins the log of a run.
fn run_log(
    folder: &RunFolder,
    manifest: &Manifest,
    recording: RecordingArguments,
) -> Result<RunLogWriter, LogError> {
    let log = RunLogWriter::create(&folder.run_log(), manifest, recording.compression)?;
    log.durable(recording.forcing_period())
}

/// Begins the record of the machine's side of a run.
fn host_record(folder: &RunFolder, recording: RecordingArguments) -> Result<HostRecord, LogError> {
    let log = HostLogWriter::create(&folder.host_log(), recording.compression)?;
    Ok(HostRecord::new(log.durable(recording.forcing_period())?))
}

/// When everybody steps in a flight of `scenario`.
fn schedule_of(scenario: &Scenario) -> Result<Schedule, Failure> {
    flight::schedule_of(scenario).map_err(|failure| Failure::new(Exit::BadInput, failure))
}

/// The log that a path means: the file itself, or the run's log in the folder, be it complete, recovered or never closed.
///
/// Says so if it was recovered, for no command may take such a log for the one that was recorded.
fn log_path(path: &Path) -> PathBuf {
    let log = log_meant_by(path);
    if let Ok(reader) = LogReader::open(&log)
        && let Some(recovery) = reader.recovery()
    {
        note(format_args!("{} was recovered: {recovery}", log.display()));
    }
    log
}

/// Name of a flight: that of its scenario's file.
fn scenario_name(path: &Path) -> String {
    path.file_stem()
        .map_or_else(|| "flight".to_owned(), |stem| stem.to_string_lossy().into_owned())
}

/// Writes a file of a run's results under its name once it is whole.
///
/// The bytes are on the disk before the name is: a process or machine that dies in between leaves no empty file.
fn write_result(path: &Path, value: &impl Serialize) -> Result<(), Failure> {
    let text = serde_json::to_string_pretty(value).map_err(|error| Failure::new(Exit::Trouble, error))?;
    let partial = partial_path(path);
    let written = make_anew(&partial).and_then(|mut file| {
        file.write_all((text + "\n").as_bytes())?;
        file.sync_all()
    });
    written
        .and_then(|()| std::fs::rename(&partial, path))
        .map_err(|error| not_written(path, &error))
}

fn write_json(path: &Path, value: &impl Serialize) -> Result<(), Failure> {
    let text = serde_json::to_string_pretty(value).map_err(|error| Failure::new(Exit::Trouble, error))?;
    write(path, &(text + "\n"))
}

fn write(path: &Path, text: &str) -> Result<(), Failure> {
    std::fs::write(path, text).map_err(|error| not_written(path, &error))
}

fn not_written(path: &Path, error: &std::io::Error) -> Failure {
    let reason = format!("cannot write {}: {error}", path.display());
    Failure::new(Exit::NotWritten, reason)
}

/// What a terminal is told of an error.
fn report_of(error: &impl std::fmt::Display) -> Report {
    Report::msg(printable_lines(&error.to_string()).into_owned())
}

/// Tells of something that is not an error, beside the results.
fn note(text: impl std::fmt::Display) {
    eprintln!("note: {}", printable_lines(&text.to_string()));
}

/// Prints results, made harmless for a terminal.
fn print(text: impl std::fmt::Display) {
    print_as_it_is(printable_lines(&text.to_string()));
}

/// Prints results that have colours. A reader that takes no more of them (`gerono check … | head`) has what it wants.
fn print_as_it_is(text: impl std::fmt::Display) {
    let _ = write!(std::io::stdout(), "{text}");
}
