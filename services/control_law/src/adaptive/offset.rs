//! Known position offset of the paper's design, and its removal (not in the paper).
//!
//! At rest z2 = 0 gives k1 σ(z1) = Rδ: the vehicle hangs at z1 = σ⁻¹(Rδ/k1) = atanh(δ R e3/(k1 σmax)), element by
//! element, below the path when level. The offset is known at any moment. If errors are measured from a position
//! shifted by it, the vehicle hangs on the path.

use nalgebra::{Matrix3, Vector3};

use crate::adaptive::parameters::Parameters;

/// Returns σ⁻¹(Rδ/k1), the offset of the vehicle below the path, in {I}, m. Finite since σmax > δ/k1.
#[must_use]
#[inline]
pub fn hanging_offset(parameters: &Parameters, world_from_body: &Matrix3<f64>) -> Vector3<f64> {
    let scale = parameters.delta / (parameters.k1 * parameters.saturation.level);
    world_from_body.column(2).map(|axis| libm::atanh(scale * axis))
}
