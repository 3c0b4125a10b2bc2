//! What hosts may rely on: the path generator through the contract that they step it by.

mod allocation;
#[path = "../../../../tests/common/allocations.rs"]
mod allocations;
mod evaluations;
mod flight;
mod phases;
#[path = "../../../../tests/common/restart.rs"]
mod restart;
mod safety;
mod step;
