//! Tests of the plant from outside, in one program: linking takes longer than running.

mod air;
#[path = "../../../../tests/common/allocations.rs"]
mod allocations;
mod motors;
mod no_allocation;
#[path = "../../../../tests/common/restart.rs"]
mod restart;
mod safety;
mod sensors;
mod service;
