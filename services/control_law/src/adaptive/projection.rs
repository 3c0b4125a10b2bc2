//! Smooth projection π (5), which keeps estimates within known bounds, and its potential V (6).

/// Projection π(s) of one number: the identity on [smin, smax], and beyond it an exponential approach to smin − ε and
/// smax + ε.
///
/// π is of class C¹, increases strictly in exact arithmetic and stays within [smin − ε, smax + ε]. It uses `expm1`,
/// because 1 − e^(−x/ε) would lose all digits to cancellation just beyond a bound, where π must continue the identity
/// without a step. It calls `libm` and not the system's functions, so that results are equal to the bit on every
/// machine.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Projection {
    /// smin, lower bound.
    pub minimum: f64,
    /// smax, upper bound; above smin.
    pub maximum: f64,
    /// ε, largest excess of the projection over the bounds; positive.
    pub epsilon: f64,
}

impl Projection {
    /// Returns π(s), eq. (5).
    #[must_use]
    #[inline]
    pub fn value(&self, s: f64) -> f64 {
        let Self {
            minimum,
            maximum,
            epsilon,
        } = *self;
        if s > maximum {
            maximum - epsilon * libm::expm1((maximum - s) / epsilon)
        } else if s < minimum {
            minimum + epsilon * libm::expm1((s - minimum) / epsilon)
        } else {
            s
        }
    }

    /// Returns π′(s) = dπ/ds, from the derivative of (5): 1 within the bounds, (0, 1] beyond.
    #[must_use]
    #[inline]
    pub fn slope(&self, s: f64) -> f64 {
        let excess = self.excess(s);
        if excess > 0.0 {
            libm::exp(-excess / self.epsilon)
        } else {
            1.0
        }
    }

    /// Returns V(s, s̃) = ∫₀^s̃ (π(φ + s) − s) dφ, eq. (6), with s̃ = ŝ − s: the share of an estimate ŝ of `actual` s
    /// in the Lyapunov function.
    ///
    /// Positive for s̃ ≠ 0 if s lies within the bounds; ½s̃² if ŝ does as well.
    #[must_use]
    pub fn potential(&self, actual: f64, estimate: f64) -> f64 {
        // π(x) − s = (x − s) + (π(x) − x). The second bracket is zero within the bounds.
        let error = estimate - actual;
        0.5 * error * error + self.correction(estimate) - self.correction(actual)
    }

    /// Returns ∫ (π(x) − x) dx from the nearest bound to s; zero within the bounds.
    fn correction(&self, s: f64) -> f64 {
        let (epsilon, excess) = (self.epsilon, self.excess(s));
        epsilon * excess + epsilon * epsilon * libm::expm1(-excess / epsilon) - 0.5 * excess * excess
    }

    /// Returns the distance of s from [smin, smax].
    #[inline]
    fn excess(&self, s: f64) -> f64 {
        (s - self.maximum).max(self.minimum - s).max(0.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    prop_compose! {
        fn projection()(
            minimum in -5.0..5.0f64, width in 0.01..10.0f64, epsilon in 0.01..1.0f64,
        ) -> Projection {
            Projection { minimum, maximum: minimum + width, epsilon }
        }
    }

    /// A projection and an s up to 8ε beyond its bounds.
    fn projection_and_place() -> impl Strategy<Value = (Projection, f64)> {
        (projection(), 0.0..1.0f64).prop_map(|(projection, part)| {
            let Projection {
                minimum,
                maximum,
                epsilon,
            } = projection;
            let reach = 8.0 * epsilon;
            (
                projection,
                minimum - reach + part * (maximum - minimum + 2.0 * reach),
            )
        })
    }

    /// ∫ f from a to b by Gauss–Legendre with five nodes in each of 64 pieces.
    fn integral(f: impl Fn(f64) -> f64, a: f64, b: f64) -> f64 {
        const NODES: [(f64, f64); 3] = [
            (0.0, 128.0 / 225.0),
            (0.538_469_310_105_683_1, 0.478_628_670_499_366_47),
            (0.906_179_845_938_664, 0.236_926_885_056_189_08),
        ];
        let half = (b - a) / 128.0;
        let piece = |index: u32| {
            let middle = a + half * f64::from(2 * index + 1);
            NODES
                .iter()
                .map(|&(x, weight)| match x {
                    0.0 => weight * f(middle),
                    x => weight * (f(middle - half * x) + f(middle + half * x)),
                })
                .sum::<f64>()
        };
        half * (0..64).map(piece).sum::<f64>()
    }

    /// The same integral in three parts, so that no piece straddles a bound, where π has a kink in π′.
    fn integral_between_kinks(projection: &Projection, s: f64, estimate: f64) -> f64 {
        let inside = |x: f64| x.clamp(projection.minimum, projection.maximum);
        let integrand = |x| projection.value(x) - s;
        integral(integrand, s, inside(s))
            + integral(integrand, inside(s), inside(estimate))
            + integral(integrand, inside(estimate), estimate)
    }

    proptest! {
        #[test]
        fn the_value_is_the_identity_inside_and_stays_within_epsilon_outside(
            (projection, s) in projection_and_place(),
        ) {
            let Projection { minimum, maximum, epsilon } = projection;
            let value = projection.value(s);
            if (minimum..=maximum).contains(&s) {
                prop_assert_eq!(value, s);
            } else {
                let excess = if s > maximum { value - maximum } else { minimum - value };
                prop_assert!(excess > 0.0 && excess < epsilon, "{excess}");
            }
        }

        #[test]
        fn the_slope_is_the_derivative_of_the_value((projection, s) in projection_and_place()) {
            let step = 1e-3 * projection.epsilon;
            let bounds = [projection.minimum, projection.maximum];
            let near_a_kink = bounds.iter().any(|bound| (s - bound).abs() < 3.0 * step);
            prop_assume!(!near_a_kink);
            let difference = |h: f64| (projection.value(s + h) - projection.value(s - h)) / (2.0 * h);
            let extrapolated = (4.0 * difference(step) - difference(2.0 * step)) / 3.0;
            prop_assert!((projection.slope(s) - extrapolated).abs() < 1e-9);
        }

        #[test]
        fn value_and_slope_are_continuous_at_the_bounds(projection in projection()) {
            for bound in [projection.minimum, projection.maximum] {
                for s in [bound.next_down(), bound.next_up()] {
                    prop_assert!((projection.value(s) - bound).abs() <= 4.0 * (s - bound).abs());
                    prop_assert!((projection.slope(s) - 1.0).abs() < 1e-12);
                }
            }
        }

        #[test]
        fn the_potential_is_the_integral(
            (projection, estimate) in projection_and_place(), part in -0.1..1.1f64,
        ) {
            let actual = projection.minimum + part * (projection.maximum - projection.minimum);
            let (got, wanted) = (
                projection.potential(actual, estimate),
                integral_between_kinks(&projection, actual, estimate),
            );
            let scale = 1.0 + actual * actual + estimate * estimate;
            prop_assert!((got - wanted).abs() < 1e-13 * scale, "{} {}", got, wanted);
        }

        #[test]
        fn the_potential_is_positive_for_a_value_within_the_bounds(
            projection in projection(),
            part in 0.0..=1.0f64,
            error in prop_oneof![-20.0..-1e-6f64, 1e-6..20.0f64],
        ) {
            let actual = projection.minimum + part * (projection.maximum - projection.minimum);
            prop_assert!(projection.potential(actual, actual + error) > 0.0);
            prop_assert_eq!(projection.potential(actual, actual), 0.0);
        }
    }

    #[test]
    fn the_value_of_the_papers_mass_bounds_is_positive_for_any_estimate() {
        let projection = Projection {
            minimum: 1.0 / 0.6,
            maximum: 10.0,
            epsilon: 0.01,
        };
        for s in [f64::MIN, -1e9, -1.0, 0.0, 1e9, f64::MAX] {
            let value = projection.value(s);
            assert!(
                value >= projection.minimum - projection.epsilon && value <= 10.01,
                "{s}: {value}"
            );
        }
    }
}
