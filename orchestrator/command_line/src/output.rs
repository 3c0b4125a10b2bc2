//! The output of commands, and the logs that they are given.

use std::io::{ErrorKind, Write};
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

use run_log::LogReader;
use run_log::run_folder::log_meant_by;
use scenario_file::printable::printable_lines;
use serde::Serialize;

use crate::exit::Exit;
use crate::failure::Failure;

/// The log that a path means: the file itself, or the run's log in the folder, be it complete, recovered or never closed.
///
/// Says so if it was recovered or has topics in part only, for no command may take such a log for the whole one.
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
    }
    log
}

/// Says which topics a log has in part only, as its scenario asks.
pub fn note_omissions(log: &Path, omissions: Option<String>) {
    if let Some(omissions) = omissions {
        note(format_args!(
            "{}: as its scenario says in `[record]`, it has {omissions}; results are of what it has",
            log.display()
        ));
    }
}

/// Writes a file of results as JSON, whole or not at all ([`result_file`]).
///
/// # Errors
/// [`Failure`] if it cannot be written.
pub fn write_json(path: &Path, value: &impl Serialize) -> Result<(), Failure> {
    let text = serde_json::to_string_pretty(value).map_err(Failure::trouble)?;
    write(path, &(text + "\n"))
}

/// Writes a file of results, whole or not at all ([`result_file`]).
///
/// # Errors
/// [`Failure`] if it cannot be written.
pub fn write(path: &Path, text: &str) -> Result<(), Failure> {
    result_file::write(path, text, &[]).map_err(|error| not_written(path, &error))
}

/// Returns the failure to write a file of results.
#[must_use]
pub fn not_written(path: &Path, error: &std::io::Error) -> Failure {
    Failure::not_written(format!("cannot write {}: {error}", path.display()))
}

/// Tells of something that is not an error, beside the results.
pub fn note(text: impl std::fmt::Display) {
    complain(format_args!("note: {}", printable_lines(&text.to_string())));
}

/// Tells of an error. A full disk behind standard error changes no exit code.
pub fn complain(text: impl std::fmt::Display) {
    let _ = writeln!(std::io::stderr(), "{text}");
}

/// Prints results, made harmless for a terminal.
pub fn print(text: impl std::fmt::Display) {
    print_as_it_is(printable_lines(&text.to_string()));
}

/// Prints results that have colours. A reader that takes no more of them (`gerono check … | head`) has what it wants; any
/// other error is kept for [`end`].
pub fn print_as_it_is(text: impl std::fmt::Display) {
    let mut output = std::io::stdout().lock();
    if let Err(error) = write!(output, "{text}").and_then(|()| output.flush())
        && error.kind() != ErrorKind::BrokenPipe
    {
        let _ = UNPRINTED.set(error);
    }
}

/// The first error of printing.
static UNPRINTED: OnceLock<std::io::Error> = OnceLock::new();

/// Ends a command that has printed its results: they are not there if a disk behind standard output was full.
#[must_use]
pub fn end(exit: Exit) -> Exit {
    match UNPRINTED.get() {
        Some(error) if exit == Exit::Success => {
            complain(format_args!("cannot write to standard output: {error}"));
            Exit::NotWritten
        }
        _ => exit,
    }
}
