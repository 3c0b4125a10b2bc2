//! Common parts of the decoders: a bounds-checked cursor, and the frame that they fill.
//!
//! All untrusted input has limits: names, bodies, lengths. A packet with an invalid *structure* gives a [`WireError`] and
//! is dropped as a whole. A packet contains bodies of several users, so an invalid *value* gives a [`PoseError`] of that
//! body alone: it counts as not tracked, and the others are used.

use nalgebra::{Matrix3, Vector3};

/// Maximum number of bodies in a frame or a list of names.
pub const MAX_BODIES: usize = 256;

/// Maximum length of a body's name, bytes.
pub const MAX_NAME_LENGTH: usize = 255;

/// Maximum coordinate in a laboratory, m.
const MAX_COORDINATE: f64 = 1e3;

/// Maximum error of a quaternion's squared norm; single precision passes, most flipped bits do not.
const QUATERNION_DEFECT: f64 = 1e-4;

/// Error of a packet, with the part of the packet that is wrong.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum WireError {
    /// The packet is too short.
    #[error("the packet is truncated in {0}")]
    Truncated(&'static str),
    /// The length of a part, or the number of parts, exceeds its limit.
    #[error("{0} exceeds its limit")]
    Oversized(&'static str),
    /// A value is not valid in the format, or not plausible.
    #[error("{0} is not valid")]
    Invalid(&'static str),
    /// The packet needs another one, which was not received yet.
    #[error("the packet arrived before {0}")]
    Early(&'static str),
    /// The server sends an unsupported version of `NatNet`: major and minor.
    #[error("Motive sends NatNet {0}.{1}; 3.x and 4.x are supported")]
    Version(u8, u8),
    /// The server states a version of `NatNet` (major, minor), but its frames have the layout of another one.
    #[error(
        "the server states NatNet {}.{}, but its frames have the layout of {}.{}: set one bit stream version in Motive",
        .stated[0], .stated[1], .sent[0], .sent[1]
    )]
    OtherVersion {
        /// The stated version.
        stated: [u8; 2],
        /// A version with the layout of the frames.
        sent: [u8; 2],
    },
}

/// Error of one body's pose in a packet with a valid structure.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum PoseError {
    /// A coordinate or an angle is NaN or infinite.
    #[error("a coordinate or an angle is not a number")]
    NotFinite,
    /// A coordinate is implausibly large, m.
    #[error("{0:.0} m from the origin: millimetres?")]
    Far(f64),
    /// A quaternion of this norm is not a rotation.
    #[error("a quaternion of norm {0:.4} is not a rotation")]
    Norm(f64),
    /// Angle of several turns, rad.
    #[error("an angle of {0:.1} rad: degrees?")]
    Angle(f64),
    /// Another body has the same name.
    #[error("another body has the same name: rename one of them in the capture program")]
    SharedName,
    /// Another body has the same id.
    #[error("another body has the same id: change the streaming id of one of them in the capture program")]
    SharedId,
    /// The time stamp has more than 999,999 µs.
    #[error("its time stamp has more than 999,999 µs")]
    Stamp,
}

/// Name of up to [`MAX_NAME_LENGTH`] bytes, stored inline.
#[derive(Clone, Copy, PartialEq, Eq)]
pub struct Name {
    length: u8,
    bytes: [u8; MAX_NAME_LENGTH],
}

impl Name {
    /// No name.
    pub const EMPTY: Self = Self {
        length: 0,
        bytes: [0; MAX_NAME_LENGTH],
    };

    /// Makes a name of the bytes up to the first zero.
    ///
    /// # Errors
    /// If the name is too long.
    pub fn new(bytes: &[u8]) -> Result<Self, WireError> {
        let end = bytes.iter().position(|&byte| byte == 0).unwrap_or(bytes.len());
        if end > MAX_NAME_LENGTH {
            return Err(WireError::Oversized("a name"));
        }
        Ok(Self::truncated(&bytes[..end]))
    }

    /// Makes a name of the first [`MAX_NAME_LENGTH`] bytes.
    pub(crate) fn truncated(bytes: &[u8]) -> Self {
        let bytes = &bytes[..bytes.len().min(MAX_NAME_LENGTH)];
        let mut name = Self::EMPTY;
        name.length = u8::try_from(bytes.len()).unwrap_or(u8::MAX);
        name.bytes[..bytes.len()].copy_from_slice(bytes);
        name
    }

    /// Returns the bytes of the name.
    #[must_use]
    pub fn as_bytes(&self) -> &[u8] {
        &self.bytes[..usize::from(self.length)]
    }
}

impl std::fmt::Display for Name {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        for chunk in self.as_bytes().utf8_chunks() {
            // Untrusted control characters must not reach a terminal.
            for character in chunk.valid().chars().filter(|character| !character.is_control()) {
                write!(formatter, "{character}")?;
            }
            if !chunk.invalid().is_empty() {
                write!(formatter, "{}", char::REPLACEMENT_CHARACTER)?;
            }
        }
        Ok(())
    }
}

impl std::fmt::Debug for Name {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(formatter, "\"{self}\"")
    }
}

/// Received pose of a body's markers in the capture system's frame, in SI units.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CapturePose {
    /// Origin of the markers' frame, m.
    pub position: Vector3<f64>,
    /// The markers' frame to the capture system's.
    pub capture_from_markers: Matrix3<f64>,
}

impl CapturePose {
    /// Makes a pose of a position (m) and a rotation as quaternion x, y, z, w.
    ///
    /// # Errors
    /// If the position is not plausible, or the quaternion is not a rotation.
    pub fn from_quaternion(position: [f64; 3], [x, y, z, w]: [f64; 4]) -> Result<Self, PoseError> {
        let squared = x * x + y * y + z * z + w * w;
        if !squared.is_finite() {
            return Err(PoseError::NotFinite);
        }
        if (squared - 1.0).abs() > QUATERNION_DEFECT {
            return Err(PoseError::Norm(squared.sqrt()));
        }
        let s = 2.0 / squared;
        #[rustfmt::skip]
        let rotation = Matrix3::new(
            1.0 - s * (y * y + z * z), s * (x * y - z * w), s * (x * z + y * w),
            s * (x * y + z * w), 1.0 - s * (x * x + z * z), s * (y * z - x * w),
            s * (x * z - y * w), s * (y * z + x * w), 1.0 - s * (x * x + y * y),
        );
        Self::new(position, rotation)
    }

    /// Makes a pose of a position (m) and a rotation.
    ///
    /// # Errors
    /// If the position is not plausible.
    pub fn new(position: [f64; 3], capture_from_markers: Matrix3<f64>) -> Result<Self, PoseError> {
        if !position.iter().all(|coordinate| coordinate.is_finite()) {
            return Err(PoseError::NotFinite);
        }
        let farthest = position
            .iter()
            .fold(0.0_f64, |most, coordinate| most.max(coordinate.abs()));
        if farthest > MAX_COORDINATE {
            return Err(PoseError::Far(farthest));
        }
        Ok(Self {
            position: Vector3::from(position),
            capture_from_markers,
        })
    }
}

/// Body of a frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WireBody {
    /// Name; empty if it is not known.
    pub name: Name,
    /// `NatNet`'s streaming id, or VRPN's sensor; 0 with Vicon.
    pub number: i32,
    /// Pose; `None` if the body is not tracked.
    pub pose: Option<CapturePose>,
}

/// Times of a frame on the sender's clock, ns from an arbitrary epoch.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Stamp {
    /// Exposure, as far as the sender states it.
    pub exposed_ns: i64,
    /// Transmission; equal to the exposure if it is not known.
    pub sent_ns: i64,
}

/// Content of one packet. Its memory is allocated once and reused.
#[derive(Clone, Debug, PartialEq)]
pub struct Frame {
    /// Frame number, which counts up; `None` if the protocol has none.
    pub number: Option<u32>,
    /// Time on the sender's clock; `None` if the protocol has none.
    pub stamp: Option<Stamp>,
    /// `true` if all tracked bodies are contained; otherwise absent bodies may be tracked too.
    pub is_complete: bool,
    bodies: Vec<WireBody>,
    /// Indices of bodies with a refused pose, with the reasons.
    refusals: Vec<(usize, PoseError)>,
}

impl Default for Frame {
    fn default() -> Self {
        Self::new()
    }
}

impl Frame {
    /// Makes an empty frame.
    #[must_use]
    pub fn new() -> Self {
        Self {
            number: None,
            stamp: None,
            is_complete: true,
            bodies: Vec::with_capacity(MAX_BODIES),
            refusals: Vec::with_capacity(MAX_BODIES),
        }
    }

    /// Returns the bodies.
    #[must_use]
    pub fn bodies(&self) -> &[WireBody] {
        &self.bodies
    }

    /// Returns the bodies with a refused pose, with the reasons. They count as not tracked.
    pub fn refused(&self) -> impl Iterator<Item = (&WireBody, PoseError)> {
        let refused = self.refusals.iter();
        refused.map(|&(index, reason)| (&self.bodies[index], reason))
    }

    /// Removes all content.
    pub fn clear(&mut self) {
        self.number = None;
        self.stamp = None;
        self.is_complete = true;
        self.bodies.clear();
        self.refusals.clear();
    }

    /// Adds a body.
    ///
    /// # Errors
    /// If there are too many.
    pub fn push(&mut self, body: WireBody) -> Result<(), WireError> {
        if self.bodies.len() == MAX_BODIES {
            return Err(WireError::Oversized("the number of bodies"));
        }
        self.bodies.push(body);
        Ok(())
    }

    /// Adds a body with a pose, without one, or with a refused one.
    ///
    /// # Errors
    /// If there are too many.
    pub(crate) fn push_pose(
        &mut self,
        name: Name,
        number: i32,
        pose: Result<Option<CapturePose>, PoseError>,
    ) -> Result<(), WireError> {
        self.push(WireBody {
            name,
            number,
            pose: pose.unwrap_or_default(),
        })?;
        if let Err(reason) = pose {
            self.refusals.push((self.bodies.len() - 1, reason));
        }
        Ok(())
    }

    /// Refuses the pose of a body that was already added.
    pub(crate) fn refuse(&mut self, index: usize, reason: PoseError) {
        self.bodies[index].pose = None;
        match self.refusals.iter_mut().find(|(known, _)| *known == index) {
            Some(known) => known.1 = reason,
            None => self.refusals.push((index, reason)),
        }
    }

    /// Fills the frame by a decoder. After an error the frame is empty.
    pub(crate) fn fill(
        &mut self,
        decode: impl FnOnce(&mut Self) -> Result<(), WireError>,
    ) -> Result<(), WireError> {
        self.clear();
        let result = decode(self);
        if result.is_err() {
            self.clear();
        }
        result
    }
}

/// Bounds-checked cursor over the bytes of a packet. `what` names the part that is read, for the error.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Cursor<'a> {
    rest: &'a [u8],
}

impl<'a> Cursor<'a> {
    pub(crate) fn new(bytes: &'a [u8]) -> Self {
        Self { rest: bytes }
    }

    pub(crate) fn remaining(&self) -> usize {
        self.rest.len()
    }

    pub(crate) fn slice(&mut self, length: usize, what: &'static str) -> Result<&'a [u8], WireError> {
        let (taken, rest) = self
            .rest
            .split_at_checked(length)
            .ok_or(WireError::Truncated(what))?;
        self.rest = rest;
        Ok(taken)
    }

    pub(crate) fn array<const N: usize>(&mut self, what: &'static str) -> Result<[u8; N], WireError> {
        let (taken, rest) = self.rest.split_first_chunk().ok_or(WireError::Truncated(what))?;
        self.rest = rest;
        Ok(*taken)
    }

    /// Skips `count` elements of `size` bytes.
    pub(crate) fn skip(&mut self, count: usize, size: usize, what: &'static str) -> Result<(), WireError> {
        let length = count.checked_mul(size).ok_or(WireError::Truncated(what))?;
        self.slice(length, what).map(|_| ())
    }

    /// Reads a zero-terminated text, and skips the zero.
    pub(crate) fn text(&mut self, what: &'static str) -> Result<&'a [u8], WireError> {
        let end = self.rest.iter().position(|&byte| byte == 0);
        let text = self.slice(end.ok_or(WireError::Truncated(what))?, what)?;
        self.rest = &self.rest[1..];
        Ok(text)
    }

    pub(crate) fn u8(&mut self, what: &'static str) -> Result<u8, WireError> {
        self.array(what).map(|[byte]| byte)
    }
}

/// Readers of numbers.
macro_rules! numbers {
    ($($name:ident: $number:ty, $from:ident;)*) => {
        impl Cursor<'_> {
            $(pub(crate) fn $name(&mut self, what: &'static str) -> Result<$number, WireError> {
                self.array(what).map(<$number>::$from)
            })*
        }
    };
}

numbers! {
    u16_le: u16, from_le_bytes;
    u32_le: u32, from_le_bytes;
    i32_le: i32, from_le_bytes;
    u64_le: u64, from_le_bytes;
    f32_le: f32, from_le_bytes;
    f64_le: f64, from_le_bytes;
    u32_be: u32, from_be_bytes;
    i32_be: i32, from_be_bytes;
    f64_be: f64, from_be_bytes;
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_name_ends_at_its_first_zero_and_is_shown_without_control_characters() {
        let name = Name::new(b"qu\x1bad\xff\0rest").unwrap();
        assert_eq!(name.as_bytes(), b"qu\x1bad\xff");
        assert_eq!(name.to_string(), "quad\u{fffd}");
        assert_eq!(
            Name::new(&[b'a'; MAX_NAME_LENGTH + 1]),
            Err(WireError::Oversized("a name"))
        );
    }

    #[test]
    fn a_frame_takes_no_more_bodies_than_it_has_memory_for() {
        let body = WireBody {
            name: Name::EMPTY,
            number: 0,
            pose: None,
        };
        let mut frame = Frame::new();
        let memory = frame.bodies.capacity();
        for _ in 0..MAX_BODIES {
            frame.push(body).unwrap();
        }
        assert!(frame.push(body).is_err());
        assert_eq!(frame.bodies.capacity(), memory);
    }

    #[test]
    fn invalid_rotations_and_places_are_refused() {
        let level = [0.0, 0.0, 0.0, 1.0];
        assert!(CapturePose::from_quaternion([0.0; 3], level).is_ok());
        for quaternion in [[0.0; 4], [0.0, 0.0, 0.0, 1.1], [f64::NAN, 0.0, 0.0, 1.0]] {
            assert!(CapturePose::from_quaternion([0.0; 3], quaternion).is_err());
        }
        for coordinate in [f64::NAN, f64::INFINITY, 1e4] {
            assert!(CapturePose::from_quaternion([0.0, coordinate, 0.0], level).is_err());
        }
    }

    #[test]
    fn a_refusal_says_what_was_wrong() {
        let level = [0.0, 0.0, 0.0, 1.0];
        for (position, quaternion, words) in [
            ([0.0, 1234.0, 0.0], level, "1234 m from the origin: millimetres?"),
            (
                [0.0; 3],
                [0.0; 4],
                "a quaternion of norm 0.0000 is not a rotation",
            ),
            (
                [0.0; 3],
                [0.0, 0.0, 0.0, 1.001],
                "a quaternion of norm 1.0010 is not a rotation",
            ),
            ([f64::NAN, 0.0, 0.0], level, "not a number"),
        ] {
            let reason = CapturePose::from_quaternion(position, quaternion).unwrap_err();
            assert!(reason.to_string().contains(words), "{reason}");
        }
        assert_eq!(
            WireError::Version(2, 8).to_string(),
            "Motive sends NatNet 2.8; 3.x and 4.x are supported"
        );
    }
}
