//! Axis conventions: from the capture system's frames to the paper's, {I} with z down, and {B} with x forward, y right,
//! z down.
//!
//! | axes | default of both transforms |
//! | --- | --- |
//! | z up (Vicon, VRPN) | half a turn about x |
//! | y up (`NatNet`) | a quarter turn about x |
//!
//! With the defaults, a level body that was defined while its nose pointed along the capture system's x axis is level in
//! {I} with yaw 0. Another definition of the body needs `body_from_markers`, another {I} `world_from_capture`.

use nalgebra::{Matrix3, Vector3};
use scenario::{CaptureSystem, FrameTransform};
use shared_types::rotation::from_roll_pitch_yaw;

use crate::protocol;
use crate::wire::CapturePose;

/// Upward axis of a capture system.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum UpAxis {
    /// y.
    Y,
    /// z.
    Z,
}

/// x ↦ R x + t.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Transform {
    /// R.
    pub rotation: Matrix3<f64>,
    /// t, m.
    pub translation: Vector3<f64>,
}

impl From<&FrameTransform> for Transform {
    fn from(config: &FrameTransform) -> Self {
        Self {
            rotation: from_roll_pitch_yaw(config.roll_pitch_yaw),
            translation: Vector3::from(config.position),
        }
    }
}

impl Transform {
    /// Returns the inverse transform.
    #[must_use]
    pub fn inverse(&self) -> Self {
        let rotation = self.rotation.transpose();
        Self {
            rotation,
            translation: -(rotation * self.translation),
        }
    }
}

/// Transforms from a capture system's poses to poses of the vehicle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Calibration {
    /// The capture system's frame to {I}.
    pub world_from_capture: Transform,
    /// The markers' frame to {B}.
    pub body_from_markers: Transform,
}

/// Pose of the vehicle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WorldPose {
    /// Origin of {B} in {I}, m.
    pub position_world: Vector3<f64>,
    /// R, {B} to {I}.
    pub world_from_body: Matrix3<f64>,
}

/// Returns the default rotation from a system's axes to {I}, and from its bodies' axes to {B}.
#[must_use]
pub fn axes(system: CaptureSystem) -> Matrix3<f64> {
    match protocol::for_system(system).up_axis() {
        UpAxis::Y => Matrix3::new(1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, -1.0, 0.0),
        UpAxis::Z => Matrix3::new(1.0, 0.0, 0.0, 0.0, -1.0, 0.0, 0.0, 0.0, -1.0),
    }
}

impl Calibration {
    /// Makes the calibration of the stated transforms, with the system's defaults for the others.
    #[must_use]
    pub fn new(
        system: CaptureSystem,
        world_from_capture: Option<&FrameTransform>,
        body_from_markers: Option<&FrameTransform>,
    ) -> Self {
        let default = Transform {
            rotation: axes(system),
            translation: Vector3::zeros(),
        };
        Self {
            world_from_capture: world_from_capture.map_or(default, Transform::from),
            body_from_markers: body_from_markers.map_or(default, Transform::from),
        }
    }

    /// Converts a pose of the markers to the pose of the vehicle.
    #[must_use]
    pub fn world_pose(&self, pose: &CapturePose) -> WorldPose {
        let world = &self.world_from_capture;
        let markers_from_body = self.body_from_markers.inverse();
        let origin_capture = pose.position + pose.capture_from_markers * markers_from_body.translation;
        WorldPose {
            position_world: world.rotation * origin_capture + world.translation,
            world_from_body: world.rotation * pose.capture_from_markers * markers_from_body.rotation,
        }
    }

    /// Converts a pose of the vehicle to that of the markers: the inverse of [`Calibration::world_pose`].
    #[must_use]
    pub fn capture_pose(&self, pose: &WorldPose) -> CapturePose {
        let capture = self.world_from_capture.inverse();
        let capture_from_markers = capture.rotation * pose.world_from_body * self.body_from_markers.rotation;
        let origin_capture = capture.rotation * pose.position_world + capture.translation;
        CapturePose {
            position: origin_capture
                + capture.rotation * pose.world_from_body * self.body_from_markers.translation,
            capture_from_markers,
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;
    use shared_types::rotation::{defect, exp, roll_pitch_yaw};

    use super::*;

    const SYSTEMS: [CaptureSystem; CaptureSystem::ALL.len()] = CaptureSystem::ALL;

    /// Returns the axis that points up in the room.
    fn up(system: CaptureSystem) -> Vector3<f64> {
        match protocol::for_system(system).up_axis() {
            UpAxis::Y => Vector3::y(),
            UpAxis::Z => Vector3::z(),
        }
    }

    fn level(position: Vector3<f64>, rotation: Matrix3<f64>) -> CapturePose {
        CapturePose {
            position,
            capture_from_markers: rotation,
        }
    }

    #[test]
    fn gravity_points_along_positive_z_and_a_level_body_is_level() {
        for system in SYSTEMS {
            let calibration = Calibration::new(system, None, None);
            let pose = calibration.world_pose(&level(up(system) * 1.5, Matrix3::identity()));
            assert_eq!(pose.position_world, Vector3::new(0.0, 0.0, -1.5));
            assert_eq!(pose.world_from_body, Matrix3::identity());
        }
    }

    /// Seen from above, a turn to the left is negative about the axis that points down.
    #[test]
    fn a_turn_to_the_left_is_a_negative_yaw_and_nose_up_a_positive_pitch() {
        for system in SYSTEMS {
            let calibration = Calibration::new(system, None, None);
            let to_the_left = exp(&(up(system) * 0.3));
            let pose = calibration.world_pose(&level(Vector3::zeros(), to_the_left));
            let [roll, pitch, yaw] = roll_pitch_yaw(&pose.world_from_body);
            assert!((yaw + 0.3).abs() < 1e-12 && roll.abs() + pitch.abs() < 1e-12);
            // About the axis to the right, which is forward × up.
            let nose_up = exp(&(Vector3::x().cross(&up(system)) * 0.2));
            let pose = calibration.world_pose(&level(Vector3::zeros(), nose_up));
            let [_, pitch, _] = roll_pitch_yaw(&pose.world_from_body);
            assert!((pitch - 0.2).abs() < 1e-12, "{system:?} {pitch}");
        }
    }

    #[test]
    fn stated_transforms_say_where_the_world_and_the_body_are() {
        let world = FrameTransform {
            position: [1.0, 2.0, 0.5],
            roll_pitch_yaw: [std::f64::consts::PI, 0.0, 0.0],
        };
        // The markers' frame sits 3 cm above the body's origin: at z = −0.03 in {B}.
        let body = FrameTransform {
            position: [0.0, 0.0, -0.03],
            roll_pitch_yaw: [std::f64::consts::PI, 0.0, 0.0],
        };
        let calibration = Calibration::new(CaptureSystem::Vrpn, Some(&world), Some(&body));
        let pose = calibration.world_pose(&level(Vector3::new(0.1, 0.2, 1.0), Matrix3::identity()));
        let wanted = Vector3::new(1.1, 1.8, -0.47);
        assert!((pose.position_world - wanted).norm() < 1e-12, "{pose:?}");
    }

    fn transform() -> impl Strategy<Value = FrameTransform> {
        (
            [-5.0..5.0f64, -5.0..5.0, -5.0..5.0],
            [-3.0..3.0f64, -1.5..1.5, -3.0..3.0],
        )
            .prop_map(|(position, roll_pitch_yaw)| FrameTransform {
                position,
                roll_pitch_yaw,
            })
    }

    proptest! {
        #[test]
        fn the_way_there_and_back_is_the_identity(
            world in transform(), body in transform(), pose in transform(), system in prop::sample::select(&SYSTEMS[..])
        ) {
            let calibration = Calibration::new(system, Some(&world), Some(&body));
            let pose = Transform::from(&pose);
            let pose = WorldPose { position_world: pose.translation, world_from_body: pose.rotation };
            let back = calibration.world_pose(&calibration.capture_pose(&pose));
            prop_assert!((back.position_world - pose.position_world).norm() < 1e-12);
            prop_assert!((back.world_from_body - pose.world_from_body).norm() < 1e-12);
            prop_assert!(defect(&back.world_from_body) < 1e-12);
        }
    }
}
