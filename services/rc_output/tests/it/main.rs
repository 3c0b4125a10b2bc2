//! Tests of the transmitter from outside, in one program: linking takes longer than running.

mod guard;
#[path = "../../../../tests/common/restart.rs"]
mod restart;
mod safety;
mod service;
