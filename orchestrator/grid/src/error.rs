//! Reasons why a grid cannot be flown.

use std::io;

use flight::failure::FlightFailure;
use flight::journal::JournalError;
use scenario_file::ScenarioError;

/// Reason why a grid cannot be flown.
#[derive(Debug, thiserror::Error)]
pub enum GridError {
    /// The scenario is wrong.
    #[error(transparent)]
    Scenario(#[from] ScenarioError),
    /// A flight could not begin.
    #[error(transparent)]
    Flight(#[from] FlightFailure),
    /// Results cannot be kept.
    #[error(transparent)]
    Journal(#[from] JournalError),
    /// What is asked for is wrong.
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
