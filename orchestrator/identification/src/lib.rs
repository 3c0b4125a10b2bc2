//! Identification of a laboratory from the log of a flight.
//!
//! * [`model`]: marker offset, delay and noise, for the estimator;
//! * [`link`]: calibration of a radio link's channels;
//! * [`rehearsal`]: flights of the simulated laboratory, whose values are of the simulation;
//! * [`lateness`]: flights that are unfit for both.

pub mod lateness;
pub mod link;
pub mod model;
pub mod rehearsal;
