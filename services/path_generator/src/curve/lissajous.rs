//! A Lissajous figure: an oscillation along each axis.

use nalgebra::Vector3;
use shared_types::scenario;

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
    /// The figure of these parameters.
    #[must_use]
    pub fn new(parameters: &scenario::Lissajous) -> Self {
        Self {
            center: parameters.center.into(),
            amplitude: parameters.amplitude.into(),
            frequency: parameters.frequency.into(),
            phase: parameters.phase.into(),
        }
    }

    /// pd(γ) and its derivatives.
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
    }
}
