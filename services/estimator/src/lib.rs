//! Estimator: from the cameras' captures to the vehicle's state.
//!
//! * [`source`]: sources of a state;
//! * [`kalman`]: the error-state Kalman filter, which makes the state from poses and the frames already sent;
//! * [`EstimatorService`]: the step function.
//!
//! When the body is not seen, the state says so and is otherwise the last one: every consumer decides for itself how
//! long it uses such a state.

pub mod kalman;
mod service;
pub mod source;

pub use service::{EstimatorService, EstimatorState};
pub use source::Estimate;
