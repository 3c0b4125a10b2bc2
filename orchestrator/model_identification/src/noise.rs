//! Scatter of the captures.
//!
//! The third difference of equally spaced positions is that of their noise, of variance (1 + 9 + 9 + 1) σ², and of the
//! motion, jerk times the cube of the spacing, which is a tenth of a millimetre at most at 100 Hz. The median of its
//! magnitude is no matter of single wrong captures. Attitudes are treated alike, as rotation vectors between captures.

use estimator::kalman::attitude::log;
use nalgebra::{Matrix3, Vector3};
use shared_types::rotation::from_row_major;
use shared_types::samples::MocapPose;

use crate::report::Quantity;

/// Median of the magnitude of a normal variable of deviation 1.
const MEDIAN_MAGNITUDE: f64 = 0.674_489_750_196_081_7;

/// Variance of a third difference of independent variables of variance 1.
const OF_THIRD_DIFFERENCE: f64 = 20.0;

/// Part by which intervals between captures may differ and count as equal.
const EQUAL: f64 = 0.2;

/// Returns the deviation of a position's components (m) and of the attitude about each axis (rad), each without what is
/// stated.
#[must_use]
pub fn of_captures<'a>(poses: impl Iterator<Item = &'a MocapPose>) -> [Quantity; 2] {
    let seen: Vec<&MocapPose> = poses.filter(|pose| pose.tracked.is_set()).collect();
    let (mut positions, mut attitudes) = (Vec::new(), Vec::new());
    for captures in seen
        .array_windows::<4>()
        .filter(|captures| are_equally_spaced(captures))
    {
        let [a, b, c, d] = captures.map(|pose| Vector3::from(pose.position_world));
        positions.extend((d - (c - b) * 3.0 - a).iter());
        let rotations = captures.map(|pose| from_row_major(&pose.world_from_body));
        let turned = |from: &Matrix3<f64>, to: &Matrix3<f64>| log(&from.tr_mul(to));
        let [a, b, c, d] = &rotations;
        attitudes.extend((turned(c, d) - turned(b, c) * 2.0 + turned(a, b)).iter());
    }
    [positions, attitudes].map(deviation)
}

fn are_equally_spaced(captures: &[&MocapPose; 4]) -> bool {
    let times = captures.map(|pose| pose.capture_time_ns as f64);
    let mean = (times[3] - times[0]) / 3.0;
    times
        .array_windows::<2>()
        .all(|[from, to]| (to - from - mean).abs() <= EQUAL * mean)
        && mean > 0.0
}

/// Returns the deviation of what third differences were taken of, with its standard error.
fn deviation(mut differences: Vec<f64>) -> Quantity {
    for difference in &mut differences {
        *difference = difference.abs();
    }
    differences.sort_by(f64::total_cmp);
    let median = differences.get(differences.len() / 2).copied().unwrap_or(0.0);
    let found = median / (MEDIAN_MAGNITUDE * OF_THIRD_DIFFERENCE.sqrt());
    Quantity {
        stated: 0.0,
        found,
        // Of a median's: some 1.2 times σ/√n, and neighbours are not independent.
        error: 2.0 * found / (differences.len().max(1) as f64).sqrt(),
    }
}
