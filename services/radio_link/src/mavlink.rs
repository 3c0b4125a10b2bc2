//! MAVLink 2: the three messages that control an autopilot.
//!
//! `0xFD`, length, two bytes of flags, sequence, system, component, message ID in three bytes, payload without trailing
//! zeros, CRC-16/MCRF4XX over everything but the first byte, and over `CRC_EXTRA`, a byte derived from the message's
//! definition. Fields are ordered by size. Body rates are about the axes forward, right, down, as everywhere in this
//! project.
//!
//! PX4 follows `SET_ATTITUDE_TARGET` in its mode *offboard* and leaves that mode when the messages stop; ArduPilot in
//! *GUIDED_NOGPS*. `RC_CHANNELS_OVERRIDE` replaces a receiver. Neither arms: the operator arms at the ground station.

mod battery;
mod link;

pub use battery::read_reply;
pub(crate) use link::Mavlink;

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

const START: u8 = 0xfd;
/// Bytes before the payload.
const HEADER: usize = 10;
/// Flag of `SET_ATTITUDE_TARGET`: the attitude is to be ignored.
const IGNORE_ATTITUDE: u8 = 128;

/// Sender of a message.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Sender {
    /// System ID.
    pub system: u8,
    /// Component ID.
    pub component: u8,
}

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

/// Message ID, length of the payload, and `CRC_EXTRA`.
#[derive(Clone, Copy)]
struct Kind {
    id: u32,
    length: usize,
    crc_extra: u8,
}

const HEARTBEAT: Kind = Kind {
    id: 0,
    length: 9,
    crc_extra: 50,
};
const RC_CHANNELS_OVERRIDE: Kind = Kind {
    id: 70,
    length: 38,
    crc_extra: 124,
};
const SET_ATTITUDE_TARGET: Kind = Kind {
    id: 82,
    length: 39,
    crc_extra: 49,
};
const KINDS: [Kind; 3] = [HEARTBEAT, RC_CHANNELS_OVERRIDE, SET_ATTITUDE_TARGET];
const LONGEST: usize = SET_ATTITUDE_TARGET.length;

/// Offset of the body rates in `SET_ATTITUDE_TARGET`.
const RATES_OFFSET: usize = 20;
/// Offset of the target in `RC_CHANNELS_OVERRIDE`.
const TARGET_OFFSET: usize = 16;

/// Appends a message to a frame.
#[inline]
pub fn encode(message: &MavlinkPacket, sender: Sender, sequence: u8, frame: &mut Frame) {
    let (kind, payload) = build_payload(message);
    let payload = &payload[..kind.length];
    // Trailing zeros are truncated; the first byte always remains.
    let zeros = payload[1..].iter().rev().take_while(|&&byte| byte == 0).count();
    let payload = &payload[..kind.length - zeros];
    let [id0, id1, id2, _] = kind.id.to_le_bytes();
    let length = payload.len().to_le_bytes()[0];
    let header = [
        START,
        length,
        0,
        0,
        sequence,
        sender.system,
        sender.component,
        id0,
        id1,
        id2,
    ];
    let sum = accumulate(accumulate(0xffff, &header[1..]), payload);
    frame.push(&header);
    frame.push(payload);
    frame.push(&accumulate(sum, &[kind.crc_extra]).to_le_bytes());
}

#[inline]
fn build_payload(message: &MavlinkPacket) -> (Kind, [u8; LONGEST]) {
    let mut payload = [0; LONGEST];
    let kind = match message {
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
    (kind, payload)
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
    let header = bytes.get(..HEADER).ok_or(shorter_than(HEADER))?;
    let unexpected = |offset: usize| DecodeError::Constant {
        offset,
        found: header[offset],
    };
    // Signatures and other incompatible flags are not supported.
    for (offset, expected) in [(0, START), (2, 0)] {
        if header[offset] != expected {
            return Err(unexpected(offset));
        }
    }
    let id = u32::from_le_bytes([header[7], header[8], header[9], 0]);
    let kind = KINDS
        .into_iter()
        .find(|kind| kind.id == id)
        .ok_or(unexpected(7))?;
    let length = usize::from(header[1]);
    if length == 0 || length > kind.length {
        return Err(unexpected(1));
    }
    let end = HEADER + length;
    let sum = bytes.get(end..end + 2).ok_or(shorter_than(end + 2))?;
    let computed = accumulate(accumulate(0xffff, &bytes[1..end]), &[kind.crc_extra]);
    if sum != computed.to_le_bytes() {
        return Err(DecodeError::Checksum);
    }
    let mut payload = [0; LONGEST];
    payload[..length].copy_from_slice(&bytes[HEADER..end]);
    let sender = Sender {
        system: header[5],
        component: header[6],
    };
    Ok((parse_payload(kind, &payload), sender, header[4], end + 2))
}

fn parse_payload(kind: Kind, payload: &[u8; LONGEST]) -> MavlinkPacket {
    let number = |at: usize| f32::from_le_bytes([0, 1, 2, 3].map(|byte| payload[at + byte]));
    match kind.id {
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

/// Continues a CRC-16/MCRF4XX over further bytes.
#[inline]
fn accumulate(sum: u16, bytes: &[u8]) -> u16 {
    bytes.iter().fold(sum, |sum, &byte| {
        let low = byte ^ sum.to_le_bytes()[0];
        let low = u16::from(low ^ (low << 4));
        (sum >> 8) ^ (low << 8) ^ (low << 3) ^ (low >> 4)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The check value of CRC-16/MCRF4XX in the catalogue of parametrised CRC algorithms.
    #[test]
    fn the_checksum_is_that_of_the_catalogue() {
        assert_eq!(accumulate(0xffff, b"123456789"), 0x6f91);
    }
}
