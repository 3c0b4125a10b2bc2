//! Distributions of a sweep's parameters, as functions of a coordinate in [0, 1).

use std::fmt;

use crate::normal;

/// Range of coordinates at which a normal distribution is evaluated: at 0 and 1 it is infinite.
const UNIT: [f64; 2] = [0.5 / (1_u64 << 53) as f64, 1.0 - 0.5 / (1_u64 << 52) as f64];

/// Distribution of a parameter, in the parameter's unit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Distribution {
    /// Uniform distribution.
    Uniform {
        /// Minimum.
        low: f64,
        /// Maximum.
        high: f64,
    },
    /// Uniform distribution of the logarithm.
    LogUniform {
        /// Minimum, > 0.
        low: f64,
        /// Maximum.
        high: f64,
    },
    /// Normal distribution, truncated at the stated limits.
    Normal {
        /// Mean before truncation.
        mean: f64,
        /// Standard deviation before truncation, > 0.
        deviation: f64,
        /// Minimum.
        low: Option<f64>,
        /// Maximum.
        high: Option<f64>,
    },
}

/// Error of the parameters of a distribution.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum DistributionError {
    /// This number, or the width of the range, is not finite.
    NotFinite(f64),
    /// The least value is not below the largest.
    Reversed {
        /// Minimum.
        low: f64,
        /// Maximum.
        high: f64,
    },
    /// The least value of a log-uniform distribution is not positive.
    LowNotPositive(f64),
    /// The standard deviation is not positive.
    DeviationNotPositive(f64),
    /// The probability between the limits of a normal distribution is below the resolution of a double.
    NothingLeft,
}

impl fmt::Display for DistributionError {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NotFinite(value) => write!(formatter, "{value} is not a finite number"),
            Self::Reversed { low, high } => {
                write!(
                    formatter,
                    "the least value, {low}, is not below the largest, {high}"
                )
            }
            Self::LowNotPositive(low) => {
                write!(
                    formatter,
                    "the least value of a log-uniform distribution, {low}, is not positive"
                )
            }
            Self::DeviationNotPositive(deviation) => {
                write!(formatter, "the standard deviation, {deviation}, is not positive")
            }
            Self::NothingLeft => formatter.write_str(
                "the limits leave nothing of the normal distribution: they are too far from its mean",
            ),
        }
    }
}

impl std::error::Error for DistributionError {}

impl Distribution {
    /// Returns the value at a coordinate in [0, 1]: the inverse of the cumulative distribution function.
    ///
    /// ```text
    /// low + u (high − low)        exp(ln low + u (ln high − ln low))        μ + σ Φ⁻¹(Φ(α) + u (Φ(β) − Φ(α)))
    /// ```
    ///
    /// with α = (low − μ)/σ and β = (high − μ)/σ. The value lies exactly within the limits. Valid only for
    /// distributions that pass [`check`](Self::check).
    #[must_use]
    pub fn at(&self, unit: f64) -> f64 {
        debug_assert!((0.0..=1.0).contains(&unit), "a coordinate of {unit}");
        match *self {
            Self::Uniform { low, high } => (low + unit * (high - low)).max(low).min(high),
            Self::LogUniform { low, high } => {
                let (log_low, log_high) = (libm::log(low), libm::log(high));
                libm::exp(log_low + unit * (log_high - log_low))
                    .max(low)
                    .min(high)
            }
            Self::Normal { mean, deviation, .. } => {
                let [low, high] = self.limits();
                let [alpha, beta] = [low, high].map(|limit| (limit - mean) / deviation);
                let z = truncated_quantile(unit.clamp(UNIT[0], UNIT[1]), alpha, beta);
                (mean + deviation * z).max(low).min(high)
            }
        }
    }

    /// Returns level k of n, from 0: from the minimum to the maximum in equal steps of the value, or of its logarithm; for a
    /// normal distribution the quantile (k + ½)/n. A single level is the median.
    ///
    /// # Panics
    /// If there is no such level.
    #[must_use]
    pub fn level(&self, k: u32, n: u32) -> f64 {
        assert!(k < n, "no level {k} of {n}");
        match *self {
            Self::Uniform { low, high } | Self::LogUniform { low, high } => match k {
                _ if n == 1 => self.at(0.5),
                0 => low,
                _ if k == n - 1 => high,
                _ => rounded(self.at(f64::from(k) / f64::from(n - 1))),
            },
            Self::Normal { .. } => self.at((f64::from(k) + 0.5) / f64::from(n)),
        }
    }

    /// Checks the parameters.
    ///
    /// # Errors
    /// If a parameter is not finite, the range is empty, or a parameter that must be positive is not.
    pub fn check(&self) -> Result<(), DistributionError> {
        match *self {
            Self::Uniform { low, high } => check_range(low, high),
            Self::LogUniform { low, high } => {
                check_range(low, high)?;
                if low > 0.0 {
                    Ok(())
                } else {
                    Err(DistributionError::LowNotPositive(low))
                }
            }
            Self::Normal {
                mean,
                deviation,
                low,
                high,
            } => {
                [Some(mean), Some(deviation), low, high]
                    .into_iter()
                    .flatten()
                    .try_for_each(check_finite)?;
                if deviation <= 0.0 {
                    return Err(DistributionError::DeviationNotPositive(deviation));
                }
                self.check_truncation(mean, deviation)
            }
        }
    }

    fn check_truncation(&self, mean: f64, deviation: f64) -> Result<(), DistributionError> {
        let [low, high] = self.limits();
        if low >= high {
            return Err(DistributionError::Reversed { low, high });
        }
        let [alpha, beta] = [low, high].map(|limit| (limit - mean) / deviation);
        let [below, up_to] = if alpha > 0.0 {
            [-beta, -alpha].map(normal::cumulative)
        } else {
            [alpha, beta].map(normal::cumulative)
        };
        // A probability that is small, absolutely or relative to its lower end, has too few digits.
        if up_to - below >= (1e-9 * up_to).max(f64::MIN_POSITIVE) {
            Ok(())
        } else {
            Err(DistributionError::NothingLeft)
        }
    }

    /// Returns the limits, infinite without truncation.
    fn limits(&self) -> [f64; 2] {
        match *self {
            Self::Uniform { low, high } | Self::LogUniform { low, high } => [low, high],
            Self::Normal { low, high, .. } => {
                [low.unwrap_or(f64::NEG_INFINITY), high.unwrap_or(f64::INFINITY)]
            }
        }
    }
}

/// Returns the quantile of the standard normal distribution truncated to [α, β].
fn truncated_quantile(unit: f64, alpha: f64, beta: f64) -> f64 {
    // Use the lower tail: probabilities near 1 have no resolution.
    if alpha > 0.0 {
        return -truncated_quantile(1.0 - unit, -beta, -alpha);
    }
    let (below, up_to) = (normal::cumulative(alpha), normal::cumulative(beta));
    // A coordinate near 1 must not round to probability 1, whose quantile is infinite.
    let probability = below + unit * (up_to - below);
    normal::quantile(probability.clamp(f64::MIN_POSITIVE, 1.0 - f64::EPSILON / 2.0))
}

fn check_finite(value: f64) -> Result<(), DistributionError> {
    if value.is_finite() {
        Ok(())
    } else {
        Err(DistributionError::NotFinite(value))
    }
}

fn check_range(low: f64, high: f64) -> Result<(), DistributionError> {
    [low, high].into_iter().try_for_each(check_finite)?;
    if low >= high {
        return Err(DistributionError::Reversed { low, high });
    }
    check_finite(high - low)
}

/// Rounds a value to 15 digits: a level is shown as 0.2 instead of 0.19999999999999998.
fn rounded(value: f64) -> f64 {
    format!("{value:.14e}").parse().unwrap_or(value)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const fn normal(mean: f64, deviation: f64, low: Option<f64>, high: Option<f64>) -> Distribution {
        Distribution::Normal {
            mean,
            deviation,
            low,
            high,
        }
    }

    /// Probability of a value of at most `value`, from the definition.
    fn cumulative(distribution: &Distribution, value: f64) -> f64 {
        match *distribution {
            Distribution::Uniform { low, high } => (value - low) / (high - low),
            Distribution::LogUniform { low, high } => libm::log(value / low) / libm::log(high / low),
            Distribution::Normal { mean, deviation, .. } => {
                let below = |value: f64| normal::cumulative((value - mean) / deviation);
                let [low, high] = distribution.limits();
                (below(value) - below(low)) / (below(high) - below(low))
            }
        }
    }

    fn any_distribution() -> impl Strategy<Value = Distribution> {
        let width = 0.1..5.0f64;
        prop_oneof![
            (-5.0..5.0f64, width.clone()).prop_map(|(low, width)| Distribution::Uniform {
                low,
                high: low + width
            }),
            (0.01..5.0f64, width.clone()).prop_map(|(low, width)| Distribution::LogUniform {
                low,
                high: low + width
            }),
            (-5.0..5.0f64, 0.1..3.0f64, 0.2..3.0f64, 0.2..3.0f64, 0..4_u8).prop_map(
                |(mean, deviation, below, above, limits)| {
                    let low = (limits & 1 > 0).then_some(mean - below * deviation);
                    normal(
                        mean,
                        deviation,
                        low,
                        (limits & 2 > 0).then_some(mean + above * deviation),
                    )
                }
            ),
        ]
    }

    #[test]
    fn the_ends_of_the_coordinates_give_finite_values() {
        let cases = [
            (None, None),
            (Some(2.0), None),
            (Some(-1.0), None),
            (None, Some(0.5)),
            (Some(5.0), None),
        ];
        for (low, high) in cases {
            for unit in [0.0, f64::MIN_POSITIVE, 1.0 - f64::EPSILON / 2.0, 1.0] {
                let value = normal(2.0, 3.0, low, high).at(unit);
                assert!(value.is_finite(), "{low:?} to {high:?} at {unit}: {value}");
            }
        }
        assert!(normal(0.0, 1.0, Some(0.0), Some(1e-15)).check().is_err());
    }

    #[test]
    fn truncated_quantiles_are_those_of_an_independent_implementation() {
        // scipy.stats.truncnorm.ppf(u, (low − μ)/σ, (high − μ)/σ, μ, σ) at u = 0.05, 0.5, 0.9
        let cases = [
            (
                normal(1.0, 2.0, Some(0.0), Some(4.0)),
                [0.17381980272825637, 1.6155076422979913, 3.2596714362576424],
            ),
            (
                normal(0.0, 1.0, Some(3.0), None),
                [3.015589034785826, 3.2051549205989334, 3.6425222758316242],
            ),
            (
                normal(0.0, 1.0, None, Some(-2.0)),
                [-3.0517634360376915, -2.2776048388094594, -2.0440335029544965],
            ),
        ];
        for (distribution, expected) in cases {
            for (unit, expected) in [0.05, 0.5, 0.9].into_iter().zip(expected) {
                let value = distribution.at(unit);
                assert!((value - expected).abs() < 1e-13, "{value}, not {expected}");
            }
        }
    }

    #[test]
    fn levels_begin_and_end_at_the_limits_in_equal_steps() {
        let levels = |distribution: Distribution, n: u32| -> Vec<f64> {
            (0..n).map(|k| distribution.level(k, n)).collect()
        };
        let uniform = Distribution::Uniform { low: 1.0, high: 3.0 };
        assert_eq!(levels(uniform, 5), [1.0, 1.5, 2.0, 2.5, 3.0]);
        assert_eq!(levels(uniform, 1), [2.0]);
        let masses = Distribution::Uniform {
            low: 0.18,
            high: 0.24,
        };
        assert_eq!(levels(masses, 4), [0.18, 0.2, 0.22, 0.24]);
        let logarithmic = levels(
            Distribution::LogUniform {
                low: 0.1,
                high: 1000.0,
            },
            5,
        );
        for (level, expected) in logarithmic.iter().zip([0.1, 1.0, 10.0, 100.0, 1000.0]) {
            assert!((level / expected - 1.0).abs() < 1e-14, "{logarithmic:?}");
        }
        assert_eq!((logarithmic[0], logarithmic[4]), (0.1, 1000.0));
    }

    #[test]
    fn the_levels_of_a_normal_distribution_are_the_middles_of_equal_shares() {
        let distribution = normal(2.0, 3.0, None, None);
        assert_eq!(distribution.level(0, 1), 2.0);
        // scipy.stats.norm.ppf(0.125, 2, 3)
        assert!((distribution.level(0, 4) - (2.0 - 3.0 * 1.1503493803760083)).abs() < 1e-14);
        assert!((distribution.level(0, 4) + distribution.level(3, 4) - 4.0).abs() < 1e-14);
    }

    #[test]
    fn ranges_that_cannot_be_are_refused_by_name() {
        use DistributionError::{DeviationNotPositive, LowNotPositive, NotFinite, NothingLeft, Reversed};
        let reversed = Reversed { low: 2.0, high: 1.0 };
        let cases = [
            (Distribution::Uniform { low: 2.0, high: 1.0 }, reversed),
            (Distribution::LogUniform { low: 2.0, high: 1.0 }, reversed),
            (normal(0.0, 1.0, Some(2.0), Some(1.0)), reversed),
            (
                Distribution::Uniform { low: 1.0, high: 1.0 },
                Reversed { low: 1.0, high: 1.0 },
            ),
            (
                Distribution::LogUniform { low: 0.0, high: 1.0 },
                LowNotPositive(0.0),
            ),
            (normal(0.0, 0.0, None, None), DeviationNotPositive(0.0)),
            (normal(0.0, 1.0, Some(40.0), None), NothingLeft),
            (normal(0.0, 1.0, None, Some(-40.0)), NothingLeft),
            (normal(f64::INFINITY, 1.0, None, None), NotFinite(f64::INFINITY)),
            (
                normal(0.0, 1.0, Some(f64::NEG_INFINITY), None),
                NotFinite(f64::NEG_INFINITY),
            ),
            (
                Distribution::Uniform {
                    low: -1e308,
                    high: 1e308,
                },
                NotFinite(f64::INFINITY),
            ),
        ];
        for (distribution, error) in cases {
            assert_eq!(distribution.check(), Err(error), "{distribution:?}");
        }
        let no_number = Distribution::Uniform {
            low: f64::NAN,
            high: 1.0,
        };
        assert!(matches!(no_number.check(), Err(NotFinite(value)) if value.is_nan()));
    }

    #[test]
    fn the_ends_of_an_unlimited_distribution_are_finite() {
        let distribution = normal(0.0, 1.0, None, None);
        assert!(distribution.at(0.0).is_finite() && distribution.at(1.0).is_finite());
    }

    proptest! {
        #[test]
        fn values_invert_the_cumulative_distribution(distribution in any_distribution(), unit in 0.0..1.0f64) {
            prop_assert_eq!(distribution.check(), Ok(()));
            let found = cumulative(&distribution, distribution.at(unit));
            prop_assert!((found - unit).abs() < 1e-12, "{found} {unit}");
        }

        #[test]
        fn values_stay_within_the_limits_and_rise_with_the_coordinate(
            distribution in any_distribution(), first in 0.0..=1.0f64, second in 0.0..=1.0f64,
        ) {
            let [low, high] = distribution.limits();
            let (less, more) = (distribution.at(first.min(second)), distribution.at(first.max(second)));
            prop_assert!(low <= less && more <= high, "{low} {less} {more} {high}");
            // Rounding may exchange neighbours.
            prop_assert!(less <= more + 1e-14 * (1.0 + more.abs()), "{less} {more}");
        }

        #[test]
        fn levels_rise_and_the_middle_one_is_the_median(distribution in any_distribution(), half in 0..20_u32) {
            let n = 2 * half + 1;
            let levels: Vec<_> = (0..n).map(|k| distribution.level(k, n)).collect();
            prop_assert!(levels.windows(2).all(|pair| pair[0] < pair[1]), "{:?}", levels);
            let (middle, median) = (levels[half as usize], distribution.at(0.5));
            prop_assert!((middle - median).abs() <= 1e-14 * median.abs(), "{} {}", middle, median);
        }
    }
}
