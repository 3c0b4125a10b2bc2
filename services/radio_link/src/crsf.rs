//! CRSF: `RC_CHANNELS_PACKED`, the frame of sixteen channels from a receiver or handset.
//!
//! 420000 baud 8N1, not inverted: `0xC8`, length 24, type `0x16`, 22 bytes of channels, CRC-8 (polynomial `0xD5`, no
//! reflection, from 0) over type and channels. The codes 172, 992 and 1811 are −100, 0 and 100 %: 988, 1500 and 2012 µs.
//! The link signals failsafe by stopping its frames.

use crate::channel_map::{CodeUnit, ELEVEN_BITS, Units};
use crate::format::{Content, Decoded, Format, decode_fixed};
use crate::frame::Frame;
use crate::packing::{self, PACKED};
use crate::{ChannelCodes, DecodeError};

/// Bytes of a frame.
pub const LENGTH: usize = 26;

/// Codes at −100 and 100 %.
pub const ENDS: [u16; 2] = [172, 1811];

/// Address of a flight controller: the first byte of every frame to it.
const ADDRESS: u8 = 0xc8;
/// Value of the length field: type, channels and checksum.
const LENGTH_FIELD: u8 = 24;
/// `RC_CHANNELS_PACKED`.
const TYPE: u8 = 0x16;

/// CRSF frame format.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Crsf;

impl Format for Crsf {
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
        frame.push(&encode(&content.codes));
    }

    fn decode(&self, bytes: &[u8]) -> Decoded {
        decode_fixed(bytes, LENGTH, |frame| Ok((decode(frame)?, false)))
    }
}

/// Encodes the lower 11 bits of each channel.
#[must_use]
#[inline]
pub fn encode(channels: &ChannelCodes) -> [u8; LENGTH] {
    let mut frame = [0; LENGTH];
    frame[..3].copy_from_slice(&[ADDRESS, LENGTH_FIELD, TYPE]);
    frame[3..3 + PACKED].copy_from_slice(&packing::pack(channels));
    frame[LENGTH - 1] = checksum(&frame[2..LENGTH - 1]);
    frame
}

/// Decodes the channels of a frame.
///
/// # Errors
/// [`DecodeError`] if the bytes are not a frame of channels.
pub fn decode(bytes: &[u8]) -> Result<ChannelCodes, DecodeError> {
    let frame: &[u8; LENGTH] = bytes.try_into().map_err(|_| DecodeError::Length {
        expected: LENGTH,
        found: bytes.len(),
    })?;
    for (offset, expected) in [ADDRESS, LENGTH_FIELD, TYPE].into_iter().enumerate() {
        if frame[offset] != expected {
            return Err(DecodeError::Constant {
                offset,
                found: frame[offset],
            });
        }
    }
    if checksum(&frame[2..LENGTH - 1]) != frame[LENGTH - 1] {
        return Err(DecodeError::Checksum);
    }
    let mut packed = [0; PACKED];
    packed.copy_from_slice(&frame[3..3 + PACKED]);
    Ok(packing::unpack(&packed))
}

/// CRC-8/DVB-S2.
#[inline]
fn checksum(bytes: &[u8]) -> u8 {
    bytes.iter().fold(0, |sum, byte| {
        (0..8).fold(sum ^ byte, |sum, _| {
            if sum & 0x80 == 0 {
                sum << 1
            } else {
                (sum << 1) ^ 0xd5
            }
        })
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The check value of CRC-8/DVB-S2 in the catalogue of parametrised CRC algorithms.
    #[test]
    fn the_checksum_is_that_of_the_catalogue() {
        assert_eq!(checksum(b"123456789"), 0xbc);
    }
}
