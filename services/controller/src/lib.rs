//! The paper's adaptive control law, as step logic and as a pure function.
//!
//! * [`projection`]: the smooth projection π (5) and the potential V(s, s̃) (6);
//! * [`saturation`]: σ and its derivatives;
//! * [`parameters`]: gains and bounds;
//! * [`signals`]: what the law is a function of;
//! * [`law`]: errors, thrust, torque and the estimators' rates, (7) to (21), as one pure function;
//! * [`zeta_rate`]: ζ̇ as an affine function of the unknown acceleration;
//! * [`regressor`]: W of (20), kept structured;
//! * [`lyapunov`]: the Lyapunov function that the law makes decrease;
//! * [`offset`]: what δ makes the vehicle hang below the path;
//! * [`rates`]: the law for a vehicle that takes body rates, rolled out over the hold of a command;
//! * [`yaw`]: the yaw law (28);
//! * [`rate_controller`]: both, from hold to hold;
//! * [`failsafe`]: what is commanded when the vehicle's state is too old for the law;
//! * [`dead_reckoning`]: where the vehicle is by now, from the last good state and the commands since;
//! * [`bumpless_transfer`]: commands that pass over to the law's without a jump;
//! * [`safety`]: the three of them together, by the age of the state;
//! * [`references`]: which reference the law flies by;
//! * [`phase`]: what the phase of the flight leaves to the controller;
//! * [`control_supervisor`]: what is commanded, by the law or something safer;
//! * [`observer`]: a mass observer of another kind, to compare with;
//! * [`service`]: the law and its estimators as a service of the flight.
//!
//! The controller knows nothing of the path or of its timing law: what it needs of them comes with
//! [`PathReference`](shared_types::samples::PathReference).
//!
//! Where it differs from the paper: k1 d²σ(z1)/dt² and d³γ/dt³ contain the unknown acceleration as well, and
//! both are part of W here, which the paper leaves to the reader.

pub mod bumpless_transfer;
pub mod control_supervisor;
pub mod dead_reckoning;
pub mod errors;
pub mod failsafe;
pub mod law;
pub mod lyapunov;
pub mod observer;
pub mod offset;
pub mod parameter_vector;
pub mod parameters;
pub mod phase;
pub mod projection;
pub mod rate_controller;
pub mod rates;
pub mod references;
pub mod regressor;
pub mod safety;
pub mod saturation;
pub mod service;
pub mod signals;
pub mod yaw;
pub mod zeta_rate;

pub use law::{Evaluation, evaluate};
pub use parameters::Parameters;
pub use service::ControllerService;
pub use signals::{Acting, Estimates, Measured, Reference};
