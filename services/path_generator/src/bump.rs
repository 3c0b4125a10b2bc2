//! Bump ψ by which the path waits: C^∞, 1 up to α1, 0 from α2 on.
//!
//! ψ(s) = ½ tanh χ + ½ with χ = θ/(θ² − 1), θ = (2s − α1 − α2)/(α2 − α1). χ runs from +∞ at α1 to −∞ at α2, so this
//! form cancels near the ends and loses all digits there. With a = (s − α1)/(α2 − α1) and b = (α2 − s)/(α2 − α1) it is
//!
//!   θ = a − b,  1 − θ² = 4ab,  χ = (b − a)/(4ab),  ½ tanh χ + ½ = 1/(1 + exp(−2χ)),
//!
//! and each of these is accurate to a few roundings throughout.

/// ψ and its first two derivatives at a point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BumpPoint {
    /// ψ, 0 to 1.
    pub value: f64,
    /// ψ′ = dψ/ds, 1/m, never positive.
    pub slope: f64,
    /// ψ″ = d²ψ/ds², 1/m².
    pub curvature: f64,
}

impl BumpPoint {
    fn flat(value: f64) -> Self {
        Self {
            value,
            slope: 0.0,
            curvature: 0.0,
        }
    }

    /// Returns whether ψ′ = ψ″ = 0: outside of the transition, and near its ends, where both round to zero.
    #[must_use]
    pub fn is_flat(&self) -> bool {
        self.slope == 0.0 && self.curvature == 0.0
    }
}

/// Error of the limits α1 and α2.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[error(
    "the path cannot slow down between alpha1 = {alpha1} and alpha2 = {alpha2}: choose 0 ≤ alpha1 < alpha2; the paper uses 0.5 and 1.5"
)]
pub struct TransitionError {
    /// α1, m.
    pub alpha1: f64,
    /// α2, m.
    pub alpha2: f64,
}

/// Bump between α1 and α2.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bump {
    alpha1: f64,
    alpha2: f64,
}

impl Bump {
    /// Makes the bump that is 1 up to `alpha1` and 0 from `alpha2` on, m.
    ///
    /// # Errors
    /// [`TransitionError`] unless 0 ≤ α1 < α2 < ∞.
    pub fn new(alpha1: f64, alpha2: f64) -> Result<Self, TransitionError> {
        if 0.0 <= alpha1 && alpha1 < alpha2 && alpha2.is_finite() {
            Ok(Self { alpha1, alpha2 })
        } else {
            Err(TransitionError { alpha1, alpha2 })
        }
    }

    /// Returns ψ, ψ′ and ψ″ at a distance `s` ≥ 0, m. At and outside α1 and α2 the derivatives are exactly 0.
    #[must_use]
    pub fn at(&self, s: f64) -> BumpPoint {
        if s <= self.alpha1 {
            return BumpPoint::flat(1.0);
        }
        if s >= self.alpha2 {
            return BumpPoint::flat(0.0);
        }
        let width = self.alpha2 - self.alpha1;
        let (a, b) = ((s - self.alpha1) / width, (self.alpha2 - s) / width);
        let (theta, q) = (a - b, 4.0 * a * b); // q = 1 − θ²
        let chi = -theta / q;

        // e = exp(−2|χ|) is 0 from |χ| ≈ 373 on, before any power of 1/q below could overflow.
        let e = libm::exp(-2.0 * chi.abs());
        if e == 0.0 {
            return BumpPoint::flat(if chi > 0.0 { 1.0 } else { 0.0 });
        }
        let tanh = (1.0 - e).copysign(chi) / (1.0 + e);
        let sech2 = 4.0 * e / ((1.0 + e) * (1.0 + e));
        let chi1 = -(1.0 + theta * theta) / (q * q); // dχ/dθ
        let chi2 = -2.0 * theta * (theta * theta + 3.0) / (q * q * q); // d²χ/dθ²
        let theta1 = 2.0 / width; // dθ/ds
        BumpPoint {
            value: if chi > 0.0 { 1.0 } else { e } / (1.0 + e),
            slope: 0.5 * sech2 * chi1 * theta1,
            curvature: 0.5 * sech2 * (chi2 - 2.0 * tanh * chi1 * chi1) * theta1 * theta1,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::taylor::Taylor;
    use proptest::prelude::*;

    const PAPER: Bump = Bump {
        alpha1: 0.5,
        alpha2: 1.5,
    };

    /// Places all over the transition, as many near the ends as in the middle; binary fractions, so that
    /// neither a place nor θ there is rounded.
    fn part_of_transition() -> impl Strategy<Value = f64> {
        let near_an_end = (-12.0..-0.31f64).prop_map(libm::exp10);
        let anywhere = prop_oneof![
            0.0..1.0f64,
            near_an_end.clone(),
            near_an_end.prop_map(|part| 1.0 - part)
        ];
        const FINEST: f64 = (1_u64 << 42) as f64;
        anywhere.prop_map(|part| (part * FINEST).round() / FINEST)
    }

    /// ψ as the paper writes it.
    fn as_written(bump: &Bump, s: f64) -> Taylor {
        let Bump { alpha1, alpha2 } = *bump;
        let theta =
            (Taylor::variable(s) * 2.0 - Taylor::constant(alpha1 + alpha2)) * (1.0 / (alpha2 - alpha1));
        (theta / (theta * theta - Taylor::constant(1.0))).tanh() * 0.5 + Taylor::constant(0.5)
    }

    proptest! {
        #[test]
        fn value_and_derivatives_are_those_of_the_formula(
            part in part_of_transition(), eighths in 0..32u8, exponent in -3..3i32,
        ) {
            let (alpha1, width) = (f64::from(eighths) / 8.0, libm::ldexp(1.0, exponent));
            let (bump, s) = (Bump::new(alpha1, alpha1 + width).unwrap(), alpha1 + part * width);
            let (point, q) = (bump.at(s), 4.0 * part * (1.0 - part));
            if q < 1e-3 {
                // Where the formula as written gives no number, ψ is flat to the last bit.
                prop_assert!(point.is_flat() && (point.value == 0.0 || point.value == 1.0), "{:?}", point);
                return Ok(());
            }
            let expected = as_written(&bump, s);
            prop_assert!((point.value - expected.derivative(0)).abs() < 1e-14);
            // As written, χ ≈ 1/q is accurate to 1/q roundings, and its exponential to χ times as many.
            let tolerance = 1e-14 / (q * q);
            for (got, order) in [(point.slope, 1), (point.curvature, 2)] {
                let wanted = expected.derivative(order);
                // ψ″ passes through zero three times, at q > 0.4: there its terms are the scale.
                let scale = wanted.abs() + if q > 0.4 { 4.0 / (width * width) } else { 0.0 };
                prop_assert!((got - wanted).abs() <= tolerance * scale + 1e-290, "{} {} {}", order, got, wanted);
            }
        }

        #[test]
        fn it_falls_and_stays_between_0_and_1(one in 0.0..2.0f64, other in 0.0..2.0f64) {
            let (near, far) = (PAPER.at(one.min(other)), PAPER.at(one.max(other)));
            prop_assert!(1.0 >= near.value && near.value >= far.value && far.value >= 0.0);
            prop_assert!(near.slope <= 0.0);
        }

        #[test]
        fn it_is_symmetric_about_the_middle_of_the_transition(part in part_of_transition()) {
            let (left, right) = (PAPER.at(0.5 + part), PAPER.at(1.5 - part));
            prop_assert!((left.value + right.value - 1.0).abs() < 1e-15);
            prop_assert_eq!(left.slope, right.slope);
            prop_assert_eq!(left.curvature, -right.curvature);
        }

        #[test]
        fn the_smallest_steps_into_the_transition_yield_numbers(ulps in 0..1_000_000u64, exponent in 0..52u32) {
            for (end, step) in [(PAPER.alpha1, 1), (PAPER.alpha2, -1), (0.0, 1)] {
                let bump = if end == 0.0 { Bump::new(0.0, 1e9).unwrap() } else { PAPER };
                let step = i64::try_from(ulps.min(1 << exponent)).unwrap() * step;
                let s = f64::from_bits(end.to_bits().checked_add_signed(step).unwrap());
                let point = bump.at(s);
                prop_assert!(point.is_flat(), "{:?}", point);
                prop_assert_eq!(point.value, if end == PAPER.alpha2 { 0.0 } else { 1.0 });
            }
        }
    }

    #[test]
    fn the_ends_and_the_outside_are_exactly_flat() {
        for s in [0.0, 0.25, 0.5] {
            assert_eq!(PAPER.at(s), BumpPoint::flat(1.0));
        }
        for s in [1.5, 2.0, 1e300, f64::INFINITY] {
            assert_eq!(PAPER.at(s), BumpPoint::flat(0.0));
        }
    }

    #[test]
    fn the_middle_has_half_the_value_and_the_slope_minus_one_over_the_width() {
        // θ = 0: χ = 0, χ′ = −1, so ψ = ½ and ψ′ = −½ · 2/(α2 − α1).
        let middle = PAPER.at(1.0);
        assert_eq!((middle.value, middle.slope), (0.5, -1.0));
        assert_eq!(middle.curvature.abs(), 0.0);
    }

    #[test]
    fn the_far_tail_keeps_its_relative_accuracy() {
        // θ = ¾: χ = −12/7, ψ = e/(1 + e) with e = exp(−24/7).
        let e = libm::exp(-24.0 / 7.0);
        assert!((PAPER.at(1.375).value / (e / (1.0 + e)) - 1.0).abs() < 1e-14);
        // θ = 63/64: χ = −(63/64)/(1 − (63/64)²) = −4032/127, ψ ≈ 2.7e−28.
        let tail = PAPER.at(1.5 - 1.0 / 128.0).value;
        assert!((tail / libm::exp(-8064.0 / 127.0) - 1.0).abs() < 1e-12);
    }

    #[test]
    fn a_transition_without_width_or_below_zero_is_refused() {
        for (alpha1, alpha2) in [
            (1.0, 1.0),
            (1.5, 0.5),
            (-0.5, 1.0),
            (0.5, f64::INFINITY),
            (f64::NAN, 1.0),
        ] {
            let error = Bump::new(alpha1, alpha2).unwrap_err();
            assert!(error.to_string().contains("0 ≤ alpha1 < alpha2"), "{error}");
        }
    }
}
