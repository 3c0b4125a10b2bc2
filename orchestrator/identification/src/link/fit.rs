//! Linear regression by least squares or with an instrumental variable.
//!
//! A controller that moves a stick against disturbances correlates the stick with them, which biases least squares. An
//! instrument z is correlated with the stick and not with the disturbances: slope = Σ(z − z̄)(y − ȳ) / Σ(z − z̄)(x − x̄).
//! With z = x this is least squares.

use std::ops::Range;

use metrics::{CERTAIN, CONFIDENCE};
use nalgebra::Vector6;
use serde::Serialize;
use statistics::student;

/// Minimum number of clusters for a fit. Intervals hold with fewer as well, but are too wide to be useful.
const CLUSTERS: usize = 5;

/// Relative covariance of travel and instrument below which it is a rounding error of the sums.
const ROUNDING: f64 = 1e-9;

/// Number of parameters of a line.
const PARAMETERS: usize = 2;

/// value = offset + slope · travel.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Fit {
    /// Value at a travel of 0, N or rad/s.
    pub offset: f64,
    /// Value per unit of travel, N or rad/s.
    pub slope: f64,
    /// Half-widths of the 95 % intervals of offset and slope: for independent residuals or for clustered ones, whichever is
    /// wider. Residuals are clustered because windows overlap and gusts last.
    pub errors: [f64; 2],
    /// Half-widths of the 99.9 % intervals.
    pub certain: [f64; 2],
    /// Standard deviation of the residuals, N or rad/s.
    pub residual: f64,
    /// Share of the variance that the line explains.
    pub explained: f64,
    /// Standard deviation of the travel.
    pub travel_deviation: f64,
    /// Number of points.
    pub points: usize,
}

/// A point of a fit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Point {
    /// Travel of the stick.
    pub travel: f64,
    /// Measured value, N or rad/s.
    pub value: f64,
    /// Instrument, in any unit; the travel itself for least squares.
    pub instrument: f64,
}

impl Fit {
    /// Returns the minimum number of points for a fit, with `cluster` neighbours in a cluster.
    pub(super) const fn min_points(cluster: usize) -> usize {
        CLUSTERS * cluster
    }

    /// Fits a line to points. Returns `None` if there are fewer than `Fit::min_points`, or if travel or instrument vary in a
    /// single cluster only. `cluster` is the number of neighbours whose residuals may be correlated.
    #[must_use]
    pub fn new(points: &[Point], cluster: usize) -> Option<Self> {
        if points.len() < Self::min_points(cluster) {
            return None;
        }
        let count = points.len() as f64;
        let mean = |of: fn(&Point) -> f64| points.iter().map(of).sum::<f64>() / count;
        let center = Point {
            travel: mean(|point| point.travel),
            value: mean(|point| point.value),
            instrument: mean(|point| point.instrument),
        };
        let (mut xx, mut yy, mut zx, mut zy, mut zz) = (0.0, 0.0, 0.0, 0.0, 0.0);
        let centered: Vec<Point> = points.iter().map(|point| point.from(&center)).collect();
        for &Point {
            travel: x,
            value: y,
            instrument: z,
        } in &centered
        {
            xx += x * x;
            yy += y * y;
            zx += z * x;
            zy += z * y;
            zz += z * z;
        }
        let slope = zy / zx;
        let residual = |point: &Point| point.value - slope * point.travel;
        let unexplained: f64 = centered
            .iter()
            .map(|point| residual(point) * residual(point))
            .sum();
        let variance = unexplained / (count - 2.0);
        let of_slope = variance * zz / (zx * zx);
        let independent = [
            variance / count + center.travel * center.travel * of_slope,
            of_slope,
        ]
        .map(f64::sqrt);
        let clusters = points.len() / cluster;
        let [at_center, clustered_slope, covariance] = jackknife(&centered, clusters)?;
        let clustered = [
            at_center - 2.0 * center.travel * covariance + center.travel * center.travel * clustered_slope,
            clustered_slope,
        ]
        .map(|variance| variance.max(0.0).sqrt());
        let half_widths = |confidence: f64| {
            let quantile = |values: usize| student::two_sided(confidence, values - PARAMETERS);
            let [among_clusters, among_points] = [clusters, points.len()].map(quantile);
            [0, 1].map(|of| (among_clusters * clustered[of]).max(among_points * independent[of]))
        };
        let fit = Self {
            offset: center.value - slope * center.travel,
            slope,
            errors: half_widths(CONFIDENCE),
            certain: half_widths(CERTAIN),
            residual: variance.sqrt(),
            explained: 1.0 - unexplained / yy,
            travel_deviation: (xx / count).sqrt(),
            points: points.len(),
        };
        let are_finite = |values: [f64; 2]| values.into_iter().all(f64::is_finite);
        let is_whole = xx > 0.0 && yy > 0.0 && fit.slope.is_finite() && are_finite(clustered);
        is_whole.then_some(fit)
    }
}

impl Point {
    /// Returns a point for least squares.
    #[must_use]
    pub fn new(travel: f64, value: f64) -> Self {
        Self {
            travel,
            value,
            instrument: travel,
        }
    }

    fn from(&self, center: &Self) -> Self {
        Self {
            travel: self.travel - center.travel,
            value: self.value - center.value,
            instrument: self.instrument - center.instrument,
        }
    }
}

/// Returns the variances of the value at the centre and of the slope, and their covariance, for residuals correlated within
/// clusters of neighbours, by the jackknife: (G − 1)/G Σ d dᵀ, where d is the change of the line without one of G equal clusters.
///
/// With few clusters the sandwich estimate is too small, because the line follows the clusters with the largest travel; the
/// jackknife is conservative instead: J. G. MacKinnon, M. Ø. Nielsen and M. D. Webb, Cluster-robust inference: a guide to
/// empirical practice, Journal of Econometrics 232 (2023), 272–299.
///
/// Returns `None` if the stick moved in a single cluster only.
fn jackknife(centered: &[Point], clusters: usize) -> Option<[f64; 3]> {
    let all = sums(centered);
    let [_, slope] = line(&all);
    let share = (clusters - 1) as f64 / clusters as f64;
    let mut variances = [0.0; 3];
    for index in 0..clusters {
        let rest = all - sums(&centered[part(centered.len(), clusters, index)]);
        if covariation(&rest).abs() <= ROUNDING * covariation(&all).abs() {
            return None;
        }
        let [value, other_slope] = line(&rest);
        let change = other_slope - slope;
        let products = [value * value, change * change, value * change];
        variances = [0, 1, 2].map(|of| variances[of] + share * products[of]);
    }
    Some(variances)
}

/// Returns the range of one of `parts` parts of equal size.
fn part(count: usize, parts: usize, index: usize) -> Range<usize> {
    index * count / parts..(index + 1) * count / parts
}

/// Returns the sums over points of 1, x, y, z, zx and zy.
fn sums(points: &[Point]) -> Vector6<f64> {
    let terms = |point: &Point| {
        let (x, y, z) = (point.travel, point.value, point.instrument);
        Vector6::new(1.0, x, y, z, z * x, z * y)
    };
    points.iter().map(terms).sum()
}

/// Returns the value at 0 and the slope of the line for these sums.
fn line(sums: &Vector6<f64>) -> [f64; 2] {
    let [count, x, y, z, _, zy] = (*sums).into();
    let slope = (zy - z * y / count) / covariation(sums);
    [(y - slope * x) / count, slope]
}

/// Returns Σ(z − z̄)(x − x̄) of travel and instrument.
fn covariation(sums: &Vector6<f64>) -> f64 {
    let [count, x, _, z, zx, _] = (*sums).into();
    zx - z * x / count
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use shared_types::noise::{Noise, Stream};

    proptest! {
        #[test]
        fn points_on_a_line_give_the_line(offset in -5.0..5.0f64, slope in -20.0..20.0f64) {
            prop_assume!(slope.abs() > 0.1);
            let points: Vec<_> = (0..50).map(|x| f64::from(x) / 25.0 - 1.0).map(|x| Point::new(x, offset + slope * x)).collect();
            let fit = Fit::new(&points, 10).unwrap();
            prop_assert!((fit.offset - offset).abs() < 1e-9 && (fit.slope - slope).abs() < 1e-9);
            prop_assert!(fit.residual < 1e-6 && fit.explained > 1.0 - 1e-9);
        }
    }

    #[test]
    fn a_stick_that_never_moved_has_no_line() {
        assert_eq!(Fit::new(&[Point::new(0.5, 1.0); 100], 10), None);
        assert_eq!(Fit::new(&[Point::new(0.0, 0.0), Point::new(1.0, 1.0)], 10), None);
    }

    #[test]
    fn a_stick_that_moved_in_one_cluster_alone_has_no_line() {
        let point = |at: i32| Point::new(if at < 10 { f64::from(at) } else { 4.5 }, f64::from(at % 3));
        assert_eq!(Fit::new(&(0..100).map(point).collect::<Vec<_>>(), 10), None);
    }

    #[test]
    fn too_few_clusters_have_no_line() {
        let points: Vec<_> = (0..50)
            .map(|at| Point::new(f64::from(at % 7), f64::from(at % 5)))
            .collect();
        assert!(Fit::new(&points, 10).is_some());
        assert_eq!(Fit::new(&points[1..], 10), None);
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(32))]

        /// Errors that are the same for a whole cluster, as those of a gust: of 400 lines, as many intervals miss as stated.
        #[test]
        fn intervals_hold_whether_there_are_few_clusters_or_many(seed in 0..1000_u64, clusters in CLUSTERS..12) {
            let mut noise = Noise::new(seed, Stream::Turbulence);
            let mut missed = [0; 2];
            for index in 0..400 {
                let mut draws = noise.at(index);
                let gusts: Vec<f64> = (0..clusters).map(|_| draws.normal_pair()[0]).collect();
                let points: Vec<_> = (0..10 * clusters)
                    .map(|at| Point::new(draws.normal_pair()[0] + 0.1 * (at / 10) as f64, gusts[at / 10] + 0.1 * draws.normal_pair()[0]))
                    .collect();
                let fit = Fit::new(&points, 10).unwrap();
                missed[0] += u32::from(fit.slope.abs() > fit.errors[1]);
                missed[1] += u32::from(fit.slope.abs() > fit.certain[1]);
            }
            // 20 and 0.4 are expected at most.
            prop_assert!(missed[0] <= 34 && missed[1] <= 4, "{missed:?}");
        }
    }

    #[test]
    fn the_interval_is_that_of_the_spread() {
        // Values ±1 around a line: the variance of the slope is 1/Σx².
        let points: Vec<_> = (0..400)
            .map(|at| {
                let value = if at % 2 == 0 { 1.0 } else { -1.0 };
                Point::new(f64::from(at / 2) / 100.0 - 0.995, value)
            })
            .collect();
        let fit = Fit::new(&points, 10).unwrap();
        let xx: f64 = points.iter().map(|point| point.travel * point.travel).sum();
        assert!(fit.slope.abs() < 1e-9 && (fit.errors[1] * xx.sqrt() - 1.966).abs() < 0.01);
    }

    /// A stick that answers pushes: least squares give half of the slope, the instrument all of it.
    #[test]
    fn an_instrument_is_not_misled_by_a_stick_that_answers_pushes() {
        let wanted = |at: i32| libm::sin(0.37 * f64::from(at));
        let push = |at: i32| libm::sin(1.91 * f64::from(at) + 0.3);
        let point = |at: i32| {
            let travel = wanted(at) - push(at);
            Point {
                travel,
                value: 5.0 + 2.0 * travel + 2.0 * push(at),
                instrument: wanted(at),
            }
        };
        let points: Vec<_> = (0..2000).map(point).collect();
        let fit = Fit::new(&points, 10).unwrap();
        assert!(
            (fit.slope - 2.0).abs() < fit.errors[1] && fit.errors[1] < 0.3,
            "{fit:?}"
        );
        let squares: Vec<_> = points
            .iter()
            .map(|point| Point::new(point.travel, point.value))
            .collect();
        assert!((Fit::new(&squares, 10).unwrap().slope - 1.0).abs() < 0.05);
    }
}
