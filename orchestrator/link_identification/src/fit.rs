//! A line through points, by least squares.

use serde::Serialize;

/// Points below which there is no line.
const FEWEST: usize = 10;

/// Neighbouring points whose residuals may depend on each other.
const CLUSTER: usize = 10;

/// Half-width of a 95 % interval, standard errors.
const INTERVAL: f64 = 2.1;

/// value = offset + slope · travel.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Fit {
    /// Value at a travel of 0, N or rad/s.
    pub offset: f64,
    /// Value per unit of travel, N or rad/s.
    pub slope: f64,
    /// Half-widths of the 95 % intervals of offset and slope: of independent residuals, or of clusters of neighbours where these
    /// are wider, because windows overlap and gusts last.
    pub errors: [f64; 2],
    /// Standard deviation of what the line does not explain, N or rad/s.
    pub residual: f64,
    /// Share of the variance that the line explains.
    pub explained: f64,
    /// Standard deviation of the travel.
    pub travel_deviation: f64,
    /// Points.
    pub points: usize,
}

impl Fit {
    /// The line through points (travel, value); `None` if they are few or their travels are all the same.
    #[must_use]
    pub fn of(points: &[[f64; 2]]) -> Option<Self> {
        if points.len() < FEWEST {
            return None;
        }
        let count = points.len() as f64;
        let mean = [0, 1].map(|of| points.iter().map(|point| point[of]).sum::<f64>() / count);
        let (mut xx, mut xy, mut yy) = (0.0, 0.0, 0.0);
        for [x, y] in points {
            let (x, y) = (x - mean[0], y - mean[1]);
            xx += x * x;
            xy += x * y;
            yy += y * y;
        }
        let slope = xy / xx;
        let unexplained = (yy - slope * xy).max(0.0);
        let variance = unexplained / (count - 2.0);
        let independent = [variance * (1.0 / count + mean[0] * mean[0] / xx), variance / xx];
        let clustered = clustered_variances(points, mean, slope, xx);
        let errors = [0, 1].map(|of| INTERVAL * independent[of].max(clustered[of]).sqrt());
        let fit = Self {
            offset: mean[1] - slope * mean[0],
            slope,
            errors,
            residual: variance.sqrt(),
            explained: 1.0 - unexplained / yy,
            travel_deviation: (xx / count).sqrt(),
            points: points.len(),
        };
        let is_whole = xx > 0.0 && yy > 0.0 && fit.slope.is_finite() && fit.errors[0].is_finite();
        is_whole.then_some(fit)
    }
}

/// Returns the variances of offset and slope if the residuals of [`CLUSTER`] neighbours depend on each other: the sandwich
/// estimate.
fn clustered_variances(points: &[[f64; 2]], mean: [f64; 2], slope: f64, xx: f64) -> [f64; 2] {
    let count = points.len() as f64;
    let clusters = points.chunks(CLUSTER);
    let freedom = (clusters.len() as f64 - 2.0).max(1.0);
    let factor = clusters.len() as f64 / freedom;
    let mut variances = [0.0; 2];
    for cluster in clusters {
        let (mut offset, mut slopes) = (0.0, 0.0);
        for [x, y] in cluster {
            let residual = (y - mean[1]) - slope * (x - mean[0]);
            offset += residual * (1.0 / count - mean[0] * (x - mean[0]) / xx);
            slopes += residual * (x - mean[0]) / xx;
        }
        variances[0] += factor * offset * offset;
        variances[1] += factor * slopes * slopes;
    }
    variances
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn points_on_a_line_give_the_line(offset in -5.0..5.0f64, slope in -20.0..20.0f64) {
            prop_assume!(slope.abs() > 0.1);
            let points: Vec<_> = (0..50).map(|x| f64::from(x) / 25.0 - 1.0).map(|x| [x, offset + slope * x]).collect();
            let fit = Fit::of(&points).unwrap();
            prop_assert!((fit.offset - offset).abs() < 1e-9 && (fit.slope - slope).abs() < 1e-9);
            prop_assert!(fit.residual < 1e-6 && fit.explained > 1.0 - 1e-9);
        }
    }

    #[test]
    fn a_stick_that_never_moved_has_no_line() {
        assert_eq!(Fit::of(&[[0.5, 1.0]; 100]), None);
        assert_eq!(Fit::of(&[[0.0, 0.0], [1.0, 1.0]]), None);
    }

    #[test]
    fn the_interval_is_that_of_the_spread() {
        // Values ±1 around a line: the variance of the slope is 1/Σx².
        let points: Vec<_> = (0..400)
            .map(|at| {
                [
                    f64::from(at / 2) / 100.0 - 0.995,
                    if at % 2 == 0 { 1.0 } else { -1.0 },
                ]
            })
            .collect();
        let fit = Fit::of(&points).unwrap();
        let xx: f64 = points.iter().map(|[x, _]| x * x).sum();
        assert!(fit.slope.abs() < 1e-9 && (fit.errors[1] * xx.sqrt() - INTERVAL).abs() < 0.03);
    }
}
