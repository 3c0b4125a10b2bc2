//! A Lissajous figure: an oscillation along each axis.

use nalgebra::Vector3;

use super::CurvePoint;

/// pd(γ) = centre + amplitude ∘ sin(frequency γ + phase).
#[derive(Clone, Debug, PartialEq)]
pub struct Lissajous {
    center: Vector3<f64>,
    amplitude: Vector3<f64>,
    frequency: Vector3<f64>,
    phase: Vector3<f64>,
}

impl Lissajous {
    #[must_use]
    pub fn new(parameters: &scenario::Lissajous) -> Self {
        Self {
            center: parameters.center.into(),
            amplitude: parameters.amplitude.into(),
            frequency: parameters.frequency.into(),
            phase: parameters.phase.into(),
        }
    }

    /// Returns pd(γ) and its derivatives.
    #[must_use]
    pub fn at(&self, gamma: f64) -> CurvePoint {
        let w = self.frequency;
        let (mut sine, mut cosine) = (self.amplitude, self.amplitude);
        for axis in 0..3 {
            let (s, c) = libm::sincos(w[axis] * gamma + self.phase[axis]);
            sine[axis] *= s;
            cosine[axis] *= c;
        }
        let w2 = w.component_mul(&w);
        CurvePoint {
            position: self.center + sine,
            derivative1: cosine.component_mul(&w),
            derivative2: -sine.component_mul(&w2),
            derivative3: -cosine.component_mul(&w2).component_mul(&w),
            derivative4: sine.component_mul(&w2).component_mul(&w2),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::curve::Circle;
    use crate::curve::testing::distance_to_taylor;
    use crate::taylor::Taylor;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn the_derivatives_are_those_of_the_oscillations(
            gamma in -50.0..50.0f64,
            center in proptest::array::uniform3(-10.0..10.0f64),
            amplitude in proptest::array::uniform3(-2.0..2.0f64),
            frequency in proptest::array::uniform3(-2.0..2.0f64),
            phase in proptest::array::uniform3(-3.0..3.0f64),
        ) {
            let curve = Lissajous::new(&scenario::Lissajous { center, amplitude, frequency, phase });
            let expected = [0, 1, 2].map(|axis| {
                let angle = Taylor::variable(gamma) * frequency[axis] + Taylor::constant(phase[axis]);
                angle.sin_cos().0 * amplitude[axis] + Taylor::constant(center[axis])
            });
            prop_assert!(distance_to_taylor(&curve.at(gamma), expected) < 1e-12);
        }

        #[test]
        fn two_oscillations_a_quarter_apart_are_a_circle(
            gamma in -20.0..20.0f64, radius in 0.1..3.0f64, frequency in 0.1..3.0f64,
        ) {
            let center = [0.3, -0.2, -1.2];
            let figure = Lissajous::new(&scenario::Lissajous {
                center,
                amplitude: [radius, radius, 0.0],
                frequency: [frequency; 3],
                phase: [std::f64::consts::FRAC_PI_2, 0.0, 0.0],
            });
            let circle = Circle::new(&scenario::Circle { center, radius, frequency, tilt: 0.0 });
            for (one, other) in figure.at(gamma).orders().iter().zip(circle.at(gamma).orders()) {
                prop_assert!((one - other).norm() < 1e-11 * (1.0 + other.norm()), "{} {}", one, other);
            }
        }
    }

    #[test]
    fn an_axis_without_frequency_stands_where_its_phase_is() {
        let bob = Lissajous::new(&scenario::Lissajous {
            center: [1.0, 2.0, -1.2],
            amplitude: [0.5, 0.0, 0.3],
            frequency: [0.0, 7.0, 4.0],
            phase: [std::f64::consts::FRAC_PI_2, 1.0, 0.0],
        });
        for gamma in [-3.0, 0.0, 0.1, 10.0] {
            let point = bob.at(gamma);
            assert_eq!(point.position.xy(), nalgebra::Vector2::new(1.5, 2.0));
            for derivative in &point.orders()[1..] {
                assert_eq!(derivative.xy().norm(), 0.0);
            }
        }
        assert_eq!(bob.at(0.0).position.z, -1.2);
        assert_eq!(bob.at(0.0).derivative1.z, 0.3 * 4.0);
    }
}
