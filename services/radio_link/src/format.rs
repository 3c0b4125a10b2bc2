//! Frame formats: everything that is specific to one radio protocol.
//!
//! A format is a module that implements [`Format`], and a line in [`for_link`]. Its name in scenarios, baud rate, frame
//! rate and limits are in [`RadioProtocol::properties`].

use std::fmt::Debug;

use scenario::{RadioProtocol, RcLink, Transmitter};

use crate::channel_map::{ChannelMap, Units};
use crate::frame::Frame;
use crate::sticks::Sticks;
use crate::telemetry::Reply;
use crate::{ChannelCodes, DecodeError, crazyflie, crsf, mavlink, msp, multi, sbus};

/// Encoder and decoder of a link's frames.
pub trait Format: Debug + Send {
    /// Returns the units of the link's channels; pulses if it has none.
    fn units(&self) -> Units;

    /// Appends a frame. Does not allocate.
    fn encode(&mut self, content: &Content<'_>, frame: &mut Frame);

    /// Decodes the frame at the start of the bytes.
    fn decode(&self, bytes: &[u8]) -> Decoded;

    /// Appends a request that is due beside the frame of these sticks, if any. Does not allocate.
    fn request(&mut self, _map: &ChannelMap, _sticks: &Sticks, _frame: &mut Frame) {}

    /// Reads the start of what the vehicle sends back, for the battery's voltage. Does not allocate.
    fn read_reply(&mut self, bytes: &[u8]) -> Reply {
        Reply::Other(bytes.len())
    }

    /// Appends a request for the battery's voltage, if one is due. Does not allocate.
    fn request_voltage(&mut self, _now_ns: u64, _are_motors_off: bool, _frame: &mut Frame) {}

    /// Returns whether frames have a failsafe flag. Without one, stopping the frames signals failsafe.
    fn has_failsafe_flag(&self) -> bool {
        false
    }

    /// Returns whether a frame is a packet whose end the transport states. A decoder gets it alone and whole.
    fn has_packets(&self) -> bool {
        false
    }
}

/// Returns the format of a checked link; `None` for the simulated link.
#[must_use]
pub fn for_link(link: &RcLink, transmitter: &Transmitter) -> Option<Box<dyn Format>> {
    Some(match link.link {
        RadioProtocol::Simulated => return None,
        RadioProtocol::Crsf => Box::new(crsf::Crsf),
        RadioProtocol::Sbus => Box::new(sbus::Sbus),
        RadioProtocol::Multi => Box::new(multi::Settings::new(&transmitter.multi.unwrap_or_default())),
        RadioProtocol::Msp => Box::new(msp::Msp::default()),
        RadioProtocol::Mavlink => Box::new(mavlink::Mavlink::new(
            &transmitter.mavlink.unwrap_or_default(),
            link,
        )),
        RadioProtocol::Crazyflie => Box::new(crazyflie::Crazyflie::new(link)),
    })
}

/// Content of a frame to encode.
#[derive(Clone, Copy, Debug)]
pub struct Content<'a> {
    /// Codes of the channels.
    pub codes: ChannelCodes,
    /// `true` to set the failsafe flag, if the format has one.
    pub failsafe: bool,
    /// Sticks, for formats without channels.
    pub sticks: &'a Sticks,
    /// Channel map.
    pub map: &'a ChannelMap,
    /// Transmission time, ns.
    pub now_ns: u64,
}

/// Result of decoding the start of a byte stream; lengths are in bytes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Decoded {
    /// A frame with channels, and its failsafe flag.
    Channels(usize, ChannelCodes, bool),
    /// A frame with fields that override channels.
    Override(usize, ChannelCodes),
    /// A frame with body rates, rad/s, and a normalised thrust.
    Rates(usize, [f64; 3], f64),
    /// A frame that stops the motors.
    Stop(usize),
    /// A frame without a command.
    Other(usize),
    /// An incomplete frame.
    Incomplete,
    /// No frame.
    Noise,
}

/// Decodes a frame of a format with a fixed frame length.
pub(crate) fn decode_fixed(
    bytes: &[u8],
    length: usize,
    decode: impl Fn(&[u8]) -> Result<(ChannelCodes, bool), DecodeError>,
) -> Decoded {
    match bytes.get(..length).map(decode) {
        Some(Ok((codes, failsafe))) => Decoded::Channels(length, codes, failsafe),
        Some(Err(_)) => Decoded::Noise,
        None => Decoded::Incomplete,
    }
}
