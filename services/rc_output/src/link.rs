//! Encoding of a command on the link.
//!
//! * The ideal link carries unchanged numbers: no channels, no limits, no saturation.
//! * The radio link carries thrust and body rates as four channels ([`Channel`]); the frame has the decoded values of the
//!   channels. With the paper's calibration the travels are TRC = (T − 2.3071)/3.138 and ωRC = −[ωx/19, ωy/19, ωz/8].
//!
//! Without a command, for a failsafe command, and for torque on the radio link it sends a failsafe frame, which stops the
//! motors.

use scenario::RcLink;
use shared_types::samples::{ControlCommand, RcFrame};

use crate::battery::BatteryEffect;
use crate::channel::Channel;

/// Link of a flight.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Link {
    /// Carries every command unchanged.
    Ideal,
    /// Carries thrust and body rates within its range and resolution.
    Radio(Radio),
}

impl Link {
    /// Makes the link of a scenario; ideal unless stated.
    #[must_use]
    pub fn new(link: Option<&RcLink>) -> Self {
        link.map_or(Self::Ideal, |link| Self::Radio(Radio::new(link)))
    }

    /// Writes the frame of `command`, whose numbers are finite, except for header, stage and counters. On the radio link a
    /// modelled battery corrects the thrust channel, and not the frame's `thrust`.
    #[inline]
    pub fn transmit(
        &self,
        command: Option<&ControlCommand>,
        battery: Option<&BatteryEffect>,
        frame: &mut RcFrame,
    ) {
        match (
            self,
            command.filter(|command| command.mode != ControlCommand::MODE_FAILSAFE),
        ) {
            (Self::Ideal, Some(command)) => transmit_unchanged(command, frame),
            (Self::Radio(radio), Some(command)) if command.mode == ControlCommand::MODE_RATES => {
                radio.transmit(command, battery.and_then(|battery| battery.factor), frame);
            }
            (Self::Ideal, None) => transmit_failsafe(RcFrame::MODE_TORQUE, frame),
            (Self::Radio(_), _) => transmit_failsafe(RcFrame::MODE_RATES, frame),
        }
    }
}

/// Writes the frame of the ideal link.
#[inline]
fn transmit_unchanged(command: &ControlCommand, frame: &mut RcFrame) {
    frame.channels = [0; 16];
    frame.thrust = command.thrust;
    frame.torque_body = command.torque_body;
    frame.rates_body = command.rates_body;
    frame.mode = command.mode;
    frame.failsafe = false.into();
    frame.saturated = false.into();
}

/// Writes the frame that stops the motors.
#[inline]
fn transmit_failsafe(mode: u32, frame: &mut RcFrame) {
    frame.channels = [0; 16];
    frame.thrust = 0.0;
    frame.torque_body = [0.0; 3];
    frame.rates_body = [0.0; 3];
    frame.mode = mode;
    frame.failsafe = true.into();
    frame.saturated = false.into();
}

/// The radio link's four channels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Radio {
    thrust: Channel,
    rates: [Channel; 3],
}

impl Radio {
    /// Makes the link of these checked parameters.
    #[must_use]
    pub fn new(link: &RcLink) -> Self {
        let rate_channel = |slope| Channel::new(0.0, slope, link.rate_range, link.resolution);
        Self {
            thrust: Channel::new(
                link.thrust_offset,
                link.thrust_slope,
                thrust_range(link),
                link.resolution,
            ),
            rates: link.rate_slope.map(rate_channel),
        }
    }

    /// Writes the frame of a command of thrust and body rates: the channels `thrust`, `roll rate`, `pitch rate`, `yaw
    /// rate`, and their decoded values. The thrust channel has the thrust times `factor`, if there is one.
    #[inline]
    fn transmit(&self, command: &ControlCommand, factor: Option<f64>, frame: &mut RcFrame) {
        let thrust = self
            .thrust
            .send(factor.map_or(command.thrust, |factor| factor * command.thrust));
        let mut saturated = thrust.saturated;
        frame.channels = [0; 16];
        frame.channels[0] = thrust.code;
        // The code of zero thrust may decode to a value below zero by rounding.
        let meant = self.thrust.meaning(thrust.code).max(0.0);
        frame.thrust = factor.map_or(meant, |factor| meant / factor);
        for (axis, channel) in self.rates.iter().enumerate() {
            let rate = channel.send(command.rates_body[axis]);
            saturated |= rate.saturated;
            frame.channels[1 + axis] = rate.code;
            frame.rates_body[axis] = channel.meaning(rate.code);
        }
        frame.torque_body = [0.0; 3];
        frame.mode = RcFrame::MODE_RATES;
        frame.failsafe = false.into();
        frame.saturated = saturated.into();
    }
}

/// Returns the part of the thrust channel's range with non-negative thrust.
fn thrust_range(link: &RcLink) -> [f64; 2] {
    let [least, most] = link.thrust_range;
    let at_rest = -link.thrust_offset / link.thrust_slope;
    if link.thrust_slope > 0.0 {
        [least.max(at_rest), most]
    } else {
        [least, most.min(at_rest)]
    }
}
