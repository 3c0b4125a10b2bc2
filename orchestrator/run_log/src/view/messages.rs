//! The viewers' messages, as far as they are used here: names and numbers are those of Foxglove's schemas for Protocol Buffers, which
//! Foxglove, Lichtblick and Rerun know. Units: m, rad-free quaternions, colours from 0 to 1.

use super::wire::{Kind, Member, Message, Package, Value, describe, messages};

const TIME_FILE: &str = "google/protobuf/timestamp.proto";

messages! {
    fn time, "google.protobuf"

    /// A time.
    Timestamp {
        1 seconds: i64,
        2 nanos: i32,
    }
}

messages! {
    fn foxglove, "foxglove"

    /// A vector, or the size of something.
    Vector3 {
        1 x: f64,
        2 y: f64,
        3 z: f64,
    }

    /// A place.
    Point3 {
        1 x: f64,
        2 y: f64,
        3 z: f64,
    }

    /// A rotation.
    Quaternion {
        1 x: f64,
        2 y: f64,
        3 z: f64,
        4 w: f64,
    }

    /// A colour, each part from 0 to 1.
    Color {
        1 r: f64,
        2 g: f64,
        3 b: f64,
        4 a: f64,
    }

    /// Where something is and how it is turned.
    Pose {
        1 position: Vector3,
        2 orientation: Quaternion,
    }

    /// A pose at a time, relative to a frame.
    PoseInFrame {
        1 timestamp: Timestamp,
        2 frame_id: &'static str,
        3 pose: Pose,
    }

    /// Where a frame is in its parent.
    FrameTransform {
        1 timestamp: Timestamp,
        2 parent_frame_id: &'static str,
        3 child_frame_id: &'static str,
        4 translation: Vector3,
        5 rotation: Quaternion,
    }

    /// A box.
    CubePrimitive {
        1 pose: Pose,
        2 size: Vector3,
        3 color: Color,
    }

    /// A cylinder about z.
    CylinderPrimitive {
        1 pose: Pose,
        2 size: Vector3,
        3 bottom_scale: f64,
        4 top_scale: f64,
        5 color: Color,
    }

    /// Points joined by a line.
    LinePrimitive {
        2 pose: Pose,
        3 thickness: f64,
        /// Whether the thickness is in pixels.
        4 scale_invariant: bool,
        5 points: Vec<Point3>,
        6 color: Color,
    }

    /// A thing in the scene.
    SceneEntity {
        1 timestamp: Timestamp,
        2 frame_id: &'static str,
        3 id: &'static str,
        /// Whether it moves with its frame.
        5 frame_locked: bool,
        8 cubes: Vec<CubePrimitive>,
        10 cylinders: Vec<CylinderPrimitive>,
        11 lines: Vec<LinePrimitive>,
    }

    /// Things to show from now on.
    SceneUpdate {
        2 entities: Vec<SceneEntity>,
    }

    /// Where a number of a point stands in its bytes.
    PackedElementField {
        1 name: &'static str,
        2 offset: u32,
        3 r#type: NumericType,
    }

    /// Points, packed.
    PointCloud {
        1 timestamp: Timestamp,
        2 frame_id: &'static str,
        3 pose: Pose,
        4 point_stride: u32,
        5 fields: Vec<PackedElementField>,
        6 data: Vec<u8>,
    }
}

/// What a packed number is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum NumericType {
    Uint8 = 1,
    Float32 = 7,
}

const NUMERIC_TYPES: (&str, &[&str]) = (
    "NumericType",
    &[
        "UNKNOWN", "UINT8", "INT8", "UINT16", "INT16", "UINT32", "INT32", "FLOAT32", "FLOAT64",
    ],
);

impl Value for NumericType {
    const KIND: Kind = Kind::Enumeration;

    fn type_name() -> Option<String> {
        Some(".foxglove.NumericType".to_owned())
    }

    fn write(&self, number: u32, out: &mut Vec<u8>) {
        (*self as i32).write(number, out);
    }
}

/// The description of all of them: the schema of each.
pub(super) fn description() -> Vec<u8> {
    describe(&[
        Package {
            name: "google.protobuf",
            file: TIME_FILE,
            imports: &[],
            messages: time(),
            enumerations: &[],
        },
        Package {
            name: "foxglove",
            file: "foxglove.proto",
            imports: &[TIME_FILE],
            messages: foxglove(),
            enumerations: &[NUMERIC_TYPES],
        },
    ])
}

impl Timestamp {
    /// So many ns after the start of the flight.
    pub(super) fn from_ns(time_ns: u64) -> Self {
        const NS_PER_SECOND: u64 = 1_000_000_000;
        Self {
            seconds: (time_ns / NS_PER_SECOND).cast_signed(),
            nanos: (time_ns % NS_PER_SECOND) as i32,
        }
    }
}

impl From<[f64; 3]> for Vector3 {
    fn from([x, y, z]: [f64; 3]) -> Self {
        Self { x, y, z }
    }
}

impl From<[f64; 3]> for Point3 {
    fn from([x, y, z]: [f64; 3]) -> Self {
        Self { x, y, z }
    }
}

impl Pose {
    /// At a place, turned as the frame is.
    pub(super) fn at(position: [f64; 3]) -> Self {
        Self {
            position: position.into(),
            orientation: Quaternion {
                x: 0.0,
                y: 0.0,
                z: 0.0,
                w: 1.0,
            },
        }
    }
}
