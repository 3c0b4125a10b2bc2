//! VRPN over TCP: a cookie both ways, then big-endian messages.
//!
//! A message is `u32 length, u32 s, u32 µs, i32 sender, i32 type, u32 0` and a payload, whose length is `length` − 24 and
//! which is filled up to a multiple of 8. Senders (type −1) and types (−2) are given their names first. A pose is a
//! message of the type `vrpn_Tracker Pos_Quat`: `i32 sensor, i32, f64 position[3]` in m, `f64 quaternion[4]` x y z w.
//!
//! Bytes arrive in pieces of any length. A stream that has become invalid cannot be resumed: the error ends the
//! connection.

use crate::wire::{CapturePose, Cursor, Frame, MOST_BODIES, Name, Stamp, WireBody, WireError};

/// Port on which a server listens by default.
pub const PORT: u16 = 3883;

/// Greeting of both sides: version, and no logging.
pub const COOKIE: [u8; 24] = *b"vrpn: ver. 07.38  0\0\0\0\0\0";

/// The part of the cookie on which both sides must agree.
const COOKIE_MAGIC: &[u8] = b"vrpn: ver. 07.";

/// Name of the messages that hold poses.
pub const POSE_TYPE: &str = "vrpn_Tracker Pos_Quat";

/// Type of the message that names a sender.
pub const SENDER_DESCRIPTION: i32 = -1;
/// Type of the message that names a type.
pub const TYPE_DESCRIPTION: i32 = -2;

/// Length of a message's head, bytes.
pub(crate) const HEAD: usize = 24;
/// Longest message, bytes: VRPN's own buffer.
const LONGEST_MESSAGE: usize = 64 * 1024;

/// A pose as it travels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PoseReport {
    /// Number of the sensor.
    pub sensor: i32,
    /// Position, m.
    pub position: [f64; 3],
    /// Attitude x, y, z, w.
    pub quaternion: [f64; 4],
}

/// Decoder of the stream. Its memory does not grow.
#[derive(Clone, Debug)]
pub struct Decoder {
    buffer: Vec<u8>,
    filled: usize,
    has_cookie: bool,
    senders: Vec<Name>,
    pose_type: Option<i32>,
    frame: Frame,
    refused: u64,
}

impl Default for Decoder {
    fn default() -> Self {
        Self::new()
    }
}

impl Decoder {
    /// Makes a decoder at the beginning of a connection.
    #[must_use]
    pub fn new() -> Self {
        Self {
            buffer: vec![0; LONGEST_MESSAGE],
            filled: 0,
            has_cookie: false,
            senders: vec![Name::EMPTY; MOST_BODIES],
            pose_type: None,
            frame: Frame::new(),
            refused: 0,
        }
    }

    /// Resets the decoder for another connection.
    pub fn restart(&mut self) {
        self.filled = 0;
        self.has_cookie = false;
        self.senders.fill(Name::EMPTY);
        self.pose_type = None;
    }

    /// Returns whether the server has greeted.
    #[must_use]
    pub fn is_greeted(&self) -> bool {
        self.has_cookie
    }

    /// Returns the senders that have a name, with their numbers.
    pub fn senders(&self) -> impl Iterator<Item = &Name> {
        self.senders.iter().filter(|name| **name != Name::EMPTY)
    }

    /// Returns the number of impossible poses in otherwise valid streams; some servers send zeros for bodies that they
    /// do not see.
    #[must_use]
    pub fn refused(&self) -> u64 {
        self.refused
    }

    /// Takes the next bytes, and hands out a frame of one body for every pose among them, in order.
    ///
    /// # Errors
    /// [`WireError`] if this is not such a stream. Frames that were handed out before are valid; the connection is to
    /// be closed.
    pub fn push(&mut self, mut bytes: &[u8], mut sink: impl FnMut(&Frame)) -> Result<(), WireError> {
        while !bytes.is_empty() {
            let taken = bytes.len().min(self.buffer.len() - self.filled);
            let (now, later) = bytes.split_at(taken);
            self.buffer[self.filled..self.filled + taken].copy_from_slice(now);
            self.filled += taken;
            bytes = later;
            self.drain(&mut sink)?;
        }
        Ok(())
    }

    /// Reads the whole messages, and moves the rest to the front: it is shorter than one message.
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
            let message = &self.buffer[from..from + length];
            match read(message, &mut self.senders, &mut self.pose_type, &mut self.frame)? {
                VrpnMessage::Pose => sink(&self.frame),
                VrpnMessage::NoPose => self.refused += 1,
                VrpnMessage::Other => {}
            }
            from += length;
        }
        self.buffer.copy_within(from..self.filled, 0);
        self.filled -= from;
        Ok(())
    }
}

/// Returns the length of the message that begins here, with its padding; `None` if it is not known yet.
fn message_length(bytes: &[u8]) -> Result<Option<usize>, WireError> {
    let Some(length) = bytes.first_chunk().map(|length| u32::from_be_bytes(*length)) else {
        return Ok(None);
    };
    let length = usize::try_from(length).map_err(|_| WireError::Oversized("a message"))?;
    if length < HEAD {
        return Err(WireError::Invalid("the length of a message"));
    }
    if length > LONGEST_MESSAGE {
        return Err(WireError::Oversized("a message"));
    }
    Ok(Some(length.next_multiple_of(8)))
}

/// Kind of a message.
enum VrpnMessage {
    /// A pose, which the frame now holds.
    Pose,
    /// Of a pose's type, but with invalid numbers.
    NoPose,
    /// Something else.
    Other,
}

/// Reads a whole message.
fn read(
    message: &[u8],
    senders: &mut [Name],
    pose_type: &mut Option<i32>,
    frame: &mut Frame,
) -> Result<VrpnMessage, WireError> {
    let mut cursor = Cursor::new(message);
    let length = cursor.u32_be("a message's length")?;
    let seconds = cursor.u32_be("a message's time")?;
    let microseconds = cursor.u32_be("a message's time")?;
    let sender = cursor.i32_be("a message's sender")?;
    let kind = cursor.i32_be("a message's type")?;
    cursor.skip(1, 4, "a message's head")?;
    // The payload without its padding; a length of less than a head was refused before.
    let payload = cursor.slice((length as usize).saturating_sub(HEAD), "a message")?;
    let mut payload = Cursor::new(payload);
    let sender_index = usize::try_from(sender)
        .ok()
        .filter(|&index| index < senders.len());
    match kind {
        SENDER_DESCRIPTION => {
            // Trackers beyond the limit stay without a name and are skipped.
            if let Some(index) = sender_index {
                senders[index] = described_name(&mut payload)?;
            }
        }
        TYPE_DESCRIPTION if described_name(&mut payload)?.as_bytes() == POSE_TYPE.as_bytes() => {
            *pose_type = Some(sender);
        }
        kind if Some(kind) == *pose_type => {
            let Some(index) = sender_index else {
                return Ok(VrpnMessage::Other);
            };
            let report = report(&mut payload)?;
            let pose = CapturePose::from_quaternion(report.position, report.quaternion);
            let (Ok(pose), true) = (pose, microseconds < 1_000_000) else {
                return Ok(VrpnMessage::NoPose);
            };
            let at_ns = i64::from(seconds) * 1_000_000_000 + i64::from(microseconds) * 1000;
            frame.is_complete = false;
            frame.stamp = Some(Stamp {
                exposed_ns: at_ns,
                sent_ns: at_ns,
            });
            frame.push(WireBody {
                name: senders[index],
                number: report.sensor,
                pose: Some(pose),
            })?;
            return Ok(VrpnMessage::Pose);
        }
        _ => {}
    }
    Ok(VrpnMessage::Other)
}

fn described_name(payload: &mut Cursor<'_>) -> Result<Name, WireError> {
    let length = payload.u32_be("the length of a name")?;
    let length = usize::try_from(length).map_err(|_| WireError::Oversized("a name"))?;
    Name::new(payload.slice(length, "a name")?)
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
