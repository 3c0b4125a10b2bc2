//! Vicon Tracker's UDP object stream: one datagram per frame, little-endian, packed.
//!
//! `u32 frame, u8 items`, then per item `u8 id (0: object), u16 size (72), char name[24], f64 translation[3]` in mm and
//! `f64 rotation[3]` in rad with R = Rx Ry Rz, right-handed. Datagrams are padded to 256, 512 or 1024 bytes. There is no
//! time stamp and no quality. An occluded object is absent, repeats its last pose, or is all zero. Objects with the same
//! name, or whose first 24 bytes are equal, count as not tracked, because they cannot be distinguished.

pub mod sender;
pub(crate) mod source;

use nalgebra::{Matrix3, Vector3};
use shared_types::rotation::{exp, roll_pitch_yaw};

use crate::conventions::UpAxis;
use crate::protocol::{Decode, Plan, Protocol, SentFrame, Transport};
use crate::transport::{Address, CaptureSource, TransportError};
use crate::wire::{CapturePose, Cursor, Frame, Name, PoseError, WireError};

/// Protocol of Vicon's UDP object stream.
pub(crate) struct ViconUdp;

impl Protocol for ViconUdp {
    fn up_axis(&self) -> UpAxis {
        UpAxis::Z
    }

    fn open(&self, address: &Address) -> Result<Box<dyn CaptureSource>, TransportError> {
        Ok(Box::new(source::Source::open(address)?))
    }

    fn decoder(&self) -> Box<dyn Decode> {
        Box::new(Datagrams(Frame::new()))
    }

    fn transport(&self) -> Transport {
        Transport::Datagrams
    }

    fn frame(&self, _plan: &Plan, frame: &SentFrame, bodies: &[(&str, Option<CapturePose>)]) -> Vec<u8> {
        let seen = bodies
            .iter()
            .filter_map(|(name, pose)| Some(Object::new(name, pose.as_ref()?)));
        let mut datagram = Vec::new();
        sender::frame(frame.number, &seen.collect::<Vec<_>>(), &mut datagram);
        datagram
    }
}

/// Decoder of datagrams, each of which is a frame.
struct Datagrams(Frame);

impl Decode for Datagrams {
    fn decode(&mut self, bytes: &[u8], sink: &mut dyn FnMut(&Frame)) -> Result<(), WireError> {
        decode(bytes, &mut self.0)?;
        sink(&self.0);
        Ok(())
    }
}

/// Length of an object's name on the wire, bytes.
pub const NAME_LENGTH: usize = 24;

/// Kind of an item that is an object.
pub(crate) const OBJECT: u8 = 0;
/// Maximum angle, rad: angles of several turns are a wrong unit.
const MAX_ANGLE: f64 = 10.0;
/// Length of an object without its kind and length fields, bytes.
pub(crate) const OBJECT_LENGTH: u16 = 72;

/// Object as on the wire.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Object {
    /// Name, padded with zeros.
    pub name: [u8; NAME_LENGTH],
    /// Translation, mm.
    pub translation_mm: [f64; 3],
    /// Rotation, rad: R = Rx Ry Rz.
    pub rotation: [f64; 3],
}

impl Object {
    /// Makes the object of a pose. Truncates a longer name.
    fn new(name: &str, pose: &CapturePose) -> Self {
        let mut padded = [0; NAME_LENGTH];
        let length = name.len().min(NAME_LENGTH);
        padded[..length].copy_from_slice(&name.as_bytes()[..length]);
        // R = Rx Ry Rz, so that Rᵀ is Rz Ry Rx of the negative angles.
        let turned = roll_pitch_yaw(&pose.capture_from_markers.transpose());
        Self {
            name: padded,
            translation_mm: (pose.position * 1e3).into(),
            rotation: turned.map(|angle| -angle),
        }
    }

    /// Returns the pose in SI units; `None` if the object is not tracked.
    fn pose(&self) -> Result<Option<CapturePose>, PoseError> {
        let numbers = self.translation_mm.iter().chain(&self.rotation);
        if numbers.clone().all(|&number| number == 0.0) {
            return Ok(None);
        }
        if !self.rotation.iter().all(|angle| angle.is_finite()) {
            return Err(PoseError::NotFinite);
        }
        if let Some(angle) = self.rotation.iter().find(|angle| angle.abs() > MAX_ANGLE) {
            return Err(PoseError::Angle(*angle));
        }
        CapturePose::new(
            self.translation_mm.map(|millimetres| millimetres / 1000.0),
            capture_from_markers(self.rotation),
        )
        .map(Some)
    }
}

/// Returns R = Rx Ry Rz of the three angles, rad.
#[must_use]
pub fn capture_from_markers([x, y, z]: [f64; 3]) -> Matrix3<f64> {
    exp(&(Vector3::x() * x)) * exp(&(Vector3::y() * y)) * exp(&(Vector3::z() * z))
}

/// Decodes a datagram into the frame.
///
/// # Errors
/// [`WireError`]; the frame is then empty.
pub fn decode(datagram: &[u8], frame: &mut Frame) -> Result<(), WireError> {
    frame.fill(|frame| {
        let mut cursor = Cursor::new(datagram);
        frame.number = Some(cursor.u32_le("the frame number")?);
        for _ in 0..cursor.u8("the number of items")? {
            let kind = cursor.u8("the kind of an item")?;
            let length = cursor.u16_le("the length of an item")?;
            if kind != OBJECT {
                cursor.skip(1, usize::from(length), "an item")?;
                continue;
            }
            if length != OBJECT_LENGTH {
                return Err(WireError::Invalid("the length of an object"));
            }
            let object = object(&mut cursor)?;
            let name = Name::new(&object.name)?;
            let pose = match frame.bodies().iter().position(|body| body.name == name) {
                Some(twin) => {
                    frame.refuse(twin, PoseError::SharedName);
                    Err(PoseError::SharedName)
                }
                None => object.pose(),
            };
            frame.push_pose(name, 0, pose)?;
        }
        Ok(())
    })
}

fn object(cursor: &mut Cursor<'_>) -> Result<Object, WireError> {
    let name = cursor.array("the name of an object")?;
    let mut numbers = [0.0; 6];
    for number in &mut numbers {
        *number = cursor.f64_le("the pose of an object")?;
    }
    let [x, y, z, about_x, about_y, about_z] = numbers;
    Ok(Object {
        name,
        translation_mm: [x, y, z],
        rotation: [about_x, about_y, about_z],
    })
}
