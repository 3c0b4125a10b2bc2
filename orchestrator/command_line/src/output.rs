//! Output of commands, and lookup of the logs in their arguments.

use std::io::{ErrorKind, Write};
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::OnceLock;

use run_log::LogReader;
use run_log::run_folder::log_meant_by;
use scenario_file::printable::printable_lines;
use serde::Serialize;

use crate::exit::Exit;
use crate::failure::Failure;

/// Returns the log that a path names: the file itself, or the log in a run's folder, whether complete, recovered or
/// never closed.
///
/// Prints a note if the log was recovered or omits samples: its results are then not those of the whole flight.
#[must_use]
pub fn log_path(path: &Path) -> PathBuf {
    let log = log_meant_by(path);
    if let Ok(reader) = LogReader::open(&log) {
        note_omissions(&log, reader.manifest().scenario.omissions());
        for recovery in reader.recoveries() {
            note(format_args!(
                "{}: {} was recovered: {recovery}",
                log.display(),
                recovery.source
            ));
        }
    } else if holds_a_sweep(path) {
        note(format_args!(
            "{0} is the folder of a sweep: open its `index.html`, or repeat one of its flights, with a log, by `gerono sweep fly {0} \
             --sample N`",
            path.display()
        ));
    }
    log
}

/// Returns whether a folder has the rows of a sweep.
fn holds_a_sweep(folder: &Path) -> bool {
    let files = std::fs::read_dir(folder).into_iter().flatten().flatten();
    let mut names = files.map(|file| file.path());
    names.any(|name| name.extension().is_some_and(|extension| extension == "rows"))
}

/// Prints a note about the topics that a log omits at its scenario's request.
pub fn note_omissions(log: &Path, omissions: Option<String>) {
    if let Some(omissions) = omissions {
        note(format_args!(
            "{}: as its scenario says in `[record]`, it has {omissions}; results are of what it has",
            log.display()
        ));
    }
}

/// Writes results as JSON, atomically ([`result_file`]).
///
/// # Errors
/// [`Failure`] if it cannot be written.
pub fn write_json(path: &Path, value: &impl Serialize) -> Result<(), Failure> {
    let text = serde_json::to_string_pretty(value).map_err(Failure::trouble)?;
    write(path, &(text + "\n"))
}

/// Writes results, atomically ([`result_file`]).
///
/// # Errors
/// [`Failure`] if it cannot be written.
pub fn write(path: &Path, text: &str) -> Result<(), Failure> {
    result_file::write(path, text, &[]).map_err(|error| not_written(path, &error))
}

/// Returns the failure for a file of results that could not be written.
#[must_use]
pub fn not_written(path: &Path, error: &std::io::Error) -> Failure {
    Failure::not_written(format!("cannot write {}: {error}", path.display()))
}

/// Prints a note on standard error.
pub fn note(text: impl std::fmt::Display) {
    print_error(format_args!("note: {}", printable_lines(&text.to_string())));
}

/// Prints an error on standard error. If that fails, as on a full disk, the exit code stays.
pub fn print_error(text: impl std::fmt::Display) {
    let _ = writeln!(std::io::stderr(), "{text}");
}

/// Prints results on standard output, with control characters replaced.
pub fn print(text: impl std::fmt::Display) {
    print_as_it_is(printable_lines(&text.to_string()));
}

/// Prints results that contain colour codes. A reader that closes the pipe early (`gerono check … | head`) is no error;
/// [`conclude`] reports any other error.
pub fn print_as_it_is(text: impl std::fmt::Display) {
    let mut output = std::io::stdout().lock();
    if let Err(error) = write!(output, "{text}").and_then(|()| output.flush())
        && error.kind() != ErrorKind::BrokenPipe
    {
        let _ = PRINT_ERROR.set(error);
    }
}

/// First error of printing.
static PRINT_ERROR: OnceLock<std::io::Error> = OnceLock::new();

/// Returns the exit of a command that has printed its results: [`Exit::NotWritten`] if printing failed.
fn end(exit: Exit) -> Exit {
    match PRINT_ERROR.get() {
        Some(error) if exit == Exit::Success => {
            print_error(format_args!("cannot write to standard output: {error}"));
            Exit::NotWritten
        }
        _ => exit,
    }
}

/// Returns the exit code of a program from the result of its command, whose failure it shows.
#[must_use]
pub fn conclude(result: Result<Exit, Failure>) -> ExitCode {
    match result {
        Ok(exit) => end(exit).into(),
        Err(failure) => {
            print_error(format_args!("{:?}", failure.report));
            failure.exit.into()
        }
    }
}
