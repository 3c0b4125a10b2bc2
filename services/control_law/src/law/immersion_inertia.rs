//! Torque by immersion and invariance of the inertia, in the style of the paper's ref. \[29\].
//!
//! The mass is known, couplings between the axes other than the gyroscopic one are neglected, and nothing compensates a
//! disturbance. The nominal loop gives T and the desired ωd; each axis i with j, k after it obeys
//!
//! ```text
//!     ω̇i = αi ωj ωk + βi τi            αi = (Jj − Jk)/Ji,  βi = 1/Ji
//!     τi = (kω (ωd,i − ωi) − α̂i ωj ωk)/β̂i
//! ```
//!
//! The estimators θ̂ = ξ + γ ωi φ with φ = (ωj ωk, βi0 τi) and ξ̇ such that the rate of φ cancels have
//! θ̂˙ = γ φ (ω̇i − φᵀθ̂). They step once a tick, exactly in θ̂ along φ while the torque is held. βi is estimated as a
//! share of its prior βi0, so that both are of the order of one. Memory: α̂, β̂/β0, ω, τ, and whether there was a step.

use nalgebra::Vector3;
use scenario::Scenario;

use super::baseline::{save_vector, vector_at};
use super::baseline_law::BaselineLaw;
use super::{LawOutput, Memory, Moment};
use crate::signals::Commanded;

/// Least share of its prior to which 1/J may fall: a torque stays finite.
const LEAST_SHARE: f64 = 0.05;

/// The law with its estimates.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ImmersionInertia {
    /// Thrust and ωd.
    outer: BaselineLaw,
    /// kω, 1/s.
    rate_gain: f64,
    /// γ, s³.
    gain: f64,
    /// β0, 1/(kg m²).
    prior: Vector3<f64>,
    /// α̂.
    coupling: Vector3<f64>,
    /// β̂/β0.
    share: Vector3<f64>,
    /// ω and τ of the step before, if there was one.
    before: Option<(Vector3<f64>, Vector3<f64>)>,
}

impl ImmersionInertia {
    /// Makes the law of a scenario.
    #[must_use]
    pub fn new(scenario: &Scenario, outer: BaselineLaw) -> Self {
        let stated = scenario.controller.baseline.clone().unwrap_or_default();
        let [x, y, z] = scenario.controller.initial.inertia;
        Self {
            outer,
            rate_gain: stated.rate_gain,
            gain: stated.inertia_gain,
            prior: Vector3::new(1.0 / x, 1.0 / y, 1.0 / z),
            coupling: Vector3::new((y - z) / x, (z - x) / y, (x - y) / z),
            share: Vector3::repeat(1.0),
            before: None,
        }
    }

    /// Returns the law's estimate of the inertia, kg m².
    #[must_use]
    pub fn inertia(&self) -> Vector3<f64> {
        self.prior.component_mul(&self.share).map(|beta| 1.0 / beta)
    }

    /// Returns thrust and torque; learns before, if the motion teaches.
    pub fn command(&mut self, moment: &Moment<'_>) -> LawOutput {
        let omega = moment.measured.angular_velocity_body;
        if !moment.teaches {
            self.before = None;
        }
        if let Some((omega_before, torque)) = self.before
            && moment.elapsed > 0.0
        {
            self.learn(&omega_before, &torque, &omega, moment.elapsed);
        }
        let (thrust, omega_desired, telemetry) = self.outer.wanted(&moment.measured, moment.reference);
        let wanted =
            (omega_desired - omega) * self.rate_gain - self.coupling.component_mul(&products(&omega));
        let torque = wanted.component_mul(&self.inertia());
        self.before = moment.teaches.then_some((omega, torque));
        LawOutput {
            command: Commanded {
                thrust,
                torque_body: torque.into(),
                ..Commanded::NOTHING
            },
            limited_thrust: thrust,
            telemetry,
            is_telling: true,
        }
    }

    /// Learns from ω at both ends of `h` seconds under a torque.
    fn learn(&mut self, from: &Vector3<f64>, torque: &Vector3<f64>, to: &Vector3<f64>, h: f64) {
        let gyroscopic = products(&((from + to) * 0.5));
        let turning = self.prior.component_mul(torque);
        for axis in 0..3 {
            let phi = [gyroscopic[axis], turning[axis]];
            let square = phi[0] * phi[0] + phi[1] * phi[1];
            if square == 0.0 {
                continue;
            }
            let explained = phi[0] * self.coupling[axis] + phi[1] * self.share[axis];
            let error = (to[axis] - from[axis]) / h - explained;
            let step = -libm::expm1(-self.gain * square * h) / square * error;
            let learned = [
                self.coupling[axis] + phi[0] * step,
                self.share[axis] + phi[1] * step,
            ];
            if learned.iter().all(|number| number.is_finite()) {
                self.coupling[axis] = learned[0];
                self.share[axis] = learned[1].max(LEAST_SHARE);
            }
        }
    }

    /// Forgets the step before.
    pub fn rest(&mut self) {
        self.before = None;
    }

    /// Writes the state.
    pub fn save(&self, memory: &mut Memory) {
        let (omega, torque) = self.before.unwrap_or_default();
        for (index, vector) in [self.coupling, self.share, omega, torque].iter().enumerate() {
            save_vector(memory, 3 * index, vector);
        }
        memory[12] = f64::from(u8::from(self.before.is_some()));
    }

    /// Restores a saved state.
    pub fn restore(&mut self, memory: &Memory) {
        self.coupling = vector_at(memory, 0);
        self.share = vector_at(memory, 3);
        self.before = (memory[12] != 0.0).then(|| (vector_at(memory, 6), vector_at(memory, 9)));
    }
}

/// ωj ωk of each axis.
fn products(omega: &Vector3<f64>) -> Vector3<f64> {
    Vector3::new(omega.y * omega.z, omega.z * omega.x, omega.x * omega.y)
}
