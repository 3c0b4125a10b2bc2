//! Controller as a service: the control supervisor around a [law](control_law::law).
//!
//! * [`failsafe`]: the stages of commands when the vehicle's state is too old for the law;
//! * [`command_history`]: the last commands, for a state that comes late;
//! * [`dead_reckoning`]: the predicted state of the vehicle, from the last good one and the commands since;
//! * [`bumpless_transfer`]: the return of commands to the law's without a jump;
//! * [`safety`]: these three together, by the age of the state;
//! * [`lone_landing`]: the landing of a vehicle whose path generator is lost;
//! * [`references`]: the reference for the law;
//! * [`phase`]: the control mode in each phase of the flight;
//! * [`control_supervisor`]: commands by the law or a failsafe stage;
//! * [`service`]: the supervisor as a service of the flight.
//!
//! The controller does not depend on the path or its timing law: a
//! [`PathReference`](shared_types::samples::PathReference) holds all that it needs of them.

pub mod bumpless_transfer;
pub mod command_history;
pub mod control_supervisor;
pub mod dead_reckoning;
pub mod failsafe;
pub mod lone_landing;
pub mod phase;
pub mod references;
pub mod safety;
pub mod service;

pub use service::ControllerService;
