//! Comparison of two laws over the same samples: statistics of the differences a − b.
//!
//! * [`sign_test`]: test whether one law wins more often than by chance;
//! * [`signed_rank`]: test whether the differences are symmetric about 0;
//! * [`bootstrap`]: confidence interval of the median difference.

pub mod bootstrap;
pub mod sign_test;
pub mod signed_rank;

use crate::quantile::{median, sorted};

/// Confidence of [`Paired::median_interval`].
pub const CONFIDENCE: f64 = 0.95;

/// Comparison of paired values a and b, such as errors of two laws; the smaller value wins.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Paired {
    /// Compared pairs.
    pub pairs: u64,
    /// Pairs without a finite value in both, which are ignored.
    pub left_out: u64,
    /// Pairs with a < b.
    pub won: u64,
    /// Pairs with a > b.
    pub lost: u64,
    /// Pairs with a = b.
    pub tied: u64,
    /// Median of a − b.
    pub median: f64,
    /// Mean of a − b.
    pub mean: f64,
    /// Interval around the median of a − b, of [`CONFIDENCE`], by the percentile bootstrap.
    pub median_interval: [f64; 2],
    /// Two-sided p-value of the sign test.
    pub sign_p: f64,
    /// Two-sided p-value of Wilcoxon's signed-rank test.
    pub signed_rank_p: f64,
}

impl Paired {
    /// Compares pairs (a, b); `seed` is for the bootstrap. `None` if no pair is finite.
    #[must_use]
    pub fn of(pairs: &[(f64, f64)], seed: u64) -> Option<Self> {
        let differences = pairs.iter().map(|(a, b)| a - b);
        let differences: Vec<_> = differences.filter(|difference| difference.is_finite()).collect();
        let sorted = sorted(differences.iter().copied());
        let count = |holds: fn(f64) -> bool| differences.iter().filter(|&&d| holds(d)).count() as u64;
        let (won, lost) = (count(|d| d < 0.0), count(|d| d > 0.0));
        Some(Self {
            pairs: differences.len() as u64,
            left_out: (pairs.len() - differences.len()) as u64,
            won,
            lost,
            tied: differences.len() as u64 - won - lost,
            median: median(&sorted)?,
            mean: differences.iter().sum::<f64>() / differences.len() as f64,
            median_interval: bootstrap::median_interval(&sorted, CONFIDENCE, seed)?,
            sign_p: sign_test::p_value(won, lost),
            signed_rank_p: signed_rank::p_value(&differences),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Depression scale factors of nine patients before and after a therapy: M. Hollander and D. A. Wolfe, Nonparametric
    /// Statistical Methods (1973), 29.
    #[expect(clippy::approx_constant, reason = "a measured 3.14")]
    const PATIENTS: [(f64, f64); 9] = [
        (1.83, 0.878),
        (0.50, 0.647),
        (1.62, 0.598),
        (2.48, 2.05),
        (1.68, 1.06),
        (1.88, 1.29),
        (1.55, 1.06),
        (3.06, 3.14),
        (1.30, 1.29),
    ];

    /// Pairs of few values, so that there are ties.
    fn pairs() -> impl Strategy<Value = Vec<(f64, f64)>> {
        let coarse = (0..6_u8).prop_map(|value| f64::from(value) / 2.0);
        let value = prop_oneof![coarse, 0.0..3.0f64];
        proptest::collection::vec((value.clone(), value), 1..80)
    }

    #[test]
    fn the_published_example_gives_the_published_numbers() {
        let paired = Paired::of(&PATIENTS, 1).unwrap();
        assert_eq!((paired.pairs, paired.won, paired.lost, paired.tied), (9, 2, 7, 0));
        // numpy.median, numpy.mean, scipy.stats.binomtest(2, 9), scipy.stats.wilcoxon(a − b, method="exact")
        let found = [paired.median, paired.mean, paired.sign_p, paired.signed_rank_p];
        let expected = [0.49, 0.43188888888888893, 0.1796875, 0.0390625];
        for (found, expected) in found.into_iter().zip(expected) {
            assert!((found - expected).abs() < 1e-12, "{found}, not {expected}");
        }
        // scipy.stats.bootstrap((a − b,), numpy.median, method="percentile", n_resamples=200000)
        for (found, expected) in paired.median_interval.into_iter().zip([-0.08, 0.952]) {
            assert!((found - expected).abs() < 1e-12, "{:?}", paired.median_interval);
        }
    }

    #[test]
    fn pairs_that_are_not_finite_are_counted_and_left_out() {
        let pairs = [
            (f64::NAN, 1.0),
            (1.0, f64::INFINITY),
            (f64::INFINITY, f64::INFINITY),
            (1.0, 3.0),
        ];
        let paired = Paired::of(&pairs, 1).unwrap();
        assert_eq!(
            (paired.pairs, paired.left_out, paired.won, paired.mean),
            (1, 3, 1, -2.0)
        );
        assert_eq!(Paired::of(&pairs[..3], 1), None);
        assert_eq!(Paired::of(&[], 1), None);
    }

    proptest! {
        #[test]
        fn exchanged_laws_exchange_the_signs(pairs in pairs(), seed: u64) {
            let exchanged: Vec<_> = pairs.iter().map(|&(a, b)| (b, a)).collect();
            let (paired, other) = (Paired::of(&pairs, seed).unwrap(), Paired::of(&exchanged, seed).unwrap());
            prop_assert_eq!([paired.median, paired.mean], [-other.median, -other.mean]);
            prop_assert_eq!((paired.won, paired.lost, paired.tied), (other.lost, other.won, other.tied));
            prop_assert_eq!([paired.sign_p, paired.signed_rank_p], [other.sign_p, other.signed_rank_p]);
        }

        #[test]
        fn probabilities_are_between_0_and_1_and_counts_add_up(pairs in pairs(), seed: u64) {
            let paired = Paired::of(&pairs, seed).unwrap();
            prop_assert!([paired.sign_p, paired.signed_rank_p].iter().all(|p| (0.0..=1.0).contains(p)), "{paired:?}");
            prop_assert_eq!(paired.won + paired.lost + paired.tied, pairs.len() as u64);
        }

        #[test]
        fn laws_that_do_the_same_do_not_differ(values in proptest::collection::vec(-5.0..5.0f64, 1..50)) {
            let pairs: Vec<_> = values.into_iter().map(|value| (value, value)).collect();
            let paired = Paired::of(&pairs, 1).unwrap();
            prop_assert_eq!((paired.median, paired.mean, paired.median_interval), (0.0, 0.0, [0.0, 0.0]));
            prop_assert_eq!([paired.sign_p, paired.signed_rank_p], [1.0, 1.0]);
        }
    }
}
