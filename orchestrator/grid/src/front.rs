//! The Pareto front of the laws in error, delay margin and lost flights.
//!
//! A faster law has a smaller error and a smaller delay margin: either number alone would rank tunings, not laws.

use serde::Serialize;

/// Quantity whose margin is the second axis.
pub const MARGIN: &str = "delay";

/// Performance and margin of a law.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct FrontPoint {
    /// Name of the law.
    pub law: String,
    /// Geometric mean over the conditions of the median RMS distance, m; `None` if a condition has no result.
    pub rms: Option<f64>,
    /// Lost flights in all conditions.
    pub lost: usize,
    /// Largest delay survived, ms; `None` if the law is lost even without added delay.
    pub delay: Option<f64>,
    /// Laws that dominate this one; empty on the front.
    pub beaten_by: Vec<String>,
}

impl FrontPoint {
    /// Returns whether this law dominates another: no worse in any of the three numbers and better in one.
    fn beats(&self, other: &Self) -> bool {
        // Smaller is better.
        let costs = |point: &Self| {
            let delay = point.delay.unwrap_or(-1.0);
            [point.rms.unwrap_or(f64::INFINITY), -delay, point.lost as f64]
        };
        let (costs, other) = (costs(self), costs(other));
        costs != other && costs.iter().zip(&other).all(|(cost, other)| cost <= other)
    }
}

/// Returns the geometric mean of distances; `None` if one is missing.
#[must_use]
pub fn geometric_mean(distances: &[Option<f64>]) -> Option<f64> {
    let logarithms: Option<Vec<f64>> = distances.iter().map(|rms| rms.map(libm::log)).collect();
    let logarithms = logarithms.filter(|logarithms| !logarithms.is_empty())?;
    Some(libm::exp(
        logarithms.iter().sum::<f64>() / logarithms.len() as f64,
    ))
}

/// Returns the points with the laws that dominate each.
#[must_use]
pub fn compared(points: &[FrontPoint]) -> Vec<FrontPoint> {
    let beaten = |point: &FrontPoint| {
        let better = points.iter().filter(|other| other.beats(point));
        FrontPoint {
            beaten_by: better.map(|other| other.law.clone()).collect(),
            ..point.clone()
        }
    };
    points.iter().map(beaten).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_law_that_none_beats_is_on_the_front() {
        let point = |(law, rms, lost, delay): (&str, Option<f64>, usize, Option<f64>)| FrontPoint {
            law: law.to_owned(),
            rms,
            lost,
            delay,
            beaten_by: Vec::new(),
        };
        let points = [
            ("near", Some(0.2), 0, Some(10.0)),
            ("robust", Some(0.4), 0, Some(23.0)),
            ("between", Some(0.3), 0, Some(18.0)),
            ("as good", Some(0.3), 0, Some(18.0)),
            ("late", Some(0.3), 0, Some(17.0)),
            ("far", Some(0.31), 0, Some(18.0)),
            ("nearest but lost", Some(0.1), 3, Some(23.0)),
            ("lost", None, 300, None),
        ];
        let found = compared(&points.map(point));
        let beaten: Vec<_> = found.iter().map(|point| point.beaten_by.join(", ")).collect();
        let both = "between, as good";
        assert_eq!(beaten[..4], ["", "", "", ""]);
        assert_eq!(beaten[4..7], [both, both, ""]);
        assert_eq!(found[7].beaten_by.len(), 7);
    }

    #[test]
    fn means_are_of_all_conditions() {
        let mean = geometric_mean(&[Some(0.001), Some(0.004), Some(0.002)]).unwrap();
        assert!((mean - 0.002).abs() < 1e-15, "{mean}");
        assert_eq!(geometric_mean(&[Some(0.001), None]), None);
        assert_eq!(geometric_mean(&[]), None);
    }
}
