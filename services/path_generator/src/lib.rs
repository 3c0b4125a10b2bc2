//! Path and timing law: the desired place of the vehicle, and the rate at which the path moves on.
//!
//! A [`curve`] is pd(γ) with its γ-derivatives. The [`timing_law`] of the paper, (22)–(25), moves γ: at full speed
//! while the vehicle is close, not at all while it is far, by a smooth [`bump`] between. The [`service`] joins both at
//! every tick. A flight with [`phases`] leads from the ground to the path and back on straight [`transition_segments`],
//! with a [`speed_profile`] from rest to rest.
//!
//! Failure policy: without a tracked vehicle the path stands still. A scenario without a valid path is refused at
//! construction; a step never fails.

pub mod bump;
pub mod curve;
pub mod phases;
pub mod service;
pub mod speed_profile;
#[cfg(test)]
mod taylor;
pub mod timing_law;
pub mod transition_segments;

pub use curve::{Curve, CurveError, CurvePoint};
pub use service::{PathGeneratorError, PathGeneratorService, PathGeneratorState};
