//! MAVLink 2: the three messages that control an autopilot, in frames of [`mavlink_frame`].
//!
//! Fields are ordered by size. Body rates are about the axes forward, right, down, as everywhere in this project.
//!
//! PX4 follows `SET_ATTITUDE_TARGET` in its mode *offboard* and leaves that mode when the messages stop; ArduPilot in
//! *GUIDED_NOGPS*. `RC_CHANNELS_OVERRIDE` replaces a receiver. Neither arms: the operator arms at the ground station.

mod battery;
mod link;

pub use battery::read_reply;
pub(crate) use link::Mavlink;
pub use mavlink_frame::Sender;
use mavlink_frame::{Definition, FrameError, HEADER_2, START_2};

use crate::frame::Frame;
use crate::{ChannelCodes, DecodeError};

/// Pulses at −100 and 100 %, µs.
pub const ENDS: [u16; 2] = [1000, 2000];

/// Fields of `RC_CHANNELS_OVERRIDE` that leave a channel unchanged: `UINT16_MAX` for the first eight; 0 for the others, as
/// in a message that is too short to contain them.
pub const UNCHANGED: ChannelCodes = {
    let mut fields = [0; 16];
    let mut channel = 0;
    while channel < FIRST {
        fields[channel] = u16::MAX;
        channel += 1;
    }
    fields
};

/// Number of channels in the original definition of `RC_CHANNELS_OVERRIDE`: 0 releases them to the radio.
const FIRST: usize = 8;

/// Flag of `SET_ATTITUDE_TARGET`: the attitude is to be ignored.
const IGNORE_ATTITUDE: u8 = 128;

/// Message with a command, or a heartbeat.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum MavlinkPacket {
    /// `HEARTBEAT` of a ground station.
    Heartbeat,
    /// `SET_ATTITUDE_TARGET` without an attitude.
    AttitudeTarget(AttitudeTarget),
    /// `RC_CHANNELS_OVERRIDE`.
    RcOverride {
        /// The autopilot's system and component.
        target: [u8; 2],
        /// Fields of the channels: pulses in µs, or values that leave a channel unchanged or release it.
        channels: ChannelCodes,
    },
}

/// Body rates and thrust.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AttitudeTarget {
    /// Time since the sender started, ms.
    pub time_ms: u32,
    /// Body rates about the axes forward, right, down, rad/s.
    pub rates_body: [f32; 3],
    /// Normalised thrust, 0 to 1.
    pub thrust: f32,
    /// The autopilot's system and component.
    pub target: [u8; 2],
}

/// Channels of an autopilot that `RC_CHANNELS_OVERRIDE` has overridden.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Overrides {
    /// Pulses, µs; 0 for channels that are not overridden.
    pub pulses: ChannelCodes,
}

impl Overrides {
    /// Applies the fields of a message.
    pub fn apply(&mut self, fields: &ChannelCodes) {
        for (channel, (pulse, &field)) in self.pulses.iter_mut().zip(fields).enumerate() {
            *pulse = match field {
                u16::MAX => *pulse,
                0 if channel >= FIRST => *pulse,
                // Released to the radio.
                0xfffe if channel >= FIRST => 0,
                pulse => pulse,
            };
        }
    }
}

const HEARTBEAT: Definition = Definition {
    id: 0,
    base_length: 9,
    length: 9,
    crc_extra: 50,
};
const RC_CHANNELS_OVERRIDE: Definition = Definition {
    id: 70,
    base_length: 18,
    length: 38,
    crc_extra: 124,
};
const SET_ATTITUDE_TARGET: Definition = Definition {
    id: 82,
    base_length: 39,
    length: 39,
    crc_extra: 49,
};
const MESSAGES: [Definition; 3] = [HEARTBEAT, RC_CHANNELS_OVERRIDE, SET_ATTITUDE_TARGET];
const LONGEST: usize = SET_ATTITUDE_TARGET.length;

/// Offset of the body rates in `SET_ATTITUDE_TARGET`.
const RATES_OFFSET: usize = 20;
/// Offset of the target in `RC_CHANNELS_OVERRIDE`.
const TARGET_OFFSET: usize = 16;

/// Appends a message to a frame.
#[inline]
pub fn encode(message: &MavlinkPacket, sender: Sender, sequence: u8, frame: &mut Frame) {
    let (definition, payload) = build_payload(message);
    mavlink_frame::encode(
        &definition,
        &payload[..definition.length],
        sender,
        sequence,
        |part| frame.push(part),
    );
}

#[inline]
fn build_payload(message: &MavlinkPacket) -> (Definition, [u8; LONGEST]) {
    let mut payload = [0; LONGEST];
    let definition = match message {
        MavlinkPacket::Heartbeat => {
            // Custom mode; a ground station (6) without an autopilot (8), mode 0, active (4), version 3.
            payload[4..9].copy_from_slice(&[6, 8, 0, 4, 3]);
            HEARTBEAT
        }
        MavlinkPacket::AttitudeTarget(target) => {
            payload[..4].copy_from_slice(&target.time_ms.to_le_bytes());
            // The attitude is ignored, but autopilots require it to be valid.
            payload[4..8].copy_from_slice(&1.0_f32.to_le_bytes());
            let [x, y, z] = target.rates_body;
            let numbers = [x, y, z, target.thrust];
            for (bytes, number) in payload[RATES_OFFSET..].chunks_exact_mut(4).zip(numbers) {
                bytes.copy_from_slice(&number.to_le_bytes());
            }
            let [system, component] = target.target;
            payload[36..].copy_from_slice(&[system, component, IGNORE_ATTITUDE]);
            SET_ATTITUDE_TARGET
        }
        MavlinkPacket::RcOverride { target, channels } => {
            for (index, channel) in channels.iter().enumerate() {
                let at = 2 * index + if index < 8 { 0 } else { 2 };
                payload[at..at + 2].copy_from_slice(&channel.to_le_bytes());
            }
            payload[TARGET_OFFSET..TARGET_OFFSET + 2].copy_from_slice(target);
            RC_CHANNELS_OVERRIDE
        }
    };
    (definition, payload)
}

/// Decodes the message at the start of the bytes. Returns it with its sender, its sequence number, and its length in
/// bytes.
///
/// # Errors
/// [`DecodeError`] if the bytes do not start with a known message.
pub fn decode(bytes: &[u8]) -> Result<(MavlinkPacket, Sender, u8, usize), DecodeError> {
    let shorter_than = |expected| DecodeError::Length {
        expected,
        found: bytes.len(),
    };
    let header = bytes.get(..HEADER_2).ok_or(shorter_than(HEADER_2))?;
    let unexpected = |offset: usize| DecodeError::Constant {
        offset,
        found: header[offset],
    };
    // Signatures and other incompatible flags are not supported.
    for (offset, expected) in [(0, START_2), (2, 0)] {
        if header[offset] != expected {
            return Err(unexpected(offset));
        }
    }
    let frame = mavlink_frame::decode(bytes, &MESSAGES).map_err(|error| match error {
        FrameError::Incomplete(length) => shorter_than(length),
        FrameError::Start => unexpected(0),
        FrameError::Length => unexpected(1),
        FrameError::Flags => unexpected(2),
        FrameError::Unknown => unexpected(7),
        FrameError::Checksum => DecodeError::Checksum,
    })?;
    let mut payload = [0; LONGEST];
    payload[..frame.payload.len()].copy_from_slice(frame.payload);
    let packet = parse_payload(frame.definition.id, &payload);
    Ok((packet, frame.sender, frame.sequence, frame.length))
}

fn parse_payload(id: u32, payload: &[u8; LONGEST]) -> MavlinkPacket {
    let number = |at: usize| f32::from_le_bytes([0, 1, 2, 3].map(|byte| payload[at + byte]));
    match id {
        id if id == SET_ATTITUDE_TARGET.id => MavlinkPacket::AttitudeTarget(AttitudeTarget {
            time_ms: u32::from_le_bytes([0, 1, 2, 3].map(|byte| payload[byte])),
            rates_body: [0, 4, 8].map(|offset| number(RATES_OFFSET + offset)),
            thrust: number(RATES_OFFSET + 12),
            target: [payload[36], payload[37]],
        }),
        id if id == RC_CHANNELS_OVERRIDE.id => {
            let mut channels = [0; 16];
            for (index, channel) in channels.iter_mut().enumerate() {
                let at = 2 * index + if index < 8 { 0 } else { 2 };
                *channel = u16::from_le_bytes([payload[at], payload[at + 1]]);
            }
            MavlinkPacket::RcOverride {
                target: [payload[TARGET_OFFSET], payload[TARGET_OFFSET + 1]],
                channels,
            }
        }
        _ => MavlinkPacket::Heartbeat,
    }
}
