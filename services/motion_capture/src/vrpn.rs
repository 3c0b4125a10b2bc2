//! VRPN over TCP: a cookie in both directions, then big-endian messages.
//!
//! A message is `u32 length, u32 s, u32 µs, i32 sender, i32 type, u32 0` and a payload of `length` − 24 bytes, padded to a
//! multiple of 8. Messages of type −1 and −2 first define the names of senders and types. A pose is a message of the type
//! `vrpn_Tracker Pos_Quat`: `i32 sensor, i32, f64 position[3]` in m, `f64 quaternion[4]` x y z w.
//!
//! Bytes arrive in pieces of any length. A message that cannot be decoded is skipped. A stream with an invalid length
//! cannot be resynchronised: the error ends the connection. A body with an invalid pose counts as not tracked, without a
//! stamp: the stamp must not influence the clock estimate.

pub mod sender;
mod source;

use std::ops::Range;

use crate::conventions::UpAxis;
use crate::protocol::{Decode, Plan, Protocol, SentFrame, Transport};
use crate::refusals::Tally;
use crate::server::quaternion;
use crate::transport::{Address, CaptureSource, TransportError};
use crate::wire::{CapturePose, Cursor, Frame, MAX_BODIES, Name, PoseError, Stamp, WireError};

/// VRPN protocol.
pub(crate) struct Vrpn;

impl Protocol for Vrpn {
    fn up_axis(&self) -> UpAxis {
        UpAxis::Z
    }

    fn open(&self, address: &Address) -> Result<Box<dyn CaptureSource>, TransportError> {
        Ok(Box::new(source::Source::new(address.server)))
    }

    fn decoder(&self) -> Box<dyn Decode> {
        Box::new(Decoder::new())
    }

    fn transport(&self) -> Transport {
        Transport::Connections
    }

    fn introduction(&self, _plan: &Plan, bodies: &[&str]) -> Vec<Vec<u8>> {
        let mut bytes = COOKIE.to_vec();
        for (number, name) in (0..).zip(bodies) {
            sender::sender(number, name, &mut bytes);
        }
        sender::types(&mut bytes);
        vec![bytes]
    }

    fn frame(&self, _plan: &Plan, frame: &SentFrame, bodies: &[(&str, Option<CapturePose>)]) -> Vec<u8> {
        let microseconds = frame.computed_ns / 1000;
        let time = [microseconds / 1_000_000, microseconds % 1_000_000]
            .map(|part| u32::try_from(part).unwrap_or(u32::MAX));
        let mut bytes = Vec::new();
        for (number, (_, pose)) in (0..).zip(bodies) {
            if let Some(pose) = pose {
                let report = PoseReport {
                    sensor: 0,
                    position: pose.position.into(),
                    quaternion: quaternion(&pose.capture_from_markers),
                };
                sender::report(time, number, &report, &mut bytes);
            }
        }
        bytes
    }
}

impl Decode for Decoder {
    fn decode(&mut self, bytes: &[u8], sink: &mut dyn FnMut(&Frame)) -> Result<(), WireError> {
        self.push(bytes, sink)
    }
}

/// First message of both sides: version, and no logging.
pub const COOKIE: [u8; 24] = *b"vrpn: ver. 07.38  0\0\0\0\0\0";

/// The part of the cookie on which both sides must agree.
const COOKIE_MAGIC: &[u8] = b"vrpn: ver. 07.";

/// Name of the message type of poses.
pub const POSE_TYPE: &str = "vrpn_Tracker Pos_Quat";

/// Type of the message that defines the name of a sender.
pub const SENDER_DESCRIPTION: i32 = -1;
/// Type of the message that defines the name of a type.
pub const TYPE_DESCRIPTION: i32 = -2;

/// Length of a message's header, bytes.
pub(crate) const HEADER: usize = 24;
/// Maximum length of a message, bytes: the size of VRPN's own buffer.
const MAX_MESSAGE: usize = 64 * 1024;

/// Pose as on the wire.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PoseReport {
    /// Sensor number.
    pub sensor: i32,
    /// Position, m.
    pub position: [f64; 3],
    /// Attitude x, y, z, w.
    pub quaternion: [f64; 4],
}

/// Decoder of the stream, with fixed memory.
#[derive(Clone, Debug)]
pub struct Decoder {
    buffer: Vec<u8>,
    filled: usize,
    has_cookie: bool,
    senders: Vec<Name>,
    pose_type: Option<i32>,
    frame: Frame,
    refusals: Tally<WireError>,
}

impl Default for Decoder {
    fn default() -> Self {
        Self::new()
    }
}

impl Decoder {
    /// Makes a decoder for the start of a connection.
    #[must_use]
    pub fn new() -> Self {
        Self {
            buffer: vec![0; MAX_MESSAGE],
            filled: 0,
            has_cookie: false,
            senders: vec![Name::EMPTY; MAX_BODIES],
            pose_type: None,
            frame: Frame::new(),
            refusals: Tally::default(),
        }
    }

    /// Resets the decoder for another connection.
    pub fn restart(&mut self) {
        self.filled = 0;
        self.has_cookie = false;
        self.senders.fill(Name::EMPTY);
        self.pose_type = None;
    }

    /// Returns whether the server's cookie was received.
    #[must_use]
    pub fn has_cookie(&self) -> bool {
        self.has_cookie
    }

    /// Returns the names of the senders.
    pub fn senders(&self) -> impl Iterator<Item = &Name> {
        self.senders.iter().filter(|name| **name != Name::EMPTY)
    }

    /// Returns the refused messages and streams, by reason.
    #[must_use]
    pub fn refusals(&self) -> &Tally<WireError> {
        &self.refusals
    }

    /// Decodes the next bytes, and passes a frame of one body for each pose to `sink`, in order.
    ///
    /// # Errors
    /// [`WireError`] if the stream is invalid. Frames passed before are valid; the caller must close the connection.
    pub fn push(&mut self, mut bytes: &[u8], mut sink: impl FnMut(&Frame)) -> Result<(), WireError> {
        while !bytes.is_empty() {
            let taken = bytes.len().min(self.buffer.len() - self.filled);
            let (now, later) = bytes.split_at(taken);
            self.buffer[self.filled..self.filled + taken].copy_from_slice(now);
            self.filled += taken;
            bytes = later;
            self.drain(&mut sink)
                .inspect_err(|error| self.refusals.add(*error))?;
        }
        Ok(())
    }

    /// Decodes complete messages, and moves the remainder to the front of the buffer: it is shorter than one message.
    fn drain(&mut self, sink: &mut impl FnMut(&Frame)) -> Result<(), WireError> {
        let mut from = 0;
        if !self.has_cookie {
            let Some(cookie) = self.buffer[..self.filled].first_chunk::<{ COOKIE.len() }>() else {
                return Ok(());
            };
            if !cookie.starts_with(COOKIE_MAGIC) {
                return Err(WireError::Invalid("the cookie"));
            }
            self.has_cookie = true;
            from = COOKIE.len();
        }
        while let Some(length) = message_length(&self.buffer[from..self.filled])? {
            if length > self.filled - from {
                break;
            }
            self.frame.clear();
            match self.read(from..from + length) {
                Ok(true) => sink(&self.frame),
                Ok(false) => {}
                // The length was valid, so the next message can be decoded.
                Err(error) => self.refusals.add(error),
            }
            from += length;
        }
        self.buffer.copy_within(from..self.filled, 0);
        self.filled -= from;
        Ok(())
    }

    /// Decodes a complete message. Returns whether it was a pose, which the frame then contains.
    fn read(&mut self, message: Range<usize>) -> Result<bool, WireError> {
        let Self {
            buffer,
            senders,
            pose_type,
            frame,
            refusals,
            ..
        } = self;
        let mut cursor = Cursor::new(&buffer[message]);
        let length = cursor.u32_be("a message's length")?;
        let seconds = cursor.u32_be("a message's time")?;
        let microseconds = cursor.u32_be("a message's time")?;
        let sender = cursor.i32_be("a message's sender")?;
        let kind = cursor.i32_be("a message's type")?;
        cursor.skip(1, 4, "a message's head")?;
        // The payload without its padding; `message_length` refused a length below that of the header.
        let payload = cursor.slice((length as usize).saturating_sub(HEADER), "a message")?;
        let mut payload = Cursor::new(payload);
        let sender_index = usize::try_from(sender)
            .ok()
            .filter(|&index| index < senders.len());
        match kind {
            SENDER_DESCRIPTION => {
                let name = described_name(&mut payload)?;
                match (sender_index, Name::new(name)) {
                    (Some(index), Ok(name)) => senders[index] = name,
                    // A sender without a name is never the vehicle.
                    (Some(index), Err(error)) => {
                        senders[index] = Name::EMPTY;
                        refusals.add(error);
                    }
                    (None, _) => refusals.add(WireError::Oversized("the number of trackers")),
                }
            }
            TYPE_DESCRIPTION => {
                let name = described_name(&mut payload)?;
                if name.split(|&byte| byte == 0).next() == Some(POSE_TYPE.as_bytes()) {
                    *pose_type = Some(sender);
                }
            }
            kind if Some(kind) == *pose_type => {
                let Some(index) = sender_index else {
                    return Ok(false);
                };
                let report = report(&mut payload)?;
                let pose = pose(&report, microseconds, index, senders);
                if let Ok(Some(_)) = pose {
                    let at_ns = i64::from(seconds) * 1_000_000_000 + i64::from(microseconds) * 1000;
                    frame.stamp = Some(Stamp {
                        exposed_ns: at_ns,
                        sent_ns: at_ns,
                    });
                }
                frame.is_complete = false;
                frame.push_pose(senders[index], report.sensor, pose)?;
                return Ok(true);
            }
            _ => {}
        }
        Ok(false)
    }
}

/// Returns the length of the message at the start of the bytes, with its padding; `None` if it is not known yet.
fn message_length(bytes: &[u8]) -> Result<Option<usize>, WireError> {
    let Some(length) = bytes.first_chunk().map(|length| u32::from_be_bytes(*length)) else {
        return Ok(None);
    };
    let length = usize::try_from(length).map_err(|_| WireError::Oversized("a message"))?;
    if length < HEADER {
        return Err(WireError::Invalid("the length of a message"));
    }
    if length > MAX_MESSAGE {
        return Err(WireError::Oversized("a message"));
    }
    Ok(Some(length.next_multiple_of(8)))
}

/// Returns the pose of a report; `None` for all zeros, which some servers send for a body that is not tracked.
fn pose(
    report: &PoseReport,
    microseconds: u32,
    index: usize,
    senders: &[Name],
) -> Result<Option<CapturePose>, PoseError> {
    let numbers = report.position.iter().chain(&report.quaternion);
    if numbers.into_iter().all(|&number| number == 0.0) {
        return Ok(None);
    }
    let has_twin = |(other, name): (usize, &Name)| other != index && *name == senders[index];
    if senders[index] != Name::EMPTY && senders.iter().enumerate().any(has_twin) {
        return Err(PoseError::SharedName);
    }
    if microseconds >= 1_000_000 {
        return Err(PoseError::Stamp);
    }
    CapturePose::from_quaternion(report.position, report.quaternion).map(Some)
}

/// Returns the bytes of a name, which ends at the first zero.
fn described_name<'a>(payload: &mut Cursor<'a>) -> Result<&'a [u8], WireError> {
    let length = payload.u32_be("the length of a name")?;
    let length = usize::try_from(length).map_err(|_| WireError::Oversized("a name"))?;
    payload.slice(length, "a name")
}

fn report(payload: &mut Cursor<'_>) -> Result<PoseReport, WireError> {
    let sensor = payload.i32_be("a sensor")?;
    payload.skip(1, 4, "a sensor")?;
    let mut numbers = [0.0; 7];
    for number in &mut numbers {
        *number = payload.f64_be("a pose")?;
    }
    let [x, y, z, quaternion @ ..] = numbers;
    Ok(PoseReport {
        sensor,
        position: [x, y, z],
        quaternion,
    })
}
