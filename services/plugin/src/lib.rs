//! Services from shared libraries, in C or any language with a C interface: **plug-ins**.
//!
//! A plug-in implements the contract [`Service`](shared_types::Service) in C: create, step, save, restore, destroy. It runs
//! wherever a built-in service does: in lock step, in real time, in one process, in a replay and in a sweep. Its state is in
//! the checkpoints, so that it is restarted and replayed as other services.
//!
//! * [`abi`]: the interface, version 1;
//! * [`header`]: the interface as `gerono.h`, with the samples of all topics;
//! * [`mod@export`]: the interface of a [`Service`](shared_types::Service) in Rust;
//! * `float_mode`: the floating-point mode, which no library may change;
//! * [`loader`]: loads and checks a library, and makes its service;
//! * [`mod@math`]: elementary functions with the same bytes on every machine;
//! * [`library_file`]: path and hash of a scenario's library.

#![warn(missing_docs)]

pub mod abi;
#[cfg(feature = "load")]
mod calls;
pub mod export;
#[cfg(feature = "load")]
pub mod float_mode;
#[cfg(feature = "load")]
mod guarded;
pub mod header;
pub mod library_file;
#[cfg(feature = "load")]
pub mod loader;
pub mod math;
#[cfg(feature = "load")]
mod setup_texts;

#[cfg(feature = "load")]
pub use calls::end_process;
pub use export::{Plugin, Setup};
