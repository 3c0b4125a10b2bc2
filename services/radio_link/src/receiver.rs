//! Receiver: the vehicle's end of a link, from received bytes to stick travels. It is the inverse of
//! [`encoder`](crate::encoder) and of [`channel_map`](crate::channel_map), for vehicle simulators.
//!
//! Failure policy: bytes outside of frames are skipped and counted until the next frame.

use scenario::{RcLink, Transmitter};

use crate::ChannelCodes;
use crate::channel_map::{ChannelMap, Units};
use crate::format::{self, Decoded, Format};
use crate::mavlink::Overrides;

/// Buffer for an incomplete frame, bytes: more than the longest frame.
const BUFFER: usize = 512;

/// Command of a frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Command {
    /// Received channel codes in the link's units; all zero for a frame without channels.
    pub codes: ChannelCodes,
    /// Travels of the sticks thrust, roll, pitch and yaw as in the calibration: −1 to 1, exceeded by at most half a step of
    /// the link.
    pub travels: [f64; 4],
    /// `true` if the motors may turn: the arming switch is on and the failsafe flag is not set.
    pub is_armed: bool,
}

impl Command {
    /// Returns the way of the thrust stick on a link: 0 at the least thrust, 1 at the largest.
    #[must_use]
    pub fn thrust_share(&self, link: &RcLink) -> f64 {
        (1.0 + self.travels[0] * link.thrust_slope.signum()) / 2.0
    }

    /// Returns the thrust T on a link, N; never negative.
    #[must_use]
    pub fn thrust(&self, link: &RcLink) -> f64 {
        (link.thrust_offset + link.thrust_slope * self.travels[0]).max(0.0)
    }

    /// Returns the body rates ω on a link, in {B}, rad/s.
    #[must_use]
    pub fn rates_body(&self, link: &RcLink) -> [f64; 3] {
        std::array::from_fn(|axis| link.rate_slope[axis] * self.travels[axis + 1])
    }
}

/// Counters of a receiver since its start.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ReceivedCommands {
    /// Frames with a command.
    pub frames: u64,
    /// Bytes outside of frames.
    pub skipped: u64,
}

/// Decoder from a byte stream to commands.
#[derive(Debug)]
pub struct Receiver {
    format: Box<dyn Format>,
    map: ChannelMap,
    units: Units,
    link: RcLink,
    overrides: Overrides,
    bytes: Vec<u8>,
    received: ReceivedCommands,
}

impl Receiver {
    /// Makes the receiver of a checked link; `None` for the simulated link.
    #[must_use]
    pub fn new(link: &RcLink, transmitter: &Transmitter) -> Option<Self> {
        let format = format::for_link(link, transmitter)?;
        Some(Self {
            map: ChannelMap::new(link, transmitter),
            units: format.units(),
            format,
            link: link.clone(),
            overrides: Overrides::default(),
            bytes: Vec::with_capacity(BUFFER),
            received: ReceivedCommands::default(),
        })
    }

    /// Decodes received bytes and passes their commands to `sink`, oldest first. Of a format of packets these are the bytes
    /// of one packet.
    pub fn push(&mut self, bytes: &[u8], sink: &mut dyn FnMut(&Command)) {
        if self.format.has_packets() {
            self.push_packet(bytes, sink);
            return;
        }
        self.bytes.extend_from_slice(bytes);
        let mut at = 0;
        while at < self.bytes.len() {
            at += match self.format.decode(&self.bytes[at..]) {
                Decoded::Incomplete if self.bytes.len() - at < BUFFER => break,
                Decoded::Incomplete | Decoded::Noise => {
                    self.received.skipped += 1;
                    1
                }
                decoded => self.take(&decoded, sink),
            };
        }
        self.bytes.drain(..at);
    }

    fn push_packet(&mut self, bytes: &[u8], sink: &mut dyn FnMut(&Command)) {
        match self.format.decode(bytes) {
            Decoded::Incomplete | Decoded::Noise => self.received.skipped += bytes.len() as u64,
            decoded => {
                self.take(&decoded, sink);
            }
        }
    }

    /// Passes the command of a frame, if it has one, to `sink`. Returns the length of the frame.
    fn take(&mut self, decoded: &Decoded, sink: &mut dyn FnMut(&Command)) -> usize {
        let (length, command) = match decoded {
            Decoded::Channels(length, codes, failsafe) => {
                (*length, Some(self.channel_command(codes, *failsafe)))
            }
            Decoded::Override(length, fields) => (*length, Some(self.override_command(fields))),
            Decoded::Rates(length, rates, share) => (*length, Some(self.rate_command(*rates, *share))),
            Decoded::Stop(length) => (*length, Some(self.stop_command())),
            Decoded::Other(length) => (*length, None),
            Decoded::Incomplete | Decoded::Noise => (0, None),
        };
        if let Some(command) = command {
            self.received.frames += 1;
            sink(&command);
        }
        length
    }

    /// Returns the counters since the start.
    #[must_use]
    pub fn received(&self) -> ReceivedCommands {
        self.received
    }

    fn channel_command(&self, codes: &ChannelCodes, failsafe: bool) -> Command {
        let sent = codes.map(|code| self.units.travel(code));
        Command {
            codes: *codes,
            travels: self.map.stick_travels(&sent),
            is_armed: !failsafe && self.map.is_armed(&sent),
        }
    }

    /// Stops the motors if a needed channel is not overridden: it would come from the radio, which is not simulated.
    fn override_command(&mut self, fields: &ChannelCodes) -> Command {
        self.overrides.apply(fields);
        let pulses = self.overrides.pulses;
        let needed = self
            .map
            .stick_channels()
            .into_iter()
            .chain(self.map.arming_channel());
        let is_missing = needed.into_iter().any(|channel| pulses[channel] == 0);
        self.channel_command(&pulses, is_missing)
    }

    /// Returns the command of a frame that stops the motors.
    fn stop_command(&self) -> Command {
        Command {
            codes: [0; 16],
            travels: [self.map.least_thrust().value(), 0.0, 0.0, 0.0],
            is_armed: false,
        }
    }

    /// Interprets a message by its definition: rates about the body's axes, and thrust from 0 (least) to 1 (largest),
    /// independent of the transmitter's channels and sticks.
    fn rate_command(&self, rates: [f64; 3], share: f64) -> Command {
        let RcLink {
            thrust_offset: offset,
            thrust_slope: slope,
            rate_slope,
            ..
        } = &self.link;
        let (least, largest) = (offset - slope.abs(), offset + slope.abs());
        let thrust_newtons = least + share * (largest - least);
        let thrust = (thrust_newtons - offset) / slope;
        let [roll, pitch, yaw] = std::array::from_fn(|axis| rates[axis] / rate_slope[axis]);
        Command {
            codes: [0; 16],
            travels: [thrust, roll, pitch, yaw],
            is_armed: true,
        }
    }
}
