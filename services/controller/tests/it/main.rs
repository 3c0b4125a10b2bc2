//! Tests of the controller from outside, in one program: linking takes longer than running.

#[path = "../../../../tests/common/allocations.rs"]
mod allocations;
#[path = "../../../../tests/common/garbage.rs"]
mod garbage;
mod phase;
#[path = "../../../../tests/common/restart.rs"]
mod restart;
mod safety;
mod service;
mod support;
