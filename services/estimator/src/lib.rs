//! The estimator: from what the cameras saw to the vehicle's state.
//!
//! * [`source`]: what a state may rest on;
//! * [`kalman`]: the error-state Kalman filter, which makes the state from poses and the frames already sent;
//! * [`EstimatorService`]: the step function.
//!
//! When the body is not seen it says so and keeps its last state: every consumer decides for itself how long
//! such a state is good enough.

pub mod kalman;
mod service;
pub mod source;

pub use service::{EstimatorService, EstimatorState};
pub use source::Estimate;
