//! Encoding of a command on the link.
//!
//! * The ideal link carries unchanged numbers: no channels, no limits, no saturation.
//! * The radio link carries thrust and body rates as four channels ([`Channel`]); the frame has the decoded values of the
//!   channels. With the paper's calibration the travels are TRC = (T − 2.3071)/3.138 and ωRC = −[ωx/19, ωy/19, ωz/8].
//!
//! A link to hardware has the thrust stick at its end from arming until the first thrust (`ThrustRest`).
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

    /// Puts the thrust stick of a frame to hardware at its end until the first thrust. `has_pulled` is the state from frame to
    /// frame: whether there was a thrust since the motors were last stopped.
    #[inline]
    pub fn rest(&self, has_pulled: &mut bool, frame: &mut RcFrame) {
        if let Self::Radio(Radio { rest: Some(rest), .. }) = self {
            rest.apply(has_pulled, frame);
        }
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
    /// `None` if the link is simulated.
    rest: Option<ThrustRest>,
}

/// Thrust stick at no thrust. A flight controller does not arm while that stick is off its end (`min_check` of Betaflight), and
/// the calibrated code of no thrust may be far from it: with the paper's radio at an eighth of the way. In flight the calibration
/// holds, because a flight controller may stop levelling at that end.
#[derive(Clone, Copy, Debug, PartialEq)]
struct ThrustRest {
    /// Code of the stick's end.
    end: u16,
    /// Thrust of one code, N.
    one_code: f64,
}

impl ThrustRest {
    #[inline]
    fn apply(&self, has_pulled: &mut bool, frame: &mut RcFrame) {
        let is_armed = !frame.failsafe.is_set();
        *has_pulled = is_armed && (*has_pulled || frame.thrust >= self.one_code);
        if is_armed && !*has_pulled {
            frame.channels[0] = self.end;
        }
    }
}

impl Radio {
    /// Makes the link of these checked parameters.
    #[must_use]
    pub fn new(link: &RcLink) -> Self {
        let rate_channel = |slope| Channel::new(0.0, slope, link.rate_range, link.resolution);
        let thrust = Channel::new(
            link.thrust_offset,
            link.thrust_slope,
            thrust_range(link),
            link.resolution,
        );
        let rest = ThrustRest {
            end: if link.thrust_slope > 0.0 {
                0
            } else {
                thrust.last_code()
            },
            one_code: thrust.quantum(),
        };
        Self {
            thrust,
            rates: link.rate_slope.map(rate_channel),
            rest: (!link.link.is_simulated()).then_some(rest),
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

#[cfg(test)]
mod tests {
    use super::*;
    use scenario::RadioProtocol;
    use zerocopy::FromZeros;

    #[test]
    fn the_thrust_stick_is_at_its_end_until_the_first_thrust_and_after_the_motors_were_stopped() {
        for (slope, end) in [(3.138, 0), (-3.138, 2047)] {
            let stated = RcLink {
                link: RadioProtocol::Crsf,
                thrust_offset: 2.3071,
                thrust_slope: slope,
                ..RcLink::default()
            };
            let simulated = RcLink {
                link: RadioProtocol::Simulated,
                ..stated.clone()
            };
            let [link, simulated] = [&stated, &simulated].map(|link| Link::new(Some(link)));
            let mut has_pulled = false;
            let mut thrust_code = |link: Link, thrust: Option<f64>| {
                let command = thrust.map(|thrust| ControlCommand {
                    thrust,
                    mode: ControlCommand::MODE_RATES,
                    ..ControlCommand::new_zeroed()
                });
                let mut frame = RcFrame::new_zeroed();
                link.transmit(command.as_ref(), None, &mut frame);
                link.rest(&mut has_pulled, &mut frame);
                frame.channels[0]
            };
            let none = thrust_code(simulated, Some(0.0));
            assert_ne!(none, end);
            assert_eq!(
                [0.0, 0.001].map(|thrust| thrust_code(link, Some(thrust))),
                [end; 2]
            );
            assert_ne!(thrust_code(link, Some(0.5)), end);
            assert_eq!(thrust_code(link, Some(0.0)), none, "in flight");
            thrust_code(link, None);
            assert_eq!(thrust_code(link, Some(0.0)), end, "armed again");
        }
    }
}
