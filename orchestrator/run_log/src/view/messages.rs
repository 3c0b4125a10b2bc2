//! Messages for viewers: names and numbers are those of Foxglove's schemas for Protocol Buffers, which Foxglove, Lichtblick
//! and Rerun support. Units: m, rad-free quaternions, colours from 0 to 1.
//!
//! All members are required, so that zeros are written too: some readers interpret a missing member as unknown.

use prost::Message;
use prost_types::field_descriptor_proto::{Label, Type};
use prost_types::{
    DescriptorProto, EnumDescriptorProto, EnumValueDescriptorProto, FieldDescriptorProto,
    FileDescriptorProto, FileDescriptorSet,
};

const TIME: &str = "google.protobuf";
const TIME_FILE: &str = "google/protobuf/timestamp.proto";
const FOXGLOVE: &str = "foxglove";

/// Declares messages of a package, each member with its number, its type in Protocol Buffers and that in Rust, and a
/// function of this name that describes all of them.
macro_rules! messages {
    (
        fn $all:ident, $package:ident
        $(
            $(#[$attribute:meta])*
            $name:ident { $(
                $number:tt $member:ident: $label:ident $kind:ident $(= $detail:tt)? as $type:ty
            ),* $(,)? }
        )*
    ) => {
        $(
            $(#[$attribute])*
            #[derive(Clone, PartialEq, prost::Message)]
            pub(super) struct $name { $(
                #[prost($kind $(= $detail)?, $label, tag = $number)]
                pub(super) $member: $type
            ),* }

            impl prost::Name for $name {
                const NAME: &'static str = stringify!($name);
                const PACKAGE: &'static str = $package;
            }
        )*

        fn $all() -> Vec<DescriptorProto> {
            vec![$( DescriptorProto {
                name: Some(stringify!($name).to_owned()),
                field: vec![$(
                    member(stringify!($member), $number, stringify!($label), stringify!($kind), stringify!($type))
                ),*],
                ..DescriptorProto::default()
            } ),*]
        }
    };
}

messages! {
    fn time, TIME

    /// A time.
    Timestamp {
        1 seconds: required int64 as i64,
        2 nanos: required int32 as i32,
    }
}

messages! {
    fn foxglove, FOXGLOVE

    /// A vector, or the size of something.
    Vector3 {
        1 x: required double as f64,
        2 y: required double as f64,
        3 z: required double as f64,
    }

    /// A place.
    Point3 {
        1 x: required double as f64,
        2 y: required double as f64,
        3 z: required double as f64,
    }

    /// A rotation.
    Quaternion {
        1 x: required double as f64,
        2 y: required double as f64,
        3 z: required double as f64,
        4 w: required double as f64,
    }

    /// A colour, each part from 0 to 1.
    Color {
        1 r: required double as f64,
        2 g: required double as f64,
        3 b: required double as f64,
        4 a: required double as f64,
    }

    /// Place where something is and how it is turned.
    Pose {
        1 position: required message as Vector3,
        2 orientation: required message as Quaternion,
    }

    /// A pose at a time, relative to a frame.
    PoseInFrame {
        1 timestamp: required message as Timestamp,
        2 frame_id: required string as String,
        3 pose: required message as Pose,
    }

    /// Place where a frame is in its parent.
    FrameTransform {
        1 timestamp: required message as Timestamp,
        2 parent_frame_id: required string as String,
        3 child_frame_id: required string as String,
        4 translation: required message as Vector3,
        5 rotation: required message as Quaternion,
    }

    /// Place on the earth.
    LocationFix {
        // Degrees.
        1 latitude: required double as f64,
        2 longitude: required double as f64,
        // Above the ellipsoid, m.
        3 altitude: required double as f64,
        // East, north and up, row by row, m².
        4 position_covariance: repeated double as Vec<f64>,
        5 position_covariance_type: required enumeration = "PositionCovarianceType" as i32,
        6 timestamp: required message as Timestamp,
        7 frame_id: required string as String,
    }

    /// A box.
    CubePrimitive {
        1 pose: required message as Pose,
        2 size: required message as Vector3,
        3 color: required message as Color,
    }

    /// A cylinder about z.
    CylinderPrimitive {
        1 pose: required message as Pose,
        2 size: required message as Vector3,
        3 bottom_scale: required double as f64,
        4 top_scale: required double as f64,
        5 color: required message as Color,
    }

    /// Points joined by a line.
    LinePrimitive {
        2 pose: required message as Pose,
        3 thickness: required double as f64,
        // Whether the thickness is in pixels.
        4 scale_invariant: required bool as bool,
        5 points: repeated message as Vec<Point3>,
        6 color: required message as Color,
    }

    /// A thing in the scene.
    SceneEntity {
        1 timestamp: required message as Timestamp,
        2 frame_id: required string as String,
        3 id: required string as String,
        // Whether it moves with its frame.
        5 frame_locked: required bool as bool,
        8 cubes: repeated message as Vec<CubePrimitive>,
        10 cylinders: repeated message as Vec<CylinderPrimitive>,
        11 lines: repeated message as Vec<LinePrimitive>,
    }

    /// Things to show from now on.
    SceneUpdate {
        2 entities: repeated message as Vec<SceneEntity>,
    }

    /// Place where a number of a point stands in its bytes.
    PackedElementField {
        1 name: required string as String,
        2 offset: required fixed32 as u32,
        3 r#type: required enumeration = "NumericType" as i32,
    }

    /// Points, packed.
    PointCloud {
        1 timestamp: required message as Timestamp,
        2 frame_id: required string as String,
        3 pose: required message as Pose,
        4 point_stride: required fixed32 as u32,
        5 fields: repeated message as Vec<PackedElementField>,
        6 data: required bytes = "vec" as Vec<u8>,
    }
}

/// The type of a packed number.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord, prost::Enumeration)]
#[repr(i32)]
pub(super) enum NumericType {
    Unknown = 0,
    Uint8 = 1,
    Float32 = 7,
}

/// What is known of a covariance.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord, prost::Enumeration)]
#[repr(i32)]
pub(super) enum PositionCovarianceType {
    Unknown = 0,
    Approximated = 1,
    DiagonalKnown = 2,
    Known = 3,
}

/// Names of what is known of a covariance, from 0. They are those of the enumeration inside of the message.
const COVARIANCE_TYPES: [&str; 4] = ["UNKNOWN", "APPROXIMATED", "DIAGONAL_KNOWN", "KNOWN"];

/// Names of the types of packed numbers, from 0.
const NUMERIC_TYPES: [&str; 9] = [
    "UNKNOWN", "UINT8", "INT8", "UINT16", "INT16", "UINT32", "INT32", "FLOAT32", "FLOAT64",
];

/// Returns the description of a member.
fn member(name: &str, number: i32, label: &str, kind: &str, rust_type: &str) -> FieldDescriptorProto {
    let kind = Type::from_str_name(&format!("TYPE_{}", kind.to_uppercase())).unwrap_or(Type::Enum);
    let label = match label {
        "repeated" => Label::Repeated,
        _ => Label::Optional,
    };
    let type_name = match (kind, rust_type) {
        (Type::Enum, _) if name == "position_covariance_type" => {
            Some(format!(".{FOXGLOVE}.LocationFix.PositionCovarianceType"))
        }
        (Type::Enum, _) => Some(format!(".{FOXGLOVE}.NumericType")),
        (Type::Message, "Timestamp") => Some(format!(".{TIME}.Timestamp")),
        (Type::Message, name) => Some(format!(
            ".{FOXGLOVE}.{}",
            name.trim_start_matches("Vec<").trim_end_matches('>')
        )),
        _ => None,
    };
    FieldDescriptorProto {
        // Keywords of Rust are written as `r#type` in the macro.
        name: Some(name.trim_start_matches("r#").to_owned()),
        number: Some(number),
        label: Some(label.into()),
        r#type: Some(kind.into()),
        type_name,
        ..FieldDescriptorProto::default()
    }
}

/// Returns the description of all messages as a schema of MCAP: a `FileDescriptorSet` in which packages precede their users.
pub(super) fn description() -> Vec<u8> {
    let file = |name: &str, package: &str, message_type| FileDescriptorProto {
        name: Some(name.to_owned()),
        package: Some(package.to_owned()),
        message_type,
        syntax: Some("proto3".to_owned()),
        ..FileDescriptorProto::default()
    };
    let value = |(number, name): (i32, &&str)| EnumValueDescriptorProto {
        name: Some((*name).to_owned()),
        number: Some(number),
        ..EnumValueDescriptorProto::default()
    };
    let enumeration = |name: &str, names: &[&str]| EnumDescriptorProto {
        name: Some(name.to_owned()),
        value: (0..).zip(names).map(value).collect(),
        ..EnumDescriptorProto::default()
    };
    let mut messages = foxglove();
    let fix = messages
        .iter_mut()
        .find(|message| message.name() == "LocationFix");
    if let Some(fix) = fix {
        fix.enum_type = vec![enumeration("PositionCovarianceType", &COVARIANCE_TYPES)];
    }
    let foxglove = FileDescriptorProto {
        dependency: vec![TIME_FILE.to_owned()],
        enum_type: vec![enumeration("NumericType", &NUMERIC_TYPES)],
        ..file("foxglove.proto", FOXGLOVE, messages)
    };
    let file = vec![file(TIME_FILE, TIME, time()), foxglove];
    FileDescriptorSet { file }.encode_to_vec()
}

impl Timestamp {
    /// Makes a time stamp, in ns since the start of the flight.
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
    /// Makes a pose with the attitude of the frame.
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
