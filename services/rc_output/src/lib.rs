//! The radio link's transmitter: from what the controller commands to the frames that are sent.
//!
//! * [`channel`]: what a stick's travel means, and in which steps it is sent;
//! * [`link`]: what a command becomes on the link;
//! * [`envelope`]: the limits of vehicle and commands;
//! * [`guard`]: what may be sent at all;
//! * [`RcOutputService`]: the step function.
//!
//! Failure policy:
//! * without any command, and with one that the link cannot carry or that asks for it, it sends failsafe frames, with
//!   which the motors rest;
//! * a command that cannot be meant (a number that is not finite, an unknown mode) is refused and counted; the
//!   last good one is sent again in its place, which is what the vehicle would do without a frame;
//! * with a policy a command that is too old is sent again as well, and from a greater age on failsafe frames are;
//! * what the operator, the phases or the envelope forbid is not sent, whatever the command ([`guard`]);
//! * the frame's `stage` says which of it is the case; a limit that changes a command is said and counted as well.

pub mod channel;
pub mod envelope;
pub mod guard;
pub mod link;
mod service;

pub use service::{RcOutputService, RcOutputState};
