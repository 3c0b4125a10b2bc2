//! Cayley map: a chart of SO(3) without trigonometric functions.
//!
//! θ ∈ R³ maps to the rotation about θ by 2 atan(‖θ‖/2), which is the rotation vector θ itself up to O(‖θ‖³). Unlike
//! the exponential map, the map and its derivative are rational. So every θ gives a rotation, there is no 0/0 at θ = 0,
//! and the result has the same bits on every machine.

use nalgebra::{Matrix3, Vector3};
use shared_types::rotation::skew;

/// Returns cay(θ) = (I − S(θ)/2)⁻¹ (I + S(θ)/2) = I + (S + S²/2) · 4/(4 + ‖θ‖²) ∈ SO(3).
#[must_use]
#[inline]
pub fn rotation(theta: &Vector3<f64>) -> Matrix3<f64> {
    let s = skew(theta);
    Matrix3::identity() + (s + s * s * 0.5) * (4.0 / (4.0 + theta.norm_squared()))
}

/// Returns θ̇ = ω + θ × ω/2 + θ (θᵀω)/4, with which R = R0 cay(θ) satisfies Ṙ = R S(ω), eq. (2).
#[must_use]
#[inline]
pub fn chart_rate(theta: &Vector3<f64>, omega: &Vector3<f64>) -> Vector3<f64> {
    omega + theta.cross(omega) * 0.5 + theta * (0.25 * theta.dot(omega))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use shared_types::rotation::{defect, exp};

    fn vector(bound: f64) -> impl Strategy<Value = Vector3<f64>> {
        [-bound..bound, -bound..bound, -bound..bound].prop_map(Vector3::from)
    }

    proptest! {
        #[test]
        fn every_vector_gives_a_rotation(direction in vector(1.0), exponent in -12..12i32) {
            let theta = direction * libm::pow(10.0, f64::from(exponent));
            prop_assert!(defect(&rotation(&theta)) < 2e-15);
        }

        #[test]
        fn the_angle_is_twice_the_arc_tangent_of_half_the_length(theta in vector(10.0)) {
            prop_assume!(theta.norm() > 1e-3);
            let angle = 2.0 * libm::atan(0.5 * theta.norm());
            prop_assert!((rotation(&theta) - exp(&(theta.normalize() * angle))).norm() < 1e-14);
        }

        #[test]
        fn the_chart_rate_turns_the_rotation_by_omega(theta in vector(3.0), omega in vector(3.0)) {
            let h = 1e-5;
            let step = chart_rate(&theta, &omega) * h;
            let derivative = (rotation(&(theta + step)) - rotation(&(theta - step))) / (2.0 * h);
            prop_assert!((derivative - rotation(&theta) * skew(&omega)).norm() < 1e-7);
        }
    }
}
