//! Links from outside, in one program: linking takes longer than running.

#[path = "../../../../tests/common/allocations.rs"]
mod allocations;
mod every_link;
mod formats;
mod meaning;
mod ports;
mod receiver;
mod telemetry;
mod vehicles;
