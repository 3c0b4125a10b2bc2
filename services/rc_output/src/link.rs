//! What a command becomes on the link.
//!
//! The ideal link carries numbers as they are: no channels, no limits, and so no saturation. A real one maps
//! them to channels within the range of its sticks.

use shared_types::samples::{ControlCommand, RcFrame};

/// Writes the frame that carries `command`.
#[inline]
pub fn transmit(command: &ControlCommand, frame: &mut RcFrame) {
    frame.channels = [0; 16];
    frame.thrust = command.thrust;
    frame.torque_body = command.torque_body;
    frame.rates_body = command.rates_body;
    frame.mode = command.mode;
    frame.failsafe = false.into();
    frame.saturated = false.into();
}

/// Writes the frame that lets the motors rest: no thrust, no torque, failsafe.
#[inline]
pub fn transmit_failsafe(frame: &mut RcFrame) {
    frame.channels = [0; 16];
    frame.thrust = 0.0;
    frame.torque_body = [0.0; 3];
    frame.rates_body = [0.0; 3];
    frame.mode = RcFrame::MODE_TORQUE;
    frame.failsafe = true.into();
    frame.saturated = false.into();
}
