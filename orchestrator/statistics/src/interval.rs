//! Confidence intervals of a success rate.
//!
//! L. D. Brown, T. T. Cai and A. DasGupta: Interval estimation for a binomial proportion, Statistical Science 16 (2001),
//! 101–133, compare the intervals: the coverage of Wilson's is the stated one on average, that of Clopper's and Pearson's is
//! at least the stated one for every rate.

use crate::{assert_confidence, beta, normal};

/// Maximum number of bisections: more than the bits of a double that is not subnormal.
const BISECTIONS: u32 = 200;

/// Returns the interval of E. B. Wilson (1927) around the success rate after k successes in n trials:
///
/// ```text
/// (p̂ + z²/2n ± z √(p̂(1 − p̂)/n + z²/4n²))/(1 + z²/n)        p̂ = k/n        z = Φ⁻¹((1 + confidence)/2)
/// ```
///
/// It contains k/n; for n = 0 it is [0, 1].
///
/// # Panics
/// If k > n, or if the confidence is not between 0 and 1.
#[must_use]
pub fn wilson(k: u64, n: u64, confidence: f64) -> [f64; 2] {
    assert_counts(k, n);
    assert_confidence(confidence);
    if n == 0 {
        return [0.0, 1.0];
    }
    let z = -normal::quantile(0.5 * (1.0 - confidence));
    let (trials, rate) = (n as f64, k as f64 / n as f64);
    let share = z * z / trials;
    let half = (rate * (1.0 - rate) * share + 0.25 * share * share).sqrt();
    let bound = |half: f64| (rate + 0.5 * share + half) / (1.0 + share);
    // Rounding must not exclude a rate of 0, of 1, or k/n.
    [bound(-half).clamp(0.0, rate), bound(half).clamp(rate, 1.0)]
}

/// Returns the exact interval of C. J. Clopper and E. S. Pearson (1934) for the success rate after k successes in n trials:
/// the rates p at which both k or more and k or fewer successes have at least the probability (1 − confidence)/2:
///
/// ```text
/// I_low(k, n − k + 1) = (1 − confidence)/2 = I_{1−high}(n − k, k + 1)
/// ```
///
/// It contains k/n; for n = 0 it is [0, 1].
///
/// # Panics
/// If k > n, or if the confidence is not between 0 and 1.
#[must_use]
pub fn clopper_pearson(k: u64, n: u64, confidence: f64) -> [f64; 2] {
    assert_counts(k, n);
    assert_confidence(confidence);
    let tail = 0.5 * (1.0 - confidence);
    [lower(k, n, tail), 1.0 - lower(n - k, n, tail)]
}

/// Returns the exact one-sided lower bound of the success rate after k successes in n trials: the rate at which k or more
/// successes have the probability 1 − confidence.
///
/// # Panics
/// If k > n, or if the confidence is not between 0 and 1.
#[must_use]
pub fn lower_bound(k: u64, n: u64, confidence: f64) -> f64 {
    assert_counts(k, n);
    assert_confidence(confidence);
    lower(k, n, 1.0 - confidence)
}

/// Returns the minimum number of flights whose exact [`lower_bound`] supports a success rate despite `failures`: the
/// minimum n with P(X ≤ failures) ≤ 1 − confidence for X binomial of n trials with the rate 1 − `rate`.
///
/// # Panics
/// If the rate or the confidence is not between 0 and 1.
#[must_use]
pub fn flights_needed(rate: f64, confidence: f64, failures: u64) -> u64 {
    assert_confidence(confidence);
    assert!(
        rate > 0.0 && rate < 1.0,
        "a rate of {rate} is not between 0 and 1"
    );
    // Rounding must not refuse a claim that holds exactly.
    let tail = (1.0 - confidence) * (1.0 + 1e-12);
    let supports = |n: u64| beta::regularised((n - failures) as f64, (failures + 1) as f64, rate) <= tail;
    let mut enough = failures + 1;
    while !supports(enough) {
        enough *= 2;
    }
    let mut too_few = failures.max(enough / 2);
    while enough - too_few > 1 {
        let middle = too_few + (enough - too_few) / 2;
        if supports(middle) {
            enough = middle;
        } else {
            too_few = middle;
        }
    }
    enough
}

/// Returns the rate p at which k or more successes in n trials have the probability `tail`, by bisection of I_p(k, n − k +
/// 1), which increases with p.
fn lower(k: u64, n: u64, tail: f64) -> f64 {
    if k == 0 {
        return 0.0;
    }
    let (a, b) = (k as f64, (n - k + 1) as f64);
    let (mut low, mut high) = (0.0, 1.0);
    for _ in 0..BISECTIONS {
        let middle = 0.5 * (low + high);
        if middle <= low || middle >= high {
            break;
        }
        if beta::regularised(a, b, middle) <= tail {
            low = middle;
        } else {
            high = middle;
        }
    }
    low
}

fn assert_counts(k: u64, n: u64) {
    assert!(k <= n, "{k} successes in {n} trials");
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// k, n, confidence; Wilson's interval, that of Clopper and Pearson, the one-sided lower bound.
    type Case = (u64, u64, f64, [f64; 2], [f64; 2], f64);

    /// scipy.stats.binomtest(k, n).proportion_ci(confidence, "wilson" or "exact"), with alternative="greater" the last.
    const CASES: [Case; 5] = [
        (
            8,
            10,
            0.95,
            [0.4901624715366418, 0.9433178485456248],
            [0.4439045376923585, 0.9747892736731665],
            0.4930986989367977,
        ),
        (
            0,
            20,
            0.95,
            [0.0, 0.16112515805281935],
            [0.0, 0.16843347098308548],
            0.0,
        ),
        (
            20,
            20,
            0.99,
            [0.7508945989012464, 1.0],
            [0.7672704990114109, 1.0],
            0.7943282347242815,
        ),
        (
            997,
            1000,
            0.95,
            [0.9912169859464968, 0.9989792161188613],
            [0.9912579767613423, 0.9993809000683501],
            0.992264755281518,
        ),
        (
            1,
            3,
            0.9,
            [0.07826572633372841, 0.7464661317187758],
            [0.01695242750844312, 0.8646496378284162],
            0.03451061539437023,
        ),
    ];

    #[test]
    fn intervals_are_those_of_an_independent_implementation() {
        for (k, n, confidence, by_wilson, exact, bound) in CASES {
            let expected = [by_wilson[0], by_wilson[1], exact[0], exact[1], bound];
            let ([a, b], [c, d]) = (wilson(k, n, confidence), clopper_pearson(k, n, confidence));
            let found = [a, b, c, d, lower_bound(k, n, confidence)];
            for (found, expected) in found.into_iter().zip(expected) {
                assert!(
                    (found - expected).abs() < 1e-12,
                    "{k} of {n}: {found}, not {expected}"
                );
            }
        }
    }

    #[test]
    fn of_no_trials_every_rate_is_possible() {
        assert_eq!(wilson(0, 0, 0.95), [0.0, 1.0]);
        assert_eq!(clopper_pearson(0, 0, 0.95), [0.0, 1.0]);
        assert_eq!(lower_bound(0, 0, 0.95), 0.0);
    }

    #[test]
    fn the_flights_that_a_claim_needs_are_those_of_the_tables() {
        let needed = |rate: f64, confidence: f64, failures: std::ops::Range<u64>| -> Vec<u64> {
            failures
                .map(|failures| flights_needed(rate, confidence, failures))
                .collect()
        };
        assert_eq!(needed(0.999, 0.95, 0..4), [2995, 4742, 6294, 7752]);
        assert_eq!(needed(0.99, 0.95, 0..4), [299, 473, 628, 773]);
        assert_eq!(needed(0.999, 0.99, 0..3), [4603, 6636, 8403]);
        // Two heads in a row have exactly a quarter.
        assert_eq!(needed(0.5, 0.75, 0..1), [2]);
        assert_eq!(needed(0.5, 0.5, 1..2), [3]);
    }

    proptest! {
        #[test]
        fn both_intervals_hold_the_observed_rate(n in 1..5000u64, share in 0.0..=1.0f64, confidence in 0.01..0.999f64) {
            let k = (share * n as f64).round() as u64;
            let rate = k as f64 / n as f64;
            for [low, high] in [wilson(k, n, confidence), clopper_pearson(k, n, confidence)] {
                prop_assert!(0.0 <= low && low <= rate && rate <= high && high <= 1.0, "{low} {rate} {high}");
            }
        }

        #[test]
        fn the_exact_interval_holds_every_rate_at_least_as_often_as_stated(
            n in 1..60u64, rate in 0.001..0.999f64, confidence in 0.5..0.999f64,
        ) {
            let mut probability = libm::pow(1.0 - rate, n as f64);
            let mut coverage = 0.0;
            for k in 0..=n {
                let [low, high] = clopper_pearson(k, n, confidence);
                if (low..=high).contains(&rate) {
                    coverage += probability;
                }
                probability *= (n - k) as f64 / (k + 1) as f64 * rate / (1.0 - rate);
            }
            prop_assert!(coverage >= confidence - 1e-9, "{coverage}");
        }

        #[test]
        fn the_flights_needed_support_the_claim_and_one_fewer_does_not(
            rate in 0.5..0.9999f64, confidence in 0.5..0.99f64, failures in 0..10u64,
        ) {
            let n = flights_needed(rate, confidence, failures);
            prop_assert!(n > failures);
            prop_assert!(lower_bound(n - failures, n, confidence) >= rate - 1e-12);
            if n > failures + 1 {
                prop_assert!(lower_bound(n - 1 - failures, n - 1, confidence) < rate);
            }
        }
    }
}
