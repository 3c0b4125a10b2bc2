//! A tilted circle.

use nalgebra::{Matrix3, Vector3};
use shared_types::rotation::paper_rx;

use super::CurvePoint;

/// pd(γ) = Rx(tilt) [r cos wγ, r sin wγ, 0]ᵀ + centre.
#[derive(Clone, Debug, PartialEq)]
pub struct Circle {
    center: Vector3<f64>,
    radius: f64,
    frequency: f64,
    world_from_level: Matrix3<f64>,
}

impl Circle {
    #[must_use]
    pub fn new(parameters: &scenario::Circle) -> Self {
        Self {
            center: Vector3::from(parameters.center),
            radius: parameters.radius,
            frequency: parameters.frequency,
            world_from_level: paper_rx(parameters.tilt),
        }
    }

    /// Returns pd(γ) and its derivatives.
    #[must_use]
    pub fn at(&self, gamma: f64) -> CurvePoint {
        let w = self.frequency;
        let (s, c) = libm::sincos(w * gamma);
        let spoke = self.world_from_level * Vector3::new(self.radius * c, self.radius * s, 0.0);
        let tangent = self.world_from_level * Vector3::new(-self.radius * s, self.radius * c, 0.0);
        CurvePoint {
            position: spoke + self.center,
            derivative1: tangent * w,
            derivative2: spoke * -(w * w),
            derivative3: tangent * -(w * w * w),
            derivative4: spoke * (w * w * w * w),
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
        fn the_derivatives_are_those_of_the_tilted_circle(
            gamma in -50.0..50.0f64,
            center in proptest::array::uniform3(-10.0..10.0f64),
            radius in 0.1..3.0f64,
            frequency in -2.0..2.0f64,
            tilt in -1.5..1.5f64,
        ) {
            let circle = Circle::new(&scenario::Circle { center, radius, frequency, tilt });
            let (sine, cosine) = (Taylor::variable(gamma) * frequency).sin_cos();
            let expected = [
                cosine * radius + Taylor::constant(center[0]),
                sine * (radius * libm::cos(tilt)) + Taylor::constant(center[1]),
                sine * (-radius * libm::sin(tilt)) + Taylor::constant(center[2]),
            ];
            prop_assert!(distance_to_taylor(&circle.at(gamma), expected) < 1e-12);
        }
    }
}
