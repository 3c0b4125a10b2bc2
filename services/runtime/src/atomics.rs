//! Atomics of the lock-free modules, replaced by loom's in their models.

pub use std::sync::atomic::{AtomicU32, AtomicU64, Ordering, fence};
