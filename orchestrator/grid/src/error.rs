//! Errors of a grid.

use std::io;

use flight::failure::FlightFailure;
use flight::journal::JournalError;
use scenario_file::ScenarioError;

/// Reason why a grid cannot be flown.
#[derive(Debug, thiserror::Error)]
pub enum GridError {
    /// The scenario is invalid.
    #[error(transparent)]
    Scenario(#[from] ScenarioError),
    /// A flight could not begin.
    #[error(transparent)]
    Flight(#[from] FlightFailure),
    /// Results cannot be stored.
    #[error(transparent)]
    Journal(#[from] JournalError),
    /// The request is invalid.
    #[error("{0}")]
    BadInput(String),
    /// The scenario cannot be read.
    #[error(transparent)]
    Unreadable(io::Error),
    /// A law cannot fly a condition.
    #[error("`{law}` cannot fly the condition `{condition}`")]
    Condition {
        /// The law.
        law: String,
        /// The condition.
        condition: &'static str,
        /// The reason.
        source: Box<GridError>,
    },
}
