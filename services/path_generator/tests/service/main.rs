//! What hosts may rely on: the path generator through the contract that they step it by.

mod allocation;
mod evaluations;
mod flight;
mod step;
