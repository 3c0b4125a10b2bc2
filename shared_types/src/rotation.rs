//! Attitude: R maps body {B} to inertial {I}; {I} has z down. Rotations travel row-major.

use nalgebra::{Matrix3, Vector3};

/// Returns S(x), the skew-symmetric matrix with S(x) y = x × y.
#[must_use]
#[inline]
pub fn skew(x: &Vector3<f64>) -> Matrix3<f64> {
    Matrix3::new(0.0, -x.z, x.y, x.z, 0.0, -x.x, -x.y, x.x, 0.0)
}

/// Returns exp S(θ) ∈ SO(3), Rodrigues' formula; `theta` is axis times angle, rad.
///
/// Below 1e−4 rad the two coefficients come from their series, which are then exact to the last bit. The closed forms
/// would divide cancelled differences by almost zero there.
#[must_use]
#[inline]
pub fn exp(theta: &Vector3<f64>) -> Matrix3<f64> {
    let angle_squared = theta.norm_squared();
    let (sine_ratio, cosine_ratio) = if angle_squared < 1e-8 {
        (1.0 - angle_squared / 6.0, 0.5 - angle_squared / 24.0)
    } else {
        let angle = angle_squared.sqrt();
        let half_sine = libm::sin(0.5 * angle);
        (
            libm::sin(angle) / angle,
            2.0 * half_sine * half_sine / angle_squared,
        )
    };
    let s = skew(theta);
    Matrix3::identity() + s * sine_ratio + s * s * cosine_ratio
}

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

/// Returns Rx(a) of the paper, eq. (27): the rotation about x by −a in the right-handed sense.
#[must_use]
pub fn paper_rx(angle: f64) -> Matrix3<f64> {
    let (sine, cosine) = libm::sincos(angle);
    Matrix3::new(1.0, 0.0, 0.0, 0.0, cosine, sine, 0.0, -sine, cosine)
}

/// Makes one step of the polar iteration R ← R (3I − RᵀR)/2, which pulls a nearly orthogonal matrix back to SO(3) with
/// quadratic convergence.
#[must_use]
#[inline]
pub fn orthonormalized(r: &Matrix3<f64>) -> Matrix3<f64> {
    r * (Matrix3::identity() * 3.0 - r.transpose() * r) * 0.5
}

/// Returns the distance of a matrix from SO(3): ‖RᵀR − I‖F, and infinity for a reflection.
#[must_use]
pub fn defect(r: &Matrix3<f64>) -> f64 {
    if r.determinant() <= 0.0 {
        return f64::INFINITY;
    }
    (r.transpose() * r - Matrix3::identity()).norm()
}

/// Returns whether a matrix is in SO(3) up to rounding. A matrix with a NaN passes: publication stops it.
#[must_use]
pub fn is_rotation(r: &Matrix3<f64>) -> bool {
    let defect = defect(r);
    defect.is_nan() || defect < 1e-9
}

/// Returns the angle of the turn from one rotation to another, rad, from 0 to π: |R1 − R2|F = √8 sin(angle / 2).
#[must_use]
#[inline]
pub fn angle_between(from: &Matrix3<f64>, to: &Matrix3<f64>) -> f64 {
    let sine = (from - to).norm() / 8.0_f64.sqrt();
    2.0 * libm::asin(sine.min(1.0))
}

/// Returns the angle between the body's z axis and that of {I}, rad, of a row-major rotation: 0 of a level vehicle.
#[must_use]
pub fn tilt(world_from_body: &[f64; 9]) -> f64 {
    libm::acos(world_from_body[8].clamp(-1.0, 1.0))
}

/// Returns roll, pitch and yaw (rad) with R = Rz(yaw) Ry(pitch) Rx(roll), right-handed about z down.
#[must_use]
pub fn roll_pitch_yaw(r: &Matrix3<f64>) -> [f64; 3] {
    [
        libm::atan2(r[(2, 1)], r[(2, 2)]),
        -libm::asin(r[(2, 0)].clamp(-1.0, 1.0)),
        libm::atan2(r[(1, 0)], r[(0, 0)]),
    ]
}

/// Returns R = Rz(yaw) Ry(pitch) Rx(roll), the inverse of [`roll_pitch_yaw`].
#[must_use]
pub fn from_roll_pitch_yaw([roll, pitch, yaw]: [f64; 3]) -> Matrix3<f64> {
    exp(&Vector3::new(0.0, 0.0, yaw))
        * exp(&Vector3::new(0.0, pitch, 0.0))
        * exp(&Vector3::new(roll, 0.0, 0.0))
}

/// Converts a rotation to row-major order, as samples carry it.
#[must_use]
#[inline]
pub fn to_row_major(r: &Matrix3<f64>) -> [f64; 9] {
    let t = r.transpose();
    let mut elements = [0.0; 9];
    elements.copy_from_slice(t.as_slice());
    elements
}

/// Converts a rotation from row-major order.
#[must_use]
#[inline]
pub fn from_row_major(elements: &[f64; 9]) -> Matrix3<f64> {
    Matrix3::from_row_slice(elements)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::f64::consts::PI;

    fn vector(bound: f64) -> impl Strategy<Value = Vector3<f64>> {
        [-bound..bound, -bound..bound, -bound..bound].prop_map(Vector3::from)
    }

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
        fn exp_is_a_rotation_about_its_axis(theta in vector(4.0)) {
            let r = exp(&theta);
            prop_assert!(defect(&r) < 1e-14);
            prop_assert!((r * theta - theta).norm() < 1e-14 * (1.0 + theta.norm()));
        }

        #[test]
        fn exp_agrees_with_its_series_across_the_switch(direction in vector(1.0), size in 1e-6..1e-3f64) {
            let theta = direction * size;
            let s = skew(&theta);
            let series = Matrix3::identity() + s + s * s / 2.0 + s * s * s / 6.0 + s * s * s * s / 24.0;
            prop_assert!((exp(&theta) - series).norm() < 1e-15);
        }

        #[test]
        fn the_angle_between_rotations_is_that_of_the_turn(start in vector(3.0), axis in vector(1.0), angle in 0.0..3.1f64) {
            prop_assume!(axis.norm() > 0.1);
            let from = exp(&start);
            let turn = exp(&(axis.normalize() * angle));
            for to in [from * turn, turn * from] {
                prop_assert!((angle_between(&from, &to) - angle).abs() < 1e-7);
            }
        }

        #[test]
        fn orthonormalization_converges_quadratically(theta in vector(3.0), noise in vector(1e-4)) {
            let r = exp(&theta) + Matrix3::from_diagonal(&noise);
            prop_assert!(defect(&orthonormalized(&r)) < 10.0 * defect(&r) * defect(&r) + 1e-15);
        }

        #[test]
        fn angles_round_trip(roll in -3.1..3.1f64, pitch in -1.5..1.5f64, yaw in -3.1..3.1f64) {
            let angles = roll_pitch_yaw(&from_roll_pitch_yaw([roll, pitch, yaw]));
            for (got, wanted) in angles.iter().zip([roll, pitch, yaw]) {
                prop_assert!((got - wanted).abs() < 1e-12);
            }
        }
    }
}
