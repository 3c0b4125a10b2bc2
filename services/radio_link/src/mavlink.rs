//! MAVLink 2: the three messages that control an autopilot.
//!
//! `0xFD`, length, two bytes of flags, sequence, system, component, number of the message in three bytes, payload without
//! the zeros at its end, CRC-16/MCRF4XX over all of it but the first byte, and over one byte that stands for the message's
//! definition. Fields stand in the order of their size. Body rates are about the axes forward, right, down, as everywhere
//! in this project.
//!
//! PX4 follows `SET_ATTITUDE_TARGET` in its mode *offboard* and leaves that mode when the messages stop; ArduPilot in
//! *GUIDED_NOGPS*. `RC_CHANNELS_OVERRIDE` replaces a receiver. Neither arms: the operator does, at the ground station.

mod link;

pub(crate) use link::Mavlink;

use crate::frame::Frame;
use crate::{ChannelCodes, DecodeError};

/// Pulses at −100 and 100 %, µs.
pub const ENDS: [u16; 2] = [1000, 2000];

/// Fields of `RC_CHANNELS_OVERRIDE` that leave a channel as it is: of the first eight `UINT16_MAX`, of the others 0, as
/// in a message that is too short to have them.
pub const LEFT_ALONE: ChannelCodes = {
    let mut fields = [0; 16];
    let mut channel = 0;
    while channel < FIRST {
        fields[channel] = u16::MAX;
        channel += 1;
    }
    fields
};

/// Channels of `RC_CHANNELS_OVERRIDE` whose fields are of the first definition: 0 gives them back to the radio.
const FIRST: usize = 8;

const START: u8 = 0xfd;
/// Bytes before the payload.
const HEADER: usize = 10;
/// Flag of `SET_ATTITUDE_TARGET`: the attitude is to be ignored.
const IGNORE_ATTITUDE: u8 = 128;

/// Sender of a message.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Sender {
    /// Its system.
    pub system: u8,
    /// Its component.
    pub component: u8,
}

/// Message that carries a command, or a heartbeat.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum MavlinkPacket {
    /// `HEARTBEAT` of a controller on the ground.
    Heartbeat,
    /// `SET_ATTITUDE_TARGET` without an attitude.
    AttitudeTarget(AttitudeTarget),
    /// `RC_CHANNELS_OVERRIDE`.
    RcOverride {
        /// The autopilot's system and component.
        target: [u8; 2],
        /// Fields of the channels: pulses in µs, or values that leave a channel alone or give it back.
        channels: ChannelCodes,
    },
}

/// Body rates and thrust.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AttitudeTarget {
    /// Time since the sender has begun, ms.
    pub time_ms: u32,
    /// Body rates about the axes forward, right, down, rad/s.
    pub rates_body: [f32; 3],
    /// Thrust as a share of the largest, 0 to 1.
    pub thrust: f32,
    /// The autopilot's system and component.
    pub target: [u8; 2],
}

/// Channels that an autopilot takes from `RC_CHANNELS_OVERRIDE` in place of those of its radio.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Overrides {
    /// Pulses, µs; 0 for channels that are the radio's.
    pub pulses: ChannelCodes,
}

impl Overrides {
    /// Takes the fields of a message.
    pub fn take(&mut self, fields: &ChannelCodes) {
        for (channel, (pulse, &field)) in self.pulses.iter_mut().zip(fields).enumerate() {
            *pulse = match field {
                u16::MAX => *pulse,
                0 if channel >= FIRST => *pulse,
                // Given back to the radio.
                0xfffe if channel >= FIRST => 0,
                pulse => pulse,
            };
        }
    }
}

/// Number, length of the payload and the byte that stands for the definition.
#[derive(Clone, Copy)]
struct Kind {
    id: u32,
    length: usize,
    extra: u8,
}

const HEARTBEAT: Kind = Kind {
    id: 0,
    length: 9,
    extra: 50,
};
const RC_CHANNELS_OVERRIDE: Kind = Kind {
    id: 70,
    length: 38,
    extra: 124,
};
const SET_ATTITUDE_TARGET: Kind = Kind {
    id: 82,
    length: 39,
    extra: 49,
};
const KINDS: [Kind; 3] = [HEARTBEAT, RC_CHANNELS_OVERRIDE, SET_ATTITUDE_TARGET];
const LONGEST: usize = SET_ATTITUDE_TARGET.length;

/// Offset of the fields of `SET_ATTITUDE_TARGET` after time and attitude.
const RATES_AT: usize = 20;
/// Offset of the fields of `RC_CHANNELS_OVERRIDE` after the first eight channels.
const TARGET_AT: usize = 16;

/// Appends a message to a frame.
#[inline]
pub fn encode(message: &MavlinkPacket, sender: Sender, sequence: u8, frame: &mut Frame) {
    let (kind, payload) = payload_of(message);
    let payload = &payload[..kind.length];
    // The payload loses the zeros at its end, all but its first byte.
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
    frame.push(&accumulate(sum, &[kind.extra]).to_le_bytes());
}

#[inline]
fn payload_of(message: &MavlinkPacket) -> (Kind, [u8; LONGEST]) {
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
            for (bytes, number) in payload[RATES_AT..].chunks_exact_mut(4).zip(numbers) {
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
            payload[TARGET_AT..TARGET_AT + 2].copy_from_slice(target);
            RC_CHANNELS_OVERRIDE
        }
    };
    (kind, payload)
}

/// Decodes the message at the beginning of the bytes. Returns it with its sender, its sequence number, and its length
/// in bytes.
///
/// # Errors
/// [`DecodeError`] if no known message begins there.
pub fn decode(bytes: &[u8]) -> Result<(MavlinkPacket, Sender, u8, usize), DecodeError> {
    let shorter_than = |wanted| DecodeError::Length {
        wanted,
        found: bytes.len(),
    };
    let header = bytes.get(..HEADER).ok_or(shorter_than(HEADER))?;
    let mark = |at: usize| DecodeError::Mark {
        at,
        found: header[at],
    };
    // Signatures and other flags of unknown senders are not understood.
    for (at, wanted) in [(0, START), (2, 0)] {
        if header[at] != wanted {
            return Err(mark(at));
        }
    }
    let id = u32::from_le_bytes([header[7], header[8], header[9], 0]);
    let kind = KINDS.into_iter().find(|kind| kind.id == id).ok_or(mark(7))?;
    let length = usize::from(header[1]);
    if length == 0 || length > kind.length {
        return Err(mark(1));
    }
    let end = HEADER + length;
    let sum = bytes.get(end..end + 2).ok_or(shorter_than(end + 2))?;
    let computed = accumulate(accumulate(0xffff, &bytes[1..end]), &[kind.extra]);
    if sum != computed.to_le_bytes() {
        return Err(DecodeError::CheckSum);
    }
    let mut payload = [0; LONGEST];
    payload[..length].copy_from_slice(&bytes[HEADER..end]);
    let sender = Sender {
        system: header[5],
        component: header[6],
    };
    Ok((message_of(kind, &payload), sender, header[4], end + 2))
}

fn message_of(kind: Kind, payload: &[u8; LONGEST]) -> MavlinkPacket {
    let number = |at: usize| f32::from_le_bytes([0, 1, 2, 3].map(|byte| payload[at + byte]));
    match kind.id {
        id if id == SET_ATTITUDE_TARGET.id => MavlinkPacket::AttitudeTarget(AttitudeTarget {
            time_ms: u32::from_le_bytes([0, 1, 2, 3].map(|byte| payload[byte])),
            rates_body: [0, 4, 8].map(|offset| number(RATES_AT + offset)),
            thrust: number(RATES_AT + 12),
            target: [payload[36], payload[37]],
        }),
        id if id == RC_CHANNELS_OVERRIDE.id => {
            let mut channels = [0; 16];
            for (index, channel) in channels.iter_mut().enumerate() {
                let at = 2 * index + if index < 8 { 0 } else { 2 };
                *channel = u16::from_le_bytes([payload[at], payload[at + 1]]);
            }
            MavlinkPacket::RcOverride {
                target: [payload[TARGET_AT], payload[TARGET_AT + 1]],
                channels,
            }
        }
        _ => MavlinkPacket::Heartbeat,
    }
}

/// CRC-16/MCRF4XX, continued.
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
    fn the_check_sum_is_that_of_the_catalogue() {
        assert_eq!(accumulate(0xffff, b"123456789"), 0x6f91);
    }
}
