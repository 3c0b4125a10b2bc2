//! The radio link's transmitter: from what the controller commands to the frames that are sent.
//!
//! * [`channel`]: what a stick's travel means, and in which steps it is sent;
//! * [`link`]: what a command becomes on the link;
//! * [`RcOutputService`]: the step function.
//!
//! Failure policy: as long as there is no command that the link can carry it sends failsafe frames, with which the
//! motors rest. A limit that changes a command is said in the frame and counted.

pub mod channel;
pub mod link;
mod service;

pub use service::{RcOutputService, RcOutputState};
