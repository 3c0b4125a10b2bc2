//! Limits of the operating system.
//!
//! * [`packet`]: texts of any length over a socket with a limited packet size;
//! * [`resource_limits`]: the exhausted limit behind a system error, with the fix;
//! * [`shared_memory`]: what lacks when shared memory cannot be used.

pub mod packet;
pub mod resource_limits;
pub mod shared_memory;
