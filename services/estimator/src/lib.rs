//! Estimator: from the cameras' captures, or from the sensors of flight outdoors, to the vehicle's state.
//!
//! * [`source`]: sources of the state;
//! * [`kalman`]: the error-state Kalman filter, which estimates the state from poses and the sent frames;
//! * [`EstimatorService`]: the step function;
//! * [`InertialEstimatorService`]: that of flight outdoors.
//!
//! Without captures the estimator repeats the last state and marks it as not tracked: every consumer decides how long to use
//! it.

mod inertial;
pub mod kalman;
mod service;
pub mod source;

pub use inertial::{InertialEstimatorService, InertialEstimatorState};
pub use service::{EstimatorService, EstimatorState};
pub use source::Estimate;
