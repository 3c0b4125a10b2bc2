//! Likely causes of wrong axes and signs, from the movements of a hand test.
//!
//! With M the axes of the program as {I} shows them (W e_x, W e_y, W e_z) and B those of the body, a proper system measures
//! W R Bᵀ. Displacements show W: lifting −W e_z, carrying W e_x. Rotation vectors in {B} show B: a tilt to the right B e_x,
//! nose down −B e_y, a turn to the left −B e_z. In {I} a turn to the left is a turn about the direction of lifting; in
//! mirrored axes it is the opposite.

use std::fmt::{Display, Formatter};

use nalgebra::{Matrix3, Vector3};
use shared_types::rotation::{angle_between, orthonormalized, roll_pitch_yaw};

use crate::steps::Step;
use crate::test::{Rest, StepResult, Verdict};

/// Cosine above which two directions are the same axis: of 45° and less, as steps fail from 30° on.
const SAME: f64 = 0.7;

/// Angle from which axes are turned, rad: more than a hand is wrong by.
const TURNED: f64 = 0.26;

/// Angle within which two rotations are the same, rad.
const SAME_ROTATION: f64 = 0.5;

/// Tilt at rest from which the body was created while it was not level, rad.
pub const NOT_LEVEL: f64 = 0.087;

/// Volume of three rotation axes below which two of them are the same.
const SAME_AXES: f64 = 0.3;

/// Likely cause of a wrong movement.
#[derive(Clone, Debug, PartialEq)]
pub enum Cause {
    /// Axes are left-handed.
    Mirrored,
    /// The vertical axis of the program is another one than assumed.
    UpAxis {
        /// What rises or falls when the vehicle is lifted.
        seen: String,
    },
    /// Up and down are exchanged.
    UpsideDown,
    /// The program's horizontal axes are turned about the vertical, to the right, rad.
    CamerasTurned(f64),
    /// The body was created while the vehicle was turned to the right of x, rad.
    BodyTurned(f64),
    /// The body was created upside down.
    BodyUpsideDown,
    /// The axes of the body have another rotation, as roll, pitch and yaw, rad.
    BodyRotated([f64; 3]),
    /// Roll and pitch are exchanged.
    RollAndPitchExchanged,
    /// Axes of rotation are exchanged otherwise.
    Exchanged,
    /// Rotations about an axis have the wrong sign: roll, pitch or yaw.
    Reversed(&'static str),
    /// The body was created while it was not level: tilt at rest, rad.
    NotLevel(f64),
    /// The height at rest is not that of the ground: z and the stated ground, m.
    OffTheGround([f64; 2]),
    /// Two movements turned the vehicle about the same axis.
    SameAxis,
    /// The movement of a step was wrong, and no cause explains it.
    Unexplained(Step),
}

impl Display for Cause {
    fn fmt(&self, formatter: &mut Formatter<'_>) -> std::fmt::Result {
        let side = |angle: f64| if angle > 0.0 { "right" } else { "left" };
        match self {
            Self::Mirrored => formatter.write_str(
                "the axes are mirrored (left-handed): a turn to the left is one to the right in them; no transform of the scenario \
                 repairs that, so change them in the capture program or in what relays its poses",
            ),
            Self::UpAxis { seen } => write!(
                formatter,
                "the up axis of the program is another one than here (Y in one of them, Z in the other): when lifted, {seen}, \
                 not z; change the up axis in the program, or state `motion_capture.world_from_capture`"
            ),
            Self::UpsideDown => formatter.write_str(
                "up and down are exchanged: z points down in {I}, so it must fall when the vehicle is lifted; \
                 `motion_capture.world_from_capture` lacks the half turn about x",
            ),
            Self::CamerasTurned(angle) => write!(
                formatter,
                "the axes of the camera system are turned by {:.0}° to the {} of the room's: +x of the room is not its x; \
                 turn them in the program, or state `motion_capture.world_from_capture`",
                angle.abs().to_degrees(),
                side(*angle)
            ),
            Self::BodyTurned(angle) => write!(
                formatter,
                "the body was created turned by {:.0}° to the {}: create it again with the nose along the program's x axis, or \
                 write its transform with `gerono mocap probe --calibrate`",
                angle.abs().to_degrees(),
                side(*angle)
            ),
            Self::BodyUpsideDown => formatter.write_str(
                "the body was created upside down, or `motion_capture.body_from_markers` lacks the half turn about x: create it \
                 again while the vehicle stands level, or use `gerono mocap probe --calibrate`",
            ),
            Self::BodyRotated(angles) => {
                let [roll, pitch, yaw] = angles.map(f64::to_degrees);
                write!(
                    formatter,
                    "the body was created turned: roll {roll:.0}°, pitch {pitch:.0}°, yaw {yaw:.0}°; create it again while the \
                     vehicle stands level, or use `gerono mocap probe --calibrate`"
                )
            }
            Self::RollAndPitchExchanged => formatter.write_str(
                "roll and pitch are exchanged: a relay of the poses exchanges axes of rotation, which no transform of the \
                 scenario repairs",
            ),
            Self::Exchanged => formatter.write_str(
                "the axes of rotation are exchanged with a change of handedness: look at what relays the poses",
            ),
            Self::Reversed(axis) => write!(
                formatter,
                "{axis} has the wrong sign, or the vehicle was moved the other way: a relay of the poses reverses it, which no \
                 transform of the scenario repairs"
            ),
            Self::NotLevel(angle) => write!(
                formatter,
                "at rest it is tilted by {:.1}°: the body was created while it was not level, or the ground is not; create it \
                 again, or use `gerono mocap probe --calibrate`",
                angle.to_degrees()
            ),
            Self::OffTheGround([z, ground]) => write!(
                formatter,
                "at rest z is {z:.2} m, and the ground is at {ground:.2} m: the origin is not on the ground, or the body's pivot \
                 is not at the vehicle; state `flight.ground`, or correct the origin"
            ),
            Self::SameAxis => formatter.write_str(
                "two of the movements turned it about the same axis: repeat the test and do one movement at a time",
            ),
            Self::Unexplained(step) => write!(
                formatter,
                "the step `{}` showed another movement than asked for: repeat the test",
                step.name()
            ),
        }
    }
}

/// Returns the likely causes, the most fundamental one first; none if the test was passed. `ground` is z of the ground and
/// the distance from it that is permitted, m.
#[must_use]
pub fn causes(rest: Option<&Rest>, results: &[StepResult], [ground, tolerance]: [f64; 2]) -> Vec<Cause> {
    let moved = |step: Step| results.iter().find(|result| result.step == step);
    let judged = |step| moved(step).and_then(|result| result.movement.judged(step).try_normalize(1e-9));
    let world = judged(Step::Lift)
        .zip(judged(Step::CarryAlongX))
        .map(|(lift, x)| axes_of_cameras(&lift, &x));
    let body = rotations(
        judged(Step::TiltRight),
        judged(Step::NoseDown),
        judged(Step::TurnLeft),
    );
    let about_up = moved(Step::TurnLeft).and_then(|turn| {
        let turn_world = turn.movement.world.try_normalize(1e-9)?;
        Some(turn_world.dot(&judged(Step::Lift)?))
    });
    let mut causes = match &body {
        Some(body) if body.determinant() < -SAME_AXES => improper(body),
        Some(body) if body.determinant() > SAME_AXES && about_up.is_some_and(|about| about < -SAME) => {
            return vec![Cause::Mirrored];
        }
        _ => Vec::new(),
    };
    let is_proper = causes.is_empty();
    let turned = world
        .as_ref()
        .and_then(|world| world_cause(world, judged(Step::Lift)));
    let is_tumbled = matches!(turned, Some(Cause::UpAxis { .. } | Cause::UpsideDown));
    causes.extend(turned);
    if let Some(body) = body.filter(|_| is_proper) {
        if body.determinant().abs() <= SAME_AXES {
            causes.push(Cause::SameAxis);
        } else {
            let body = nearest_rotation(&body);
            // A body of the same program has its axes: one correction is enough.
            let follows =
                is_tumbled && world.is_some_and(|world| angle_between(&world, &body) < SAME_ROTATION);
            causes.extend(body_cause(&body).filter(|_| !follows));
        }
    }
    let has_up = !causes.iter().any(|cause| {
        matches!(
            cause,
            Cause::UpAxis { .. } | Cause::UpsideDown | Cause::BodyUpsideDown | Cause::BodyRotated(_)
        )
    });
    if let Some(rest) = rest.filter(|_| has_up) {
        causes.extend((rest.tilt > NOT_LEVEL).then_some(Cause::NotLevel(rest.tilt)));
    }
    if causes.is_empty() {
        let wrong = results.iter().filter(|result| result.verdict == Verdict::Wrong);
        causes.extend(wrong.map(|result| Cause::Unexplained(result.step)));
    }
    if let Some(rest) = rest.filter(|_| !is_tumbled) {
        let z = rest.position_world.z;
        causes.extend(((z - ground).abs() > tolerance).then_some(Cause::OffTheGround([z, ground])));
    }
    causes
}

/// Returns W, of right-handed axes, from the directions of lifting and of carrying along x.
fn axes_of_cameras(lift: &Vector3<f64>, x: &Vector3<f64>) -> Matrix3<f64> {
    let down = -lift;
    let along = (x - down * x.dot(&down)).try_normalize(0.1).unwrap_or(*x);
    Matrix3::from_columns(&[along, down.cross(&along), down])
}

/// Returns B, also an improper one, from the axes of the three rotations in {B}.
fn rotations(
    tilt_right: Option<Vector3<f64>>,
    nose_down: Option<Vector3<f64>>,
    turn_left: Option<Vector3<f64>>,
) -> Option<Matrix3<f64>> {
    Some(Matrix3::from_columns(&[tilt_right?, -nose_down?, -turn_left?]))
}

fn nearest_rotation(body: &Matrix3<f64>) -> Matrix3<f64> {
    (0..16).fold(*body, |rotation, _| orthonormalized(&rotation))
}

fn improper(body: &Matrix3<f64>) -> Vec<Cause> {
    let diagonal = body.diagonal();
    let is_signed = diagonal.iter().all(|element| element.abs() > SAME);
    if is_signed {
        let names = ["roll", "pitch", "yaw"].into_iter().zip(diagonal.iter());
        return names
            .filter(|(_, element)| **element < 0.0)
            .map(|(name, _)| Cause::Reversed(name))
            .collect();
    }
    let is_swapped = body[(1, 0)] > SAME && body[(0, 1)] > SAME && body[(2, 2)] > SAME;
    vec![if is_swapped {
        Cause::RollAndPitchExchanged
    } else {
        Cause::Exchanged
    }]
}

fn world_cause(world: &Matrix3<f64>, lift: Option<Vector3<f64>>) -> Option<Cause> {
    let down = world.column(2);
    if down.z < -SAME {
        return Some(Cause::UpsideDown);
    }
    if down.z < SAME {
        let seen = lift.map_or_else(String::new, |lift| Step::Lift.in_words(&lift));
        return Some(Cause::UpAxis { seen });
    }
    let turned = libm::atan2(world[(1, 0)], world[(0, 0)]);
    // The program's axis is turned the other way than the room's appears in it.
    (turned.abs() > TURNED).then_some(Cause::CamerasTurned(-turned))
}

fn body_cause(body: &Matrix3<f64>) -> Option<Cause> {
    let [roll, pitch, yaw] = roll_pitch_yaw(body);
    if body[(2, 2)] < -SAME && (body[(0, 0)] > SAME || body[(1, 1)] > SAME) {
        return Some(Cause::BodyUpsideDown);
    }
    if libm::hypot(roll, pitch) > 2.0 * TURNED {
        return Some(Cause::BodyRotated([roll, pitch, yaw]));
    }
    (yaw.abs() > TURNED).then_some(Cause::BodyTurned(yaw))
}
