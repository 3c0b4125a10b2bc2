//! Atomics of [`crate::seqlock`], replaced by loom's in its models.

pub use std::sync::atomic::{AtomicU64, Ordering, fence};
