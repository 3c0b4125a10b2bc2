//! Control laws: the paper's, its extensions and the baselines, from a state and a reference to a command.
//!
//! * [`adaptive`]: the paper's law, (7) to (21), as pure functions;
//! * [`law`]: a control law as the control supervisor flies it, and the baselines;
//! * [`signals`]: the arguments of a law, and its commands;
//! * [`rates`]: a law for a vehicle with body-rate commands, rolled out over the hold of a command;
//! * [`yaw`]: the yaw law (28);
//! * [`rate_controller`]: both, from hold to hold;
//! * [`observer`]: a mass observer of another kind, for comparison.
//!
//! Difference from the paper: k1 d²σ(z1)/dt² and d³γ/dt³ contain the unknown acceleration as well. Both are part of W
//! here; the paper leaves that to the reader.

#![warn(missing_docs)]

pub mod adaptive;
pub mod law;
pub mod observer;
pub mod rate_controller;
pub mod rates;
pub mod signals;
pub mod yaw;

pub use adaptive::evaluation::{Evaluation, evaluate};
pub use adaptive::parameters::Parameters;
pub use signals::{Acting, Estimates, Measured, Reference};
