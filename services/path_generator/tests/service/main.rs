//! Path generator through the contract by which hosts step it.

mod allocation;
#[path = "../../../../tests/common/allocations.rs"]
mod allocations;
mod evaluations;
mod flight;
mod flown_path;
mod phases;
#[path = "../../../../tests/common/restart.rs"]
mod restart;
mod safety;
mod sight;
mod step;
