//! SBUS: the frames of a receiver with a serial output.
//!
//! 100000 baud 8E2, and **inverted**: a serial adapter drives the port through an inverter (a transistor, or the adapter's
//! own inverted output); F7 and H7 flight controllers can be configured for an uninverted signal.
//! `0x0F`, 22 bytes of channels, flags, `0x00`. The codes 172, 992 and 1811 are −100, 0 and 100 %. A flag signals
//! failsafe.

use crate::channel_map::{CodeUnit, ELEVEN_BITS, Units};
use crate::format::{Content, Decoded, Format, decode_fixed};
use crate::frame::Frame;
use crate::packing::{self, PACKED};
use crate::{ChannelCodes, DecodeError};

/// Bytes of a frame.
pub const LENGTH: usize = 25;

/// Codes at −100 and 100 %.
pub const ENDS: [u16; 2] = [172, 1811];

const HEADER: u8 = 0x0f;
const FOOTER: u8 = 0x00;

/// Flags and switches of a frame.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Flags {
    /// The two binary channels, 17 and 18.
    pub switches: [bool; 2],
    /// The previous frame was lost on the air.
    pub frame_lost: bool,
    /// The receiver has lost its transmitter, and the flight controller uses its failsafe.
    pub failsafe: bool,
}

impl Flags {
    fn byte(self) -> u8 {
        let bits = [self.switches[0], self.switches[1], self.frame_lost, self.failsafe];
        bits.iter()
            .rev()
            .fold(0, |byte, &bit| (byte << 1) | u8::from(bit))
    }

    fn from_byte(byte: u8) -> Self {
        let bit = |at: u8| byte >> at & 1 == 1;
        Self {
            switches: [bit(0), bit(1)],
            frame_lost: bit(2),
            failsafe: bit(3),
        }
    }
}

/// SBUS frame format.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Sbus;

impl Format for Sbus {
    fn units(&self) -> Units {
        Units {
            ends: ENDS,
            limits: ELEVEN_BITS,
            unstated: [ENDS[0]; 16],
            unit: CodeUnit::ReceiverStep,
        }
    }

    #[inline]
    fn encode(&mut self, content: &Content<'_>, frame: &mut Frame) {
        let flags = Flags {
            failsafe: content.failsafe,
            ..Flags::default()
        };
        frame.push(&encode(&content.codes, flags));
    }

    fn decode(&self, bytes: &[u8]) -> Decoded {
        decode_fixed(bytes, LENGTH, |frame| {
            decode(frame).map(|(codes, flags)| (codes, flags.failsafe))
        })
    }

    fn has_failsafe_flag(&self) -> bool {
        true
    }
}

/// Encodes the lower 11 bits of each channel.
#[must_use]
#[inline]
pub fn encode(channels: &ChannelCodes, flags: Flags) -> [u8; LENGTH] {
    let mut frame = [0; LENGTH];
    frame[0] = HEADER;
    frame[1..=PACKED].copy_from_slice(&packing::pack(channels));
    frame[LENGTH - 2] = flags.byte();
    frame[LENGTH - 1] = FOOTER;
    frame
}

/// Decodes the channels and flags of a frame, which has no checksum.
///
/// # Errors
/// [`DecodeError`] if the bytes are not a frame.
pub fn decode(bytes: &[u8]) -> Result<(ChannelCodes, Flags), DecodeError> {
    let frame: &[u8; LENGTH] = bytes.try_into().map_err(|_| DecodeError::Length {
        expected: LENGTH,
        found: bytes.len(),
    })?;
    for (offset, expected) in [(0, HEADER), (LENGTH - 1, FOOTER)] {
        if frame[offset] != expected {
            return Err(DecodeError::Constant {
                offset,
                found: frame[offset],
            });
        }
    }
    // The upper four bits are unused.
    if frame[LENGTH - 2] > 0x0f {
        return Err(DecodeError::Constant {
            offset: LENGTH - 2,
            found: frame[LENGTH - 2],
        });
    }
    let mut packed = [0; PACKED];
    packed.copy_from_slice(&frame[1..=PACKED]);
    Ok((packing::unpack(&packed), Flags::from_byte(frame[LENGTH - 2])))
}
