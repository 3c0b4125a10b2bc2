//! Services from shared libraries, in C or any language that can be called from it: **plug-ins**.
//!
//! A plug-in is the image of the contract [`Service`](shared_types::Service) in C: create, step, save, restore,
//! destroy. It flies wherever a built-in service does: in lock step, in real time, in one process, in a replay and in a
//! sweep. Its state is in the checkpoints, so that it is restarted and replayed as the others.
//!
//! * [`abi`]: the interface, version 1;
//! * [`header`]: the same as `gerono.h`, with the samples of all topics;
//! * [`mod@export`]: the interface of a Rust library, made from a [`Service`](shared_types::Service);
//! * `float_mode`: the floating-point mode, which no library may change;
//! * [`loader`]: loads a library, checks it, and makes a service of it;
//! * [`mod@math`]: elementary functions with the same bytes on every machine;
//! * [`library_file`]: where the library of a scenario is, and whether it is the one that was flown.

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
