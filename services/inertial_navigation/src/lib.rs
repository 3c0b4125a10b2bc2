//! Error-state Kalman filter for flight outdoors: from inertial, satellite, pressure and magnetic sensors to the vehicle's
//! motion. Poses of motion capture are a further source, outdoors or indoors.
//!
//! * [`nominal`]: the mean, and its propagation by the inertial measurement unit;
//! * [`error_state`]: the error of the mean: its transition, and the process noise;
//! * [`horizon`]: mean and covariance at a delayed time, and their correction by a measurement;
//! * [`measurement`]: what a fix, a baseline, a field, an altitude and a pose measure, with their derivatives;
//! * [`alignment`]: the start at rest;
//! * [`InertialFilter`]: measurements at their time of validity, gates, resets, and the motion at present;
//! * [`InertialState`]: all of it as a record, from which a restarted filter continues bit by bit.
//!
//! The error is that of J. Solà, "Quaternion kinematics for the error-state Kalman filter", 2017 (sections 5 and 6), with the
//! attitude's on the right: R_true = R exp S(θ). Measurements are late by up to a tenth of a second. As in PX4's EKF2 (P. Riseborough,
//! "Application of the EKF to small UAVs"), the filter therefore works at a horizon that is older than the latest of them,
//! where each one is fused exactly at the time at which it is valid. The motion at present is the mean of the horizon,
//! propagated by the samples since: no output predictor approximates it.
//!
//! {I} has z down, {B} is the body. A magnetic field is in gauss; all else in SI units. A step allocates nothing.

pub mod alignment;
pub mod error_state;
pub mod filter;
pub mod horizon;
pub mod measurement;
pub mod nominal;
pub mod parameters;
mod state;

pub use filter::{Correction, InertialFilter, Source, SourceStatus};
pub use measurement::{Altitude, Baseline, Field, Fix, ImuSample, Pose};
pub use parameters::Parameters;
pub use state::InertialState;
