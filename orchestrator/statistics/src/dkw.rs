//! The Dvoretzky–Kiefer–Wolfowitz band around an empirical distribution.

/// Returns the half-width ε of the band around the empirical distribution function of n independent values that contains the
/// distribution function with a confidence:
///
/// ```text
/// P(sup |F_n − F| > ε) ≤ 2 e^(−2nε²)        ε = √(ln(2/(1 − confidence))/(2n))
/// ```
///
/// At most 1, also for no values. P. Massart: The tight constant in the Dvoretzky–Kiefer–Wolfowitz inequality,
/// Annals of Probability 18 (1990), 1269–1283.
///
/// # Panics
/// If the confidence is not between 0 and 1.
#[must_use]
pub fn half_width(n: u64, confidence: f64) -> f64 {
    crate::assert_confidence(confidence);
    if n == 0 {
        return 1.0;
    }
    (libm::log(2.0 / (1.0 - confidence)) / (2.0 * n as f64))
        .sqrt()
        .min(1.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_band_of_a_thousand_values_is_as_wide_as_the_inequality_says() {
        // math.sqrt(math.log(2/0.05)/2000)
        assert!((half_width(1000, 0.95) - 0.04294694083467376).abs() < 1e-15);
    }

    #[test]
    fn four_times_the_values_halve_the_band() {
        assert!((half_width(400, 0.9) / half_width(1600, 0.9) - 2.0).abs() < 1e-14);
    }

    #[test]
    fn few_values_say_nothing() {
        assert_eq!([half_width(0, 0.95), half_width(1, 0.95)], [1.0, 1.0]);
    }
}
