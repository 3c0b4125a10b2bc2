//! Identification of a laboratory from the log of a flight.
//!
//! * [`model`]: marker offset, delay and noise, for the estimator;
//! * [`link`]: calibration of a radio link's channels.

pub mod link;
pub mod model;
