//! MSP version 1: `MSP_SET_RAW_RC` to a flight controller, and `MSP_RC`, what it has received.
//!
//! `$M<` to the flight controller, `$M>` from it (`$M!` if it refuses): length, command, payload, and the exclusive or of
//! all of these from the length on. A channel is a pulse in µs, 1000 to 2000. The flight controller must be told that its
//! receiver is MSP; its own failsafe acts when frames stop.
//!
//! Betaflight takes the sticks in the order of its channel map (AETR by default) and tells them as roll, pitch, yaw,
//! thrust.

use crate::channel_map::{CodeUnit, PULSES, Units};
use crate::format::{Content, Decoded, Format, fixed};
use crate::frame::Frame;
use crate::{ChannelCodes, DecodeError};

/// Pulses at −100 and 100 %, µs.
pub const ENDS: [u16; 2] = [1000, 2000];

/// Bytes of a frame that carries sixteen channels.
pub const LENGTH: usize = 6 + 32;

/// Largest payload.
const LARGEST_PAYLOAD: usize = 255;

/// Command that replaces the receiver of a flight controller.
pub const SET_RAW_RC: u8 = 200;
/// Command that asks for the received channels.
pub const RC: u8 = 105;

/// The format.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Msp;

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
        fixed(bytes, LENGTH, |frame| {
            let message = decode(frame)?;
            let (codes, _) = message.channels();
            if message.sense == Direction::Request && message.command == SET_RAW_RC {
                Ok((codes, false))
            } else {
                let (at, found) = (4, message.command);
                Err(DecodeError::Mark { at, found })
            }
        })
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
    frame[LENGTH - 1] = check_sum(&frame[3..LENGTH - 1]);
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
    /// From it.
    Answer,
    /// From it: the request is unknown or not permitted.
    Refusal,
}

/// A frame as it was received.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct MspMessage<'a> {
    /// Its direction.
    pub sense: Direction,
    /// Its command.
    pub command: u8,
    /// Its payload.
    pub payload: &'a [u8],
}

impl MspMessage<'_> {
    /// Returns the pulses of the first sixteen channels, µs, and their number; 0 beyond them.
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

/// Decodes bytes that are exactly one frame.
///
/// # Errors
/// [`DecodeError`] if they are not.
pub fn decode(bytes: &[u8]) -> Result<MspMessage<'_>, DecodeError> {
    let mut receiver = Receiver::default();
    for (at, &byte) in bytes.iter().enumerate() {
        let is_last = at + 1 == bytes.len();
        let sense = match (receiver.push(byte), is_last) {
            (Step::Whole(message), true) => message.sense,
            (Step::Unfinished, false) => continue,
            (Step::Unfinished, true) => break,
            (Step::Broken, true) if at >= 5 => return Err(DecodeError::CheckSum),
            (Step::Broken | Step::Whole(_), _) => return Err(DecodeError::Mark { at, found: byte }),
        };
        return Ok(MspMessage {
            sense,
            command: bytes[4],
            payload: &bytes[5..bytes.len() - 1],
        });
    }
    Err(DecodeError::Length {
        wanted: 6 + usize::from(bytes.get(3).copied().unwrap_or(0)),
        found: bytes.len(),
    })
}

/// Finder of frames in a stream of bytes.
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

/// Result of a byte of the stream.
#[derive(Debug, PartialEq, Eq)]
pub enum Step<'a> {
    /// Nothing yet.
    Unfinished,
    /// The last byte of a frame.
    Whole(MspMessage<'a>),
    /// A byte that cannot follow the ones before, all of which are dropped.
    Broken,
}

impl Receiver {
    /// Takes a byte.
    pub fn push(&mut self, byte: u8) -> Step<'_> {
        let at = self.length;
        let is_good = match at {
            0 => byte == b'$',
            1 => byte == b'M',
            2 => matches!(byte, b'<' | b'>' | b'!'),
            _ => true,
        };
        if !is_good {
            // It may begin the next frame.
            self.bytes[0] = byte;
            self.length = usize::from(byte == b'$');
            return Step::Broken;
        }
        self.bytes[at] = byte;
        self.length = at + 1;
        if at < 5 || self.length < 6 + usize::from(self.bytes[3]) {
            return Step::Unfinished;
        }
        self.length = 0;
        if check_sum(&self.bytes[3..at]) != byte {
            return Step::Broken;
        }
        Step::Whole(MspMessage {
            sense: match self.bytes[2] {
                b'<' => Direction::Request,
                b'>' => Direction::Answer,
                _ => Direction::Refusal,
            },
            command: self.bytes[4],
            payload: &self.bytes[5..at],
        })
    }
}

#[inline]
fn check_sum(bytes: &[u8]) -> u8 {
    bytes.iter().fold(0, |sum, byte| sum ^ byte)
}
