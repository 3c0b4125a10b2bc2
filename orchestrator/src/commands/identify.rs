//! `gerono identify`: identifies marker offset, delay, lags and noise from a log.

use identification::model::{self, recording::Recording};

use super::{Failure, log_path, print_identified};
use crate::cli::Identify;

/// `gerono identify`.
///
/// # Errors
/// [`Failure`] if the log cannot be read or is too short.
pub fn identify(arguments: &Identify) -> Result<(), Failure> {
    let log = log_path(&arguments.log);
    let recording = Recording::read(&log).map_err(Failure::trouble)?;
    let found = model::identify(&recording).map_err(Failure::trouble)?;
    print_identified(&log, &found, arguments.json)
}
