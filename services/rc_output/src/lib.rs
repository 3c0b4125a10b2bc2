//! The radio link's transmitter: from what the controller commands to the frames that are sent.
//!
//! * [`link`]: what a command becomes on the link;
//! * [`RcOutputService`]: the step function.
//!
//! As long as there is no command it sends failsafe frames with the motors at rest.

pub mod link;
mod service;

pub use service::{RcOutputService, RcOutputState};
