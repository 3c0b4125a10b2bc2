//! Mean, deviation and extremes of a stream of numbers, in constant memory.

use serde::{Deserialize, Serialize};

/// Running statistics.
///
/// The sums are of differences from the first number, which avoids cancellation for a large mean without a division per
/// number. Without numbers every statistic is NaN, which passes no limit.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Statistics {
    count: u64,
    first: f64,
    /// Sum of the differences from the first number.
    sum: f64,
    /// Sum of the squares of these differences.
    squares: f64,
    largest: f64,
}

impl Statistics {
    /// Adds a number.
    #[inline]
    pub fn add(&mut self, value: f64) {
        if self.count == 0 {
            self.first = value;
        }
        self.count += 1;
        let distance = value - self.first;
        self.sum += distance;
        self.squares += distance * distance;
        self.largest = self.largest.max(value.abs());
    }

    /// Adds the numbers of other statistics.
    pub fn join(&mut self, later: &Self) {
        if self.count == 0 {
            *self = *later;
            return;
        }
        let (count, further) = (later.count as f64, later.first - self.first);
        self.count += later.count;
        self.sum += later.sum + count * further;
        self.squares += later.squares + 2.0 * further * later.sum + count * further * further;
        self.largest = self.largest.max(later.largest);
    }

    /// Returns the number of values.
    #[must_use]
    pub fn count(&self) -> u64 {
        self.count
    }

    /// Returns the mean.
    #[must_use]
    pub fn mean(&self) -> f64 {
        self.unless_empty(self.first + self.sum / self.count as f64)
    }

    /// Returns the standard deviation about the mean.
    #[must_use]
    pub fn deviation(&self) -> f64 {
        self.variance().sqrt()
    }

    fn variance(&self) -> f64 {
        let (count, mean) = (self.count as f64, self.sum / self.count as f64);
        (self.squares / count - mean * mean).max(0.0 * mean)
    }

    /// Returns the root mean square.
    #[must_use]
    pub fn rmse(&self) -> f64 {
        let mean = self.mean();
        (mean * mean + self.variance()).sqrt()
    }

    /// Returns the maximum magnitude.
    #[must_use]
    pub fn max(&self) -> f64 {
        self.unless_empty(self.largest)
    }

    fn unless_empty(&self, value: f64) -> f64 {
        if self.count == 0 { f64::NAN } else { value }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn of(values: &[f64]) -> Statistics {
        let mut statistics = Statistics::default();
        values.iter().for_each(|&value| statistics.add(value));
        statistics
    }

    #[test]
    fn nothing_measured_is_not_a_number() {
        let nothing = Statistics::default();
        for value in [nothing.mean(), nothing.deviation(), nothing.rmse(), nothing.max()] {
            assert!(value.is_nan());
        }
    }

    #[test]
    fn three_and_four_have_the_statistics_of_the_textbook() {
        let statistics = of(&[3.0, -4.0]);
        assert_eq!(statistics.mean(), -0.5);
        assert_eq!(statistics.deviation(), 3.5);
        assert!((statistics.rmse() - 12.5_f64.sqrt()).abs() < 1e-15);
        assert_eq!(statistics.max(), 4.0);
    }

    proptest! {
        #[test]
        fn parts_that_are_joined_have_the_statistics_of_the_whole(
            values in proptest::collection::vec(-1.0..1.0f64, 1..200), place in 0..200usize,
        ) {
            let (early, late) = values.split_at(place.min(values.len()));
            let mut joined = of(early);
            joined.join(&of(late));
            let whole = of(&values);
            prop_assert_eq!((joined.count(), joined.max()), (whole.count(), whole.max()));
            for (one, other) in [(joined.mean(), whole.mean()), (joined.rmse(), whole.rmse())] {
                prop_assert!((one - other).abs() < 1e-13, "{one} {other}");
            }
            prop_assert!((joined.deviation() - whole.deviation()).abs() < 1e-7);
        }

        #[test]
        fn the_stream_agrees_with_the_two_pass_formulas_also_far_from_zero(
            values in proptest::collection::vec(-1.0..1.0f64, 1..200),
            offset in -1e6..1e6f64,
        ) {
            let shifted: Vec<f64> = values.iter().map(|value| value + offset).collect();
            let statistics = of(&shifted);
            let count = shifted.len() as f64;
            let mean = shifted.iter().sum::<f64>() / count;
            let variance = shifted.iter().map(|value| (value - mean) * (value - mean)).sum::<f64>() / count;
            let squares = shifted.iter().map(|value| value * value).sum::<f64>() / count;
            // For sums of this number of values of this size.
            let rounding = 1e-12 * (1.0 + offset.abs());
            prop_assert!((statistics.mean() - mean).abs() < rounding);
            prop_assert!((statistics.deviation() - variance.sqrt()).abs() < rounding);
            prop_assert!((statistics.rmse() - squares.sqrt()).abs() < rounding);
        }
    }
}
