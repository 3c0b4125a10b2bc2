//! Path and timing law: the desired position of the vehicle, and the speed along the path.
//!
//! A [`curve`] is pd(γ) with its γ-derivatives. The [`timing_law`] of the paper, (22)–(25), moves γ: at full speed while
//! the vehicle is close, not at all while it is far, with a smooth [`bump`] between. The [`service`] evaluates both at
//! every tick. In a flight with [`phases`] the reference moves from the ground to the path and back along straight
//! [`transition_segments`], with a [`speed_profile`] from rest to rest.
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
