//! Channel map: the meaning of each channel, and its travel.
//!
//! A stick's code c of 2^bits − 1 is the travel s = 2c/(2^bits − 1) − 1, as in `rc_output`. The sent travel is reversed
//! if the stick is, and scaled to its ends. A travel of −1 to 1 is the link's −100 to 100 %.

use scenario::{RcLink, Transmitter};

use crate::ChannelCodes;
use crate::sticks::Sticks;

/// Letters of the sticks in the order of [`Sticks::codes`]: thrust, roll, pitch, yaw.
const LETTERS: [char; 4] = ['T', 'A', 'E', 'R'];

/// A travel a channel, from −1.25 to 1.25.
pub type Travels = [f64; 16];

/// Map from sticks and switches to channels.
#[derive(Clone, Debug, PartialEq)]
pub struct ChannelMap {
    /// Largest code of a stick.
    largest_code: f64,
    /// Channel and travel of each stick.
    sticks: [Stick; 4],
    /// The arming switch: its channel, and its travels disarmed and armed.
    arming: Option<(usize, [f64; 2])>,
    /// Travels of all channels when the motors stop.
    at_rest: Travels,
}

/// Channel and travel of a stick.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Stick {
    channel: usize,
    /// Travels that −1 and 1 are sent as.
    ends: [f64; 2],
}

impl ChannelMap {
    /// Makes the map of a checked link.
    #[must_use]
    pub fn new(link: &RcLink, transmitter: &Transmitter) -> Self {
        let mut at_rest = [transmitter.others; 16];
        let sticks = [0, 1, 2, 3].map(|stick| {
            let letter = LETTERS[stick];
            let channel = transmitter.order.find(letter).unwrap_or(stick);
            at_rest[channel] = transmitter.failsafe[stick];
            let mut ends = if stick == 0 {
                transmitter.thrust_ends
            } else {
                transmitter.rate_ends
            };
            if transmitter.reversed.contains(letter) {
                ends.reverse();
            }
            Stick { channel, ends }
        });
        for switch in &transmitter.switch {
            at_rest[index_of(switch.channel)] = switch.travel;
        }
        let arming = transmitter.arming_channel.map(index_of);
        if let Some(channel) = arming {
            at_rest[channel] = transmitter.arming[0];
        }
        Self {
            largest_code: f64::from((1_u32 << link.resolution.clamp(1, 16)) - 1),
            sticks,
            arming: arming.map(|channel| (channel, transmitter.arming)),
            at_rest,
        }
    }

    /// Returns the travel of a stick's code, −1 to 1, by the calibration, before it is mapped.
    #[must_use]
    #[inline]
    pub fn travel(&self, code: u16) -> f64 {
        (2.0 * f64::from(code) / self.largest_code - 1.0).min(1.0)
    }

    /// Returns the travels of all channels.
    #[must_use]
    #[inline]
    pub fn travels(&self, sticks: &Sticks) -> Travels {
        let mut travels = self.at_rest;
        if sticks.failsafe {
            return travels;
        }
        for (stick, &code) in self.sticks.iter().zip(&sticks.codes) {
            let [low, high] = stick.ends;
            let share = (self.travel(code) + 1.0) / 2.0;
            travels[stick.channel] = low + share * (high - low);
        }
        if let Some((channel, [_, armed])) = self.arming
            && !sticks.disarmed
        {
            travels[channel] = armed;
        }
        travels
    }

    /// Returns the channel of each stick, as an index: thrust, roll, pitch, yaw.
    #[must_use]
    pub fn stick_channels(&self) -> [usize; 4] {
        self.sticks.map(|stick| stick.channel)
    }

    /// Returns the travels of the sticks thrust, roll, pitch and yaw from sent channels: the inverse of
    /// [`ChannelMap::travels`], except for failsafe.
    #[must_use]
    pub fn stick_travels(&self, sent: &Travels) -> [f64; 4] {
        self.sticks.map(|stick| {
            let [low, high] = stick.ends;
            2.0 * (sent[stick.channel] - low) / (high - low) - 1.0
        })
    }

    /// Returns whether these channels let the motors turn: the arming switch is nearer to its travel armed. Without
    /// such a switch they always do.
    #[must_use]
    pub fn is_armed(&self, sent: &Travels) -> bool {
        self.arming.is_none_or(|(channel, [disarmed, armed])| {
            (sent[channel] - armed).abs() < (sent[channel] - disarmed).abs()
        })
    }

    /// Returns the code of a stick whose travel is nearest to a travel.
    #[must_use]
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "a whole number from 0 to the largest code, of at most 16 bits"
    )]
    pub fn code(&self, travel: f64) -> u16 {
        libm::round((travel.clamp(-1.0, 1.0) + 1.0) / 2.0 * self.largest_code) as u16
    }
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
}

impl Units {
    /// Returns the nearest code to each travel, within the limits.
    #[must_use]
    #[inline]
    pub fn codes(&self, travels: &Travels) -> ChannelCodes {
        travels.map(|travel| self.code(travel))
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

    /// Returns the travel that a code means.
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

    #[test]
    fn sticks_go_where_the_order_says_and_turn_around_where_they_are_reversed() {
        let map = ChannelMap::new(&RcLink::default(), &transmitter());
        let sticks = Sticks {
            codes: [2047, 2047, 2047, 0],
            failsafe: false,
            is_lost: false,
            disarmed: false,
        };
        let travels = map.travels(&sticks);
        assert_eq!(travels[..8], [1.1, 1.0, -1.0, -1.0, 1.0, -1.0, 0.5, -1.0]);
    }

    #[test]
    fn failsafe_frames_are_disarmed_and_carry_the_failsafe_travels_as_they_are() {
        let map = ChannelMap::new(&RcLink::default(), &transmitter());
        let travels = map.travels(&Sticks::AT_REST);
        assert_eq!(travels[..8], [-1.0, 0.0, 0.0, 0.0, -1.0, -1.0, 0.5, -1.0]);
    }

    #[test]
    fn sticks_move_while_the_arming_switch_stays_off() {
        let map = ChannelMap::new(&RcLink::default(), &transmitter());
        let sticks = Sticks {
            codes: [1, -1, 0, 1].map(|travel| map.code(f64::from(travel))),
            disarmed: true,
            ..Sticks::default()
        };
        let travels = map.travels(&sticks);
        assert_eq!(
            (travels[0], travels[1], travels[3], travels[4]),
            (1.1, -1.0, 1.0, -1.0)
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
                let units = Units { ends, limits: [0, 2047] };
                let step = 2.0 / f64::from(ends[1] - ends[0]);
                let error = units.travel(units.code(travel)) - travel;
                prop_assert!(error.abs() <= 0.5 * step + 1e-12, "{} of {}", error, step);
            }
        }
    }
}
