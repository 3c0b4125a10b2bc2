//! MULTI (4-in-1) transmitter module on a serial line, for Spektrum DSM2 and DSMX, the protocols of the paper's Blade
//! 200 QX.
//!
//! 100000 baud 8E2, not inverted on the module's USB or header pins: `0x55`, protocol 6 (DSM) with flags, model number
//! with sub-protocol and power, option, 22 bytes of channels. The codes 204, 1024 and 1843 are −100, 0 and 100 %. A DSM
//! receiver stores its failsafe when it is bound, and uses it when frames stop.

use scenario::{DsmProtocol, MultiModule};

use crate::channel_map::{CodeUnit, ELEVEN_BITS, Units};
use crate::format::{Content, Decoded, Format, decode_fixed};
use crate::frame::Frame;
use crate::packing::{self, PACKED};
use crate::{ChannelCodes, DecodeError};

/// Bytes of a frame.
pub const LENGTH: usize = 26;

/// Codes at −100 and 100 %.
pub const ENDS: [u16; 2] = [204, 1843];

/// First byte of a frame of channels for the protocols 0 to 31.
const HEADER: u8 = 0x55;
/// Protocol number of DSM.
const DSM: u8 = 6;
/// Flag to bind a receiver.
const BIND: u8 = 0x80;
/// Flag to transmit with low power.
const LOW_POWER: u8 = 0x80;

/// Fields of a frame other than its channels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Settings {
    /// Model number, 0 to 15.
    pub model: u8,
    /// Sub-protocol of DSM: 0 to 3 as in [`DsmProtocol`].
    pub sub_protocol: u8,
    /// Number of channels over the air, 4 to 12.
    pub option: u8,
    /// `true` to transmit with low power.
    pub low_power: bool,
    /// `true` to bind a receiver.
    pub bind: bool,
}

impl Settings {
    /// Makes the settings of a checked scenario.
    #[must_use]
    pub fn new(module: &MultiModule) -> Self {
        let small = |number: u32| u8::try_from(number).unwrap_or(0);
        Self {
            model: small(module.model) & 0x0f,
            sub_protocol: match module.dsm {
                DsmProtocol::Dsm2Slow => 0,
                DsmProtocol::Dsm2Fast => 1,
                DsmProtocol::DsmxSlow => 2,
                DsmProtocol::DsmxFast => 3,
            },
            option: small(module.channels),
            low_power: module.low_power,
            bind: false,
        }
    }

    fn bytes(self) -> [u8; 3] {
        [
            DSM | if self.bind { BIND } else { 0 },
            self.model & 0x0f | (self.sub_protocol & 0x07) << 4 | if self.low_power { LOW_POWER } else { 0 },
            self.option,
        ]
    }
}

impl Format for Settings {
    fn units(&self) -> Units {
        Units {
            ends: ENDS,
            limits: ELEVEN_BITS,
            unstated: [ENDS[0]; 16],
            unit: CodeUnit::Step,
        }
    }

    #[inline]
    fn encode(&mut self, content: &Content<'_>, frame: &mut Frame) {
        frame.push(&encode(&content.codes, *self));
    }

    fn decode(&self, bytes: &[u8]) -> Decoded {
        decode_fixed(bytes, LENGTH, |frame| Ok((decode(frame)?.0, false)))
    }
}

/// Encodes the lower 11 bits of each channel.
#[must_use]
#[inline]
pub fn encode(channels: &ChannelCodes, settings: Settings) -> [u8; LENGTH] {
    let mut frame = [0; LENGTH];
    frame[0] = HEADER;
    frame[1..4].copy_from_slice(&settings.bytes());
    frame[4..].copy_from_slice(&packing::pack(channels));
    frame
}

/// Decodes the channels and settings of a frame, which has no checksum.
///
/// # Errors
/// [`DecodeError`] if the bytes are not a frame for DSM.
pub fn decode(bytes: &[u8]) -> Result<(ChannelCodes, Settings), DecodeError> {
    let frame: &[u8; LENGTH] = bytes.try_into().map_err(|_| DecodeError::Length {
        expected: LENGTH,
        found: bytes.len(),
    })?;
    for (offset, is_valid) in [(0, frame[0] == HEADER), (1, frame[1] & !BIND == DSM)] {
        if !is_valid {
            return Err(DecodeError::Constant {
                offset,
                found: frame[offset],
            });
        }
    }
    let settings = Settings {
        model: frame[2] & 0x0f,
        sub_protocol: frame[2] >> 4 & 0x07,
        option: frame[3],
        low_power: frame[2] & LOW_POWER != 0,
        bind: frame[1] & BIND != 0,
    };
    let mut packed = [0; PACKED];
    packed.copy_from_slice(&frame[4..]);
    Ok((packing::unpack(&packed), settings))
}
