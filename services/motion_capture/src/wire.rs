//! Common parts of the decoders: a cursor that cannot leave its bytes, and the frame that they fill.
//!
//! All input from strangers has limits: names, bodies, lengths. A packet whose *structure* is wrong gives a
//! [`WireError`], and nothing of it is used. Bodies of independent parties share a packet, so a *value* that cannot be
//! true gives a [`PoseError`] of that body alone: it counts as not seen, and the others are used.

use nalgebra::{Matrix3, Vector3};

/// Most bodies of a frame, and most that a list of names holds.
pub const MOST_BODIES: usize = 256;

/// Longest name of a body, bytes.
pub const LONGEST_NAME: usize = 255;

/// Largest coordinate of a place in a laboratory, m.
const LARGEST_COORDINATE: f64 = 1e3;

/// Largest difference of a quaternion's squared norm from 1; single precision passes, a flipped bit mostly not.
const QUATERNION_DEFECT: f64 = 1e-4;

/// Error of a packet that cannot be used. Each names the part of the packet.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum WireError {
    /// It ends too early.
    #[error("the packet ends inside {0}")]
    Truncated(&'static str),
    /// A part is longer, or there are more of them, than any sender sends.
    #[error("{0} exceeds its limit")]
    Oversized(&'static str),
    /// A value that the format does not have, or that no laboratory has.
    #[error("{0} cannot be what it says")]
    Invalid(&'static str),
    /// It can be read only after another packet, which has not come.
    #[error("the packet came before {0}")]
    Early(&'static str),
    /// The server speaks a version of `NatNet` that is not understood: major and minor.
    #[error("Motive speaks NatNet {0}.{1}; 3.x and 4.x are understood")]
    Version(u8, u8),
    /// The server states one version of `NatNet` (major, minor), and its frames are laid out as another one's.
    #[error(
        "the server says NatNet {}.{}, and its frames are laid out as {}.{}: set one bit stream version in Motive",
        .said[0], .said[1], .sent[0], .sent[1]
    )]
    OtherVersion {
        /// The stated version.
        said: [u8; 2],
        /// A version with the layout of the frames.
        sent: [u8; 2],
    },
}

/// Error of one body's pose in a packet whose structure is right.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum PoseError {
    /// A coordinate or an angle is NaN or infinite.
    #[error("a coordinate or an angle is not a number")]
    NotFinite,
    /// Distance of a coordinate from the origin that no laboratory has, m.
    #[error("{0:.0} m from the origin: millimetres?")]
    Far(f64),
    /// Norm of a quaternion that is no rotation.
    #[error("a quaternion of norm {0:.4} is no rotation")]
    Norm(f64),
    /// Angle of several turns, rad.
    #[error("an angle of {0:.1} rad: degrees?")]
    Angle(f64),
    /// Another body has the same name.
    #[error("two bodies have its name: rename one in the capture program")]
    SharedName,
    /// Another body has the same id.
    #[error("two bodies have its id: give one another streaming id in the capture program")]
    SharedId,
    /// The time stamp of the pose has more microseconds than a second.
    #[error("its time stamp has more than 999,999 µs")]
    Stamp,
}

/// A name of up to [`LONGEST_NAME`] bytes, without an allocation.
#[derive(Clone, Copy, PartialEq, Eq)]
pub struct Name {
    length: u8,
    bytes: [u8; LONGEST_NAME],
}

impl Name {
    /// No name.
    pub const EMPTY: Self = Self {
        length: 0,
        bytes: [0; LONGEST_NAME],
    };

    /// Makes the name of some bytes, up to the first zero.
    ///
    /// # Errors
    /// If it is too long.
    pub fn new(bytes: &[u8]) -> Result<Self, WireError> {
        let end = bytes.iter().position(|&byte| byte == 0).unwrap_or(bytes.len());
        if end > LONGEST_NAME {
            return Err(WireError::Oversized("a name"));
        }
        Ok(Self::cut(&bytes[..end]))
    }

    /// Makes a name of the first [`LONGEST_NAME`] bytes.
    pub(crate) fn cut(bytes: &[u8]) -> Self {
        let bytes = &bytes[..bytes.len().min(LONGEST_NAME)];
        let mut name = Self::EMPTY;
        name.length = u8::try_from(bytes.len()).unwrap_or(u8::MAX);
        name.bytes[..bytes.len()].copy_from_slice(bytes);
        name
    }

    /// Its bytes.
    #[must_use]
    pub fn as_bytes(&self) -> &[u8] {
        &self.bytes[..usize::from(self.length)]
    }
}

impl std::fmt::Display for Name {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        for chunk in self.as_bytes().utf8_chunks() {
            // Control characters from strangers must not reach a terminal.
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

/// Pose of a body's markers in the capture system's frame, as it was sent except for units: m, and a rotation.
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
    /// If a number is not that of a place in a laboratory, or the quaternion is no rotation.
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
    /// If a number is not that of a place in a laboratory.
    pub fn new(position: [f64; 3], capture_from_markers: Matrix3<f64>) -> Result<Self, PoseError> {
        if !position.iter().all(|coordinate| coordinate.is_finite()) {
            return Err(PoseError::NotFinite);
        }
        let farthest = position
            .iter()
            .fold(0.0_f64, |most, coordinate| most.max(coordinate.abs()));
        if farthest > LARGEST_COORDINATE {
            return Err(PoseError::Far(farthest));
        }
        Ok(Self {
            position: Vector3::from(position),
            capture_from_markers,
        })
    }
}

/// A body of a frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WireBody {
    /// Its name; empty where the protocol has none for it.
    pub name: Name,
    /// Its number: `NatNet`'s streaming id, VRPN's sensor; 0 with Vicon.
    pub number: i32,
    /// Its pose; `None` if it is not seen.
    pub pose: Option<CapturePose>,
}

/// Times of a frame on the sender's clock, ns from an arbitrary moment.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Stamp {
    /// The exposure, as far as the sender knows it.
    pub exposed_ns: i64,
    /// Time of the sending; equal to the exposure if it is not known.
    pub sent_ns: i64,
}

/// Content of one packet. Its memory is allocated at the start and filled again and again.
#[derive(Clone, Debug, PartialEq)]
pub struct Frame {
    /// Number of the frame, which counts up; `None` where the protocol has none.
    pub number: Option<u32>,
    /// Its time on the sender's clock; `None` if the protocol has none.
    pub stamp: Option<Stamp>,
    /// `true` if it contains all bodies that are seen; if not it contains one, and says nothing of the others.
    pub is_complete: bool,
    bodies: Vec<WireBody>,
    /// Index of each body whose pose was refused, with the reason.
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
            bodies: Vec::with_capacity(MOST_BODIES),
            refusals: Vec::with_capacity(MOST_BODIES),
        }
    }

    /// Returns the bodies.
    #[must_use]
    pub fn bodies(&self) -> &[WireBody] {
        &self.bodies
    }

    /// Returns the bodies whose pose was refused, with the reasons. They count as not seen.
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
        if self.bodies.len() == MOST_BODIES {
            return Err(WireError::Oversized("the number of bodies"));
        }
        self.bodies.push(body);
        Ok(())
    }

    /// Adds a body whose pose was seen, not seen, or refused for its values.
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

    /// Refuses the pose of a body that was added before, for another reason than its own.
    pub(crate) fn refuse(&mut self, index: usize, reason: PoseError) {
        self.bodies[index].pose = None;
        match self.refusals.iter_mut().find(|(known, _)| *known == index) {
            Some(known) => known.1 = reason,
            None => self.refusals.push((index, reason)),
        }
    }

    /// Lets a decoder fill the frame; a failure leaves it empty.
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

/// Cursor over the bytes of a packet. Each request names what it reads, for the error.
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

    /// Returns a text that ends with a zero, and skips the zero.
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

/// Numbers of one byte order.
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
            Name::new(&[b'a'; LONGEST_NAME + 1]),
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
        for _ in 0..MOST_BODIES {
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
            ([0.0; 3], [0.0; 4], "a quaternion of norm 0.0000 is no rotation"),
            (
                [0.0; 3],
                [0.0, 0.0, 0.0, 1.001],
                "a quaternion of norm 1.0010 is no rotation",
            ),
            ([f64::NAN, 0.0, 0.0], level, "not a number"),
        ] {
            let reason = CapturePose::from_quaternion(position, quaternion).unwrap_err();
            assert!(reason.to_string().contains(words), "{reason}");
        }
        assert_eq!(
            WireError::Version(2, 8).to_string(),
            "Motive speaks NatNet 2.8; 3.x and 4.x are understood"
        );
    }
}
