//! Reasons why a sweep cannot be flown or merged.

use std::error::Error;
use std::path::Path;

use ::flight::failure::FlightFailure;
use ::flight::journal::JournalError;
use scenario_file::ScenarioError;

type Cause = Box<dyn Error + Send + Sync>;

/// Reason why a sweep cannot be flown or merged.
#[derive(Debug, thiserror::Error)]
pub enum SweepError {
    /// The scenario is wrong.
    #[error(transparent)]
    Scenario(#[from] ScenarioError),
    /// A flight could not begin.
    #[error(transparent)]
    Flight(#[from] FlightFailure),
    /// The sweep, or what is asked of it, is wrong.
    #[error(transparent)]
    BadInput(Cause),
    /// Results could not be written.
    #[error(transparent)]
    NotWritten(Cause),
    /// Trouble with the machine.
    #[error(transparent)]
    Trouble(Cause),
}

impl SweepError {
    /// Makes the error of a wrong sweep.
    #[must_use]
    pub fn bad_input(cause: impl Into<Cause>) -> Self {
        Self::BadInput(cause.into())
    }

    /// Makes the error of results that could not be written.
    #[must_use]
    pub fn not_written(cause: impl Into<Cause>) -> Self {
        Self::NotWritten(cause.into())
    }

    /// Makes the error of a machine that does not do its part.
    #[must_use]
    pub fn trouble(cause: impl Into<Cause>) -> Self {
        Self::Trouble(cause.into())
    }
}

impl From<JournalError> for SweepError {
    fn from(error: JournalError) -> Self {
        match error {
            JournalError::File { .. } => Self::not_written(error),
            JournalError::Program(_) => Self::trouble(error),
            _ => Self::bad_input(error),
        }
    }
}

/// Makes a folder of results, with those above it.
///
/// # Errors
/// [`SweepError::NotWritten`].
pub fn make_folder(folder: &Path) -> Result<(), SweepError> {
    std::fs::create_dir_all(folder)
        .map_err(|error| SweepError::not_written(format!("cannot make {}: {error}", folder.display())))
}
