//! Student's t distribution with a whole number of degrees of freedom.

use std::f64::consts::{FRAC_2_PI, FRAC_PI_2};

use crate::assert_confidence;

/// Number of bisections: more than the bits of a double.
const BISECTIONS: u32 = 60;

/// Returns the t with P(|T| ≤ t) = confidence: the half-width of an interval in standard errors, for a standard error
/// estimated with that number of degrees of freedom. The relative error is about 1e-12/(1 − confidence).
///
/// # Panics
/// If there are no degrees of freedom, or if the confidence is not between 0 and 1.
#[must_use]
pub fn two_sided(confidence: f64, freedom: usize) -> f64 {
    assert!(freedom > 0, "no degrees of freedom");
    assert_confidence(confidence);
    let (mut low, mut high) = (0.0, FRAC_PI_2);
    for _ in 0..BISECTIONS {
        let middle = 0.5 * (low + high);
        if central(middle, freedom) < confidence {
            low = middle;
        } else {
            high = middle;
        }
    }
    libm::tan(0.5 * (low + high)) * (freedom as f64).sqrt()
}

/// Returns P(|T| ≤ t) for t = √ν tan θ:
///
/// ```text
/// ν odd:   2/π (θ + sin θ (cos θ + 2/3 cos³θ + … + (2·4⋯(ν − 3))/(3·5⋯(ν − 2)) cos^(ν−2) θ))
/// ν even:  sin θ (1 + 1/2 cos²θ + … + (1·3⋯(ν − 3))/(2·4⋯(ν − 2)) cos^(ν−2) θ)
/// ```
///
/// M. Abramowitz and I. A. Stegun: Handbook of Mathematical Functions (1964), 26.7.3 and 26.7.4.
fn central(angle: f64, freedom: usize) -> f64 {
    let (sine, cosine) = (libm::sin(angle), libm::cos(angle));
    let is_odd = freedom % 2 == 1;
    let first = if is_odd { cosine } else { 1.0 };
    let exponents = (if is_odd { 1 } else { 0 }..freedom.saturating_sub(1)).step_by(2);
    let (sum, _) = exponents.fold((0.0, first), |(sum, term), exponent| {
        let exponent = exponent as f64;
        let next = term * cosine * cosine * (exponent + 1.0) / (exponent + 2.0);
        (sum + term, next)
    });
    if is_odd {
        FRAC_2_PI * (angle + sine * sum)
    } else {
        sine * sum
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn quantiles_are_those_of_an_independent_implementation() {
        // scipy.stats.t.ppf((1 + confidence)/2, freedom)
        let cases = [
            (0.95, 1, 12.706204736174694),
            (0.95, 2, 4.302652729749462),
            (0.95, 3, 3.1824463052837078),
            (0.95, 4, 2.7764451051977934),
            (0.95, 5, 2.5705818356363146),
            (0.95, 10, 2.228138851986274),
            (0.95, 14, 2.144786687917804),
            (0.95, 99, 1.9842169515864174),
            (0.95, 4500, 1.9604912953352636),
            (0.999, 1, 636.6192487687897),
            (0.999, 2, 31.599054576445365),
            (0.999, 3, 12.923978636687961),
            (0.999, 4, 8.610301581379522),
            (0.999, 5, 6.868826625881276),
            (0.999, 10, 4.586893858702708),
            (0.999, 14, 4.140454112738259),
            (0.999, 99, 3.391528833363685),
            (0.999, 4500, 3.292690184964743),
        ];
        for (confidence, freedom, expected) in cases {
            let t = two_sided(confidence, freedom);
            assert!(
                (t / expected - 1.0).abs() < 1e-9,
                "{confidence}, {freedom}: {t}, not {expected}"
            );
        }
    }

    proptest! {
        #[test]
        fn fewer_degrees_of_freedom_and_more_confidence_widen_an_interval(
            confidence in 0.01..0.99f64,
            more in 0.001..0.009f64,
            freedom in 1..300_usize,
        ) {
            let t = two_sided(confidence, freedom);
            prop_assert!(t > two_sided(confidence, freedom + 1));
            prop_assert!(t < two_sided(confidence + more, freedom));
            prop_assert!(t > -crate::normal::quantile(0.5 * (1.0 - confidence)));
        }
    }
}
