//! Transmitter of the radio link: from the controller's commands to the sent frames.
//!
//! * [`channel`]: calibration and quantisation of a channel;
//! * [`battery`]: the modelled battery, and the thrust that it changes;
//! * [`link`]: encoding of a command on the link;
//! * [`envelope`]: the limits of vehicle and commands;
//! * [`guard`]: the decision whether a command may be sent;
//! * [`RcOutputService`]: the step function.
//!
//! Failure policy:
//! * without a command, with one that the link cannot carry, and with a failsafe command it sends failsafe frames, which stop
//!   the motors;
//! * an invalid command (a number that is not finite, an unknown mode) is refused and counted; the last valid one is repeated,
//!   which is also the vehicle's behaviour without a frame;
//! * with a policy a command that is too old is repeated as well, and above a larger age failsafe frames are sent;
//! * commands that the operator, the phases or the envelope do not permit are not sent ([`guard`]);
//! * the frame's `stage` states the case; changes by a limit are marked and counted.

pub mod battery;
pub mod channel;
pub mod envelope;
pub mod guard;
pub mod link;
mod service;

pub use service::{RcOutputService, RcOutputState};
