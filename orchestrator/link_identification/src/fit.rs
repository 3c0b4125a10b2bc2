//! A line through points, by least squares or by an instrument.
//!
//! A controller that moves a stick against pushes makes the stick depend on them, and least squares then take their answer for
//! that of the stick. An instrument goes with the stick and not with the pushes: slope = Σ(z − z̄)(y − ȳ) / Σ(z − z̄)(x − x̄).
//! With z = x these are least squares.

use serde::Serialize;

/// Points below which there is no line.
const FEWEST: usize = 10;

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

/// A point of a fit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Point {
    /// Travel of the stick.
    pub travel: f64,
    /// What was measured, N or rad/s.
    pub value: f64,
    /// The instrument, in any unit: the travel itself for least squares.
    pub instrument: f64,
}

impl Fit {
    /// The line through points; `None` if they are few or their travels or instruments are all the same. `cluster` is the number
    /// of neighbours whose residuals may depend on each other.
    #[must_use]
    pub fn of(points: &[Point], cluster: usize) -> Option<Self> {
        if points.len() < FEWEST {
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
        ];
        // Shares of a residual in offset and slope.
        let influence = |point: &Point| {
            let in_slope = residual(point) * point.instrument / zx;
            [residual(point) / count - center.travel * in_slope, in_slope]
        };
        let clustered = clustered_errors(&centered, cluster, influence);
        let errors = [0, 1].map(|of| clustered[of].max(INTERVAL * independent[of].sqrt()));
        let fit = Self {
            offset: center.value - slope * center.travel,
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

impl Point {
    /// Returns a point of least squares.
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

/// Returns the half-widths of the 95 % intervals of offset and slope if the residuals of a cluster of neighbours depend on each
/// other: the sandwich estimate, with the quantile of Student's distribution, because there are few clusters.
fn clustered_errors(points: &[Point], cluster: usize, influence: impl Fn(&Point) -> [f64; 2]) -> [f64; 2] {
    let clusters = points.chunks(cluster);
    let freedom = (clusters.len() as f64 - 2.0).max(1.0);
    let factor = clusters.len() as f64 / freedom;
    let mut variances = [0.0; 2];
    for cluster in clusters {
        let shares = cluster.iter().map(&influence);
        let sums = shares.fold([0.0; 2], |sums, shares| [0, 1].map(|of| sums[of] + shares[of]));
        variances = [0, 1].map(|of| variances[of] + factor * sums[of] * sums[of]);
    }
    // The quantile of 97.5 % by its expansion about the normal one.
    let quantile = 1.96 + 2.37 / freedom + 2.82 / (freedom * freedom);
    variances.map(|variance| quantile * variance.sqrt())
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn points_on_a_line_give_the_line(offset in -5.0..5.0f64, slope in -20.0..20.0f64) {
            prop_assume!(slope.abs() > 0.1);
            let points: Vec<_> = (0..50).map(|x| f64::from(x) / 25.0 - 1.0).map(|x| Point::new(x, offset + slope * x)).collect();
            let fit = Fit::of(&points, 10).unwrap();
            prop_assert!((fit.offset - offset).abs() < 1e-9 && (fit.slope - slope).abs() < 1e-9);
            prop_assert!(fit.residual < 1e-6 && fit.explained > 1.0 - 1e-9);
        }
    }

    #[test]
    fn a_stick_that_never_moved_has_no_line() {
        assert_eq!(Fit::of(&[Point::new(0.5, 1.0); 100], 10), None);
        assert_eq!(Fit::of(&[Point::new(0.0, 0.0), Point::new(1.0, 1.0)], 10), None);
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
        let fit = Fit::of(&points, 10).unwrap();
        let xx: f64 = points.iter().map(|point| point.travel * point.travel).sum();
        assert!(fit.slope.abs() < 1e-9 && (fit.errors[1] * xx.sqrt() - INTERVAL).abs() < 0.03);
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
        let fit = Fit::of(&points, 10).unwrap();
        assert!(
            (fit.slope - 2.0).abs() < fit.errors[1] && fit.errors[1] < 0.3,
            "{fit:?}"
        );
        let squares: Vec<_> = points
            .iter()
            .map(|point| Point::new(point.travel, point.value))
            .collect();
        assert!((Fit::of(&squares, 10).unwrap().slope - 1.0).abs() < 0.05);
    }
}
