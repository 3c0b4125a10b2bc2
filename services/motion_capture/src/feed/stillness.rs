//! Stillness: detects parts of a pose that are frozen while the rest changes.
//!
//! Cameras have noise in every part of a pose, so a repeated value is stale or was never measured: a tracker of single
//! markers sends a constant attitude, and a filter in the capture program may hold a heading. Position and attitude are
//! compared bit for bit with those of the previous frame. A coordinate of the position, or the heading, can be equal by
//! chance, so it counts as frozen after [`FRAMES`] frames in which the others change. All are compared in the system's own
//! frame: in a rotated frame, a frozen coordinate would change with the others. In a simulator without noise, a body at
//! rest has no changing part and does not count as frozen.

use std::fmt;

use nalgebra::Matrix3;
use shared_types::rotation::roll_pitch_yaw;

use super::PoseParts;
use crate::conventions::Transform;
use crate::wire::CapturePose;

/// Consecutive frames without a change after which a coordinate counts as frozen. Few, because its error until then acts on
/// a filter as a velocity. Cameras with 20 µm of noise that send single precision repeat a coordinate once in 300 frames.
const FRAMES: u8 = 3;
/// Changes below which a coordinate is still, and above which it moves: m, and rad. Camera noise is above both; the
/// rounding of a heading in single precision is below the first.
const STILL: [f64; 2] = [1e-9, 5e-7];
const MOVES: [f64; 2] = [1e-6, 1e-5];

/// Part of a pose that can freeze while the others change.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PosePart {
    /// The whole pose.
    Pose,
    /// The position.
    Position,
    /// The attitude.
    Attitude,
    /// One coordinate in the system's frame: x, y, z or the heading about its upward axis.
    Coordinate(usize),
}

impl PosePart {
    /// Index of the heading among the coordinates.
    const HEADING: usize = 3;

    /// Returns the valid parts of a pose in which this part is frozen.
    pub(super) fn remaining_parts(self) -> Option<PoseParts> {
        match self {
            Self::Pose => None,
            Self::Attitude | Self::Coordinate(Self::HEADING) => Some(PoseParts::Position),
            Self::Position | Self::Coordinate(_) => Some(PoseParts::Attitude),
        }
    }
}

impl fmt::Display for PosePart {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str(match self {
            Self::Pose => "pose",
            Self::Position => "position",
            Self::Attitude => "attitude",
            Self::Coordinate(index) => ["x", "y", "z", "heading"][*index],
        })
    }
}

/// Last pose, and the number of frames for which each coordinate has not changed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Stillness {
    z_up_from_capture: Matrix3<f64>,
    pub(super) last: Option<CapturePose>,
    pub(super) still_for: [u8; 4],
}

impl Stillness {
    /// Makes the detector of a system with this frame, before the first pose.
    pub(super) fn new(world_from_capture: &Transform) -> Self {
        Self {
            z_up_from_capture: z_up_from_capture(&world_from_capture.rotation),
            last: None,
            still_for: [0; 4],
        }
    }

    /// Adds the next pose. Returns the frozen part, if any.
    pub(super) fn update(&mut self, pose: &CapturePose) -> Option<PosePart> {
        let (position, rotation) = (pose.position, pose.capture_from_markers);
        let last = self.last.replace(*pose)?;
        let [dx, dy, dz] = (position - last.position).abs().into();
        let [before, now] = [&last.capture_from_markers, &rotation]
            .map(|rotation| roll_pitch_yaw(&(self.z_up_from_capture * rotation)));
        let [roll, pitch, yaw] = std::array::from_fn(|axis| (now[axis] - before[axis]).abs());
        for (still_for, (change, others, kind)) in self.still_for.iter_mut().zip([
            (dx, dy.max(dz), 0),
            (dy, dz.max(dx), 0),
            (dz, dx.max(dy), 0),
            (yaw, roll.max(pitch), 1),
        ]) {
            if change > STILL[kind] {
                *still_for = 0;
            } else if others > MOVES[kind] {
                *still_for = still_for.saturating_add(1);
            }
        }
        let is_still = |index: &usize| self.still_for[*index] >= FRAMES;
        let frozen_position = if position == last.position {
            Some(PosePart::Position)
        } else {
            (0..PosePart::HEADING).find(is_still).map(PosePart::Coordinate)
        };
        let frozen_attitude = if rotation == last.capture_from_markers {
            Some(PosePart::Attitude)
        } else {
            Some(PosePart::HEADING).filter(is_still).map(PosePart::Coordinate)
        };
        match (frozen_position, frozen_attitude) {
            (Some(_), Some(_)) => Some(PosePart::Pose),
            (part, None) | (None, part) => part,
        }
    }
}

/// Returns the cyclic permutation of axes after which the most vertical axis of the system is z: the heading is the
/// rotation about it.
fn z_up_from_capture(world_from_capture: &Matrix3<f64>) -> Matrix3<f64> {
    let vertical = world_from_capture.row(2).abs();
    let x_to_y = Matrix3::new(0.0, 0.0, 1.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0);
    match vertical.transpose().imax() {
        0 => x_to_y * x_to_y,
        1 => x_to_y,
        _ => Matrix3::identity(),
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector3;
    use scenario::{CaptureSystem, FrameTransform};
    use shared_types::rotation::from_roll_pitch_yaw;

    use super::*;
    use crate::conventions::Calibration;

    fn stillness(system: CaptureSystem, world_from_capture: Option<&FrameTransform>) -> Stillness {
        Stillness::new(&Calibration::new(system, world_from_capture, None).world_from_capture)
    }

    /// Pose of a frame with the noise of good cameras, 20 µm and 0.1 mrad, on all coordinates but those that are frozen.
    fn pose(frame: u32, is_frozen: [bool; 6]) -> CapturePose {
        let mut coordinates = [1.0, -2.0, -1.5, 0.05, -0.02, 1.0];
        for (index, coordinate) in (0_u32..).zip(&mut coordinates) {
            let phase = f64::from(frame * (index + 3)) * 1.7;
            let noise = if index < 3 { 2e-5 } else { 1e-4 };
            if !is_frozen[index as usize] {
                *coordinate += noise * libm::sin(phase);
            }
        }
        let [x, y, z, roll, pitch, yaw] = coordinates;
        CapturePose {
            position: Vector3::new(x, y, z),
            capture_from_markers: from_roll_pitch_yaw([roll, pitch, yaw]),
        }
    }

    fn frozen(is_frozen: [bool; 6], frames: u32) -> Option<PosePart> {
        let mut stillness = stillness(CaptureSystem::Vrpn, None);
        (0..frames).fold(None, |_, frame| stillness.update(&pose(frame, is_frozen)))
    }

    #[test]
    fn cameras_with_noise_are_never_frozen() {
        let mut stillness = stillness(CaptureSystem::Vrpn, None);
        assert!((0..10_000).all(|frame| stillness.update(&pose(frame, [false; 6])).is_none()));
    }

    #[test]
    fn each_part_that_freezes_alone_is_found() {
        let (position, attitude) = (
            [true, true, true, false, false, false],
            [false, false, false, true, true, true],
        );
        assert_eq!(frozen([true; 6], 2), Some(PosePart::Pose));
        assert_eq!(frozen(position, 2), Some(PosePart::Position));
        assert_eq!(frozen(attitude, 2), Some(PosePart::Attitude));
        for (index, frozen_one) in [0, 1, 2, 5].into_iter().enumerate() {
            let one = std::array::from_fn(|other| other == frozen_one);
            assert_eq!(frozen(one, u32::from(FRAMES)), None);
            assert_eq!(
                frozen(one, u32::from(FRAMES) + 1),
                Some(PosePart::Coordinate(index))
            );
        }
    }

    /// Cameras whose frame is turned against {I}, and those whose y axis points up.
    #[test]
    fn a_coordinate_of_the_cameras_that_freezes_is_found_however_their_frame_is_turned() {
        let turned = |roll_pitch_yaw| FrameTransform {
            position: [0.3, -0.2, 0.1],
            roll_pitch_yaw,
        };
        let half_a_turn = std::f64::consts::PI;
        let transforms = [
            turned([half_a_turn, 0.0, 0.6]),
            turned([half_a_turn + 0.02, -0.03, -2.0]),
        ];
        for transform in &transforms {
            for (index, frozen_one) in [0, 1, 2, 5].into_iter().enumerate() {
                let mut stillness = stillness(CaptureSystem::Vrpn, Some(transform));
                let one = std::array::from_fn(|other| other == frozen_one);
                let found = (0..20).fold(None, |_, frame| stillness.update(&pose(frame, one)));
                assert_eq!(found, Some(PosePart::Coordinate(index)));
            }
        }
        // At a heading of a quarter turn roll, pitch and yaw in the frame itself are not defined.
        for heading in [0.0, 1.0, half_a_turn / 2.0, 3.0] {
            let mut stillness = stillness(CaptureSystem::Natnet, None);
            let level = Matrix3::new(1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, -1.0, 0.0);
            let mut found = [None; 2];
            for (found, is_frozen) in found.iter_mut().zip([true, false]) {
                for frame in 0..20 {
                    let noise = pose(frame, [false, false, false, false, false, is_frozen]);
                    let about_z = from_roll_pitch_yaw([0.0, 0.0, heading]) * noise.capture_from_markers;
                    *found = stillness.update(&CapturePose {
                        position: noise.position,
                        capture_from_markers: level * about_z * level.transpose(),
                    });
                }
            }
            assert_eq!(found, [Some(PosePart::Coordinate(3)), None], "{heading}");
        }
    }

    #[test]
    fn a_simulator_without_noise_whose_body_comes_to_rest_is_not_frozen() {
        let mut stillness = stillness(CaptureSystem::Vrpn, None);
        for frame in 0..1000 {
            let near = 1e-3 * libm::exp(-0.1 * f64::from(frame)) + 1e-13 * f64::from(frame);
            let pose = CapturePose {
                position: Vector3::new(near, 1.0 + near, -1.0 - near),
                capture_from_markers: from_roll_pitch_yaw([near, -near, 0.5 + near]),
            };
            assert_eq!(stillness.update(&pose), None, "frame {frame}");
        }
    }

    /// Neither part is handed out once something in each of them is frozen.
    #[test]
    fn parts_that_freeze_at_once_are_the_whole_pose() {
        let (position, attitude) = ([true, true, true], [true, true, true]);
        let (coordinate, heading) = ([false, true, false], [false, false, true]);
        for frozen_position in [position, coordinate] {
            for frozen_attitude in [attitude, heading] {
                let is_frozen = [frozen_position, frozen_attitude].concat().try_into().unwrap();
                assert_eq!(frozen(is_frozen, u32::from(FRAMES) + 1), Some(PosePart::Pose));
            }
        }
    }

    #[test]
    fn what_moves_again_is_no_longer_frozen() {
        let mut stillness = stillness(CaptureSystem::Vrpn, None);
        for frame in 0..50 {
            stillness.update(&pose(frame, [false, false, false, false, false, true]));
        }
        assert_eq!(stillness.update(&pose(50, [false; 6])), None);
    }
}
