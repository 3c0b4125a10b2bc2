//! Receiver: the vehicle's end of a link, from the bytes that arrive to the meaning of the sticks. It is the inverse of
//! [`encoder`](crate::encoder) and of [`channel_map`](crate::channel_map), for simulators of a vehicle.
//!
//! Failure policy: bytes outside of frames are skipped one by one and counted, until a frame begins again. Parts that a
//! frame does not carry (an arming switch, say) count as in a receiver without them.

use scenario::{RcLink, Transmitter};

use crate::ChannelCodes;
use crate::channel_map::{ChannelMap, Units};
use crate::format::{self, Decoded, Format};
use crate::mavlink::Overrides;

/// Bytes of an unfinished frame that are kept: more than any frame has.
const KEPT: usize = 512;

/// Command of a frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Command {
    /// Received codes of the channels, in the link's units; all zero for a frame that has none.
    pub codes: ChannelCodes,
    /// Travels of the sticks thrust, roll, pitch and yaw by the calibration: −1 to 1, beyond by half a step of the link
    /// at most.
    pub travels: [f64; 4],
    /// `true` if the motors may turn: the arming switch is on, and the frame does not say that the command is lost.
    pub is_armed: bool,
}

impl Command {
    /// Returns T of the thrust stick on a link, N; never negative.
    #[must_use]
    pub fn thrust(&self, link: &RcLink) -> f64 {
        (link.thrust_offset + link.thrust_slope * self.travels[0]).max(0.0)
    }

    /// Returns ω of the other sticks on a link, in {B}, rad/s.
    #[must_use]
    pub fn rates_body(&self, link: &RcLink) -> [f64; 3] {
        std::array::from_fn(|axis| link.rate_slope[axis] * self.travels[axis + 1])
    }
}

/// Received commands since the start.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ReceivedCommands {
    /// Frames with a command.
    pub frames: u64,
    /// Bytes that belong to no frame.
    pub skipped: u64,
}

/// Decoder of a stream of bytes to commands.
#[derive(Debug)]
pub struct Receiver {
    format: Box<dyn Format>,
    map: ChannelMap,
    units: Units,
    link: RcLink,
    overrides: Overrides,
    bytes: Vec<u8>,
    heard: ReceivedCommands,
}

impl Receiver {
    /// Makes the receiver of a checked link; `None` for the simulated one.
    #[must_use]
    pub fn new(link: &RcLink, transmitter: &Transmitter) -> Option<Self> {
        let format = format::of(link, transmitter)?;
        Some(Self {
            map: ChannelMap::new(link, transmitter),
            units: format.units(),
            format,
            link: link.clone(),
            overrides: Overrides::default(),
            bytes: Vec::with_capacity(KEPT),
            heard: ReceivedCommands::default(),
        })
    }

    /// Takes arrived bytes and hands on their commands, oldest first.
    pub fn push(&mut self, bytes: &[u8], sink: &mut dyn FnMut(&Command)) {
        self.bytes.extend_from_slice(bytes);
        let mut at = 0;
        while at < self.bytes.len() {
            let (length, command) = match self.format.decode(&self.bytes[at..]) {
                Decoded::Channels(length, codes, is_lost) => {
                    (length, Some(self.of_channels(&codes, is_lost)))
                }
                Decoded::Override(length, fields) => (length, Some(self.of_overrides(&fields))),
                Decoded::Rates(length, rates, share) => (length, Some(self.of_rates(rates, share))),
                Decoded::Other(length) => (length, None),
                Decoded::Unfinished if self.bytes.len() - at < KEPT => break,
                Decoded::Unfinished | Decoded::Noise => {
                    self.heard.skipped += 1;
                    (1, None)
                }
            };
            at += length;
            if let Some(command) = command {
                self.heard.frames += 1;
                sink(&command);
            }
        }
        self.bytes.drain(..at);
    }

    /// Returns the received commands since the start.
    #[must_use]
    pub fn heard(&self) -> ReceivedCommands {
        self.heard
    }

    fn of_channels(&self, codes: &ChannelCodes, is_lost: bool) -> Command {
        let sent = codes.map(|code| self.units.travel(code));
        Command {
            codes: *codes,
            travels: self.map.stick_travels(&sent),
            is_armed: !is_lost && self.map.is_armed(&sent),
        }
    }

    /// A channel that is not overridden is the radio's, and here there is no radio: the motors stop.
    fn of_overrides(&mut self, fields: &ChannelCodes) -> Command {
        self.overrides.take(fields);
        let pulses = self.overrides.pulses;
        let needed = self
            .map
            .stick_channels()
            .into_iter()
            .chain(self.map.arming_channel());
        let is_missing = needed.into_iter().any(|channel| pulses[channel] == 0);
        self.of_channels(&pulses, is_missing)
    }

    /// By the definition of `SET_ATTITUDE_TARGET`: the rates are those about the body's axes, and the thrust is a share
    /// of the way from the least to the largest thrust, whatever channels and sticks a transmitter has.
    fn of_rates(&self, rates: [f64; 3], share: f64) -> Command {
        let RcLink {
            thrust_offset: offset,
            thrust_slope: slope,
            rate_slope,
            ..
        } = &self.link;
        let (least, largest) = (offset - slope.abs(), offset + slope.abs());
        let asked = least + share * (largest - least);
        let thrust = (asked - offset) / slope;
        let [roll, pitch, yaw] = std::array::from_fn(|axis| rates[axis] / rate_slope[axis]);
        Command {
            codes: [0; 16],
            travels: [thrust, roll, pitch, yaw],
            is_armed: true,
        }
    }
}
