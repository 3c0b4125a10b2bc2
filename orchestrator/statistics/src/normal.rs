//! The standard normal distribution: Φ and its inverse.

use std::f64::consts::FRAC_1_SQRT_2;

/// a₀ … a₇ of the paper.
const CENTRE_NUMERATOR: [f64; 8] = [
    3.3871328727963665,
    133.14166789178438,
    1971.5909503065513,
    13731.69376550946,
    45921.95393154987,
    67265.7709270087,
    33430.57558358813,
    2509.0809287301227,
];

/// 1, b₁ … b₇ of the paper.
const CENTRE_DENOMINATOR: [f64; 8] = [
    1.0,
    42.31333070160091,
    687.1870074920579,
    5394.196021424751,
    21213.794301586597,
    39307.89580009271,
    28729.085735721943,
    5226.495278852854,
];

/// c₀ … c₇ of the paper.
const TAIL_NUMERATOR: [f64; 8] = [
    1.4234371107496835,
    4.630337846156546,
    5.769497221460691,
    3.6478483247632045,
    1.2704582524523684,
    0.2417807251774506,
    0.022723844989269184,
    0.0007745450142783414,
];

/// 1, d₁ … d₇ of the paper.
const TAIL_DENOMINATOR: [f64; 8] = [
    1.0,
    2.053191626637759,
    1.6763848301838038,
    0.6897673349851,
    0.14810397642748008,
    0.015198666563616457,
    0.0005475938084995345,
    1.0507500716444169e-09,
];

/// e₀ … e₇ of the paper.
const FAR_NUMERATOR: [f64; 8] = [
    6.657904643501103,
    5.463784911164114,
    1.7848265399172913,
    0.29656057182850487,
    0.026532189526576124,
    0.0012426609473880784,
    2.7115555687434876e-05,
    2.0103343992922881e-07,
];

/// 1, f₁ … f₇ of the paper.
const FAR_DENOMINATOR: [f64; 8] = [
    1.0,
    0.599832206555888,
    0.1369298809227358,
    0.014875361290850615,
    0.0007868691311456133,
    1.8463183175100548e-05,
    1.421511758316446e-07,
    2.0442631033899397e-15,
];

/// Returns Φ(z) = erfc(−z/√2)/2.
pub fn cumulative(z: f64) -> f64 {
    0.5 * libm::erfc(-z * FRAC_1_SQRT_2)
}

/// Returns Φ⁻¹(p) with a relative error of 1e-16 for 0 < p < 1, −∞ for 0 and ∞ for 1.
///
/// M. J. Wichura: Algorithm AS 241, the percentage points of the normal distribution, Applied Statistics 37 (1988),
/// 477–484, routine PPND16: a rational function of q² with q = p − ½ near the median, and of √(−ln min(p, 1 − p))
/// in the tails.
pub fn quantile(p: f64) -> f64 {
    let q = p - 0.5;
    if q.abs() <= 0.425 {
        let r = 0.180625 - q * q;
        return q * polynomial(&CENTRE_NUMERATOR, r) / polynomial(&CENTRE_DENOMINATOR, r);
    }
    let tail = if q < 0.0 { p } else { 1.0 - p };
    if tail <= 0.0 {
        return f64::INFINITY.copysign(q);
    }
    let r = (-libm::log(tail)).sqrt();
    let size = if r <= 5.0 {
        polynomial(&TAIL_NUMERATOR, r - 1.6) / polynomial(&TAIL_DENOMINATOR, r - 1.6)
    } else {
        polynomial(&FAR_NUMERATOR, r - 5.0) / polynomial(&FAR_DENOMINATOR, r - 5.0)
    };
    size.copysign(q)
}

/// Returns the polynomial in x with coefficients in ascending order, by Horner's rule.
fn polynomial(coefficients: &[f64], x: f64) -> f64 {
    coefficients
        .iter()
        .rev()
        .fold(0.0, |sum, coefficient| sum * x + coefficient)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn quantiles_are_those_of_an_independent_implementation() {
        // scipy.stats.norm.ppf(p)
        let cases = [
            (1e-300, -37.0470962993612),
            (1e-20, -9.262340089798409),
            (1e-6, -4.753424308822899),
            (0.025, -1.9599639845400545),
            (0.1, -1.2815515655446004),
            (0.425, -0.18911842627279252),
            (0.6, 0.2533471031357997),
            (0.95, 1.6448536269514722),
            (0.999999, 4.753424308817087),
        ];
        for (p, expected) in cases {
            let z = quantile(p);
            assert!((z / expected - 1.0).abs() < 1e-15, "{p}: {z}, not {expected}");
        }
        assert_eq!(
            [0.0, 0.5, 1.0].map(quantile),
            [f64::NEG_INFINITY, 0.0, f64::INFINITY]
        );
    }

    proptest! {
        #[test]
        fn the_quantile_inverts_the_cumulative_distribution(z in -8.0..5.0f64) {
            let error = quantile(cumulative(z)) - z;
            // Above 0 the rounding of p near 1 limits what can be known of z.
            let density = libm::exp(-0.5 * z * z) / std::f64::consts::TAU.sqrt();
            prop_assert!(error.abs() < 1e-14 + 1e-16 / density.min(0.4) * f64::from(z > 0.0), "{error:e}");
        }
    }
}
