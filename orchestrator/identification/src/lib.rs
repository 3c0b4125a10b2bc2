//! What a laboratory is, from the log of a flight.
//!
//! * [`model`]: what the estimator should believe of markers, delay and noise;
//! * [`link`]: what the channels of a radio link meant.

pub mod link;
pub mod model;
