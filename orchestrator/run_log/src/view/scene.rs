//! Scene for viewers: frames, the vehicle, its trajectory and that of the reference.
//!
//! In {I} z points down, in viewers up: {I} is rotated by half a turn in the viewers' frame, and all data are in {I}.

use nalgebra::{Matrix3, Rotation3, UnitQuaternion};

use shared_types::geodesy::LocalFrame;
use shared_types::samples::GnssFix;

use super::messages::{
    Color, CubePrimitive, CylinderPrimitive, FrameTransform, LinePrimitive, LocationFix, NumericType,
    PackedElementField, PointCloud, Pose, PoseInFrame, PositionCovarianceType, Quaternion, SceneEntity,
    SceneUpdate, Timestamp,
};

/// Frame of the viewers, with z up: x as in {I}, y and z opposite.
pub(super) const UPRIGHT: &str = "world_z_up";

/// {I}, z down.
pub(super) const WORLD: &str = "world";

/// {B}.
pub(super) const BODY: &str = "body";

/// Colour of the flown trajectory.
const FLOWN: Color = Color {
    r: 0.90,
    g: 0.38,
    b: 0.0,
    a: 1.0,
};

/// Colour of the desired trajectory.
const DESIRED: Color = Color {
    r: 0.0,
    g: 0.45,
    b: 0.70,
    a: 1.0,
};

const DARK: Color = Color {
    r: 0.25,
    g: 0.25,
    b: 0.25,
    a: 1.0,
};

/// Line width, pixels.
const LINE_PIXELS: f64 = 2.0;

/// Bytes of a point: x, y and z as f32, and four parts of a colour.
const POINT_BYTES: u32 = 16;

/// Position in {I}, m, and attitude, body to inertial.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Placed {
    pub(super) position_world: [f64; 3],
    pub(super) world_from_body: Matrix3<f64>,
}

impl Placed {
    fn orientation(&self) -> Quaternion {
        let rotation = Rotation3::from_matrix_unchecked(self.world_from_body);
        let quaternion = UnitQuaternion::from_rotation_matrix(&rotation);
        Quaternion {
            x: quaternion.i,
            y: quaternion.j,
            z: quaternion.k,
            w: quaternion.w,
        }
    }
}

/// Returns a fix as it was measured, with the accuracies that the receiver reports.
pub(super) fn fix(fix: &GnssFix) -> LocationFix {
    let horizontal = 0.5 * fix.horizontal_accuracy * fix.horizontal_accuracy;
    let vertical = fix.vertical_accuracy * fix.vertical_accuracy;
    LocationFix {
        latitude: fix.latitude,
        longitude: fix.longitude,
        altitude: fix.height,
        position_covariance: vec![horizontal, 0.0, 0.0, 0.0, horizontal, 0.0, 0.0, 0.0, vertical],
        position_covariance_type: PositionCovarianceType::DiagonalKnown.into(),
        timestamp: Timestamp::from_ns(fix.valid_ns),
        frame_id: BODY.to_owned(),
    }
}

/// Returns the place of the vehicle on the earth.
pub(super) fn location(time_ns: u64, frame: &LocalFrame, vehicle: &Placed) -> LocationFix {
    let place = frame.to_geodetic(&vehicle.position_world.into());
    LocationFix {
        latitude: place.latitude,
        longitude: place.longitude,
        altitude: place.height,
        position_covariance: vec![0.0; 9],
        position_covariance_type: PositionCovarianceType::Unknown.into(),
        timestamp: Timestamp::from_ns(time_ns),
        frame_id: BODY.to_owned(),
    }
}

/// Returns {I} in the viewers' frame: half a turn about x.
pub(super) fn upright(time_ns: u64) -> FrameTransform {
    FrameTransform {
        timestamp: Timestamp::from_ns(time_ns),
        parent_frame_id: UPRIGHT.to_owned(),
        child_frame_id: WORLD.to_owned(),
        translation: [0.0; 3].into(),
        rotation: Quaternion {
            x: 1.0,
            y: 0.0,
            z: 0.0,
            w: 0.0,
        },
    }
}

/// Returns the frame of the vehicle.
pub(super) fn body_frame(time_ns: u64, vehicle: &Placed) -> FrameTransform {
    FrameTransform {
        timestamp: Timestamp::from_ns(time_ns),
        parent_frame_id: WORLD.to_owned(),
        child_frame_id: BODY.to_owned(),
        translation: vehicle.position_world.into(),
        rotation: vehicle.orientation(),
    }
}

/// Returns a pose in {I}.
pub(super) fn pose(time_ns: u64, placed: &Placed) -> PoseInFrame {
    PoseInFrame {
        timestamp: Timestamp::from_ns(time_ns),
        frame_id: WORLD.to_owned(),
        pose: Pose {
            position: placed.position_world.into(),
            orientation: placed.orientation(),
        },
    }
}

/// Returns the vehicle, which moves with its frame, and the complete trajectories as lines.
pub(super) fn scene(time_ns: u64, flown: &[[f64; 3]], desired: &[[f64; 3]]) -> SceneUpdate {
    let entity = |id: &str, frame_id: &str| SceneEntity {
        timestamp: Timestamp::from_ns(time_ns),
        frame_id: frame_id.to_owned(),
        id: id.to_owned(),
        frame_locked: true,
        cubes: Vec::new(),
        cylinders: Vec::new(),
        lines: Vec::new(),
    };
    SceneUpdate {
        entities: vec![
            SceneEntity {
                cubes: vec![hull()],
                cylinders: rotors(),
                ..entity("vehicle", BODY)
            },
            SceneEntity {
                lines: vec![line(flown, FLOWN)],
                ..entity("way of the vehicle", WORLD)
            },
            SceneEntity {
                lines: vec![line(desired, DESIRED)],
                ..entity("way of the reference", WORLD)
            },
        ],
    }
}

/// Returns the hull, about the size of the paper's vehicle; the front is orange.
fn hull() -> CubePrimitive {
    CubePrimitive {
        pose: Pose::at([0.0; 3]),
        size: [0.08, 0.05, 0.03].into(),
        color: DARK,
    }
}

fn rotors() -> Vec<CylinderPrimitive> {
    const ARM: f64 = 0.07;
    let rotor = |[x, y]: [f64; 2]| CylinderPrimitive {
        pose: Pose::at([ARM * x, ARM * y, -0.02]),
        size: [0.11, 0.11, 0.01].into(),
        bottom_scale: 1.0,
        top_scale: 1.0,
        color: if x > 0.0 { FLOWN } else { DARK },
    };
    [[1.0, 1.0], [1.0, -1.0], [-1.0, -1.0], [-1.0, 1.0]]
        .map(rotor)
        .into()
}

fn line(places: &[[f64; 3]], color: Color) -> LinePrimitive {
    LinePrimitive {
        pose: Pose::at([0.0; 3]),
        thickness: LINE_PIXELS,
        scale_invariant: true,
        points: places.iter().map(|&place| place.into()).collect(),
        color,
    }
}

/// Returns the complete trajectories as points in {I}, for Rerun, which does not support Foxglove's lines.
pub(super) fn points(time_ns: u64, flown: &[[f64; 3]], desired: &[[f64; 3]]) -> PointCloud {
    let field = |(index, name): (u32, &str)| PackedElementField {
        name: name.to_owned(),
        offset: if index < 3 { 4 * index } else { 9 + index },
        r#type: if index < 3 {
            NumericType::Float32
        } else {
            NumericType::Uint8
        }
        .into(),
    };
    let names = ["x", "y", "z", "red", "green", "blue", "alpha"];
    let ways = [(flown, FLOWN), (desired, DESIRED)];
    let data = ways.into_iter().flat_map(|(places, color)| {
        let bytes = packed(&color);
        places.iter().flat_map(move |place| {
            place
                .map(|number| (number as f32).to_le_bytes())
                .into_iter()
                .chain([bytes])
        })
    });
    PointCloud {
        timestamp: Timestamp::from_ns(time_ns),
        frame_id: WORLD.to_owned(),
        pose: Pose::at([0.0; 3]),
        point_stride: POINT_BYTES,
        fields: (0..).zip(names).map(field).collect(),
        data: data.flatten().collect(),
    }
}

/// Packs a colour into four bytes.
fn packed(color: &Color) -> [u8; 4] {
    [color.r, color.g, color.b, color.a].map(|part| (255.0 * part).round() as u8)
}
