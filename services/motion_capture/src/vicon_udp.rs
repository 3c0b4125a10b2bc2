//! Vicon Tracker's UDP object stream: one datagram a frame, little-endian, packed.
//!
//! `u32 frame, u8 items`, then per item `u8 id (0: object), u16 size (72), char name[24], f64 translation[3]` in mm and
//! `f64 rotation[3]` in rad with R = Rx Ry Rz, right-handed. Datagrams are filled up to 256, 512 or 1024 bytes. There is
//! no time stamp and no quality. A hidden object is absent, repeats what it was, or is all zero. Objects with one name,
//! also two whose names are equal in their first 24 bytes, count as not seen: nothing tells them apart.

use nalgebra::{Matrix3, Vector3};
use shared_types::rotation::exp;

use crate::wire::{CapturePose, Cursor, Frame, Name, PoseError, WireError};

/// Port to which Tracker sends by default.
pub const PORT: u16 = 51001;

/// Length of an object's name on the wire, bytes.
pub const NAME_LENGTH: usize = 24;

/// Kind of an item that is an object.
pub(crate) const OBJECT: u8 = 0;
/// Largest angle, rad: no program computes several turns.
const LARGEST_ANGLE: f64 = 10.0;
/// Length of an object without kind and length, bytes.
pub(crate) const OBJECT_LENGTH: u16 = 72;

/// An object as it travels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Object {
    /// Its name, filled up with zeros.
    pub name: [u8; NAME_LENGTH],
    /// Translation, mm.
    pub translation_mm: [f64; 3],
    /// Rotation, rad: R = Rx Ry Rz.
    pub rotation: [f64; 3],
}

impl Object {
    /// Returns its pose in SI units; `None` if it says that it is not seen.
    fn pose(&self) -> Result<Option<CapturePose>, PoseError> {
        let numbers = self.translation_mm.iter().chain(&self.rotation);
        if numbers.clone().all(|&number| number == 0.0) {
            return Ok(None);
        }
        if !self.rotation.iter().all(|angle| angle.is_finite()) {
            return Err(PoseError::NotFinite);
        }
        if let Some(angle) = self.rotation.iter().find(|angle| angle.abs() > LARGEST_ANGLE) {
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

/// Reads a datagram into the frame.
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
