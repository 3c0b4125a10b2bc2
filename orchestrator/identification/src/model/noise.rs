//! Noise of the captures.
//!
//! The third difference of equally spaced positions consists of that of their noise, of variance (1 + 9 + 9 + 1) σ², and that of
//! the motion, jerk times the cube of the spacing, which is at most a tenth of a millimetre at 100 Hz. The median of its
//! magnitude is robust against single wrong captures. Attitudes are treated alike, as rotation vectors between captures.

use metrics::{CERTAIN, CONFIDENCE};
use nalgebra::{Matrix3, Vector3};
use shared_types::rotation::from_row_major;
use shared_types::rotation::log;
use shared_types::samples::MocapPose;
use statistics::{quantile, student};

use super::report::Quantity;

/// Median of the magnitude of a standard normal variable.
const MEDIAN_MAGNITUDE: f64 = 0.674_489_750_196_081_7;

/// Variance of a third difference of independent variables of variance 1.
const OF_THIRD_DIFFERENCE: f64 = 20.0;

/// Number of parts of a flight whose medians are compared.
const PARTS: usize = 16;

/// Relative error of the deviation due to the vehicle's motion within the spacing of captures.
const BY_MOTION: f64 = 0.05;

/// Relative tolerance within which intervals between captures count as equal.
const EQUAL: f64 = 0.2;

/// Returns the standard deviation of a position's components (m) and of the attitude about each axis (rad), without the stated
/// values.
#[must_use]
pub fn from_captures<'a>(poses: impl Iterator<Item = &'a MocapPose>) -> [Quantity; 2] {
    let tracked: Vec<&MocapPose> = poses.filter(|pose| pose.is_whole()).collect();
    let (mut positions, mut attitudes) = (Vec::new(), Vec::new());
    for captures in tracked
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

/// Returns the standard deviation of the variable whose third differences are given, with its intervals.
///
/// The scatter of the medians of parts of the flight gives the uncertainty of the overall median, even if neighbours are
/// correlated. The possible influence of the motion is added to it.
fn deviation(differences: Vec<f64>) -> Quantity {
    let sizes: Vec<f64> = differences.into_iter().map(f64::abs).collect();
    let found = deviation_by_median(&sizes);
    let parts: Vec<f64> = sizes
        .chunks(sizes.len().div_ceil(PARTS).max(1))
        .map(deviation_by_median)
        .collect();
    let half_width = |confidence: f64| {
        let by_chance = half_width_of_mean(&parts, confidence);
        (by_chance * by_chance + BY_MOTION * BY_MOTION * found * found).sqrt()
    };
    Quantity {
        stated: 0.0,
        found,
        error: half_width(CONFIDENCE),
        certain: half_width(CERTAIN),
    }
}

/// Returns the half-width of the interval of the mean of independent values; infinite for a single one.
fn half_width_of_mean(values: &[f64], confidence: f64) -> f64 {
    if values.len() < 2 {
        return f64::INFINITY;
    }
    let count = values.len() as f64;
    let mean = values.iter().sum::<f64>() / count;
    let squares: f64 = values.iter().map(|value| (value - mean) * (value - mean)).sum();
    student::two_sided(confidence, values.len() - 1) * (squares / (count * (count - 1.0))).sqrt()
}

/// Returns the standard deviation by the median of the magnitudes of third differences.
fn deviation_by_median(sizes: &[f64]) -> f64 {
    let median = quantile::median_of(sizes.iter().copied()).unwrap_or(0.0);
    median / (MEDIAN_MAGNITUDE * OF_THIRD_DIFFERENCE.sqrt())
}
