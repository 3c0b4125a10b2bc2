//! `NatNet` 3 and 4 (`OptiTrack` Motive): UDP, little-endian, packed.
//!
//! A client asks on the command port: CONNECT is answered by SERVERINFO, which states the version of everything else;
//! REQUEST_MODELDEF by MODELDEF, which gives rigid bodies their names. FRAMEs come by multicast, or to clients that
//! have asked. From 4.1 on a number of bytes precedes each section of a frame and each description, so that all but the
//! rigid bodies is skipped. The versions before 3 state neither their clock nor the exposure; they and those from 5 on
//! are refused by name.

mod frame;
mod model;
pub mod sender;
mod source;

use crate::conventions::UpAxis;
use crate::protocol::{Decode, Plan, Protocol, SentFrame, Transport};
use crate::server::quaternion;
use crate::transport::{Address, CaptureSource, TransportError};
use crate::wire::{CapturePose, Cursor, Frame, Name, WireError};

/// The protocol.
pub(crate) struct Natnet;

/// Ticks a second of the clock that a simulated server stamps with.
const CLOCK_FREQUENCY: u64 = 10_000_000;

impl Protocol for Natnet {
    fn up_axis(&self) -> UpAxis {
        UpAxis::Y
    }

    fn open(&self, address: &Address) -> Result<Box<dyn CaptureSource>, TransportError> {
        Ok(Box::new(source::Source::open(address)?))
    }

    fn decoder(&self) -> Box<dyn Decode> {
        Box::new(Datagrams {
            decoder: Decoder::new(),
            frame: Frame::new(),
        })
    }

    fn transport(&self) -> Transport {
        Transport::Requests
    }

    fn frame_port(&self, _port: u16) -> u16 {
        DATA_PORT
    }

    fn introduction(&self, plan: &Plan, bodies: &[&str]) -> Vec<Vec<u8>> {
        let requests = [message::CONNECT, message::REQUEST_MODELDEF].map(u16::to_le_bytes);
        let answers = requests
            .iter()
            .filter_map(|request| self.answer(plan, request, bodies));
        answers.collect()
    }

    fn answer(&self, plan: &Plan, request: &[u8], bodies: &[&str]) -> Option<Vec<u8>> {
        match u16::from_le_bytes(*request.first_chunk()?) {
            message::CONNECT => Some(sender::server_info(&ServerInfo {
                version: plan.version,
                clock_frequency: CLOCK_FREQUENCY,
                data_port: plan.to.port(),
                multicast: plan.to.ip().is_multicast().then(|| plan.to.ip().octets()),
            })),
            message::REQUEST_MODELDEF => {
                let named: Vec<(i32, &str)> = (1..).zip(bodies.iter().copied()).collect();
                Some(sender::names(plan.version, &named))
            }
            _ => None,
        }
    }

    fn frame(&self, plan: &Plan, frame: &SentFrame, bodies: &[(&str, Option<CapturePose>)]) -> Vec<u8> {
        let numbered = (1..).zip(bodies);
        let bodies = numbered.map(|(id, (_, pose))| RigidBody::new(id, pose.as_ref()));
        let ticks = |ns: u64| ns / (1_000_000_000 / CLOCK_FREQUENCY);
        #[expect(
            clippy::cast_precision_loss,
            reason = "s in double precision, as Motive sends it"
        )]
        let times = Times {
            timestamp: frame.exposed_ns as f64 * 1e-9,
            exposed: ticks(frame.exposed_ns),
            received: ticks(frame.sent_ns),
            sent: ticks(frame.sent_ns),
        };
        sender::frame(plan.version, frame.number, &bodies.collect::<Vec<_>>(), &times)
    }
}

/// Decoder of datagrams, with the frame that they fill.
struct Datagrams {
    decoder: Decoder,
    frame: Frame,
}

impl Decode for Datagrams {
    fn take(&mut self, bytes: &[u8], sink: &mut dyn FnMut(&Frame)) -> Result<(), WireError> {
        if let Received::Frame { .. } = self.decoder.decode(bytes, &mut self.frame)? {
            sink(&self.frame);
        }
        Ok(())
    }
}

/// Port of frames unless the server tells otherwise.
pub const DATA_PORT: u16 = 1511;

/// Kinds of messages.
pub mod message {
    /// Request of a client for the server's description.
    pub const CONNECT: u16 = 0;
    /// Description of the server.
    pub const SERVERINFO: u16 = 1;
    /// Request of a client for the names of the bodies.
    pub const REQUEST_MODELDEF: u16 = 4;
    /// The names of the bodies.
    pub const MODELDEF: u16 = 5;
    /// A frame.
    pub const FRAME: u16 = 7;
    /// Sign of life of a unicast client.
    pub const KEEP_ALIVE: u16 = 10;
}

/// Length of the name in SERVERINFO, bytes.
pub(crate) const SERVER_NAME_LENGTH: usize = 256;

/// A version of the bit stream.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Version {
    /// 3 or 4.
    pub major: u8,
    /// Such as the 1 of 4.1.
    pub minor: u8,
}

impl Version {
    /// Returns whether lengths precede sections.
    #[must_use]
    pub fn has_lengths(self) -> bool {
        self >= Self { major: 4, minor: 1 }
    }

    /// The newest version that was tried against programs of others.
    pub const NEWEST_TRIED: Self = Self { major: 4, minor: 2 };

    fn check(self) -> Result<Self, WireError> {
        if matches!(self.major, 3 | 4) {
            Ok(self)
        } else {
            Err(WireError::Version(self.major, self.minor))
        }
    }

    /// Returns a version whose frames are laid out in the other way.
    fn other_layout(self) -> Self {
        match self.has_lengths() {
            true => Self { major: 3, minor: 1 },
            false => Self { major: 4, minor: 1 },
        }
    }
}

impl std::fmt::Display for Version {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(formatter, "{}.{}", self.major, self.minor)
    }
}

/// Description of a server.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ServerInfo {
    /// Version of its bit stream.
    pub version: Version,
    /// Ticks a second of the clock of the stamps.
    pub clock_frequency: u64,
    /// Port of frames.
    pub data_port: u16,
    /// The group to which it sends; `None` if it sends to each client.
    pub multicast: Option<[u8; 4]>,
}

/// A rigid body of a frame as it travels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RigidBody {
    /// Its streaming id.
    pub id: i32,
    /// Position, m.
    pub position: [f32; 3],
    /// Attitude x, y, z, w.
    pub quaternion: [f32; 4],
    /// Mean error of its markers, m.
    pub error: f32,
    /// `true` if it is seen.
    pub tracked: bool,
}

impl RigidBody {
    /// Makes the body of a pose; all zeros if it is not seen.
    #[expect(clippy::cast_possible_truncation, reason = "the wire has single precision")]
    fn new(id: i32, pose: Option<&CapturePose>) -> Self {
        let position: [f64; 3] = pose.map_or([0.0; 3], |pose| pose.position.into());
        let quaternion = pose.map_or([0.0; 4], |pose| quaternion(&pose.capture_from_markers));
        Self {
            id,
            position: position.map(|coordinate| coordinate as f32),
            quaternion: quaternion.map(|coordinate| coordinate as f32),
            error: 2e-4,
            tracked: pose.is_some(),
        }
    }
}

/// The end of a frame: its times on the server's clock.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Times {
    /// s since the software began.
    pub timestamp: f64,
    /// Middle of the exposure, ticks of the clock; 0 if not known.
    pub exposed: u64,
    /// Time at which the cameras' data had arrived, ticks.
    pub received: u64,
    /// Time at which the frame was sent, ticks.
    pub sent: u64,
}

/// A rigid body by its description.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Described {
    /// Its streaming id.
    pub id: i32,
    /// Its name, of which the first [`LONGEST_NAME`](crate::wire::LONGEST_NAME) bytes are kept.
    pub name: Name,
    /// `true` if another body has its name or its id.
    pub is_shared: bool,
    /// `true` if its name is longer than what is kept.
    pub is_cut: bool,
}

impl Described {
    /// Returns why its name stands for no single body, if it does not.
    fn ambiguity(&self) -> Option<&'static str> {
        if self.is_cut {
            Some("its name is too long")
        } else {
            self.is_shared.then_some("another body has its name or its id")
        }
    }

    /// Returns the name of the body in a frame; empty if the name stands for no single body.
    #[must_use]
    pub fn unique_name(&self) -> Name {
        self.ambiguity().map_or(self.name, |_| Name::EMPTY)
    }
}

/// Content of a datagram.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Received {
    /// The description of the server.
    ServerInfo(ServerInfo),
    /// The names of the bodies, which the decoder knows now.
    Names {
        /// Error of a description that gave no name, if there is one.
        unreadable: Option<WireError>,
    },
    /// A frame, which the caller's frame holds now.
    Frame {
        /// `true` if the names should be requested again: the server says that the bodies have changed, or there is one
        /// without a name.
        names_are_old: bool,
    },
    /// A message without use here.
    Other,
}

/// Decoder with the data that a frame needs: the server's version and clock, and the names.
#[derive(Clone, Debug)]
pub struct Decoder {
    server: Option<ServerInfo>,
    bodies: Vec<Described>,
    /// Memory into which a message is read before it replaces the known bodies.
    reading: Vec<Described>,
}

impl Default for Decoder {
    fn default() -> Self {
        Self::new()
    }
}

impl Decoder {
    /// Makes a decoder without any data.
    #[must_use]
    pub fn new() -> Self {
        Self {
            server: None,
            bodies: Vec::with_capacity(crate::wire::MOST_BODIES),
            reading: Vec::with_capacity(crate::wire::MOST_BODIES),
        }
    }

    /// Returns the description of the server.
    #[must_use]
    pub fn server(&self) -> Option<&ServerInfo> {
        self.server.as_ref()
    }

    /// Returns the rigid bodies that have been described.
    #[must_use]
    pub fn bodies(&self) -> &[Described] {
        &self.bodies
    }

    /// Reads a datagram.
    ///
    /// # Errors
    /// [`WireError`]; nothing of the datagram is used then, the frame is empty, and known names stay.
    pub fn decode(&mut self, datagram: &[u8], frame: &mut Frame) -> Result<Received, WireError> {
        frame.clear();
        let mut cursor = Cursor::new(datagram);
        let kind = cursor.u16_le("the head")?;
        let length = usize::from(cursor.u16_le("the head")?);
        if !matches!(kind, message::SERVERINFO | message::MODELDEF | message::FRAME) {
            return Ok(Received::Other);
        }
        let mut payload = Cursor::new(cursor.slice(length, "the payload")?);
        if kind == message::SERVERINFO {
            let server = server_info(&mut payload)?;
            self.server = Some(server);
            return Ok(Received::ServerInfo(server));
        }
        let server = self.server.ok_or(WireError::Early("the server's version"))?;
        if kind == message::MODELDEF {
            let unreadable = model::read(&mut payload, server.version, &mut self.reading)?;
            std::mem::swap(&mut self.bodies, &mut self.reading);
            return Ok(Received::Names { unreadable });
        }
        let mut names_are_old = false;
        let mut read = |server: &ServerInfo, frame: &mut Frame| {
            frame.fill(|frame| {
                let mut payload = payload;
                names_are_old = frame::read(&mut payload, server, &self.bodies, frame)?;
                Ok(())
            })
        };
        if let Err(error) = read(&server, frame) {
            let version = server.version.other_layout();
            let is_other = read(&ServerInfo { version, ..server }, frame).is_ok();
            frame.clear();
            return Err(if is_other {
                WireError::OtherVersion {
                    said: [server.version.major, server.version.minor],
                    sent: [version.major, version.minor],
                }
            } else {
                error
            });
        }
        Ok(Received::Frame { names_are_old })
    }
}

fn server_info(payload: &mut Cursor<'_>) -> Result<ServerInfo, WireError> {
    payload.skip(1, SERVER_NAME_LENGTH, "the server's name")?;
    payload.skip(1, 4, "the server's version")?;
    let [major, minor, ..] = payload.array::<4>("the version of the bit stream")?;
    let clock_frequency = payload.u64_le("the clock's frequency")?;
    if !(1_000..=100_000_000_000).contains(&clock_frequency) {
        return Err(WireError::Invalid("the clock's frequency"));
    }
    let data_port = payload.u16_le("the data port")?;
    let is_multicast = payload.u8("whether it is multicast")? != 0;
    let group = payload.array::<4>("the multicast group")?;
    if is_multicast && !(224..=239).contains(&group[0]) {
        return Err(WireError::Invalid("the multicast group"));
    }
    Ok(ServerInfo {
        version: Version { major, minor }.check()?,
        clock_frequency,
        data_port,
        multicast: is_multicast.then_some(group),
    })
}
