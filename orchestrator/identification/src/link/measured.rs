//! Measured thrust and body rates with the sticks that commanded them: points (travel, value) for each stick.
//!
//! * From poses, the rates follow from the rotation between captures a tenth of a second apart. The thrust needs the
//!   acceleration, and differences of noisy positions are too coarse for it: with a smooth weight φ that vanishes at the ends
//!   of a window, ∫φ p̈ = ∫φ̈ p, so that only the weight is differentiated. With a fixed direction n, m ∫φ (g − p̈)·n = ∫φ T
//!   n·R e₃: the thrust is weighted by the angle between n and the turning thrust axis. A disturbance along the thrust axis
//!   counts as thrust, and the controller moves the stick against it. The desired thrust of the path is correlated with the
//!   stick and not with disturbances, and is the instrument of the fit.
//! * From the truth, both are read directly.

use nalgebra::{Matrix3, Vector3};
use scenario::GRAVITY;
use shared_types::rotation::{from_row_major, log};
use shared_types::samples::{MocapPose, PathReference, VehicleTruth};
use shared_types::service::seconds;

use super::FrameSource;
use super::fit::Point;
use super::history::History;

/// Time over which a rotation is measured, s.
const TURN: f64 = 0.1;

/// Half the window of an acceleration, s.
const HALF_WINDOW: f64 = 0.15;

/// Minimum number of captures in a window.
const MIN_CAPTURES: usize = 12;

/// Time between two points from the truth, s.
const TRUTH_STEP: f64 = 0.01;

/// Number of neighbouring points of each stick whose residuals may be correlated: gusts along the thrust axis last for seconds,
/// and rates follow their commands at once.
pub(super) const DEPENDENT: [usize; 4] = [27, 10, 10, 10];

/// Time from the first frame in the air to the first point, with a margin for jitter, s.
const BEFORE: f64 = 1.0;

/// Returns the time between points of each stick, s.
pub(super) const fn spacings(source: FrameSource) -> [f64; 4] {
    match source {
        FrameSource::Poses => [HALF_WINDOW, TURN, TURN, TURN],
        FrameSource::Truth => [TRUTH_STEP; 4],
    }
}

/// Returns the flight time that gives a number of points, rounded up to whole s.
pub(super) fn needed(points: usize, spacing: f64) -> f64 {
    (points as f64 * spacing + BEFORE).ceil()
}

/// Points of each stick.
pub(super) type Points = [Vec<Point>; 4];

/// Desired acceleration, valid from a time on.
#[derive(Clone, Copy, Debug)]
pub(super) struct DesiredAcceleration {
    time: f64,
    acceleration: Vector3<f64>,
}

impl DesiredAcceleration {
    pub(super) fn new(reference: &PathReference) -> Self {
        let [d1, d2] = [reference.derivative1_world, reference.derivative2_world].map(Vector3::from);
        Self {
            time: seconds(reference.header.stamp_ns),
            acceleration: d2 * (reference.gamma_dot * reference.gamma_dot) + d1 * reference.gamma_ddot,
        }
    }

    /// Returns the newest acceleration at a time; `all` is in the order of time.
    fn at(all: &[Self], time: f64) -> Option<Vector3<f64>> {
        let next = all.partition_point(|desired| desired.time <= time);
        Some(all[next.checked_sub(1)?].acceleration)
    }
}

/// A captured pose.
#[derive(Clone, Copy, Debug)]
pub(super) struct Pose {
    time: f64,
    position: Vector3<f64>,
    rotation: Matrix3<f64>,
}

impl Pose {
    pub(super) fn new(pose: &MocapPose) -> Self {
        Self {
            time: seconds(pose.capture_time_ns),
            position: pose.position_world.into(),
            rotation: from_row_major(&pose.world_from_body),
        }
    }
}

/// True thrust and rates.
#[derive(Clone, Copy, Debug)]
pub(super) struct Truth {
    time: f64,
    values: [f64; 4],
}

impl Truth {
    pub(super) fn new(truth: &VehicleTruth) -> Self {
        let [x, y, z] = truth.angular_velocity_body;
        Self {
            time: seconds(truth.header.stamp_ns),
            values: [truth.thrust, x, y, z],
        }
    }
}

/// Returns the points from the truth.
pub(super) fn by_truth(truths: &[Truth], history: &History) -> Points {
    let mut points = Points::default();
    let mut next = f64::NEG_INFINITY;
    for truth in truths {
        if truth.time < next {
            continue;
        }
        next = truth.time + TRUTH_STEP * (1.0 - 1e-6);
        if let Some(travels) = history.at(truth.time) {
            for stick in 0..4 {
                points[stick].push(Point::new(travels[stick], truth.values[stick]));
            }
        }
    }
    points
}

/// Returns the points from poses in the order of time, for a vehicle of this mass, kg.
pub(super) fn by_poses(
    poses: &[Pose],
    desired: &[DesiredAcceleration],
    mass: f64,
    history: &History,
) -> Points {
    let mut points = Points::default();
    let [mut turn, mut window] = [0, 0];
    for (index, pose) in poses.iter().enumerate() {
        let begun = &poses[turn];
        let lasted = pose.time - begun.time;
        if lasted >= TURN * (1.0 - 1e-6) {
            turn = index;
            let travels = history.mean(begun.time, pose.time);
            if let Some(travels) = travels.filter(|_| lasted < 1.5 * TURN) {
                let rates = log(&(begun.rotation.transpose() * pose.rotation)) / lasted;
                for axis in 0..3 {
                    points[1 + axis].push(Point::new(travels[1 + axis], rates[axis]));
                }
            }
        }
        if pose.time - poses[window].time >= 2.0 * HALF_WINDOW * (1.0 - 1e-6) {
            points[0].extend(thrust_point(&poses[window..=index], desired, mass, history));
            window = usize::midpoint(window, index);
        }
    }
    points
}

/// Returns the weighted means of the thrust stick and of the thrust over a window.
fn thrust_point(
    window: &[Pose],
    desired: &[DesiredAcceleration],
    mass: f64,
    history: &History,
) -> Option<Point> {
    let (first, last) = (window.first()?, window.last()?);
    let half = (last.time - first.time) / 2.0;
    let widest = 4.0 * half / window.len() as f64;
    let has_gap = window.windows(2).any(|pair| pair[1].time - pair[0].time > widest);
    if window.len() < MIN_CAPTURES || has_gap {
        return None;
    }
    history.mean(first.time, last.time)?;
    let middle = first.time + half;
    let axes = window
        .iter()
        .fold(Vector3::zeros(), |sum, pose| sum + pose.rotation.column(2));
    let direction: Vector3<f64> = axes.normalize();
    let (mut weights, mut thrusts, mut travel) = (0.0, 0.0, 0.0);
    let (mut acceleration, mut desired_acceleration) = (0.0, 0.0);
    for (index, pose) in window.iter().enumerate() {
        // Integration weight by the trapezoidal rule.
        let before = window[index.saturating_sub(1)].time;
        let after = window[(index + 1).min(window.len() - 1)].time;
        let share = (after - before) / 2.0;
        let u = (pose.time - middle) / half;
        let inside = 1.0 - u * u;
        let weight = share * inside * inside * inside;
        let bend = share * (24.0 * u * u * inside - 6.0 * inside * inside) / (half * half);
        let along = weight * direction.dot(&pose.rotation.column(2));
        weights += weight;
        thrusts += along;
        travel += along * history.at(pose.time)?[0];
        acceleration += bend * direction.dot(&(pose.position - first.position));
        desired_acceleration += weight * direction.dot(&DesiredAcceleration::at(desired, pose.time)?);
    }
    let weight_along = GRAVITY * direction.z * weights;
    Some(Point {
        travel: travel / thrusts,
        value: mass * (weight_along - acceleration) / thrusts,
        instrument: (weight_along - desired_acceleration) / thrusts,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use shared_types::rotation::exp;

    #[test]
    fn the_logarithm_takes_the_exponential_back() {
        for turn in [[0.0; 3], [1e-12, 0.0, 0.0], [0.3, -0.2, 0.5], [0.0, 2.0, -1.0]] {
            let turn = Vector3::from(turn);
            assert!((log(&exp(&turn)) - turn).norm() < 1e-12);
        }
    }
}
