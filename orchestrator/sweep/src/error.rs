//! Errors of a sweep.

use std::error::Error;
use std::path::Path;

use ::flight::failure::FlightFailure;
use ::flight::journal::JournalError;
use scenario_file::ScenarioError;

type Cause = Box<dyn Error + Send + Sync>;

/// Reason why a sweep cannot be flown or merged.
#[derive(Debug, thiserror::Error)]
pub enum SweepError {
    /// The scenario is invalid.
    #[error(transparent)]
    Scenario(#[from] ScenarioError),
    /// A flight could not begin.
    #[error(transparent)]
    Flight(#[from] FlightFailure),
    /// The sweep or the request is invalid.
    #[error(transparent)]
    BadInput(Cause),
    /// Results could not be written.
    #[error(transparent)]
    NotWritten(Cause),
    /// The operating system reported an error.
    #[error(transparent)]
    Trouble(Cause),
}

impl SweepError {
    /// Makes the error of an invalid sweep.
    #[must_use]
    pub fn bad_input(cause: impl Into<Cause>) -> Self {
        Self::BadInput(cause.into())
    }

    /// Makes the error of results that could not be written.
    #[must_use]
    pub fn not_written(cause: impl Into<Cause>) -> Self {
        Self::NotWritten(cause.into())
    }

    /// Makes the error of an operating system call.
    #[must_use]
    pub fn trouble(cause: impl Into<Cause>) -> Self {
        Self::Trouble(cause.into())
    }
}

impl From<JournalError> for SweepError {
    fn from(error: JournalError) -> Self {
        match error {
            JournalError::File { .. } => Self::not_written(error),
            JournalError::Unreadable { .. } | JournalError::Program(_) => Self::trouble(error),
            _ => Self::bad_input(error),
        }
    }
}

/// Creates a folder of results and its parents.
///
/// # Errors
/// [`SweepError::NotWritten`].
pub fn make_folder(folder: &Path) -> Result<(), SweepError> {
    std::fs::create_dir_all(folder)
        .map_err(|error| SweepError::not_written(format!("cannot make {}: {error}", folder.display())))
}
