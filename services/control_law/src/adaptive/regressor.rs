//! Regressor W of (20): the part of the torque balance that is linear in unknown constants.
//!
//! W w ≡ −S(ω)Jω + J δm ζ̇ with w = [Diag(J); η Diag(J); J1 b; J2 b; J3 b] ∈ R¹⁵. With the split
//! ζ̇ = ζ̇known + Rᵀ M A, A = −ηT R e3 + b of [`ZetaRate`], a = δm ζ̇known and Q = δm Rᵀ M, row i of W is
//!
//! * −S(ω) diag(·) ω in the columns of Diag(J), plus a_i in column i,
//! * Q_i (−T R e3) in column i of η Diag(J),
//! * Q_i in the three columns of Ji b,
//!
//! and zero elsewhere. δm has no third row, hence neither have a and Q. Of the 45 elements 16 can differ from zero;
//! they follow from the 13 numbers that are kept here.

use nalgebra::{Matrix2x3, Matrix3, SMatrix, Vector2, Vector3};

use crate::adaptive::parameter_vector::ParameterVector;
use crate::adaptive::zeta_rate::ZetaRate;

/// Returns δm y = (1/δ) [y2, −y1, 0]ᵀ without its third element.
#[must_use]
#[inline]
pub(crate) fn delta_m_times(delta: f64, y: &Vector3<f64>) -> Vector2<f64> {
    Vector2::new(y.y / delta, -y.x / delta)
}

/// W ∈ R³ˣ¹⁵, by the numbers that determine it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Regressor {
    /// [ω2ω3, ω3ω1, ω1ω2], rad²/s²: −S(ω) diag(·) ω.
    gyroscopic: Vector3<f64>,
    /// First two elements of a = δm ζ̇known, rad/s².
    known: Vector2<f64>,
    /// First two elements of Q (−T R e3), kg rad/s².
    thrust: Vector2<f64>,
    /// First two rows of Q = δm Rᵀ M, rad/m.
    disturbance: Matrix2x3<f64>,
}

impl Regressor {
    /// Returns W at an angular velocity ω (rad/s, in {B}), for a δ (m/s) and a T R e3 (N, in {I}).
    #[must_use]
    #[inline]
    pub fn new(omega: &Vector3<f64>, delta: f64, thrust_world: &Vector3<f64>, zeta_rate: &ZetaRate) -> Self {
        let sensitivity = &zeta_rate.sensitivity;
        let disturbance = Matrix2x3::from_rows(&[sensitivity.row(1) / delta, sensitivity.row(0) / -delta]);
        Self {
            gyroscopic: Vector3::new(omega.y * omega.z, omega.z * omega.x, omega.x * omega.y),
            known: delta_m_times(delta, &zeta_rate.known),
            thrust: -(disturbance * thrust_world),
            disturbance,
        }
    }

    /// Returns W w.
    #[must_use]
    #[inline]
    pub fn times(&self, w: &ParameterVector) -> Vector3<f64> {
        let Self {
            gyroscopic,
            known,
            thrust,
            disturbance,
        } = self;
        let (j1, j2, j3) = (w[0], w[1], w[2]);
        let disturbance_1 =
            disturbance[(0, 0)] * w[6] + disturbance[(0, 1)] * w[7] + disturbance[(0, 2)] * w[8];
        let disturbance_2 =
            disturbance[(1, 0)] * w[9] + disturbance[(1, 1)] * w[10] + disturbance[(1, 2)] * w[11];
        Vector3::new(
            gyroscopic.x * (j2 - j3) + known.x * j1 + thrust.x * w[3] + disturbance_1,
            gyroscopic.y * (j3 - j1) + known.y * j2 + thrust.y * w[4] + disturbance_2,
            gyroscopic.z * (j1 - j2),
        )
    }

    /// Returns Wᵀ z.
    #[must_use]
    #[inline]
    pub fn transpose_times(&self, z: &Vector3<f64>) -> ParameterVector {
        let Self {
            gyroscopic,
            known,
            thrust,
            disturbance,
        } = self;
        let gyroscopic = gyroscopic.component_mul(z);
        let mut product = ParameterVector::zeros();
        product[0] = gyroscopic.z - gyroscopic.y + known.x * z.x;
        product[1] = gyroscopic.x - gyroscopic.z + known.y * z.y;
        product[2] = gyroscopic.y - gyroscopic.x;
        product[3] = thrust.x * z.x;
        product[4] = thrust.y * z.y;
        for column in 0..3 {
            product[6 + column] = disturbance[(0, column)] * z.x;
            product[9 + column] = disturbance[(1, column)] * z.y;
        }
        product
    }

    /// Returns W with all its zeros.
    #[must_use]
    pub fn to_matrix(&self) -> SMatrix<f64, 3, 15> {
        let [x, y, z] = self.gyroscopic.into();
        let mut matrix = SMatrix::<f64, 3, 15>::zeros();
        matrix
            .fixed_columns_mut::<3>(0)
            .copy_from(&Matrix3::new(0.0, x, -x, -y, 0.0, y, z, -z, 0.0));
        for row in 0..2 {
            matrix[(row, row)] += self.known[row];
            matrix[(row, 3 + row)] = self.thrust[row];
            matrix
                .fixed_view_mut::<1, 3>(row, 6 + 3 * row)
                .copy_from(&self.disturbance.row(row));
        }
        matrix
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::adaptive::parameter_vector::parameter_vector;
    use proptest::prelude::*;

    fn vector(bound: f64) -> impl Strategy<Value = Vector3<f64>> {
        [-bound..bound, -bound..bound, -bound..bound].prop_map(Vector3::from)
    }

    prop_compose! {
        fn regressor()(
            omega in vector(5.0),
            delta in prop_oneof![-1.0..-0.05f64, 0.05..1.0f64],
            thrust_world in vector(5.0),
            known in vector(50.0),
            columns in [vector(10.0), vector(10.0), vector(10.0)],
        ) -> Regressor {
            let sensitivity = Matrix3::from_columns(&columns);
            Regressor::new(&omega, delta, &thrust_world, &ZetaRate { known, sensitivity })
        }
    }

    fn parameters() -> impl Strategy<Value = ParameterVector> {
        proptest::collection::vec(-1.0..1.0f64, 15)
            .prop_map(|elements| ParameterVector::from_row_slice(&elements))
    }

    proptest! {
        #[test]
        fn the_products_agree_with_the_dense_matrix(
            w_matrix in regressor(), w in parameters(), z in vector(10.0),
        ) {
            let dense = w_matrix.to_matrix();
            let scale = 1e-14 * dense.norm();
            prop_assert!((w_matrix.times(&w) - dense * w).norm() < scale * w.norm());
            prop_assert!((w_matrix.transpose_times(&z) - dense.transpose() * z).norm() < scale * z.norm());
        }

        #[test]
        fn the_columns_of_the_inertia_hold_the_gyroscopic_torque(
            omega in vector(5.0), inertia in vector(1.0), delta in 0.05..1.0f64,
        ) {
            let at_rest = ZetaRate { known: Vector3::zeros(), sensitivity: Matrix3::zeros() };
            let regressor = Regressor::new(&omega, delta, &Vector3::zeros(), &at_rest);
            let w = parameter_vector(&inertia, 5.0, &Vector3::new(0.3, 0.2, 0.1));
            let wanted = -omega.cross(&inertia.component_mul(&omega));
            prop_assert!((regressor.times(&w) - wanted).norm() < 1e-14 * (1.0 + omega.norm_squared()));
        }
    }
}
