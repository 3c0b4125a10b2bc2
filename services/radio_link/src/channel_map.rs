//! Channel map: the meaning of each channel, and its travel.
//!
//! A stick's code c of 2^bits − 1 is the travel s = 2c/(2^bits − 1) − 1, as in `rc_output`. The sent travel is reversed
//! if the stick is, and scaled to its ends. A travel of −1 to 1 is the link's −100 to 100 %.
//!
//! The two travels are different types, and only the map converts between them. So "motors off" is stated as the least
//! thrust and never as an end of the channel: calibration and map determine which end that is.

use scenario::{RcLink, ThrustChannel, Transmitter};

use crate::ChannelCodes;
use crate::sticks::Sticks;

/// Letters of the sticks in the order of [`Sticks::codes`]: thrust, roll, pitch, yaw.
const LETTERS: [char; 4] = ['T', 'A', 'E', 'R'];

/// Travel of a stick as in its calibration, −1 to 1: neither reversed nor scaled.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StickTravel(f64);

/// Travel of a channel as it is sent.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SentTravel(f64);

/// Sent travel of each channel; `None` for channels that the scenario does not state.
pub type Travels = [Option<SentTravel>; 16];

impl StickTravel {
    /// Centred stick: no rate.
    pub const MIDDLE: Self = Self(0.0);

    /// Makes a travel, clamped to −1 to 1.
    #[must_use]
    pub fn new(travel: f64) -> Self {
        Self(travel.clamp(-1.0, 1.0))
    }

    /// Returns the travel as a number.
    #[must_use]
    #[inline]
    pub fn value(self) -> f64 {
        self.0
    }
}

impl SentTravel {
    /// Returns the travel as a number.
    #[must_use]
    #[inline]
    pub fn value(self) -> f64 {
        self.0
    }
}

/// Map from sticks and switches to channels.
#[derive(Clone, Debug, PartialEq)]
pub struct ChannelMap {
    /// Largest code of a stick.
    largest_code: f64,
    /// Channel and travel of each stick.
    sticks: [Stick; 4],
    /// Travel of the thrust stick at the least thrust.
    least_thrust: StickTravel,
    /// Arming channel, and its travels disarmed and armed.
    arming: Option<(usize, [f64; 2])>,
    /// Travels of all channels with the motors off.
    motors_off: Travels,
}

/// Channel and travel of a stick.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Stick {
    channel: usize,
    /// Sent travels at −1 and 1.
    ends: [f64; 2],
}

impl Stick {
    #[inline]
    fn sent(&self, travel: StickTravel) -> SentTravel {
        let [low, high] = self.ends;
        SentTravel(low + (travel.0 + 1.0) / 2.0 * (high - low))
    }
}

impl ChannelMap {
    /// Makes the map of a checked link.
    #[must_use]
    pub fn new(link: &RcLink, transmitter: &Transmitter) -> Self {
        let mut motors_off = [transmitter.others.map(SentTravel); 16];
        let sticks = [0, 1, 2, 3].map(|stick| {
            let letter = LETTERS[stick];
            let mut ends = if stick == 0 {
                transmitter.thrust_ends
            } else {
                transmitter.rate_ends
            };
            if transmitter.reversed.contains(letter) {
                ends.reverse();
            }
            let channel = transmitter.order.find(letter).unwrap_or(stick);
            let mapped = Stick { channel, ends };
            motors_off[channel] = Some(match transmitter.failsafe {
                Some(stated) => SentTravel(stated[stick]),
                None if stick == 0 => SentTravel(ThrustChannel::new(link, transmitter).motors_off()),
                None => mapped.sent(StickTravel::MIDDLE),
            });
            mapped
        });
        for switch in &transmitter.switch {
            motors_off[index_of(switch.channel)] = Some(SentTravel(switch.travel));
        }
        let arming = transmitter.arming_channel.map(index_of);
        if let Some(channel) = arming {
            motors_off[channel] = Some(SentTravel(transmitter.arming[0]));
        }
        Self {
            largest_code: f64::from(largest_code(link)),
            sticks,
            least_thrust: StickTravel(-link.thrust_slope.signum()),
            arming: arming.map(|channel| (channel, transmitter.arming)),
            motors_off,
        }
    }

    /// Returns the travel of a stick's code.
    #[must_use]
    #[inline]
    pub fn travel(&self, code: u16) -> StickTravel {
        StickTravel((2.0 * f64::from(code) / self.largest_code - 1.0).min(1.0))
    }

    /// Returns the travels of all channels. No other function makes the travels that stop the motors.
    #[must_use]
    #[inline]
    pub fn travels(&self, sticks: &Sticks) -> Travels {
        let mut travels = self.motors_off;
        let Some(codes) = sticks.codes else {
            return travels;
        };
        for (stick, code) in self.sticks.iter().zip(codes) {
            travels[stick.channel] = Some(stick.sent(self.travel(code)));
        }
        if let Some((channel, [_, armed])) = self.arming
            && !sticks.disarmed
        {
            travels[channel] = Some(SentTravel(armed));
        }
        travels
    }

    /// Returns the commanded thrust: 0 at the least or with the motors off, 1 at the largest.
    #[must_use]
    #[inline]
    pub fn thrust_share(&self, sticks: &Sticks) -> f64 {
        sticks.codes.map_or(0.0, |[thrust, ..]| {
            (1.0 - self.least_thrust.0 * self.travel(thrust).0) / 2.0
        })
    }

    /// Returns the travel of the thrust stick at the least thrust.
    #[must_use]
    pub fn least_thrust(&self) -> StickTravel {
        self.least_thrust
    }

    /// Returns the channel index of each stick: thrust, roll, pitch, yaw.
    #[must_use]
    pub fn stick_channels(&self) -> [usize; 4] {
        self.sticks.map(|stick| stick.channel)
    }

    /// Returns the index of the arming channel.
    #[must_use]
    pub fn arming_channel(&self) -> Option<usize> {
        self.arming.map(|(channel, _)| channel)
    }

    /// Converts received channels to the travels of the sticks thrust, roll, pitch and yaw: the inverse of
    /// [`ChannelMap::travels`], except for failsafe.
    #[must_use]
    pub fn stick_travels(&self, received: &[f64; 16]) -> [f64; 4] {
        self.sticks.map(|stick| {
            let [low, high] = stick.ends;
            2.0 * (received[stick.channel] - low) / (high - low) - 1.0
        })
    }

    /// Returns whether received channels arm the motors: the arming channel is closer to its armed than to its disarmed
    /// travel. Always `true` without an arming channel.
    #[must_use]
    pub fn is_armed(&self, received: &[f64; 16]) -> bool {
        self.arming.is_none_or(|(channel, [disarmed, armed])| {
            (received[channel] - armed).abs() < (received[channel] - disarmed).abs()
        })
    }

    /// Returns the stick code closest to a travel.
    #[must_use]
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "a whole number from 0 to the largest code, of at most 16 bits"
    )]
    pub fn code(&self, travel: StickTravel) -> u16 {
        libm::round((travel.0 + 1.0) / 2.0 * self.largest_code) as u16
    }
}

/// Returns the largest stick code of a frame on a link: 2^bits − 1.
pub(crate) fn largest_code(link: &RcLink) -> u16 {
    u16::MAX >> (16 - link.resolution.clamp(1, 16))
}

/// Converts a channel counted from 1 to an index.
fn index_of(channel: u32) -> usize {
    usize::try_from(channel).unwrap_or(16).clamp(1, 16) - 1
}

/// Units in which a link sends travels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Units {
    /// Codes at −100 and 100 %.
    pub ends: [u16; 2],
    /// Smallest and largest code of the link.
    pub limits: [u16; 2],
    /// Codes of channels that are not stated: the link's code for an unchanged channel, or −100 % if it has none.
    pub unstated: ChannelCodes,
    /// Unit of a code.
    pub unit: CodeUnit,
}

/// Unit of a channel's code.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CodeUnit {
    /// Pulse width in µs.
    Pulse,
    /// Step of a receiver code, which flight controllers convert to pulses of 1500 ± 512 µs.
    ReceiverStep,
    /// Step of another code.
    Step,
}

/// Range of 11-bit codes.
pub(crate) const ELEVEN_BITS: [u16; 2] = [0, 2047];
/// Valid pulses, µs: outside of them a flight controller treats the channel as failed.
pub(crate) const PULSES: [u16; 2] = [900, 2100];

impl Units {
    /// Returns the code closest to each travel, within the limits.
    #[must_use]
    #[inline]
    pub fn codes(&self, travels: &Travels) -> ChannelCodes {
        let mut codes = self.unstated;
        for (code, travel) in codes.iter_mut().zip(travels) {
            if let Some(travel) = travel {
                *code = self.code(travel.0);
            }
        }
        codes
    }

    #[inline]
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "a whole number within limits of 16 bits"
    )]
    fn code(&self, travel: f64) -> u16 {
        let [low, high] = self.ends.map(f64::from);
        let [least, most] = self.limits.map(f64::from);
        let code = libm::round(low + (travel + 1.0) / 2.0 * (high - low));
        code.clamp(least, most) as u16
    }

    /// Returns the travel of a code.
    #[must_use]
    pub fn travel(&self, code: u16) -> f64 {
        let [low, high] = self.ends.map(f64::from);
        2.0 * (f64::from(code) - low) / (high - low) - 1.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use scenario::ChannelSwitch;

    fn transmitter() -> Transmitter {
        Transmitter {
            order: "TAER".to_owned(),
            reversed: "E".to_owned(),
            thrust_ends: [-0.9, 1.1],
            arming_channel: Some(5),
            switch: vec![ChannelSwitch {
                channel: 7,
                travel: 0.5,
            }],
            ..Transmitter::default()
        }
    }

    /// The first eight travels as numbers.
    fn numbers(travels: &Travels) -> [Option<f64>; 8] {
        std::array::from_fn(|channel| travels[channel].map(SentTravel::value))
    }

    #[test]
    fn sticks_go_where_the_order_says_and_turn_around_where_they_are_reversed() {
        let map = ChannelMap::new(&RcLink::default(), &transmitter());
        let travels = map.travels(&Sticks::flying([2047, 2047, 2047, 0]));
        let [thrust, roll, pitch, yaw] = [1.1, 1.0, -1.0, -1.0].map(Some);
        let switches = [Some(1.0), None, Some(0.5), None];
        assert_eq!(numbers(&travels)[..4], [thrust, roll, pitch, yaw]);
        assert_eq!(numbers(&travels)[4..], switches);
    }

    #[test]
    fn stated_failsafe_travels_are_sent_as_they_are() {
        let stated = Transmitter {
            failsafe: Some([-1.1, 0.1, 0.2, 0.3]),
            others: Some(-0.5),
            ..transmitter()
        };
        let travels = ChannelMap::new(&RcLink::default(), &stated).travels(&Sticks::MOTORS_OFF);
        let expected = [-1.1, 0.1, 0.2, 0.3, -1.0, -0.5, 0.5, -0.5].map(Some);
        assert_eq!(numbers(&travels), expected);
    }

    #[test]
    fn the_motors_stop_at_the_end_of_the_channel_that_means_the_least_thrust() {
        for (slope, reversed, [low, high], expected) in [
            (3.138, "", [-1.0, 1.0], -1.0),
            (3.138, "T", [-1.0, 1.0], 1.0),
            (-3.138, "", [-1.0, 1.0], 1.0),
            (-3.138, "T", [-1.0, 1.0], -1.0),
            // Not less than the link's own end, and as far as the stick goes.
            (3.138, "", [-0.9, 0.8], -1.0),
            (3.138, "T", [-0.9, 0.8], 1.0),
            (3.138, "", [-1.1, 1.15], -1.1),
            (3.138, "T", [-1.1, 1.15], 1.15),
        ] {
            let link = RcLink {
                thrust_slope: slope,
                ..RcLink::default()
            };
            let stated = Transmitter {
                reversed: reversed.to_owned(),
                thrust_ends: [low, high],
                rate_ends: [-1.0, 0.8],
                order: "TAER".to_owned(),
                ..Transmitter::default()
            };
            let map = ChannelMap::new(&link, &stated);
            let [thrust, rates @ ..] = numbers(&map.travels(&Sticks::MOTORS_OFF));
            assert_eq!(thrust, Some(expected), "{slope} {reversed:?} {low} {high}");
            // No rate is the middle of what is sent.
            for rate in &rates[..3] {
                assert!((rate.unwrap() + 0.1).abs() < 1e-12);
            }
        }
    }

    #[test]
    fn sticks_move_while_the_arming_switch_stays_off() {
        let map = ChannelMap::new(&RcLink::default(), &transmitter());
        let sticks = Sticks {
            disarmed: true,
            ..Sticks::flying([1, -1, 0, 1].map(|travel| map.code(StickTravel::new(f64::from(travel)))))
        };
        let travels = numbers(&map.travels(&sticks));
        assert_eq!(
            [travels[0], travels[1], travels[3], travels[4]],
            [1.1, -1.0, 1.0, -1.0].map(Some)
        );
    }

    #[test]
    fn the_ends_and_the_middle_are_those_of_the_formats() {
        for (ends, middle) in [
            (crate::crsf::ENDS, 992),
            (crate::multi::ENDS, 1024),
            (crate::msp::ENDS, 1500),
        ] {
            let units = Units {
                ends,
                limits: [0, 2047],
                unstated: [0; 16],
                unit: CodeUnit::Pulse,
            };
            assert_eq!(
                [-1.0, 0.0, 1.0].map(|travel| units.code(travel)),
                [ends[0], middle, ends[1]]
            );
            assert_eq!(units.code(9.0), 2047);
        }
    }

    proptest! {
        #[test]
        fn a_code_of_the_link_is_at_most_half_a_step_from_the_travel(travel in -1.0..=1.0f64) {
            for ends in [crate::crsf::ENDS, crate::multi::ENDS, crate::msp::ENDS] {
                let units = Units { ends, limits: [0, 2047], unstated: [0; 16], unit: CodeUnit::Pulse };
                let step = 2.0 / f64::from(ends[1] - ends[0]);
                let error = units.travel(units.code(travel)) - travel;
                prop_assert!(error.abs() <= 0.5 * step + 1e-12, "{} of {}", error, step);
            }
        }
    }
}
