//! The commands of `gerono`, one module each.

pub mod attach;
pub mod bench;
pub mod check;
pub mod clean;
mod conclusion;
pub mod doctor;
pub mod faults;
pub mod generated;
pub mod grid;
pub mod identify;
pub mod lab;
pub mod logs;
pub mod mocap;
pub mod operate;
pub mod operator;
pub mod postmortem;
pub mod rc;
pub mod replay;
pub mod report;
pub mod reproduce;
pub mod run;
pub mod service;
pub mod sweep;
pub mod top;
pub mod truth;
pub mod view;
pub mod world;

use std::cell::RefCell;
use std::fmt::Display;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use scenario::{Problem, Scenario};
use serde::Serialize;
use shared_types::Schedule;

use crate::cli::{RecordingArguments, ScenarioArguments};
use ::report::text_table::{TextTable, latex_file};
use ::sweep::slurm::quoted;
use command_line::exit::Exit;
pub use command_line::failure::Failure;
use command_line::output::{log_path, not_written, note, print, print_as_it_is, write, write_json};
use flight::interrupt::Interrupt;
use identification::lateness;
use plugin::library_file;
use run_log::run_folder::RunFolder;
use run_log::{HostLogWriter, LogError, Manifest, RunLogWriter};
use supervisor::host_record::HostRecord;

/// Loads the scenario of the command line, which Gerono's services must support.
fn load(arguments: &ScenarioArguments) -> Result<Scenario, Failure> {
    let (scenario, shortened) =
        scenario_file::load_shortened(&arguments.scenario, &arguments.sets, arguments.seed)?;
    shortened.iter().for_each(note);
    match registry::problem_of_services(&scenario) {
        Some(problem) => Err(refused(arguments, &problem)),
        None => Ok(scenario),
    }
}

/// Returns the refusal of the scenario of the command line, at the position of the key.
fn refused(arguments: &ScenarioArguments, problem: &Problem) -> Failure {
    // A pipe cannot be read again.
    if arguments.scenario.is_file() {
        scenario_file::refusal(&arguments.scenario, &arguments.sets, problem).into()
    } else {
        Failure::bad_input(problem.to_string())
    }
}

/// Prints what was identified from a log as text or as JSON, after a note if the flight is unfit for it.
fn print_identified(log: &Path, found: &(impl Display + Serialize), as_json: bool) -> Result<(), Failure> {
    lateness::warning(log).into_iter().for_each(note);
    if as_json {
        print(serde_json::to_string_pretty(found).map_err(Failure::trouble)? + "\n");
    } else {
        print(found);
    }
    Ok(())
}

/// Copies the plug-ins of a flight into the folder of the log. Returns the copies.
fn copy_plugins(scenario: &mut Scenario, folder: &RunFolder) -> Result<Vec<PathBuf>, Failure> {
    let copies = RefCell::new(Vec::new());
    let write = |path: &Path, bytes: &[u8]| {
        copies.borrow_mut().push(path.to_owned());
        result_file::write(path, bytes, &[])
    };
    library_file::copy_to(scenario, folder.path(), write).map_err(Failure::not_written)?;
    Ok(copies.into_inner())
}

/// Creates the log of a run.
fn run_log(
    folder: &RunFolder,
    manifest: &Manifest,
    recording: RecordingArguments,
) -> Result<RunLogWriter, LogError> {
    let log = RunLogWriter::create(&folder.run_log(), manifest, recording.compression)?;
    log.durable(recording.forcing_period())
}

/// Creates the host log of a run.
fn host_record(
    folder: &RunFolder,
    scenario: &Scenario,
    recording: RecordingArguments,
) -> Result<HostRecord, LogError> {
    let log = HostLogWriter::create(&folder.host_log(), recording.compression)?;
    Ok(HostRecord::new(
        log.durable(recording.forcing_period())?,
        scenario,
    ))
}

/// Returns the exit of an interrupted command.
fn ended(interrupt: &Interrupt) -> Exit {
    interrupt.signal().map_or(Exit::Success, Exit::Signal)
}

/// Writes tables as LaTeX if it is asked for, or if an earlier command wrote them: all files of a folder show the same results.
fn write_latex(path: &Path, is_asked: bool, tables: &[TextTable]) -> Result<(), Failure> {
    if is_asked || path.exists() {
        write(path, &latex_file(tables))?;
    }
    Ok(())
}

/// Writes a result, or removes that of an earlier command, which belongs to other results.
fn write_or_remove(path: &Path, text: Option<String>) -> Result<(), Failure> {
    match text {
        Some(text) => write(path, &text),
        None => match std::fs::remove_file(path) {
            Err(error) if error.kind() != ErrorKind::NotFound => Err(not_written(path, &error)),
            _ => Ok(()),
        },
    }
}

/// Prints how to resume an interrupted campaign.
fn print_resume_hint(folder: &Path) {
    note(format_args!(
        "the results so far are stored in {}; the same command with `--out {}` resumes from there",
        folder.display(),
        quoted(&folder.display().to_string())
    ));
}

/// Returns the schedule of a flight of `scenario`.
fn schedule_of(scenario: &Scenario) -> Result<Schedule, Failure> {
    flight::schedule_of(scenario).map_err(Failure::bad_input)
}

/// Returns the name of a flight: that of its scenario's file.
fn scenario_name(path: &Path) -> String {
    path.file_stem()
        .map_or_else(|| "flight".to_owned(), |stem| stem.to_string_lossy().into_owned())
}

#[cfg(test)]
#[expect(clippy::disallowed_methods, reason = "tests make their own files")]
mod tests {
    use super::*;

    #[test]
    fn files_of_earlier_results_do_not_stay_beside_others() {
        let folder = tempfile::tempdir().unwrap();
        let [drawing, tables] = ["pareto.svg", "grid.tex"].map(|name| folder.path().join(name));
        for (text, is_left) in [(None, false), (Some("drawing"), true), (None, false)] {
            write_or_remove(&drawing, text.map(str::to_owned)).unwrap();
            assert_eq!(drawing.exists(), is_left);
        }
        write_latex(&tables, false, &[]).unwrap();
        assert!(!tables.exists(), "nothing is written unasked");
        std::fs::write(&tables, format!("{}earlier", latex_file(&[]))).unwrap();
        write_latex(&tables, false, &[]).unwrap();
        assert_eq!(std::fs::read_to_string(&tables).unwrap(), latex_file(&[]));
    }
}
