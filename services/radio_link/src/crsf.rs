//! CRSF: `RC_CHANNELS_PACKED`, the frame of sixteen channels from a receiver or handset.
//!
//! 420000 baud 8N1, not inverted: `0xC8`, length 24, type `0x16`, 22 bytes of channels, CRC-8 (polynomial `0xD5`, no
//! reflection, from 0) over type and channels. The codes 172, 992 and 1811 are −100, 0 and 100 %: 988, 1500 and 2012 µs.
//! The link signals failsafe by stopping its frames.
//!
//! The vehicle sends back frames of the same form, of other types. Its battery sensor, type `0x08`, has the voltage first, in
//! 0.1 V as a signed number of 16 bits, high byte first; then the current, 0.1 A; the used capacity in three bytes, mAh; and
//! the remaining share, %. A ninth byte numbers further batteries.

use crate::channel_map::{CodeUnit, ELEVEN_BITS, Units};
use crate::format::{Content, Decoded, Format, decode_fixed};
use crate::frame::Frame;
use crate::packing::{self, PACKED};
use crate::telemetry::Reply;
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
/// `BATTERY_SENSOR`, and its length field: type, eight bytes and checksum, or nine with the number of a battery.
const BATTERY: u8 = 0x08;
const BATTERY_LENGTH: u8 = 10;
/// Addresses in frames that come back: to the flight controller, handset, receiver and transmitter module.
const ADDRESSES_BACK: [u8; 4] = [ADDRESS, 0xea, 0xec, 0xee];
/// Least and largest length field.
const LENGTHS: std::ops::RangeInclusive<u8> = 2..=62;

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

    fn read_reply(&mut self, bytes: &[u8]) -> Reply {
        read_reply(bytes)
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

/// Reads the frame at the start of what the vehicle sends back.
#[must_use]
pub fn read_reply(bytes: &[u8]) -> Reply {
    let [address, rest @ ..] = bytes else {
        return Reply::Incomplete;
    };
    if !ADDRESSES_BACK.contains(address) {
        return Reply::Noise;
    }
    let [length, rest @ ..] = rest else {
        return Reply::Incomplete;
    };
    if !LENGTHS.contains(length) {
        return Reply::Noise;
    }
    let Some((content, [sum, ..])) = rest.split_at_checked(usize::from(*length) - 1) else {
        return Reply::Incomplete;
    };
    if checksum(content) != *sum {
        return Reply::Noise;
    }
    let end = usize::from(*length) + 2;
    match *content {
        // Other batteries than the first have a number.
        [BATTERY, high, low, _, _, _, _, _, _] | [BATTERY, high, low, _, _, _, _, _, _, 0] => {
            Reply::Voltage(end, 0.1 * f64::from(i16::from_be_bytes([high, low])))
        }
        _ => Reply::Other(end),
    }
}

/// Encodes the battery sensor of a vehicle with this voltage, V, for simulators.
#[must_use]
#[expect(clippy::cast_possible_truncation, reason = "within the numbers of 16 bits")]
pub fn encode_battery(voltage: f64) -> [u8; BATTERY_LENGTH as usize + 2] {
    let mut frame = [0; BATTERY_LENGTH as usize + 2];
    let steps = libm::round((10.0 * voltage).clamp(0.0, f64::from(i16::MAX))) as i16;
    frame[..3].copy_from_slice(&[ADDRESS, BATTERY_LENGTH, BATTERY]);
    frame[3..5].copy_from_slice(&steps.to_be_bytes());
    let last = frame.len() - 1;
    frame[last] = checksum(&frame[2..last]);
    frame
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
