//! The exact sign test: J. Arbuthnot (1710); W. J. Conover, Practical Nonparametric Statistics, 3.4.
//!
//! For pairs of which only one flight survives it is McNemar's exact test (ibid., 3.5).

use crate::beta;

/// Returns the two-sided p-value of `won` and `lost` pairs under equal probabilities; ties are ignored.
///
/// ```text
/// p = min(1, 2 P(X ≤ k))        X binomial of n = won + lost with ½        k = min(won, lost)
/// P(X ≤ k) = I_½(n − k, k + 1)
/// ```
#[must_use]
pub fn p_value(won: u64, lost: u64) -> f64 {
    let (more, less) = (won.max(lost), won.min(lost));
    if more == less {
        return 1.0;
    }
    (2.0 * beta::regularised(more as f64, (less + 1) as f64, 0.5)).min(1.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn values_are_those_of_an_independent_implementation() {
        // scipy.stats.binomtest(won, won + lost).pvalue
        for (won, lost, expected) in [
            (2, 7, 0.1796875),
            (20, 40, 0.01348929373119186),
            (0, 10, 2.0 / 1024.0),
            // Laboratories that only composite adaptation, and only INDI lost (docs/experiments.md).
            (98, 128, 0.053483625594766646),
            (18, 55, 1.6913617102985627e-05),
        ] {
            let p = p_value(won, lost);
            assert!(
                (p / expected - 1.0).abs() < 1e-12,
                "{won} to {lost}: {p}, not {expected}"
            );
        }
        assert_eq!(p_value(0, 0), 1.0);
    }

    proptest! {
        #[test]
        fn a_win_more_makes_chance_less_probable(lost in 0..200_u64, more in 0..200_u64) {
            let won = lost + more;
            prop_assert!(p_value(won + 1, lost) <= p_value(won, lost));
            prop_assert_eq!(p_value(won, lost), p_value(lost, won));
        }
    }
}
