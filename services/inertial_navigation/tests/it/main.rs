//! Tests of the filter from outside, in one program: linking takes longer than running.

mod alignment;
#[path = "../../../../tests/common/allocations.rs"]
mod allocations;
mod consistency;
mod derivatives;
mod faults;
mod figures;
mod no_allocation;
mod restart;
mod rig;
