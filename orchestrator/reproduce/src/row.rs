//! Numbers of the paper's figures and their acceptance limits.

use serde::Serialize;

use super::flight::SeedResults;

/// Maximum ratio of the worst seed to the limit of the median.
pub const WORST_FACTOR: f64 = 1.5;

/// Minimum number of seeds to judge a median.
pub const MIN_SEEDS: usize = 5;

/// A number of a figure.
#[derive(Clone, Copy, Debug)]
pub struct Row {
    /// Name, unique in its figure.
    pub quantity: &'static str,
    /// The paper's value as text, in `unit`.
    pub paper: &'static str,
    /// Display unit.
    pub unit: Unit,
    /// Acceptance limit, in `unit`.
    pub bar: AcceptanceLimit,
    /// Computes the number, in SI units, from the results of a laboratory and a seed.
    pub value: fn(&SeedResults<'_>) -> Result<f64, String>,
}

/// Acceptance limit of a number.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum AcceptanceLimit {
    /// No limit: the number is only shown.
    Shown,
    /// The median over the seeds is at most this, the worst at most [`WORST_FACTOR`] times.
    AtMost(f64),
    /// The median over the seeds is at least this, the worst at least one [`WORST_FACTOR`]th of it.
    AtLeast(f64),
}

/// Display unit of a number.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Unit {
    /// 0.01 m.
    Centimetre,
    /// 0.001 kg.
    Gram,
    /// 0.001 rad.
    Milliradian,
    /// rad.
    Radian,
    /// rad/s.
    RadianPerSecond,
    /// N.
    Newton,
    /// m/s².
    MetrePerSecondSquared,
    /// 0.01.
    Percent,
    /// A ratio.
    Times,
    /// A count.
    Count,
}

impl AcceptanceLimit {
    /// Returns the limit of the median.
    #[must_use]
    pub fn for_median(self) -> Option<f64> {
        match self {
            Self::Shown => None,
            Self::AtMost(bar) | Self::AtLeast(bar) => Some(bar),
        }
    }

    /// Returns whether `value` is no worse than `limit`.
    #[must_use]
    pub fn keeps(self, value: f64, limit: f64) -> bool {
        match self {
            Self::Shown => true,
            Self::AtMost(_) => value <= limit,
            Self::AtLeast(_) => value >= limit,
        }
    }

    /// Returns whether a value keeps the limit of the worst seed.
    #[must_use]
    pub fn is_possible(self, value: f64) -> bool {
        match self {
            Self::Shown => true,
            Self::AtMost(bar) => value <= WORST_FACTOR * bar,
            Self::AtLeast(bar) => value >= bar / WORST_FACTOR,
        }
    }

    /// Returns whether a median and a worst value keep their limits.
    #[must_use]
    pub fn is_reached(self, median: f64, worst: f64) -> bool {
        let reaches = match self {
            Self::Shown => true,
            Self::AtMost(bar) => median <= bar,
            Self::AtLeast(bar) => median >= bar,
        };
        reaches && self.is_possible(worst)
    }

    /// Returns the worst of some values; the largest without a limit.
    #[must_use]
    pub fn worst(self, values: &[f64]) -> f64 {
        let worse = match self {
            Self::Shown | Self::AtMost(_) => f64::max,
            Self::AtLeast(_) => f64::min,
        };
        values.iter().copied().reduce(worse).unwrap_or(f64::NAN)
    }

    /// Returns the text in tables.
    #[must_use]
    pub fn text(self) -> String {
        match self {
            Self::Shown => String::new(),
            Self::AtMost(bar) => format!("≤ {bar}"),
            Self::AtLeast(bar) => format!("≥ {bar}"),
        }
    }
}

impl Unit {
    /// Returns the factor from SI to this unit.
    #[must_use]
    pub fn per_si(self) -> f64 {
        match self {
            Self::Centimetre | Self::Percent => 1e2,
            Self::Gram | Self::Milliradian => 1e3,
            _ => 1.0,
        }
    }

    /// Returns the symbol of the unit.
    #[must_use]
    pub fn symbol(self) -> &'static str {
        match self {
            Self::Centimetre => "cm",
            Self::Gram => "g",
            Self::Milliradian => "mrad",
            Self::Radian => "rad",
            Self::RadianPerSecond => "rad/s",
            Self::Newton => "N",
            Self::MetrePerSecondSquared => "m/s²",
            Self::Percent => "%",
            Self::Times => "times",
            Self::Count => "",
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn a_bar_is_reached_by_the_median_and_by_the_worst_with_half_as_much_again(
            bar in 0.1..10.0f64, median in 0.0..20.0f64, beyond in 0.0..10.0f64,
        ) {
            let worst = median + beyond;
            prop_assert_eq!(
                AcceptanceLimit::AtMost(bar).is_reached(median, worst),
                median <= bar && worst <= 1.5 * bar
            );
            // The same upside down.
            prop_assert_eq!(
                AcceptanceLimit::AtLeast(1.0 / bar).is_reached(1.0 / median, 1.0 / worst),
                1.0 / median >= 1.0 / bar && 1.0 / worst >= 1.0 / bar / 1.5
            );
        }

        #[test]
        fn the_worst_value_is_no_better_than_any(values in proptest::collection::vec(0.0..1.0f64, 1..30)) {
            for bar in [AcceptanceLimit::AtMost(0.5), AcceptanceLimit::AtLeast(0.5)] {
                let worst = bar.worst(&values);
                prop_assert!(values.iter().all(|&value| bar.keeps(value, worst)));
                prop_assert!(values.contains(&worst));
            }
        }
    }

    #[test]
    fn what_is_not_a_number_reaches_nothing() {
        for bar in [AcceptanceLimit::AtMost(1.0), AcceptanceLimit::AtLeast(1.0)] {
            assert!(!bar.is_reached(f64::NAN, f64::NAN));
        }
    }
}
