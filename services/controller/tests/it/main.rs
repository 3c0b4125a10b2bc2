//! Tests of the controller from outside, in one program: linking takes longer than running.

#[path = "../../../../tests/common/garbage.rs"]
mod garbage;

mod phase;
#[path = "../../../../tests/common/restart.rs"]
mod restart;
mod safety;
#[path = "../support/mod.rs"]
mod support;
