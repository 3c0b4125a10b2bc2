//! Jet of a fan: round, free and turbulent.
//!
//! Far from its nozzle such a jet spreads in a cone with constant momentum flux. The velocity on the axis falls as 1/x;
//! its radial profile is a Gaussian whose width grows as x (S. B. Pope, "Turbulent Flows", 2000, section 5.1). The force
//! on a small body is proportional to the square of the velocity:
//!
//! ```text
//! F(x, r) = F0 (x0/x̄)² exp(−(r/(x̄ tan θ))²) (n + φ)   x > 0        x̄ = max(x, x0/2)
//!           0                                          x ≤ 0
//! ```
//!
//! x distance along the axis n, r from the axis, m; F0 force on the axis at the reference distance x0, N; θ half the
//! opening angle, at which the force is 1/e of that on the axis, rad; φ fluctuation, as a share. Closer to the fan than
//! x0/2 the jet is a cylinder with the force and width at x0/2, because the far-field law diverges at the nozzle. So
//! ∫F dA is the same at every x.

use nalgebra::Vector3;

/// Jet at one instant.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Jet {
    /// Position of the nozzle in {I}, m.
    pub nozzle_world: Vector3<f64>,
    /// n, direction in {I}, a unit vector.
    pub axis_world: Vector3<f64>,
    /// F0, N.
    pub force: f64,
    /// x0, m.
    pub reference_distance: f64,
    /// tan θ.
    pub spread: f64,
    /// φ in {I}.
    pub fluctuation_world: Vector3<f64>,
}

impl Jet {
    /// Returns the force on the vehicle at a position, both in {I}, N.
    #[must_use]
    pub fn force(&self, position_world: &Vector3<f64>) -> Vector3<f64> {
        let from_nozzle = position_world - self.nozzle_world;
        let along = self.axis_world.dot(&from_nozzle);
        if along <= 0.0 {
            return Vector3::zeros();
        }
        let off_axis_squared = (from_nozzle - self.axis_world * along).norm_squared();
        let far = along.max(0.5 * self.reference_distance);
        let nearness = self.reference_distance / far;
        let width = far * self.spread;
        let profile = libm::exp(-off_axis_squared / (width * width));
        (self.axis_world + self.fluctuation_world) * (self.force * nearness * nearness * profile)
    }
}
