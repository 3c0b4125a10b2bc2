//! Atomics of [`crate::seqlock`]; loom replaces them by its own.

pub use std::sync::atomic::{AtomicU64, Ordering, fence};
