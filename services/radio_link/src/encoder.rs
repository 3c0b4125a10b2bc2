//! Encoder of sticks to frames of the scenario's link.

use scenario::{Mavlink, MavlinkMessage, RadioProtocol, RcLink, Transmitter};

use crate::channel_map::{ChannelMap, Units};
use crate::frame::Frame;
use crate::mavlink::{AttitudeTarget, MavlinkPacket, Sender};
use crate::sticks::Sticks;
use crate::{crsf, mavlink, msp, multi, sbus};

/// Time between two heartbeats of MAVLink, ns.
const HEARTBEAT_NS: u64 = 1_000_000_000;

/// Codes of 11 bits.
const ELEVEN_BITS: [u16; 2] = [0, 2047];
/// Pulses that a receiver can send, µs: beyond them a flight controller takes a channel for broken.
const PULSES: [u16; 2] = [900, 2100];

/// Encoder of the frames of a link.
#[derive(Clone, Debug)]
pub struct Encoder {
    map: ChannelMap,
    format: Format,
}

/// Format of a link, and the contents of its frames beside the sticks.
#[derive(Clone, Debug)]
enum Format {
    Crsf,
    Sbus,
    Multi(multi::Settings),
    Msp,
    Mavlink(MavlinkFormat),
}

#[derive(Clone, Debug)]
struct MavlinkFormat {
    message: MavlinkMessage,
    sender: Sender,
    target: [u8; 2],
    /// Body rates per unit of travel, rad/s.
    rate_slope: [f64; 3],
    sequence: u8,
    began_ns: Option<u64>,
    heartbeat_at_ns: u64,
}

impl Encoder {
    /// Makes the encoder of a checked link; `None` for the simulated one.
    #[must_use]
    pub fn new(link: &RcLink, transmitter: &Transmitter) -> Option<Self> {
        let format = match link.link {
            RadioProtocol::Simulated => return None,
            RadioProtocol::Crsf => Format::Crsf,
            RadioProtocol::Sbus => Format::Sbus,
            RadioProtocol::Multi => {
                Format::Multi(multi::Settings::new(&transmitter.multi.unwrap_or_default()))
            }
            RadioProtocol::Msp => Format::Msp,
            RadioProtocol::Mavlink => {
                Format::Mavlink(MavlinkFormat::new(&transmitter.mavlink.unwrap_or_default(), link))
            }
        };
        let map = ChannelMap::new(link, transmitter);
        Some(Self { map, format })
    }

    /// Writes the frame of sticks. `failsafe` is the failsafe flag of the link, if its frames have one.
    #[inline]
    pub fn encode(&mut self, sticks: &Sticks, failsafe: bool, now_ns: u64, frame: &mut Frame) {
        frame.clear();
        let codes = self.units().codes(&self.map.travels(sticks));
        match &mut self.format {
            Format::Crsf => frame.push(&crsf::encode(&codes)),
            Format::Sbus => {
                let flags = sbus::Flags {
                    failsafe,
                    ..sbus::Flags::default()
                };
                frame.push(&sbus::encode(&codes, flags));
            }
            Format::Multi(settings) => frame.push(&multi::encode(&codes, *settings)),
            Format::Msp => frame.push(&msp::encode(&codes)),
            Format::Mavlink(format) => {
                let message = match format.message {
                    MavlinkMessage::RcOverride => MavlinkPacket::RcOverride {
                        target: format.target,
                        channels: codes,
                    },
                    MavlinkMessage::AttitudeTarget => format.attitude_target(&self.map, sticks, now_ns),
                };
                format.push(&message, now_ns, frame);
            }
        }
    }

    /// Returns the units of the link's channels; pulses if it has none.
    #[must_use]
    #[inline]
    pub fn units(&self) -> Units {
        let (ends, limits) = match self.format {
            Format::Crsf => (crsf::ENDS, ELEVEN_BITS),
            Format::Sbus => (sbus::ENDS, ELEVEN_BITS),
            Format::Multi(_) => (multi::ENDS, ELEVEN_BITS),
            Format::Msp => (msp::ENDS, PULSES),
            Format::Mavlink(_) => (mavlink::ENDS, PULSES),
        };
        let unstated = match self.format {
            Format::Mavlink(_) => mavlink::LEFT_ALONE,
            _ => [ends[0]; 16],
        };
        Units {
            ends,
            limits,
            unstated,
        }
    }

    /// Returns the channel map.
    #[must_use]
    pub fn map(&self) -> &ChannelMap {
        &self.map
    }

    /// Returns whether the frames can say that the command is lost; if not, they stop.
    #[must_use]
    pub fn has_failsafe_flag(&self) -> bool {
        matches!(self.format, Format::Sbus)
    }
}

impl MavlinkFormat {
    fn new(stated: &Mavlink, link: &RcLink) -> Self {
        let small = |id: u32| u8::try_from(id).unwrap_or(u8::MAX);
        Self {
            message: stated.message,
            sender: Sender {
                system: small(stated.system),
                component: small(stated.component),
            },
            target: [small(stated.target_system), small(stated.target_component)],
            rate_slope: link.rate_slope,
            sequence: 0,
            began_ns: None,
            heartbeat_at_ns: 0,
        }
    }

    /// Returns the body rates and the thrust that the sticks mean: the message has no channels, so that neither their
    /// ends nor their reversal act on it.
    #[inline]
    #[expect(
        clippy::cast_possible_truncation,
        reason = "the message has numbers of 32 bits"
    )]
    fn attitude_target(&mut self, map: &ChannelMap, sticks: &Sticks, now_ns: u64) -> MavlinkPacket {
        let began = *self.began_ns.get_or_insert(now_ns);
        let rate = |axis: usize| {
            let travel = sticks.codes.map(|codes| map.travel(codes[axis + 1]).value());
            travel.map_or(0.0, |travel| (self.rate_slope[axis] * travel) as f32)
        };
        MavlinkPacket::AttitudeTarget(AttitudeTarget {
            time_ms: (now_ns.saturating_sub(began) / 1_000_000) as u32,
            rates_body: [0, 1, 2].map(rate),
            thrust: map.thrust_share(sticks) as f32,
            target: self.target,
        })
    }

    /// Appends a message, and a heartbeat when one is due.
    #[inline]
    fn push(&mut self, message: &MavlinkPacket, now_ns: u64, frame: &mut Frame) {
        if now_ns >= self.heartbeat_at_ns {
            self.heartbeat_at_ns = now_ns + HEARTBEAT_NS;
            mavlink::encode(&MavlinkPacket::Heartbeat, self.sender, self.next(), frame);
        }
        let sequence = self.next();
        mavlink::encode(message, self.sender, sequence, frame);
    }

    fn next(&mut self) -> u8 {
        let sequence = self.sequence;
        self.sequence = sequence.wrapping_add(1);
        sequence
    }
}
