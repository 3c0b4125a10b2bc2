//! Packing of sixteen 11-bit channels into 22 bytes, least significant bit first, as in CRSF, SBUS and MULTI.

use crate::ChannelCodes;

/// Length of sixteen packed channels, bytes.
pub(crate) const PACKED: usize = 22;

/// Largest 11-bit code.
pub(crate) const LARGEST: u16 = (1 << 11) - 1;

/// Packs the lower 11 bits of each channel.
#[inline]
pub(crate) fn pack(channels: &ChannelCodes) -> [u8; PACKED] {
    let mut packed = [0; PACKED];
    let (mut bits, mut count, mut at) = (0_u32, 0, 0);
    for &channel in channels {
        bits |= u32::from(channel & LARGEST) << count;
        count += 11;
        while count >= 8 {
            packed[at] = bits.to_le_bytes()[0];
            at += 1;
            bits >>= 8;
            count -= 8;
        }
    }
    packed
}

/// Unpacks channels.
#[inline]
#[expect(clippy::cast_possible_truncation, reason = "masked to 11 bits")]
pub(crate) fn unpack(packed: &[u8; PACKED]) -> ChannelCodes {
    let mut channels = [0; 16];
    let (mut bits, mut count, mut bytes) = (0_u32, 0, packed.iter());
    for channel in &mut channels {
        while count < 11 {
            bits |= u32::from(*bytes.next().unwrap_or(&0)) << count;
            count += 8;
        }
        *channel = (bits as u16) & LARGEST;
        bits >>= 11;
        count -= 11;
    }
    channels
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_channel_has_the_lowest_bits() {
        let mut channels = [0; 16];
        channels[0] = 0x7ff;
        channels[2] = 1;
        let packed = pack(&channels);
        assert_eq!(packed[..4], [0xff, 0x07, 0x40, 0]);
        assert_eq!(packed[4..], [0; 18]);
    }
}
