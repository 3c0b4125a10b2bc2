//! Saturation σ(x) = σmax tanh(x), element by element, with its derivatives.

use nalgebra::Vector3;

/// Saturation σ(x) = σmax tanh(x).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Saturation {
    /// σmax, the level that no element of σ exceeds.
    pub level: f64,
}

/// σ and its derivatives at one argument; its hyperbolic tangents are evaluated once.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Saturated {
    tanh: Vector3<f64>,
    level: f64,
}

impl Saturation {
    /// Returns σ and its derivatives at x.
    #[must_use]
    #[inline]
    pub fn at(&self, x: &Vector3<f64>) -> Saturated {
        Saturated {
            tanh: x.map(tanh),
            level: self.level,
        }
    }
}

impl Saturated {
    /// Returns σ(x) = σmax tanh(x).
    #[must_use]
    #[inline]
    pub fn value(&self) -> Vector3<f64> {
        self.tanh * self.level
    }

    /// Returns σ′(x) = σmax (1 − tanh²(x)).
    #[must_use]
    #[inline]
    pub fn slope(&self) -> Vector3<f64> {
        self.tanh.map(|t| self.level * (1.0 - t * t))
    }

    /// Returns σ″(x) = −2 σmax tanh(x) (1 − tanh²(x)).
    #[must_use]
    #[inline]
    pub fn curvature(&self) -> Vector3<f64> {
        self.tanh.map(|t| -2.0 * self.level * t * (1.0 - t * t))
    }
}

/// Returns tanh x = (1 − e)/(1 + e) with e = exp(−2|x|).
///
/// The absolute error is about 1e−16. Near zero the difference 1 − e cancels, so that the relative error grows there. A
/// function without that loss takes longer, and the saturated errors are not that exact themselves. The exponent is
/// never positive, so that e does not overflow for large |x|. It calls `libm` for equal bits on every machine.
#[inline]
fn tanh(x: f64) -> f64 {
    let e = libm::exp(-2.0 * x.abs());
    ((1.0 - e) / (1.0 + e)).copysign(x)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// df/dx by central differences of fourth order.
    fn derivative(f: impl Fn(f64) -> f64, x: f64) -> f64 {
        let step = 1e-3;
        let difference = |h: f64| (f(x + h) - f(x - h)) / (2.0 * h);
        (4.0 * difference(step) - difference(2.0 * step)) / 3.0
    }

    proptest! {
        #[test]
        fn slope_and_curvature_are_the_derivatives(
            level in 0.1..5.0f64, x in [-20.0..20.0f64, -2.0..2.0, -0.1..0.1],
        ) {
            let saturation = Saturation { level };
            let at = |x: f64| saturation.at(&Vector3::repeat(x));
            let here = saturation.at(&Vector3::from(x));
            for (axis, &x) in x.iter().enumerate() {
                let slope = derivative(|x| at(x).value().x, x);
                prop_assert!((here.slope()[axis] - slope).abs() < 1e-10 * level, "slope at {}", x);
                let curvature = derivative(|x| at(x).slope().x, x);
                prop_assert!((here.curvature()[axis] - curvature).abs() < 1e-10 * level, "curvature at {}", x);
            }
        }

        #[test]
        fn the_hyperbolic_tangent_is_exact_to_an_ulp_of_one(x in prop_oneof![-1e3..1e3f64, -2.0..2.0f64, -1e-6..1e-6f64]) {
            prop_assert!((tanh(x) - libm::tanh(x)).abs() <= 2.3e-16, "{} is not {}", tanh(x), libm::tanh(x));
        }

        #[test]
        fn the_value_is_odd_and_never_passes_the_level(level in 0.1..5.0f64, x in -1e3..1e3f64) {
            let saturation = Saturation { level };
            let value = saturation.at(&Vector3::repeat(x)).value().x;
            prop_assert!(value.abs() <= level);
            prop_assert_eq!(value, -saturation.at(&Vector3::repeat(-x)).value().x);
            prop_assert!(value * x > 0.0 || x.abs() < 1e-16);
        }
    }
}
