//! The bootstrap: B. Efron and R. J. Tibshirani, An Introduction to the Bootstrap (1993), 13.3.

use crate::quantile::{between, quantile, sorted};
use crate::random::{Generator, Purpose};

/// Number of resamples.
pub const RESAMPLES: usize = 2000;

/// Returns the percentile interval of the median of values in ascending order; `None` without values.
///
/// Each resample draws as many values, with replacement; the limits are the quantiles (1 ∓ confidence)/2 of their medians.
///
/// # Panics
/// If the confidence is not between 0 and 1.
#[must_use]
pub fn median_interval(rising: &[f64], confidence: f64, seed: u64) -> Option<[f64; 2]> {
    crate::assert_confidence(confidence);
    if rising.is_empty() {
        return None;
    }
    let mut generator = Generator::new(seed, Purpose::Bootstrap, 0);
    let mut ranks = vec![0; rising.len()];
    let medians = sorted((0..RESAMPLES).map(|_| {
        ranks.fill_with(|| generator.below(rising.len()));
        median_of_ranks(rising, &mut ranks)
    }));
    let tail = 0.5 * (1.0 - confidence);
    Some([quantile(&medians, tail)?, quantile(&medians, 1.0 - tail)?])
}

/// Returns the median of the values of some ranks, in linear time.
fn median_of_ranks(rising: &[f64], ranks: &mut [usize]) -> f64 {
    let middle = ranks.len() / 2;
    let is_odd = ranks.len() % 2 == 1;
    let (below, &mut upper, _) = ranks.select_nth_unstable(middle);
    let lower = below.iter().copied().max();
    match lower {
        Some(lower) if !is_odd => between(rising[lower], rising[upper], 0.5),
        _ => rising[upper],
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::quantile::{median, range};
    use proptest::prelude::*;

    #[test]
    fn the_interval_is_stable() {
        let rising: Vec<f64> = (0..40).map(|i| f64::from(i * i)).collect();
        let interval = median_interval(&rising, 0.95, 7).unwrap();
        assert_eq!(interval.map(f64::to_bits), STABLE);
    }

    /// Pinned: the bits are those of every machine.
    const STABLE: [u64; 2] = [4641100153493651456, 4649157374701993984];

    #[test]
    fn the_interval_has_the_order_statistics_that_the_binomial_distribution_says() {
        // P(median of a resample of 1 … 101 ≤ k) is P(X ≥ 51), X binomial of 101 with k/101:
        // [k for k in range(102) if scipy.stats.binom.sf(50, 101, k/101) >= q][0] for q = 0.025, 0.975 is 41, 61.
        let rising: Vec<f64> = (1..=101).map(f64::from).collect();
        let [low, high] = median_interval(&rising, 0.95, 3).unwrap();
        assert!(
            (low - 41.0).abs() <= 1.0 && (high - 61.0).abs() <= 1.0,
            "{low} {high}"
        );
    }

    proptest! {
        #[test]
        fn the_median_of_ranks_is_that_of_the_values(
            values in proptest::collection::vec(-5.0..5.0f64, 1..30), seed: u64,
        ) {
            let rising = sorted(values);
            let mut generator = Generator::new(seed, Purpose::Bootstrap, 0);
            let mut ranks: Vec<_> = rising.iter().map(|_| generator.below(rising.len())).collect();
            let drawn = sorted(ranks.iter().map(|&rank| rising[rank]));
            prop_assert_eq!(Some(median_of_ranks(&rising, &mut ranks)), median(&drawn));
        }

        #[test]
        fn the_interval_lies_within_the_values_and_widens_with_the_confidence(
            values in proptest::collection::vec(-5.0..5.0f64, 1..30), seed: u64,
        ) {
            let rising = sorted(values);
            let [least, most] = range(&rising).unwrap();
            let [low, high] = median_interval(&rising, 0.99, seed).unwrap();
            let [inner_low, inner_high] = median_interval(&rising, 0.8, seed).unwrap();
            let bounds = [least, low, inner_low, inner_high, high, most];
            prop_assert!(bounds.is_sorted(), "{:?}", bounds);
        }
    }
}
