//! The atomics of [`crate::seqlock`], in whose place loom puts its own.

pub use std::sync::atomic::{AtomicU64, Ordering, fence};
