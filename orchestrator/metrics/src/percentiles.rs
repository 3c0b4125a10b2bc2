//! Percentiles of a stream of distances, in constant memory.

use hdrhistogram::Histogram;

/// Histogram units per metre: the resolution is a micrometre.
const PER_METRE: f64 = 1e6;

/// Upper limit of the histogram, m.
const LARGEST: f64 = 1e4;

/// Significant digits of the histogram: the relative error of percentiles is 0.1 %.
const DIGITS: u8 = 3;

/// Histogram of the distances.
#[derive(Clone, Debug)]
pub struct Percentiles(Histogram<u64>);

impl Default for Percentiles {
    fn default() -> Self {
        let histogram = Histogram::new_with_bounds(1, (LARGEST * PER_METRE) as u64, DIGITS);
        Self(histogram.expect("the bounds are those of a histogram"))
    }
}

impl Percentiles {
    /// Adds a distance, m.
    #[inline]
    pub fn add(&mut self, distance: f64) {
        self.0.saturating_record((distance * PER_METRE + 0.5) as u64);
    }

    /// Adds the distances of another histogram.
    pub fn join(&mut self, later: &Self) {
        self.0.add(&later.0).expect("all have the same bounds");
    }

    /// Returns the quantile at a share, m; `None` without distances.
    #[must_use]
    pub fn at(&self, share: f64) -> Option<f64> {
        let units = self.0.value_at_quantile(share);
        (!self.0.is_empty()).then(|| self.0.median_equivalent(units) as f64 / PER_METRE)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn of_no_distances_there_is_no_percentile() {
        assert_eq!(Percentiles::default().at(0.5), None);
    }

    proptest! {
        #[test]
        fn a_percentile_is_that_of_the_sorted_distances_to_a_thousandth(
            distances in proptest::collection::vec(1e-4..100.0f64, 1..500), share in 0.01..1.0f64,
        ) {
            let mut percentiles = Percentiles::default();
            distances.iter().for_each(|&distance| percentiles.add(distance));
            let mut sorted = distances;
            sorted.sort_by(f64::total_cmp);
            let rank = (share * sorted.len() as f64).ceil() as usize;
            let exact = sorted[rank.clamp(1, sorted.len()) - 1];
            let found = percentiles.at(share).unwrap();
            prop_assert!((found - exact).abs() <= 1e-3 * exact + 1e-6, "{found} {exact}");
        }
    }
}
