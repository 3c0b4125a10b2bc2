//! Limits of the operating system.
//!
//! * [`packet`]: texts of any length over a socket with a limited packet size;
//! * [`resource_limits`]: the exhausted limit behind a system error, with the fix.

pub mod packet;
pub mod resource_limits;
