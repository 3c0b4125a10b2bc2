//! Timing law (22) to (25), straight from its definition and in dual numbers.

use super::dual::Dual;

/// Parameters of the timing law.
#[derive(Clone, Copy, Debug)]
pub(crate) struct TimingLaw {
    pub(crate) speed: f64,
    pub(crate) k4: f64,
    pub(crate) alpha1: f64,
    pub(crate) alpha2: f64,
}

impl TimingLaw {
    pub(crate) const PAPER: Self = Self {
        speed: 1.0,
        k4: 1.0,
        alpha1: 0.5,
        alpha2: 1.5,
    };

    /// ψ and ψ′ at a distance ‖z1‖.
    pub(crate) fn bump(&self, distance: Dual<f64>) -> [Dual<f64>; 2] {
        let Self { alpha1, alpha2, .. } = *self;
        let flat = |value| [Dual::constant(value), Dual::constant(0.0)];
        if distance.value <= alpha1 {
            return flat(1.0);
        }
        if distance.value >= alpha2 {
            return flat(0.0);
        }
        let one = Dual::constant(1.0);
        let theta_slope = 2.0 / (alpha2 - alpha1);
        let theta = (distance - Dual::constant(alpha1)) * theta_slope - one;
        // θ/(θ² − 1); beyond ±350 its sech² is zero to double precision.
        let inverse = (theta * theta - one).reciprocal();
        let argument = theta * inverse;
        if argument.value.abs() > 350.0 || !argument.value.is_finite() {
            return flat(if theta.value < 0.0 { 1.0 } else { 0.0 });
        }
        let argument_slope = -(theta * theta + one) * inverse * inverse * theta_slope;
        [
            (argument.tanh() + one) * 0.5,
            argument.sech_squared() * argument_slope * 0.5,
        ]
    }

    /// γ̇d = vd ψ.
    pub(crate) fn gamma_dot_desired(&self, distance: f64) -> f64 {
        self.speed * self.bump(Dual::constant(distance))[0].value
    }

    /// γ̈ = γ̈d − k4 z4 (25), for ‖z1‖, ‖z1‖˙ and γ̇.
    pub(crate) fn gamma_ddot(
        &self,
        distance: Dual<f64>,
        distance_rate: Dual<f64>,
        gamma_dot: Dual<f64>,
    ) -> Dual<f64> {
        let [psi, psi_slope] = self.bump(distance);
        psi_slope * distance_rate * self.speed - (gamma_dot - psi * self.speed) * self.k4
    }

    /// c0 and c1 of γ⃛ = c0 + c1 ‖z1‖¨, for ‖z1‖, ‖z1‖˙ and γ̇.
    pub(crate) fn gamma_dddot(&self, distance: f64, distance_rate: f64, gamma_dot: f64) -> (f64, f64) {
        // With a rate of 1 the rate of ψ′ is ψ″.
        let [psi, psi_slope] = self.bump(Dual {
            value: distance,
            rate: 1.0,
        });
        let z4 = gamma_dot - self.speed * psi.value;
        let z4_rate = -self.k4 * z4;
        (
            self.speed * psi_slope.rate * distance_rate * distance_rate - self.k4 * z4_rate,
            self.speed * psi_slope.value,
        )
    }
}
