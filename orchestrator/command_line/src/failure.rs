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

/// Failure that ends a command early.
#[derive(Debug)]
pub struct Failure {
    pub report: Report,
    pub exit: Exit,
}

impl Failure {
    /// Creates a failure from an error or a message.
    #[must_use]
    pub fn new(exit: Exit, error: impl Into<Box<dyn Error + Send + Sync>>) -> Self {
        Self {
            report: report_of(&*error.into()),
            exit,
        }
    }

    /// Creates a failure of the machine, or [`Exit::Incomplete`] if an incomplete or damaged log caused it.
    #[must_use]
    pub fn trouble(error: impl Into<Box<dyn Error + Send + Sync>>) -> Self {
        let error = error.into();
        let mut causes = successors(Some(&*error as &(dyn Error + 'static)), |&error| error.source());
        let is_incomplete = causes.any(|cause| {
            let log_error = cause.downcast_ref::<LogReadError>();
            let host_error = cause.downcast_ref::<HostReadError>();
            log_error.is_some_and(LogReadError::is_incomplete)
                || host_error.is_some_and(HostReadError::is_incomplete)
        });
        let exit = if is_incomplete {
            Exit::Incomplete
        } else {
            Exit::Trouble
        };
        Self::new(exit, error)
    }

    /// Creates the failure for a wrong command line or scenario.
    #[must_use]
    pub fn bad_input(error: impl Into<Box<dyn Error + Send + Sync>>) -> Self {
        Self::new(Exit::BadInput, error)
    }

    /// Creates the failure for results that could not be written.
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
            JournalError::Unreadable { .. } | JournalError::Program(_) => Self::trouble(error),
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
