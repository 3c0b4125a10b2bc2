//! Failures that end a command early.

use std::error::Error;
use std::io::ErrorKind;
use std::iter::successors;

use flight::failure::FlightFailure;
use flight::journal::JournalError;
use miette::Report;
use run_log::run_folder::read_summary_beside;
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

    /// Creates a failure of the machine, or [`Exit::Incomplete`] if an incomplete or damaged log caused it. Of a missing log the summary
    /// beside it may say why.
    #[must_use]
    pub fn trouble(error: impl Into<Box<dyn Error + Send + Sync>>) -> Self {
        let error = error.into();
        let causes = || successors(Some(&*error as &(dyn Error + 'static)), |&error| error.source());
        if let Some(reason) = causes().find_map(|cause| reason_of_no_log(cause.downcast_ref()?)) {
            return Self::new(
                Exit::Trouble,
                format!("there is no log, for the run ended before it: {reason}"),
            );
        }
        let is_incomplete = causes().any(|cause| {
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

/// Returns why the run of a missing log has failed, by the summary beside it.
fn reason_of_no_log(error: &LogReadError) -> Option<String> {
    #[derive(serde::Deserialize)]
    struct Ended {
        reason: String,
    }
    match error {
        LogReadError::Io { path, source } if source.kind() == ErrorKind::NotFound => {
            let ended: Ended = read_summary_beside(path)?;
            Some(ended.reason).filter(|reason| !reason.is_empty())
        }
        _ => None,
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

#[cfg(test)]
#[expect(clippy::disallowed_methods, reason = "tests make their own files")]
mod tests {
    use super::*;
    use run_log::LogReader;

    #[test]
    fn of_a_run_that_failed_before_its_first_tick_the_summary_says_why_there_is_no_log() {
        let folder = tempfile::tempdir().unwrap();
        let complaint = || {
            let error = LogReader::open(&folder.path().join("run.mcap"))
                .map(|_| ())
                .unwrap_err();
            format!("{:?}", Failure::trouble(error).report)
        };
        assert!(complaint().contains("check the path"), "{}", complaint());
        let summary = r#"{"reason": "the controller died", "seed": 1}"#;
        std::fs::write(folder.path().join("summary.json"), summary).unwrap();
        assert!(complaint().contains("the controller died"), "{}", complaint());
    }
}
