//! SBUS: the frames of a receiver with a serial output.
//!
//! 100000 baud 8E2, and **inverted**: a serial adapter drives a receiver's port through an inverter (a transistor, or an
//! adapter whose output can be turned around); F7 and H7 flight controllers take it uninverted if told so.
//! `0x0F`, 22 bytes of channels, flags, `0x00`. The codes 172, 992 and 1811 are −100, 0 and 100 %. The failsafe of the
//! link is a flag.

use crate::channel_map::{CodeUnit, ELEVEN_BITS, Units};
use crate::format::{Content, Decoded, Format, fixed};
use crate::frame::Frame;
use crate::packing::{self, PACKED};
use crate::{ChannelCodes, DecodeError};

/// Bytes of a frame.
pub const LENGTH: usize = 25;

/// Codes at −100 and 100 %.
pub const ENDS: [u16; 2] = [172, 1811];

const HEADER: u8 = 0x0f;
const FOOTER: u8 = 0x00;

/// Contents of a frame beside its channels.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Flags {
    /// The two channels that are only on or off, the 17th and the 18th.
    pub switches: [bool; 2],
    /// The frame before was lost on the air.
    pub frame_lost: bool,
    /// The receiver has lost its transmitter: the flight controller uses its failsafe.
    pub failsafe: bool,
}

impl Flags {
    fn byte(self) -> u8 {
        let bits = [self.switches[0], self.switches[1], self.frame_lost, self.failsafe];
        bits.iter()
            .rev()
            .fold(0, |byte, &bit| (byte << 1) | u8::from(bit))
    }

    fn of(byte: u8) -> Self {
        let bit = |at: u8| byte >> at & 1 == 1;
        Self {
            switches: [bit(0), bit(1)],
            frame_lost: bit(2),
            failsafe: bit(3),
        }
    }
}

/// The format.
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
        fixed(bytes, LENGTH, |frame| {
            decode(frame).map(|(codes, flags)| (codes, flags.failsafe))
        })
    }

    fn has_failsafe_flag(&self) -> bool {
        true
    }
}

/// Encodes channels, of each the lower 11 bits.
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

/// Decodes the channels and flags of a frame. It has no check sum.
///
/// # Errors
/// [`DecodeError`] if the bytes are not a frame.
pub fn decode(bytes: &[u8]) -> Result<(ChannelCodes, Flags), DecodeError> {
    let frame: &[u8; LENGTH] = bytes.try_into().map_err(|_| DecodeError::Length {
        wanted: LENGTH,
        found: bytes.len(),
    })?;
    for (at, wanted) in [(0, HEADER), (LENGTH - 1, FOOTER)] {
        if frame[at] != wanted {
            return Err(DecodeError::Mark { at, found: frame[at] });
        }
    }
    // The upper half of the flags has no meaning.
    if frame[LENGTH - 2] > 0x0f {
        return Err(DecodeError::Mark {
            at: LENGTH - 2,
            found: frame[LENGTH - 2],
        });
    }
    let mut packed = [0; PACKED];
    packed.copy_from_slice(&frame[1..=PACKED]);
    Ok((packing::unpack(&packed), Flags::of(frame[LENGTH - 2])))
}
