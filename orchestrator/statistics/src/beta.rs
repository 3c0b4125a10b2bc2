//! Regularised incomplete beta function, I_x(a, b).

use std::f64::consts::TAU;

/// Relative tolerance of the continued fraction.
const TOLERANCE: f64 = f64::EPSILON;

/// Replaces zero in the denominators of Lentz's recurrence.
const TINY: f64 = 1e-300;

/// Maximum number of terms of the continued fraction; about √max(a, b) are needed.
const TERMS: u32 = 1_000_000;

/// Returns I_x(a, b) for a, b ≥ 1: the probability that a binomial variable of a + b − 1 trials with success rate x is at
/// least a.
///
/// ```text
/// I_x(a, b) = x^a (1 − x)^b/B(a, b) · 1/(β₁ + α₁/(β₂ + α₂/(β₃ + …)))        I_x(a, b) = 1 − I_{1−x}(b, a)
/// ```
///
/// A. R. DiDonato and A. H. Morris: Algorithm 708, significant digit computation of the incomplete beta function ratios,
/// ACM Transactions on Mathematical Software 18 (1992), 360–373, (9). The fraction is evaluated
/// for the tail beyond the mean, with a relative error below 1e-12.
pub fn regularised(a: f64, b: f64, x: f64) -> f64 {
    debug_assert!(a >= 1.0 && b >= 1.0, "a = {a}, b = {b}");
    if x <= 0.0 {
        return 0.0;
    }
    if x >= 1.0 {
        return 1.0;
    }
    let factor = power_by_beta(a, b, x);
    // λ = a − (a + b) x, from x or 1 − x, whichever has no cancellation.
    let lambda = if x < 0.5 {
        a - (a + b) * x
    } else {
        (a + b) * (1.0 - x) - b
    };
    let value = if lambda >= 0.0 {
        factor * fraction(a, b, x, lambda)
    } else {
        1.0 - factor * fraction(b, a, 1.0 - x, -lambda)
    };
    value.clamp(0.0, 1.0)
}

/// Returns x^a (1 − x)^b/B(a, b), without the difference of large logarithms in the definition:
///
/// ```text
/// √(ab/(2πs)) exp(δ(s) − δ(a) − δ(b) − D(a, sx) − D(b, s(1 − x)))        s = a + b
/// ```
///
/// C. Loader: Fast and accurate computation of binomial probabilities (2000).
fn power_by_beta(a: f64, b: f64, x: f64) -> f64 {
    let sum = a + b;
    let deviance = deviance(a, sum * x) + deviance(b, sum * (1.0 - x));
    let stirling = stirling_error(sum) - stirling_error(a) - stirling_error(b);
    (a / sum * b / TAU).sqrt() * libm::exp(stirling - deviance)
}

/// Returns δ(n) = ln Γ(n + 1) − (n + ½) ln n + n − ln(2π)/2, the error of Stirling's formula.
fn stirling_error(n: f64) -> f64 {
    if n < 16.0 {
        return libm::lgamma(n + 1.0) - (n + 0.5) * libm::log(n) + n - 0.5 * libm::log(TAU);
    }
    let square = 1.0 / (n * n);
    let coefficients = [
        1.0 / 12.0,
        -1.0 / 360.0,
        1.0 / 1260.0,
        -1.0 / 1680.0,
        1.0 / 1188.0,
    ];
    let series = coefficients.iter().rev();
    series.fold(0.0, |sum, coefficient| sum * square + coefficient) / n
}

/// Returns D(value, mean) = value ln(value/mean) + mean − value ≥ 0, near 0 by the series in v = (value − mean)/(value +
/// mean):
///
/// ```text
/// D = (value − mean) v + 2 value (v³/3 + v⁵/5 + …)
/// ```
fn deviance(value: f64, mean: f64) -> f64 {
    let v = (value - mean) / (value + mean);
    if v.abs() >= 0.1 {
        return value * libm::log(value / mean) + mean - value;
    }
    // v² ≤ 1e-2: the tenth term is below the last digit of the first.
    let odd = (1..=10).rev().map(|j| 1.0 / f64::from(2 * j + 1));
    let series = odd.fold(0.0, |sum, coefficient| (sum + coefficient) * v * v);
    (value - mean) * v + 2.0 * value * v * series
}

/// Returns 1/(β₁ + α₁/(β₂ + α₂/(β₃ + …))) for λ = a − (a + b) x ≥ 0, by the modified algorithm of Lentz (Numerical Recipes,
/// 3rd edition, 5.2):
///
/// ```text
/// α_n     = (a + n − 1)(a + b + n − 1) n (b − n) x²/(a + 2n − 1)²
/// β_{n+1} = n + n (b − n) x/(a + 2n − 1) + (a + n)(λ + 1 + n (2 − x))/(a + 2n + 1)
/// ```
fn fraction(a: f64, b: f64, x: f64, lambda: f64) -> f64 {
    let not_zero = |value: f64| if value.abs() < TINY { TINY } else { value };
    let first = a * (lambda + 1.0) / (a + 1.0);
    let (mut fraction, mut numerator, mut denominator) = (first, first, 0.0);
    for n in (1..=TERMS).map(f64::from) {
        let before = a + 2.0 * n - 1.0;
        let weight = n * (b - n) * x / before;
        let alpha = (a + n - 1.0) * ((a + b + n - 1.0) * x / before) * weight;
        let beta = n + weight + (a + n) * (lambda + 1.0 + n * (2.0 - x)) / (a + 2.0 * n + 1.0);
        denominator = 1.0 / not_zero(beta + alpha * denominator);
        numerator = not_zero(beta + alpha / numerator);
        let change = denominator * numerator;
        fraction *= change;
        if (change - 1.0).abs() <= TOLERANCE {
            break;
        }
    }
    1.0 / fraction
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn values_are_those_of_an_independent_implementation() {
        // scipy.special.betainc(a, b, x)
        let cases = [
            (2.0, 3.0, 0.3, 0.34829999999999994),
            (1.0, 2995.0, 0.001, 0.9500382966026436),
            (2991.0, 4.0, 0.999, 0.6485768282891785),
            (500.0, 501.0, 0.5, 0.5126125090891802),
            (50.0, 1.0, 0.9, 0.005153775207320118),
        ];
        for (a, b, x, expected) in cases {
            let value = regularised(a, b, x);
            assert!(
                (value / expected - 1.0).abs() < 1e-12,
                "I_{x}({a}, {b}) = {value}, not {expected}"
            );
        }
    }

    #[test]
    fn a_thousand_million_trials_cost_no_digits() {
        // P(X = n) is x^n.
        let (n, x) = (1e9, 1.0 - 1e-9);
        assert!((regularised(n, 1.0, x) / libm::exp(n * libm::log(x)) - 1.0).abs() < 1e-12);
    }

    proptest! {
        #[test]
        fn the_power_by_beta_is_as_defined(a in 0.5..40.0f64, b in 0.5..40.0f64, x in 0.01..0.99f64) {
            let log_beta = libm::lgamma(a) + libm::lgamma(b) - libm::lgamma(a + b);
            let expected = libm::exp(a * libm::log(x) + b * libm::log1p(-x) - log_beta);
            prop_assert!((power_by_beta(a, b, x) / expected - 1.0).abs() < 1e-12);
        }

        #[test]
        fn both_tails_are_the_whole(a in 1.0..500.0f64, b in 1.0..500.0f64, x in 0.0..1.0f64) {
            let whole = regularised(a, b, x) + regularised(b, a, 1.0 - x);
            prop_assert!((whole - 1.0).abs() < 1e-12, "{whole}");
        }

        #[test]
        fn values_are_sums_of_binomial_probabilities(k in 1..40u32, failures in 0..40u32, x in 0.01..0.99f64) {
            let n = k + failures;
            // P(X = 0), and from each probability the next.
            let mut probability = libm::pow(1.0 - x, f64::from(n));
            let mut sum = 0.0;
            for successes in 0..=n {
                if successes >= k {
                    sum += probability;
                }
                probability *= f64::from(n - successes) / f64::from(successes + 1) * x / (1.0 - x);
            }
            let value = regularised(f64::from(k), f64::from(n - k + 1), x);
            prop_assert!((value - sum).abs() < 1e-12, "{value} {sum}");
        }
    }
}
