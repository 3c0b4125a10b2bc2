//! Tests of motion capture from outside, in one program: linking takes longer than running.

mod agreement;
#[path = "../../../../tests/common/allocations.rs"]
mod allocations;
mod campaign;
mod no_allocation;
#[path = "../../../../tests/common/ports.rs"]
mod ports;
mod strangers;
mod systems;
mod wire;
