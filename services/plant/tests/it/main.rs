//! Tests of the plant from outside, in one program: linking takes longer than running.

mod air;
mod motors;
#[path = "../../../../tests/common/restart.rs"]
mod restart;
mod safety;
mod service;
