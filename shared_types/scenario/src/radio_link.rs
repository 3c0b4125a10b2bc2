//! Transmitter of a laboratory: the radio link of its frames, and the receiver's channels.
//!
//! It does not affect the log of a flight in simulated time, in which the link is always simulated.
//! [`Scenario::experiment`](super::Scenario::experiment) removes it.

use std::ops::RangeInclusive;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::Scenario;
use crate::range::{between, within};

/// Valid baud rates of a serial device.
pub(crate) const BAUDS: RangeInclusive<u32> = 1200..=4_000_000;

/// Channels without a stick, counted from 1.
const FREE_CHANNELS: RangeInclusive<u32> = 5..=16;

/// Radio link of the frames.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum RadioProtocol {
    /// The simulated link only.
    #[default]
    Simulated,
    /// A CRSF receiver port or transmitter module.
    Crsf,
    /// An SBUS receiver port, behind an inverter.
    Sbus,
    /// A MULTI transmitter module for Spektrum DSM2 or DSMX.
    Multi,
    /// A flight controller that accepts MSP_SET_RAW_RC.
    Msp,
    /// An autopilot that accepts MAVLink 2.
    Mavlink,
    /// A Crazyflie quadcopter, by CRTP.
    Crazyflie,
}

/// Properties of a radio link that a scenario depends on.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RadioProperties {
    /// Name in `rc_output.link`.
    pub name: &'static str,
    /// `true` if a serial device can carry the frames.
    pub serial: bool,
    /// Key of the other destination that can receive the frames, if any.
    pub socket: Option<&'static str>,
    /// Baud rate of the serial device: the link's only one, or the default of most receivers. Bit rate of the air without one.
    pub baud: u32,
    /// Framing of a byte on the serial line.
    pub byte: ByteFormat,
    /// Usual frame rate, 1/s.
    pub frame_rate: f64,
    /// Length of the longest frame, bytes.
    pub longest_frame: u32,
    /// Maximum travel of a channel in both directions: beyond it a flight controller treats the channel as failed (pulses
    /// below 900 or above 2100 µs), or the frame has no code.
    pub largest_travel: f64,
}

/// Framing of a byte of eight bits on a serial line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ByteFormat {
    /// No parity, one stop bit: 8N1.
    Plain,
    /// Even parity, two stop bits: 8E2.
    EvenTwo,
}

/// Transmitter of a laboratory: the destination of frames, and the channels of the vehicle.
///
/// A travel of −1 to 1 on a channel is the link's −100 to 100 %: pulses of 1000 to 2000 µs.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Transmitter {
    /// Serial device, such as one of /dev/serial/by-id; one of `device`, `tcp`, `udp` and `uri` must be stated.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub device: Option<String>,
    /// Rate of the serial device, baud; the link's standard rate unless stated.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(transform = within(BAUDS), extend("x-hint" = "leave it out for the link's own; 420000 is CRSF's, 115200 usual for MSP"))]
    pub baud: Option<u32>,
    /// Address and port of a TCP server, such as 127.0.0.1:5761; for `msp`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub tcp: Option<String>,
    /// Destination address and port of UDP packets, such as 127.0.0.1:14540; for `mavlink`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub udp: Option<String>,
    /// Address of a Crazyflie: radio://0/80/2M/E7E7E7E7E7 by the first dongle, or udp://127.0.0.1:19850 of a simulator; for `crazyflie`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub uri: Option<String>,
    /// Frame rate, independent of new commands, 1/s; the link's usual rate unless stated.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(transform = between(1.0, 1000.0), extend("x-hint" = "leave it out for the link's own"))]
    pub frame_rate: Option<f64>,
    /// Order of the first four channels: A roll, E pitch, T thrust, R yaw.
    pub order: String,
    /// Reversed sticks, as letters of `order`, such as "ER".
    pub reversed: String,
    /// Travels sent at the ends of the thrust stick.
    pub thrust_ends: [f64; 2],
    /// Travels sent at the ends of each rate stick.
    pub rate_ends: [f64; 2],
    /// Channel of the arming switch; none unless stated.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(transform = within(FREE_CHANNELS))]
    pub arming_channel: Option<u32>,
    /// Travels of the arming switch: disarmed, also in failsafe frames, and armed.
    pub arming: [f64; 2],
    /// Travel of all other channels: -1.0 unless stated, but `rc_override` of MAVLink leaves them unchanged.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub others: Option<f64>,
    /// Channels with a constant travel, such as that of the flight mode.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub switch: Vec<ChannelSwitch>,
    /// Travels of the sticks thrust, roll, pitch and yaw in failsafe frames, as sent: neither reversed nor scaled; least thrust and no rates unless stated.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub failsafe: Option<[f64; 4]>,
    /// Time without commands or states after which the failsafe of the link is used as well, s.
    #[schemars(transform = between(0.1, 10.0), extend("x-hint" = "in s; a command is only late in a shorter time; 0.5 is usual"))]
    pub silence_after: f64,
    /// Settings of `multi`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub multi: Option<MultiModule>,
    /// Settings of `mavlink`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub mavlink: Option<Mavlink>,
}

/// Channel with a constant travel.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ChannelSwitch {
    /// The channel.
    #[schemars(transform = within(FREE_CHANNELS))]
    pub channel: u32,
    /// Its travel.
    pub travel: f64,
}

/// Settings of a MULTI module, sent with every frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct MultiModule {
    /// Spektrum protocol with which the vehicle is bound.
    pub dsm: DsmProtocol,
    /// Model number with which the vehicle is bound.
    #[schemars(transform = between(0, 15), extend("x-hint" = "the number that the vehicle was bound as"))]
    pub model: u32,
    /// Number of channels sent over the air.
    #[schemars(transform = between(4, 12), extend("x-hint" = "7 go out with every frame"))]
    pub channels: u32,
    /// `true` to transmit with low power, for tests on the ground.
    pub low_power: bool,
}

/// A Spektrum protocol.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum DsmProtocol {
    /// DSM2 with frames of 22 ms.
    Dsm2Slow,
    /// DSM2 with frames of 11 ms.
    Dsm2Fast,
    /// DSMX with frames of 22 ms.
    #[default]
    DsmxSlow,
    /// DSMX with frames of 11 ms.
    DsmxFast,
}

/// Settings of MAVLink: message, sender and autopilot.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Mavlink {
    /// The message that carries the command.
    pub message: MavlinkMessage,
    /// System ID of the sender; ArduPilot accepts overrides from its ground station only, usually 255.
    #[schemars(transform = between(1, 255))]
    pub system: u32,
    /// Component ID of the sender.
    #[schemars(transform = between(1, 255))]
    pub component: u32,
    /// System ID of the autopilot.
    #[schemars(transform = between(1, 255))]
    pub target_system: u32,
    /// Component ID of the autopilot.
    #[schemars(transform = between(1, 255))]
    pub target_component: u32,
}

/// MAVLink message of a command.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum MavlinkMessage {
    /// SET_ATTITUDE_TARGET: body rates in rad/s and normalised thrust.
    #[default]
    AttitudeTarget,
    /// RC_CHANNELS_OVERRIDE: channels as from a receiver.
    RcOverride,
}

impl Default for Transmitter {
    fn default() -> Self {
        Self {
            device: None,
            baud: None,
            tcp: None,
            udp: None,
            uri: None,
            frame_rate: None,
            order: "AETR".to_owned(),
            reversed: String::new(),
            thrust_ends: [-1.0, 1.0],
            rate_ends: [-1.0, 1.0],
            arming_channel: None,
            arming: [-1.0, 1.0],
            others: None,
            switch: Vec::new(),
            failsafe: None,
            silence_after: 0.5,
            multi: None,
            mavlink: None,
        }
    }
}

impl Default for MultiModule {
    fn default() -> Self {
        Self {
            dsm: DsmProtocol::default(),
            model: 0,
            channels: 7,
            low_power: false,
        }
    }
}

impl Default for Mavlink {
    fn default() -> Self {
        Self {
            message: MavlinkMessage::default(),
            system: 255,
            component: 190,
            target_system: 1,
            target_component: 1,
        }
    }
}

impl RadioProtocol {
    /// All links except the simulated one.
    pub const ALL: [Self; 6] = [
        Self::Crsf,
        Self::Sbus,
        Self::Multi,
        Self::Msp,
        Self::Mavlink,
        Self::Crazyflie,
    ];

    /// Returns the properties of the link.
    #[must_use]
    pub fn properties(self) -> &'static RadioProperties {
        match self {
            Self::Simulated => &RadioProperties {
                name: "simulated",
                serial: true,
                socket: None,
                baud: 115_200,
                byte: ByteFormat::Plain,
                frame_rate: 50.0,
                longest_frame: 0,
                largest_travel: 1.2,
            },
            Self::Crsf => &RadioProperties {
                name: "crsf",
                serial: true,
                socket: None,
                baud: 420_000,
                byte: ByteFormat::Plain,
                frame_rate: 150.0,
                longest_frame: 26,
                // 1.17 · 512 µs.
                largest_travel: 1.17,
            },
            Self::Sbus => &RadioProperties {
                name: "sbus",
                serial: true,
                socket: None,
                baud: 100_000,
                byte: ByteFormat::EvenTwo,
                frame_rate: 1.0 / 0.014,
                longest_frame: 25,
                // 1.17 · 512 µs.
                largest_travel: 1.17,
            },
            Self::Multi => &RadioProperties {
                name: "multi",
                serial: true,
                socket: None,
                baud: 100_000,
                byte: ByteFormat::EvenTwo,
                frame_rate: 1.0 / 0.007,
                longest_frame: 26,
                // The codes 0 to 2047 around 1024, 8.195 a percent.
                largest_travel: 1.24,
            },
            Self::Msp => &RadioProperties {
                name: "msp",
                serial: true,
                socket: Some("tcp"),
                baud: 115_200,
                byte: ByteFormat::Plain,
                frame_rate: 50.0,
                longest_frame: 38,
                // 1.2 · 500 µs.
                largest_travel: 1.2,
            },
            Self::Mavlink => &RadioProperties {
                name: "mavlink",
                serial: true,
                socket: Some("udp"),
                baud: 921_600,
                byte: ByteFormat::Plain,
                frame_rate: 50.0,
                // With the heartbeat once a second.
                longest_frame: 51 + 21,
                // 1.2 · 500 µs.
                largest_travel: 1.2,
            },
            Self::Crazyflie => &RadioProperties {
                name: "crazyflie",
                serial: false,
                socket: Some("uri"),
                baud: 2_000_000,
                byte: ByteFormat::Plain,
                // A dongle carries some 500 packets per second.
                frame_rate: 200.0,
                longest_frame: 17,
                // The packet has no channels.
                largest_travel: 1.2,
            },
        }
    }

    /// Returns whether the vehicle sends its battery's voltage back over the link.
    #[must_use]
    pub fn has_telemetry(self) -> bool {
        matches!(self, Self::Crsf | Self::Msp | Self::Mavlink | Self::Crazyflie)
    }

    /// Returns the name in scenarios.
    #[must_use]
    pub fn name(self) -> &'static str {
        self.properties().name
    }

    /// Returns whether this is the simulated link.
    #[must_use]
    pub fn is_simulated(&self) -> bool {
        *self == Self::Simulated
    }

    /// Returns the bits of the longest frame on a serial line, start, parity and stop bits included.
    #[must_use]
    pub fn bits_per_frame(self) -> u32 {
        let RadioProperties {
            longest_frame, byte, ..
        } = self.properties();
        longest_frame * byte.bits()
    }
}

impl ByteFormat {
    /// Returns the bits of a byte on the line, start, parity and stop bits included.
    #[must_use]
    pub fn bits(self) -> u32 {
        match self {
            Self::Plain => 10,
            Self::EvenTwo => 12,
        }
    }
}

impl Scenario {
    /// Returns the radio link of a laboratory; `None` for the simulated link.
    #[must_use]
    pub fn radio_link(&self) -> Option<RadioProtocol> {
        let link = self.rc_output.as_ref()?.link;
        (!link.is_simulated()).then_some(link)
    }
}

impl Transmitter {
    /// Returns the frame rate on a link, 1/s.
    #[must_use]
    pub fn frame_rate_on(&self, link: RadioProtocol) -> f64 {
        self.frame_rate.unwrap_or_else(|| link.properties().frame_rate)
    }

    /// Returns the baud rate of the serial device on a link.
    #[must_use]
    pub fn baud_on(&self, link: RadioProtocol) -> u32 {
        self.baud.unwrap_or_else(|| link.properties().baud)
    }

    /// Returns whether the frames have channels: `SET_ATTITUDE_TARGET` and the packets of a Crazyflie have none.
    #[must_use]
    pub fn has_channels(&self, link: RadioProtocol) -> bool {
        match link {
            RadioProtocol::Mavlink => self.mavlink.unwrap_or_default().message == MavlinkMessage::RcOverride,
            RadioProtocol::Crazyflie => false,
            _ => true,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Tests of the formats go through [`RadioProtocol::ALL`].
    #[test]
    fn every_word_of_a_link_but_the_simulated_one_is_among_all() {
        let schema = schemars::schema_for!(RadioProtocol).to_value();
        let variants = schema["oneOf"].as_array().unwrap().iter();
        let words: Vec<&str> = variants
            .map(|variant| variant["const"].as_str().unwrap())
            .collect();
        let others = words.into_iter().filter(|word| *word != "simulated");
        assert_eq!(
            others.collect::<Vec<_>>(),
            RadioProtocol::ALL.map(RadioProtocol::name)
        );
    }
}
