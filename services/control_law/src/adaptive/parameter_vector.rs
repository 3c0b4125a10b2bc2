//! Parameter vector w: the unknown constants in which the torque balance is linear (20).

use nalgebra::{SVector, Vector3};

/// Vector of the shape of w: Diag(J) in kg m², η Diag(J) in m², then J1 b, J2 b and J3 b in kg m³/s².
pub type ParameterVector = SVector<f64, 15>;

/// w = [Diag(J); η Diag(J); J1 b; J2 b; J3 b].
///
/// `inertia` is Diag(J) in kg m², `eta` is 1/m in 1/kg, `disturbance_world` is b in {I} in m/s².
#[must_use]
pub fn parameter_vector(
    inertia: &Vector3<f64>,
    eta: f64,
    disturbance_world: &Vector3<f64>,
) -> ParameterVector {
    let mut w = ParameterVector::zeros();
    w.fixed_rows_mut::<3>(0).copy_from(inertia);
    w.fixed_rows_mut::<3>(3).copy_from(&(inertia * eta));
    for axis in 0..3 {
        w.fixed_rows_mut::<3>(6 + 3 * axis)
            .copy_from(&(disturbance_world * inertia[axis]));
    }
    w
}
