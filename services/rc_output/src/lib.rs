//! Transmitter of the radio link: from the controller's commands to the sent frames.
//!
//! * [`channel`]: the meaning of a stick's travel, and the steps in which it is sent;
//! * [`link`]: the form of a command on the link;
//! * [`envelope`]: the limits of vehicle and commands;
//! * [`guard`]: the decision whether a command may be sent;
//! * [`RcOutputService`]: the step function.
//!
//! Failure policy:
//! * without any command, and with one that the link cannot carry or that is a failsafe, it sends failsafe frames,
//!   which stop the motors;
//! * an invalid command (a number that is not finite, an unknown mode) is refused and counted; the last good one is
//!   sent again, which is the vehicle's behaviour without a frame;
//! * with a policy a command that is too old is sent again as well, and above a greater age failsafe frames are sent;
//! * commands against the operator, the phases or the envelope are not sent ([`guard`]);
//! * the frame's `stage` states the case; changes by a limit are marked and counted as well.

pub mod channel;
pub mod envelope;
pub mod guard;
pub mod link;
mod service;

pub use service::{RcOutputService, RcOutputState};
