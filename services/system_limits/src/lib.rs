//! Bounds of the operating system that nothing of ours states.
//!
//! * [`packet`]: texts of any length over a socket whose packets are bounded;
//! * [`resource_limits`]: which limit a refusal of the system means, in words.

pub mod packet;
pub mod resource_limits;
