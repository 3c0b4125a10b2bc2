//! The plant from outside, in one program: linking takes longer than running.

#[path = "../../../../tests/common/rebirth.rs"]
mod rebirth;
mod safety;
mod service;
