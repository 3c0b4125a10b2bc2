//! Quantiles of sorted values.

/// Returns the values in ascending order, without NaN.
#[must_use]
pub fn sorted(values: impl IntoIterator<Item = f64>) -> Vec<f64> {
    let mut sorted: Vec<_> = values.into_iter().filter(|value| !value.is_nan()).collect();
    sorted.sort_by(f64::total_cmp);
    sorted
}

/// Returns the quantile at a share in [0, 1] of values in ascending order; `None` without values.
///
/// Linear interpolation at the index h = share (n − 1): type 7 of R. J. Hyndman
/// and Y. Fan: Sample quantiles in statistical packages, The American Statistician 50 (1996), 361–365.
///
/// # Panics
/// If the share is outside of [0, 1].
#[must_use]
pub fn quantile(sorted: &[f64], share: f64) -> Option<f64> {
    assert!((0.0..=1.0).contains(&share), "a share of {share}");
    let last = sorted.len().checked_sub(1)?;
    let place = share * last as f64;
    let below = place.floor() as usize;
    let (low, high) = (sorted[below], sorted[(below + 1).min(last)]);
    Some(between(low, high, place - place.floor()))
}

/// Returns the median of values in ascending order; `None` without values.
#[must_use]
pub fn median(sorted: &[f64]) -> Option<f64> {
    quantile(sorted, 0.5)
}

/// Returns the median of values in any order, without those that are no number; none of no values.
#[must_use]
pub fn median_of(values: impl IntoIterator<Item = f64>) -> Option<f64> {
    median(&sorted(values))
}

/// Returns minimum and maximum of values in ascending order; `None` without values.
#[must_use]
pub fn range(sorted: &[f64]) -> Option<[f64; 2]> {
    Some([*sorted.first()?, *sorted.last()?])
}

/// Interpolates linearly from `low` to `high`, which may be infinite.
pub(crate) fn between(low: f64, high: f64, share: f64) -> f64 {
    if share <= 0.0 || low == high {
        low
    } else {
        (low * (1.0 - share) + high * share).clamp(low, high)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn quantiles_are_those_of_an_independent_implementation() {
        // numpy.quantile([1, 2.5, 4, 7, 11], q)
        let sorted = [1.0, 2.5, 4.0, 7.0, 11.0];
        let cases = [
            (0.0, 1.0),
            (0.1, 1.6),
            (0.33, 2.98),
            (0.5, 4.0),
            (0.9, 9.4),
            (1.0, 11.0),
        ];
        for (share, expected) in cases {
            assert!(
                (quantile(&sorted, share).unwrap() - expected).abs() < 1e-14,
                "{share}"
            );
        }
    }

    #[test]
    fn of_no_values_there_is_no_quantile() {
        assert_eq!((median(&[]), range(&[])), (None, None));
    }

    #[test]
    fn what_is_no_number_is_left_out() {
        let sorted = sorted([2.0, f64::NAN, -1.0, -f64::NAN, f64::INFINITY]);
        assert_eq!(sorted, [-1.0, 2.0, f64::INFINITY]);
        assert_eq!(median(&sorted), Some(2.0));
    }

    proptest! {
        #[test]
        fn quantiles_rise_with_the_share_from_the_least_to_the_largest_value(
            values in proptest::collection::vec(-10.0..10.0f64, 1..50), first in 0.0..=1.0f64, second in 0.0..=1.0f64,
        ) {
            let sorted = sorted(values);
            let at = |share: f64| quantile(&sorted, share).unwrap();
            prop_assert!(at(first.min(second)) <= at(first.max(second)));
            prop_assert_eq!(range(&sorted), Some([at(0.0), at(1.0)]));
        }

        #[test]
        fn half_of_the_values_lie_on_either_side_of_the_median(values in proptest::collection::vec(-10.0..10.0f64, 1..50)) {
            let sorted = sorted(values);
            let median = median(&sorted).unwrap();
            let below = sorted.iter().filter(|&&value| value < median).count();
            let above = sorted.iter().filter(|&&value| value > median).count();
            prop_assert!(2 * below <= sorted.len() && 2 * above <= sorted.len());
        }
    }
}
