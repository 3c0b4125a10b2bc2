//! Formats: all that depends on which radio link carries the sticks.
//!
//! A format is one module that implements [`Format`], and one line in [`of`]. What a scenario needs to state it, its word,
//! speed, rate and limits, is its record in [`RadioProtocol::properties`].

use std::fmt::Debug;

use scenario::{RadioProtocol, RcLink, Transmitter};

use crate::channel_map::{ChannelMap, Units};
use crate::frame::Frame;
use crate::sticks::Sticks;
use crate::{ChannelCodes, DecodeError, crsf, mavlink, msp, multi, sbus};

/// Format of a link's frames, in both directions.
pub trait Format: Debug + Send {
    /// Returns the units of the link's channels; pulses if it has none.
    fn units(&self) -> Units;

    /// Appends a frame, without an allocation.
    fn encode(&mut self, content: &Content<'_>, frame: &mut Frame);

    /// Decodes the frame at the beginning of the bytes.
    fn decode(&self, bytes: &[u8]) -> Decoded;

    /// Returns whether the frames can say that the command is lost; if not, they stop.
    fn has_failsafe_flag(&self) -> bool {
        false
    }
}

/// Returns the format of a checked link; `None` for the simulated one.
#[must_use]
pub fn of(link: &RcLink, transmitter: &Transmitter) -> Option<Box<dyn Format>> {
    Some(match link.link {
        RadioProtocol::Simulated => return None,
        RadioProtocol::Crsf => Box::new(crsf::Crsf),
        RadioProtocol::Sbus => Box::new(sbus::Sbus),
        RadioProtocol::Multi => Box::new(multi::Settings::new(&transmitter.multi.unwrap_or_default())),
        RadioProtocol::Msp => Box::new(msp::Msp),
        RadioProtocol::Mavlink => Box::new(mavlink::Mavlink::new(
            &transmitter.mavlink.unwrap_or_default(),
            link,
        )),
    })
}

/// Content of a frame that is sent.
#[derive(Clone, Copy, Debug)]
pub struct Content<'a> {
    /// Codes of the channels.
    pub codes: ChannelCodes,
    /// `true` if the frame shall say that the command is lost, where it can.
    pub failsafe: bool,
    /// The sticks, for formats without channels.
    pub sticks: &'a Sticks,
    /// The map of the sticks.
    pub map: &'a ChannelMap,
    /// Time of the sending, ns.
    pub now_ns: u64,
}

/// Meaning of the first bytes of a stream; lengths are in bytes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Decoded {
    /// A frame with channels, and whether it says that the command is lost.
    Channels(usize, ChannelCodes, bool),
    /// A frame with fields that override channels.
    Override(usize, ChannelCodes),
    /// A frame with body rates, rad/s, and thrust as a share.
    Rates(usize, [f64; 3], f64),
    /// A frame without a command.
    Other(usize),
    /// The beginning of a frame.
    Unfinished,
    /// No frame.
    Noise,
}

/// Decodes the frame of a format whose frames are all equally long.
pub(crate) fn fixed(
    bytes: &[u8],
    length: usize,
    decode: impl Fn(&[u8]) -> Result<(ChannelCodes, bool), DecodeError>,
) -> Decoded {
    match bytes.get(..length).map(decode) {
        Some(Ok((codes, is_lost))) => Decoded::Channels(length, codes, is_lost),
        Some(Err(_)) => Decoded::Noise,
        None => Decoded::Unfinished,
    }
}
