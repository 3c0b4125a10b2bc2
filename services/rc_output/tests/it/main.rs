//! The transmitter from outside, in one program: linking takes longer than running.

mod guard;
#[path = "../../../../tests/common/rebirth.rs"]
mod rebirth;
mod safety;
mod service;
