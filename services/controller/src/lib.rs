//! The paper's adaptive control law, as step logic and as a pure function.
//!
//! * [`adaptive`]: the paper's law, (7) to (21), as pure functions;
//! * [`law`]: a control law as the supervisor flies it, and the baselines;
//! * [`signals`]: the arguments of a law;
//! * [`rates`]: a law for a vehicle with body-rate commands, rolled out over the hold of a command;
//! * [`yaw`]: the yaw law (28);
//! * [`rate_controller`]: both, from hold to hold;
//! * [`failsafe`]: the stages of commands when the vehicle's state is too old for the law;
//! * [`dead_reckoning`]: the predicted state of the vehicle, from the last good one and the commands since;
//! * [`bumpless_transfer`]: the return of commands to the law's without a jump;
//! * [`safety`]: these three together, by the age of the state;
//! * [`references`]: the reference for the law;
//! * [`phase`]: the control mode in each phase of the flight;
//! * [`control_supervisor`]: commands by the law or a failsafe stage;
//! * [`observer`]: a mass observer of another kind, for comparison;
//! * [`service`]: the law and its estimators as a service of the flight.
//!
//! The controller does not know the path or its timing law: [`PathReference`](shared_types::samples::PathReference)
//! brings all that it needs of them.
//!
//! Difference from the paper: k1 d²σ(z1)/dt² and d³γ/dt³ contain the unknown acceleration as well. Both are part of W
//! here; the paper leaves that to the reader.

pub mod adaptive;
pub mod bumpless_transfer;
pub mod control_supervisor;
pub mod dead_reckoning;
pub mod failsafe;
pub mod law;
pub mod observer;
pub mod phase;
pub mod rate_controller;
pub mod rates;
pub mod references;
pub mod safety;
pub mod service;
pub mod signals;
pub mod yaw;

pub use adaptive::evaluation::{Evaluation, evaluate};
pub use adaptive::parameters::Parameters;
pub use service::ControllerService;
pub use signals::{Acting, Estimates, Measured, Reference};
