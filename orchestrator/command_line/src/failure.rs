//! Failures that end a command early.

use std::error::Error;
use std::iter::successors;

use flight::failure::FlightFailure;
use flight::journal::JournalError;
use miette::Report;
use run_log::{HostReadError, LogReadError};
use scenario_file::ScenarioError;
use scenario_file::printable::report_of;

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

impl From<JournalError> for Failure {
    fn from(error: JournalError) -> Self {
        match error {
            JournalError::File { .. } => Self::not_written(error),
            _ => Self::bad_input(error),
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
