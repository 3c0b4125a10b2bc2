//! The estimator: from what the cameras saw to the vehicle's state.
//!
//! * [`source`]: what a state may rest on;
//! * [`EstimatorService`]: the step function.
//!
//! When the body is not seen it says so and keeps its last state: every consumer decides for itself how long
//! such a state is good enough.

mod service;
pub mod source;

pub use service::{EstimatorService, EstimatorState};
