//! Tests of the estimator from outside, in one program: linking takes longer than running.

#[path = "../../../../tests/common/garbage.rs"]
mod garbage;
mod kalman;
#[path = "../../../../tests/common/restart.rs"]
mod restart;
mod safety;
mod service;
