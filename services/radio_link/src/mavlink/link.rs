//! MAVLink as a radio link: the scenario's message and heartbeats.

use scenario::{MavlinkMessage, RcLink};

use super::{AttitudeTarget, ENDS, MavlinkPacket, Sender, UNCHANGED, decode, encode, read_reply};
use crate::DecodeError;
use crate::channel_map::{ChannelMap, CodeUnit, PULSES, Units};
use crate::format::{Content, Decoded, Format};
use crate::frame::Frame;
use crate::sticks::Sticks;
use crate::telemetry::Reply;

/// Period of the heartbeat, ns.
const HEARTBEAT_NS: u64 = 1_000_000_000;

/// MAVLink frame format of a scenario, with its sequence counter and timers.
#[derive(Clone, Debug)]
pub(crate) struct Mavlink {
    message: MavlinkMessage,
    sender: Sender,
    target: [u8; 2],
    /// Body rates per unit of travel, rad/s.
    rate_slope: [f64; 3],
    sequence: u8,
    started_ns: Option<u64>,
    heartbeat_at_ns: u64,
}

impl Format for Mavlink {
    fn units(&self) -> Units {
        Units {
            ends: ENDS,
            limits: PULSES,
            unstated: UNCHANGED,
            unit: CodeUnit::Pulse,
        }
    }

    #[inline]
    fn encode(&mut self, content: &Content<'_>, frame: &mut Frame) {
        let message = match self.message {
            MavlinkMessage::RcOverride => MavlinkPacket::RcOverride {
                target: self.target,
                channels: content.codes,
            },
            MavlinkMessage::AttitudeTarget => {
                self.attitude_target(content.map, content.sticks, content.now_ns)
            }
        };
        self.push(&message, content.now_ns, frame);
    }

    fn decode(&self, bytes: &[u8]) -> Decoded {
        match decode(bytes) {
            Ok((MavlinkPacket::RcOverride { channels, .. }, _, _, length)) => {
                Decoded::Override(length, channels)
            }
            Ok((MavlinkPacket::AttitudeTarget(target), _, _, length)) => {
                Decoded::Rates(length, target.rates_body.map(f64::from), f64::from(target.thrust))
            }
            Ok((MavlinkPacket::Heartbeat, _, _, length)) => Decoded::Other(length),
            Err(DecodeError::Length { .. }) => Decoded::Incomplete,
            Err(_) => Decoded::Noise,
        }
    }

    fn read_reply(&mut self, bytes: &[u8]) -> Reply {
        read_reply(bytes, self.target)
    }
}

impl Mavlink {
    pub(crate) fn new(config: &scenario::Mavlink, link: &RcLink) -> Self {
        let small = |id: u32| u8::try_from(id).unwrap_or(u8::MAX);
        Self {
            message: config.message,
            sender: Sender {
                system: small(config.system),
                component: small(config.component),
            },
            target: [small(config.target_system), small(config.target_component)],
            rate_slope: link.rate_slope,
            sequence: 0,
            started_ns: None,
            heartbeat_at_ns: 0,
        }
    }

    /// Returns the body rates and the thrust of the sticks. The message has no channels, so their ends and reversal do not
    /// apply.
    #[inline]
    #[expect(
        clippy::cast_possible_truncation,
        reason = "the message has numbers of 32 bits"
    )]
    fn attitude_target(&mut self, map: &ChannelMap, sticks: &Sticks, now_ns: u64) -> MavlinkPacket {
        let started = *self.started_ns.get_or_insert(now_ns);
        let rate = |axis: usize| {
            let travel = sticks.codes.map(|codes| map.travel(codes[axis + 1]).value());
            travel.map_or(0.0, |travel| (self.rate_slope[axis] * travel) as f32)
        };
        MavlinkPacket::AttitudeTarget(AttitudeTarget {
            time_ms: (now_ns.saturating_sub(started) / 1_000_000) as u32,
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
            encode(
                &MavlinkPacket::Heartbeat,
                self.sender,
                self.next_sequence(),
                frame,
            );
        }
        let sequence = self.next_sequence();
        encode(message, self.sender, sequence, frame);
    }

    fn next_sequence(&mut self) -> u8 {
        let sequence = self.sequence;
        self.sequence = sequence.wrapping_add(1);
        sequence
    }
}
