//! `NatNet` 3 and 4 (`OptiTrack` Motive): UDP, little-endian, packed.
//!
//! A client sends requests to the command port: the response to CONNECT is SERVERINFO, with the version of all other
//! messages; the response to REQUEST_MODELDEF is MODELDEF, with the names of rigid bodies. FRAMEs are sent by multicast, or
//! to clients that have sent a request. From 4.1 on each section of a frame and each description starts with its length,
//! so that all but the rigid bodies is skipped. Versions before 3 state neither their clock nor the exposure. They and
//! those from 5 on are refused with an error that names the version.

mod frame;
mod model;
pub mod sender;
mod source;

use crate::conventions::UpAxis;
use crate::protocol::{Decode, Plan, Protocol, SentFrame, Transport};
use crate::server::quaternion;
use crate::transport::{Address, CaptureSource, TransportError};
use crate::wire::{CapturePose, Cursor, Frame, Name, WireError};

/// `NatNet` protocol.
pub(crate) struct Natnet;

/// Clock frequency of a simulated server, Hz.
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
        let responses = requests
            .iter()
            .filter_map(|request| self.respond(plan, request, bodies));
        responses.collect()
    }

    fn respond(&self, plan: &Plan, request: &[u8], bodies: &[&str]) -> Option<Vec<u8>> {
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

/// Decoder of datagrams and the frame that it fills.
struct Datagrams {
    decoder: Decoder,
    frame: Frame,
}

impl Decode for Datagrams {
    fn decode(&mut self, bytes: &[u8], sink: &mut dyn FnMut(&Frame)) -> Result<(), WireError> {
        if let Received::Frame { .. } = self.decoder.decode(bytes, &mut self.frame)? {
            sink(&self.frame);
        }
        Ok(())
    }
}

/// Default port of frames.
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
    /// Keep-alive of a unicast client.
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
    /// Returns whether sections start with their length.
    #[must_use]
    pub fn has_lengths(self) -> bool {
        self >= Self { major: 4, minor: 1 }
    }

    /// The newest version that was tested against third-party software.
    pub const NEWEST_TESTED: Self = Self { major: 4, minor: 2 };

    fn check(self) -> Result<Self, WireError> {
        if matches!(self.major, 3 | 4) {
            Ok(self)
        } else {
            Err(WireError::Version(self.major, self.minor))
        }
    }

    /// Returns a version with the other layout of frames.
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
    /// Version of the bit stream.
    pub version: Version,
    /// Frequency of the clock of the stamps, Hz.
    pub clock_frequency: u64,
    /// Port of frames.
    pub data_port: u16,
    /// Multicast group; `None` for unicast.
    pub multicast: Option<[u8; 4]>,
}

/// Rigid body of a frame as on the wire.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RigidBody {
    /// Streaming id.
    pub id: i32,
    /// Position, m.
    pub position: [f32; 3],
    /// Attitude x, y, z, w.
    pub quaternion: [f32; 4],
    /// Mean error of the markers, m.
    pub error: f32,
    /// `true` if the body is tracked.
    pub tracked: bool,
}

impl RigidBody {
    /// Makes the body of a pose; all zeros if it is not tracked.
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

/// Times of a frame on the server's clock.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Times {
    /// Time since the start of the software, s.
    pub timestamp: f64,
    /// Middle of the exposure, ticks of the clock; 0 if not known.
    pub exposed: u64,
    /// Arrival of the cameras' data, ticks.
    pub received: u64,
    /// Transmission of the frame, ticks.
    pub sent: u64,
}

/// Name and id of a rigid body.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Description {
    /// Streaming id.
    pub id: i32,
    /// Name, truncated to [`MAX_NAME_LENGTH`](crate::wire::MAX_NAME_LENGTH) bytes.
    pub name: Name,
    /// `true` if another body has the same name or id.
    pub is_shared: bool,
    /// `true` if the name was truncated.
    pub is_truncated: bool,
}

impl Description {
    /// Returns the reason why the name is ambiguous, if it is.
    fn ambiguity(&self) -> Option<&'static str> {
        if self.is_truncated {
            Some("its name is too long")
        } else {
            self.is_shared.then_some("another body has the same name or id")
        }
    }

    /// Returns the name of the body in a frame; empty if the name is ambiguous.
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
    /// The names of the bodies, which the decoder has stored.
    Names {
        /// Error of an unreadable description, if there is one.
        unreadable: Option<WireError>,
    },
    /// A frame, stored in the caller's frame.
    Frame {
        /// `true` if the names should be requested again: the server reports that the bodies have changed, or a body has
        /// no name.
        needs_names: bool,
    },
    /// A message that is ignored.
    Other,
}

/// Decoder with the server's version and clock and the names of bodies, which frames refer to.
#[derive(Clone, Debug)]
pub struct Decoder {
    server: Option<ServerInfo>,
    bodies: Vec<Description>,
    /// Buffer of a message before it replaces `bodies`.
    reading: Vec<Description>,
}

impl Default for Decoder {
    fn default() -> Self {
        Self::new()
    }
}

impl Decoder {
    /// Makes a decoder before the server's first message.
    #[must_use]
    pub fn new() -> Self {
        Self {
            server: None,
            bodies: Vec::with_capacity(crate::wire::MAX_BODIES),
            reading: Vec::with_capacity(crate::wire::MAX_BODIES),
        }
    }

    /// Returns the description of the server.
    #[must_use]
    pub fn server(&self) -> Option<&ServerInfo> {
        self.server.as_ref()
    }

    /// Returns the described rigid bodies.
    #[must_use]
    pub fn bodies(&self) -> &[Description] {
        &self.bodies
    }

    /// Decodes a datagram.
    ///
    /// # Errors
    /// [`WireError`]; the datagram is then dropped, the frame is empty, and stored names are kept.
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
        let mut needs_names = false;
        let mut read = |server: &ServerInfo, frame: &mut Frame| {
            frame.fill(|frame| {
                let mut payload = payload;
                needs_names = frame::read(&mut payload, server, &self.bodies, frame)?;
                Ok(())
            })
        };
        if let Err(error) = read(&server, frame) {
            let version = server.version.other_layout();
            let is_other = read(&ServerInfo { version, ..server }, frame).is_ok();
            frame.clear();
            return Err(if is_other {
                WireError::OtherVersion {
                    stated: [server.version.major, server.version.minor],
                    sent: [version.major, version.minor],
                }
            } else {
                error
            });
        }
        Ok(Received::Frame { needs_names })
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
