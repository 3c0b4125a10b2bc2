//! Jet of a fan: round, free and turbulent.
//!
//! Far from its nozzle such a jet spreads in a cone and keeps its momentum. The velocity on the axis falls like 1/x;
//! across it is a bell curve whose width grows like x (S. B. Pope, "Turbulent Flows", 2000, section 5.1). Its force on
//! a small body is proportional to the square of the velocity:
//!
//! ```text
//! F(x, r) = F0 (x0/x̄)² exp(−(r/(x̄ tan θ))²) (n + φ)   x > 0        x̄ = max(x, x0/2)
//!           0                                          x ≤ 0
//! ```
//!
//! x distance along the axis n, r off it, m; F0 force on the axis at the reference distance x0, N; θ half the opening
//! angle, at which the force is 1/e of that on the axis, rad; φ fluctuation, as a share. Closer to the fan than x0/2
//! the jet is modelled as a cylinder of the force and width that it has there, because the law of the far field would
//! let the force grow without bound. So ∫F dA is the same at every x.

use nalgebra::Vector3;

/// Jet at one moment.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Jet {
    /// Its source in {I}, m.
    pub nozzle_world: Vector3<f64>,
    /// n, its direction in {I}, of length 1.
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
        let bell = libm::exp(-off_axis_squared / (width * width));
        (self.axis_world + self.fluctuation_world) * (self.force * nearness * nearness * bell)
    }
}
