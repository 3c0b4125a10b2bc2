//! Lock-free parts of `runtime`, the code itself, with loom's atomics. `tests/models.rs` checks every interleaving of them.

/// This crate, also under the name by which the code imports [`Gains`].
extern crate self as shared_types;

/// Atomics as `runtime` imports them.
mod atomics {
    pub use loom::sync::atomic::{AtomicU32, AtomicU64, Ordering, fence};
}

#[path = "../../src/announcement.rs"]
pub mod announcement;
#[path = "../../src/seqlock.rs"]
pub mod seqlock;
#[path = "../../src/status_cell.rs"]
pub mod status_cell;
#[path = "../../src/tuning.rs"]
pub mod tuning;

/// Gains of two words in place of those of the control law.
#[derive(
    Clone, Copy, Debug, Default, PartialEq, zerocopy::FromBytes, zerocopy::IntoBytes, zerocopy::Immutable,
)]
#[repr(C)]
pub struct Gains {
    pub k1: f64,
    pub k2: f64,
}
