//! Tests of the transmitter from outside, in one program: linking takes longer than running.

#[path = "../../../../tests/common/allocations.rs"]
mod allocations;
mod battery;
mod guard;
mod no_allocation;
#[path = "../../../../tests/common/restart.rs"]
mod restart;
mod safety;
mod service;
