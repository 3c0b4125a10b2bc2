//! Tests of the estimator from outside, in one program: linking takes longer than running.

#[path = "../../../../tests/common/allocations.rs"]
mod allocations;
#[path = "../../../../tests/common/garbage.rs"]
mod garbage;
mod indoors;
mod inertial;
mod kalman;
mod no_allocation;
#[path = "../../../../tests/common/restart.rs"]
mod restart;
mod safety;
mod service;
