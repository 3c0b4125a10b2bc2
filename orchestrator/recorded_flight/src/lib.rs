//! Recorded flights of other programs, as logs on which the estimator of flight outdoors can be replayed.
//!
//! * [`recording`]: the samples of a recording, a table in the format of PX4's EKF2;
//! * `units`: units that its numbers betray;
//! * [`publication`]: the ticks at which they are published;
//! * [`services`]: the recording in place of the plant, of the transmitter, and of the estimator;
//! * [`track`]: the recording's own estimate, and the distance of another one from it;
//! * [`import()`]: the command.
//!
//! The estimator of the scenario flies over the recording in one thread, by the scenario's schedule. The log is that of a
//! flight whose plant and transmitter were external programs: `gerono replay` repeats the estimator's steps.
//!
//! Failure policy: a table with a wrong line is refused with the number of the line, and nothing is written. Every sample is
//! in the log, or counted as left out.

mod command;
pub mod publication;
pub mod recording;
pub mod services;
pub mod track;
mod units;

pub use command::{Import, import};

#[cfg(test)]
mod tests;
