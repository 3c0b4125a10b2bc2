//! Logarithm and right Jacobian of SO(3).

use nalgebra::{Matrix3, Vector3};
use shared_types::rotation::skew;

/// Returns log R: the rotation vector θ, ‖θ‖ ≤ π, with exp S(θ) = R.
///
/// Computed by the unit quaternion, the largest component first (S. W. Shepperd, "Quaternion from rotation matrix", 1978).
/// A division by a small component would lose all digits near the identity or near half a turn. The result is accurate at
/// both, and finite for every matrix.
#[must_use]
pub fn log(r: &Matrix3<f64>) -> Vector3<f64> {
    let (real, imaginary) = quaternion(r);
    let sine = imaginary.norm();
    if sine == 0.0 {
        return Vector3::zeros();
    }
    // q and −q are the same rotation; a positive real part means less than half a turn.
    let sign = 1.0_f64.copysign(real);
    imaginary * (sign * 2.0 * libm::atan2(sine, real.abs()) / sine)
}

/// Returns an unnormalised quaternion of the rotation, as real and imaginary part.
fn quaternion(r: &Matrix3<f64>) -> (f64, Vector3<f64>) {
    let (x, y, z) = (r[(0, 0)], r[(1, 1)], r[(2, 2)]);
    let twist = Vector3::new(
        r[(2, 1)] - r[(1, 2)],
        r[(0, 2)] - r[(2, 0)],
        r[(1, 0)] - r[(0, 1)],
    );
    let [xy, yz, zx] = [
        r[(1, 0)] + r[(0, 1)],
        r[(2, 1)] + r[(1, 2)],
        r[(0, 2)] + r[(2, 0)],
    ];
    // Four times the square of each component. The sum is 4, so the largest is at least 1.
    let squares = [1.0 + x + y + z, 1.0 + x - y - z, 1.0 - x + y - z, 1.0 - x - y + z];
    let largest = squares[0].max(squares[1]).max(squares[2]).max(squares[3]);
    if largest == squares[0] {
        (largest, twist)
    } else if largest == squares[1] {
        (twist.x, Vector3::new(largest, xy, zx))
    } else if largest == squares[2] {
        (twist.y, Vector3::new(xy, largest, yz))
    } else {
        (twist.z, Vector3::new(zx, yz, largest))
    }
}

/// Returns the right Jacobian of SO(3), exp S(φ + δ) ≈ exp S(φ) exp S(Jr(φ) δ), to second order in φ. The error is
/// ‖φ‖³/24, for the small turns of one step and of one correction (Solà, eq. 183 in closed form).
#[must_use]
#[inline]
pub fn right_jacobian(phi: &Vector3<f64>) -> Matrix3<f64> {
    let s = skew(phi);
    Matrix3::identity() - s * 0.5 + s * s * (1.0 / 6.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use shared_types::rotation::exp;
    use std::f64::consts::PI;

    fn direction() -> impl Strategy<Value = Vector3<f64>> {
        [-1.0..1.0, -1.0..1.0, -1.0..1.0f64]
            .prop_map(Vector3::from)
            .prop_filter("a direction", |vector| vector.norm() > 0.1)
            .prop_map(|vector| vector.normalize())
    }

    proptest! {
        #[test]
        fn log_inverts_exp_for_every_angle_up_to_half_a_turn(
            axis in direction(), angle in prop_oneof![0.0..PI, PI - 1e-6..PI, 0.0..1e-9],
        ) {
            let theta = axis * angle;
            let r = exp(&theta);
            prop_assert!((exp(&log(&r)) - r).norm() < 1e-14);
            if angle < PI - 1e-3 {
                prop_assert!((log(&r) - theta).norm() < 1e-14 + 1e-12 * angle);
            }
        }

        #[test]
        fn log_is_finite_and_at_most_half_a_turn_for_any_matrix(
            elements in proptest::array::uniform9(-1e3..1e3f64),
        ) {
            let theta = log(&Matrix3::from_row_slice(&elements));
            prop_assert!(theta.norm() <= PI + 1e-12);
        }

        #[test]
        fn the_right_jacobian_is_the_derivative_of_exp(
            axis in direction(), angle in 0.0..0.1f64, change in direction(),
        ) {
            let (phi, step) = (axis * angle, 1e-6);
            let moved = |sign: f64| log(&(exp(&phi).transpose() * exp(&(phi + change * (sign * step)))));
            let derivative = (moved(1.0) - moved(-1.0)) / (2.0 * step);
            let wrong_by = (derivative - right_jacobian(&phi) * change).norm();
            prop_assert!(wrong_by < angle * angle * angle / 24.0 + 1e-9, "{wrong_by:e}");
        }
    }
}
