//! The paper's tilted figure of eight (27), Gerono's lemniscate.

use nalgebra::{Matrix3, Vector3};
use shared_types::rotation::paper_rx;

use super::CurvePoint;

/// pd(γ) = Rx(tilt) [ℓ sin wγ cos wγ, ℓ sin wγ, −height]ᵀ, eq. (27).
#[derive(Clone, Debug, PartialEq)]
pub struct TiltedEight {
    size: f64,
    frequency: f64,
    height: f64,
    world_from_level: Matrix3<f64>,
}

impl TiltedEight {
    #[must_use]
    pub fn new(parameters: &scenario::TiltedEight) -> Self {
        Self {
            size: parameters.size,
            frequency: parameters.frequency,
            height: parameters.height,
            world_from_level: paper_rx(parameters.tilt),
        }
    }

    /// Returns pd(γ) and its derivatives.
    #[must_use]
    pub fn at(&self, gamma: f64) -> CurvePoint {
        let (l, w) = (self.size, self.frequency);
        let (s, c) = libm::sincos(w * gamma);
        // sin cos has half the period: (sin cos)′ = w cos 2wγ, (sin cos)″ = −4w² sin cos.
        let (sc, cos_double) = (s * c, c * c - s * s);
        let (w2, w3, w4) = (w * w, w * w * w, w * w * w * w);
        let level = CurvePoint {
            position: Vector3::new(l * sc, l * s, -self.height),
            derivative1: Vector3::new(l * w * cos_double, l * w * c, 0.0),
            derivative2: Vector3::new(-4.0 * l * w2 * sc, -l * w2 * s, 0.0),
            derivative3: Vector3::new(-4.0 * l * w3 * cos_double, -l * w3 * c, 0.0),
            derivative4: Vector3::new(16.0 * l * w4 * sc, l * w4 * s, 0.0),
        };
        level.turned(&self.world_from_level)
    }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::PI;

    use super::*;
    use crate::curve::testing::distance_to_taylor;
    use crate::taylor::Taylor;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn the_derivatives_are_those_of_equation_27(
            gamma in -50.0..50.0f64, size in 0.1..3.0f64, frequency in -2.0..2.0f64, height in -3.0..3.0f64, tilt in -1.5..1.5f64,
        ) {
            let eight = TiltedEight::new(&scenario::TiltedEight { size, frequency, height, tilt });
            let (sine, cosine) = (Taylor::variable(gamma) * frequency).sin_cos();
            let [x, y, z] = [sine * cosine * size, sine * size, Taylor::constant(-height)];
            let expected = [
                x,
                y * libm::cos(tilt) + z * libm::sin(tilt),
                z * libm::cos(tilt) - y * libm::sin(tilt),
            ];
            prop_assert!(distance_to_taylor(&eight.at(gamma), expected) < 1e-12);
        }

        #[test]
        fn the_eight_returns_after_a_period_however_large_gamma_is(gamma in 0.0..10.0f64, turns in 1..1_000_000u32) {
            let eight = TiltedEight::new(&scenario::TiltedEight { frequency: 2.0 * PI, ..Default::default() });
            // The rounding of γ + turns alone moves the phase by up to 2π·2⁻³³.
            let distance = (eight.at(gamma + f64::from(turns)).position - eight.at(gamma).position).norm();
            prop_assert!(distance < 1e-8, "{}", distance);
        }
    }

    #[test]
    fn the_papers_eight_begins_at_its_crossing_and_spans_0_6_by_1_2_metres() {
        let eight = TiltedEight::new(&scenario::TiltedEight::default());
        let crossing = Vector3::new(0.0, -1.2 * libm::sin(PI / 20.0), -1.2 * libm::cos(PI / 20.0));
        assert!((eight.at(0.0).position - crossing).norm() < 1e-15);
        assert!((eight.at(PI / 0.6).position - crossing).norm() < 1e-15);
        assert!((eight.at(PI / 0.6 / 4.0).position.x - 0.6).abs() < 1e-15);
        let far_end = eight.at(PI / 0.6 / 2.0).position - crossing;
        assert!((far_end.norm() - 1.2).abs() < 1e-15);
        // Its steepest way is the tilt: z falls by 1.2 sin(π/20) m, so the far end is higher.
        assert!((far_end.z + 1.2 * libm::sin(PI / 20.0)).abs() < 1e-15);
        assert!((eight.at(0.0).derivative1.norm() - 1.2 * 0.6 * 2.0_f64.sqrt()).abs() < 1e-15);
    }
}
