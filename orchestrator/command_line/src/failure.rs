//! Failures that end a command early.

use std::error::Error;
use std::iter::successors;

use flight::failure::FlightFailure;
use miette::Report;
use run_log::{HostReadError, LogReadError};
use scenario_file::ScenarioError;
use scenario_file::printable::printable_lines;

use crate::exit::Exit;

/// A failure that ends a command early: the message for the user and the exit code.
#[derive(Debug)]
pub struct Failure {
    /// The message for the user.
    pub report: Report,
    /// The exit code.
    pub exit: Exit,
}

impl Failure {
    /// Makes the failure of a command from an error or a sentence.
    #[must_use]
    pub fn new(exit: Exit, error: impl Into<Box<dyn Error + Send + Sync>>) -> Self {
        Self {
            report: report_of(&*error.into()),
            exit,
        }
    }

    /// Trouble with the machine, or a log that is incomplete or damaged ([`Exit::Incomplete`]).
    #[must_use]
    pub fn trouble(error: impl Into<Box<dyn Error + Send + Sync>>) -> Self {
        let error = error.into();
        let mut causes = successors(Some(&*error as &(dyn Error + 'static)), |&error| error.source());
        let is_incomplete = causes.any(|cause| {
            let of_log = cause.downcast_ref::<LogReadError>();
            let of_machine = cause.downcast_ref::<HostReadError>();
            of_log.is_some_and(LogReadError::is_incomplete)
                || of_machine.is_some_and(HostReadError::is_incomplete)
        });
        let exit = if is_incomplete {
            Exit::Incomplete
        } else {
            Exit::Trouble
        };
        Self::new(exit, error)
    }

    /// A wrong command line or scenario.
    #[must_use]
    pub fn bad_input(error: impl Into<Box<dyn Error + Send + Sync>>) -> Self {
        Self::new(Exit::BadInput, error)
    }

    /// Results that could not be written.
    #[must_use]
    pub fn not_written(error: impl Into<Box<dyn Error + Send + Sync>>) -> Self {
        Self::new(Exit::NotWritten, error)
    }
}

impl From<ScenarioError> for Failure {
    fn from(error: ScenarioError) -> Self {
        Self {
            report: error.into(),
            exit: Exit::BadInput,
        }
    }
}

impl From<FlightFailure> for Failure {
    fn from(failure: FlightFailure) -> Self {
        let exit = match failure {
            FlightFailure::Refused(_) => Exit::BadInput,
            _ => Exit::Trouble,
        };
        Self::new(exit, failure)
    }
}

/// Returns the report of an error for a terminal: its message, and below it the causes that no message above has told.
///
/// Many messages tell their cause within the sentence, before they say what to do about it.
#[must_use]
pub fn report_of(error: &(dyn Error + 'static)) -> Report {
    let mut told: Vec<String> = Vec::new();
    for error in successors(Some(error), |&error| error.source()) {
        let text = printable_lines(&error.to_string()).into_owned();
        if !told.iter().any(|message| message.contains(&text)) {
            told.push(text);
        }
    }
    let innermost = Report::msg(told.pop().unwrap_or_default());
    told.into_iter().rev().fold(innermost, Report::wrap_err)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[derive(Debug, thiserror::Error)]
    enum Level {
        #[error("the disk is full\x1b[2J")]
        Disk,
        #[error("cannot write z1.svg: {0}; make room")]
        Write(#[source] Box<Level>),
        #[error("no figure was drawn")]
        Draw(#[source] Box<Level>),
    }

    #[test]
    fn every_cause_is_told_once_and_harmless() {
        let disk = Box::new(Level::Disk);
        let report = report_of(&Level::Draw(Box::new(Level::Write(disk))));
        let told: Vec<_> = report.chain().map(ToString::to_string).collect();
        let cause = r"cannot write z1.svg: the disk is full\u001b[2J; make room";
        assert_eq!(told, ["no figure was drawn", cause]);
    }
}
