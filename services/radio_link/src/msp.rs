//! MSP version 1: `MSP_SET_RAW_RC` sends channels to a flight controller, `MSP_RC` reads the received ones.
//!
//! `$M<` to the flight controller, `$M>` from it (`$M!` for an error): length, command, payload, and the exclusive or of
//! all bytes from the length on. A channel is a pulse in µs, 1000 to 2000. The flight controller must be configured for an
//! MSP receiver; its own failsafe acts when frames stop.
//!
//! Betaflight receives the sticks in the order of its channel map (AETR by default) and reports them as roll, pitch, yaw,
//! thrust.

use crate::channel_map::{CodeUnit, PULSES, Units};
use crate::format::{Content, Decoded, Format, decode_fixed};
use crate::frame::Frame;
use crate::telemetry::Reply;
use crate::{ChannelCodes, DecodeError};

/// Pulses at −100 and 100 %, µs.
pub const ENDS: [u16; 2] = [1000, 2000];

/// Bytes of a frame that carries sixteen channels.
pub const LENGTH: usize = 6 + 32;

/// Largest payload.
const LARGEST_PAYLOAD: usize = 255;

/// Command that sets the channels in place of a receiver.
pub const SET_RAW_RC: u8 = 200;
/// Command that reads the received channels.
pub const RC: u8 = 105;
/// Command that reads the battery: cells, capacity, voltage in 0.1 V, used capacity, current, state, voltage in 0.01 V.
pub const BATTERY_STATE: u8 = 130;

/// Offset of the voltage in 0.01 V in the payload of `BATTERY_STATE`.
const VOLTAGE_OFFSET: usize = 9;
/// Period of requests for the battery's voltage, ns.
const REQUEST_NS: u64 = 200_000_000;

/// MSP frame format.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Msp {
    request_at_ns: u64,
}

impl Format for Msp {
    fn units(&self) -> Units {
        Units {
            ends: ENDS,
            limits: PULSES,
            unstated: [ENDS[0]; 16],
            unit: CodeUnit::Pulse,
        }
    }

    #[inline]
    fn encode(&mut self, content: &Content<'_>, frame: &mut Frame) {
        frame.push(&encode(&content.codes));
    }

    fn decode(&self, bytes: &[u8]) -> Decoded {
        decode_fixed(bytes, LENGTH, |frame| {
            let message = decode(frame)?;
            let (codes, _) = message.channels();
            if message.direction == Direction::Request && message.command == SET_RAW_RC {
                Ok((codes, false))
            } else {
                let (offset, found) = (4, message.command);
                Err(DecodeError::Constant { offset, found })
            }
        })
    }

    fn read_reply(&mut self, bytes: &[u8]) -> Reply {
        read_reply(bytes)
    }

    fn request_voltage(&mut self, now_ns: u64, _are_motors_off: bool, frame: &mut Frame) {
        if now_ns >= self.request_at_ns {
            self.request_at_ns = now_ns + REQUEST_NS;
            frame.push(&request(BATTERY_STATE));
        }
    }
}

/// Reads the frame at the start of what the flight controller sends back.
#[must_use]
pub fn read_reply(bytes: &[u8]) -> Reply {
    let is_start = |(at, byte): (usize, &u8)| match at {
        0 => *byte == b'$',
        1 => *byte == b'M',
        _ => matches!(byte, b'<' | b'>' | b'!'),
    };
    if !bytes.iter().take(3).enumerate().all(is_start) {
        return Reply::Noise;
    }
    let length = bytes.get(3).map(|payload| 6 + usize::from(*payload));
    let Some(frame) = length.and_then(|length| bytes.get(..length)) else {
        return Reply::Incomplete;
    };
    if checksum(&frame[3..]) != 0 {
        return Reply::Noise;
    }
    match (&frame[2..5], &frame[5..frame.len() - 1]) {
        ([b'>', _, BATTERY_STATE], payload) if payload.len() >= VOLTAGE_OFFSET + 2 => {
            let steps = u16::from_le_bytes([payload[VOLTAGE_OFFSET], payload[VOLTAGE_OFFSET + 1]]);
            Reply::Voltage(frame.len(), 0.01 * f64::from(steps))
        }
        _ => Reply::Other(frame.len()),
    }
}

/// Encodes channels, µs.
#[must_use]
#[inline]
pub fn encode(channels: &ChannelCodes) -> [u8; LENGTH] {
    let mut frame = [0; LENGTH];
    frame[..5].copy_from_slice(&[b'$', b'M', b'<', 32, SET_RAW_RC]);
    for (bytes, channel) in frame[5..LENGTH - 1].chunks_exact_mut(2).zip(channels) {
        bytes.copy_from_slice(&channel.to_le_bytes());
    }
    frame[LENGTH - 1] = checksum(&frame[3..LENGTH - 1]);
    frame
}

/// Encodes a request without payload.
#[must_use]
pub fn request(command: u8) -> [u8; 6] {
    [b'$', b'M', b'<', 0, command, command]
}

/// Direction of a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Direction {
    /// To the flight controller.
    Request,
    /// From the flight controller.
    Response,
    /// From the flight controller: the request is unknown or not permitted.
    Error,
}

/// Received frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct MspMessage<'a> {
    /// Direction of the frame.
    pub direction: Direction,
    /// Command.
    pub command: u8,
    /// Payload.
    pub payload: &'a [u8],
}

impl MspMessage<'_> {
    /// Returns the pulses of up to sixteen channels, µs, and their number. The others are 0.
    #[must_use]
    pub fn channels(&self) -> (ChannelCodes, usize) {
        let mut channels = [0; 16];
        let mut count = 0;
        for (channel, bytes) in channels.iter_mut().zip(self.payload.chunks_exact(2)) {
            *channel = u16::from_le_bytes([bytes[0], bytes[1]]);
            count += 1;
        }
        (channels, count)
    }
}

/// Decodes exactly one frame.
///
/// # Errors
/// [`DecodeError`] if the bytes are not one frame.
pub fn decode(bytes: &[u8]) -> Result<MspMessage<'_>, DecodeError> {
    let mut receiver = Receiver::default();
    for (offset, &byte) in bytes.iter().enumerate() {
        let is_last = offset + 1 == bytes.len();
        let direction = match (receiver.push(byte), is_last) {
            (Step::Complete(message), true) => message.direction,
            (Step::Incomplete, false) => continue,
            (Step::Incomplete, true) => break,
            (Step::Invalid, true) if offset >= 5 => return Err(DecodeError::Checksum),
            (Step::Invalid | Step::Complete(_), _) => {
                return Err(DecodeError::Constant { offset, found: byte });
            }
        };
        return Ok(MspMessage {
            direction,
            command: bytes[4],
            payload: &bytes[5..bytes.len() - 1],
        });
    }
    Err(DecodeError::Length {
        expected: 6 + usize::from(bytes.get(3).copied().unwrap_or(0)),
        found: bytes.len(),
    })
}

/// Parser of frames in a byte stream.
#[derive(Clone, Debug)]
pub struct Receiver {
    bytes: [u8; 6 + LARGEST_PAYLOAD],
    length: usize,
}

impl Default for Receiver {
    fn default() -> Self {
        Self {
            bytes: [0; 6 + LARGEST_PAYLOAD],
            length: 0,
        }
    }
}

/// Result of the next byte of a stream.
#[derive(Debug, PartialEq, Eq)]
pub enum Step<'a> {
    /// The frame is not complete yet.
    Incomplete,
    /// The last byte of a frame.
    Complete(MspMessage<'a>),
    /// An invalid byte: the bytes before it are dropped.
    Invalid,
}

impl Receiver {
    /// Parses a byte.
    pub fn push(&mut self, byte: u8) -> Step<'_> {
        let at = self.length;
        let is_valid = match at {
            0 => byte == b'$',
            1 => byte == b'M',
            2 => matches!(byte, b'<' | b'>' | b'!'),
            _ => true,
        };
        if !is_valid {
            // The byte may start the next frame.
            self.bytes[0] = byte;
            self.length = usize::from(byte == b'$');
            return Step::Invalid;
        }
        self.bytes[at] = byte;
        self.length = at + 1;
        if at < 5 || self.length < 6 + usize::from(self.bytes[3]) {
            return Step::Incomplete;
        }
        self.length = 0;
        if checksum(&self.bytes[3..at]) != byte {
            return Step::Invalid;
        }
        Step::Complete(MspMessage {
            direction: match self.bytes[2] {
                b'<' => Direction::Request,
                b'>' => Direction::Response,
                _ => Direction::Error,
            },
            command: self.bytes[4],
            payload: &self.bytes[5..at],
        })
    }
}

#[inline]
fn checksum(bytes: &[u8]) -> u8 {
    bytes.iter().fold(0, |sum, byte| sum ^ byte)
}
