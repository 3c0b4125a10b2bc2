//! Right Jacobian of SO(3).

use nalgebra::{Matrix3, Vector3};
use shared_types::rotation::skew;

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
    use shared_types::rotation::{exp, log};

    fn direction() -> impl Strategy<Value = Vector3<f64>> {
        [-1.0..1.0, -1.0..1.0, -1.0..1.0f64]
            .prop_map(Vector3::from)
            .prop_filter("a direction", |vector| vector.norm() > 0.1)
            .prop_map(|vector| vector.normalize())
    }

    proptest! {
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
