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
//! share of its prior βi0, so that both are of the order of one.

use nalgebra::Vector3;
use scenario::Scenario;
use shared_types::sample::{Flag, layout_hash};

use super::flight_law::{FlightLaw, LawState};
use super::nominal::Nominal;
use super::{LawOutput, Moment};

/// Least share of its prior to which 1/J may fall: a torque stays finite.
const LEAST_SHARE: f64 = 0.05;

/// Law with its estimates.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ImmersionInertia {
    /// Loop of thrust and ωd.
    nominal: Nominal,
    /// Mass in this loop, kg.
    mass: f64,
    /// kω, 1/s.
    rate_gain: f64,
    /// γ, s³.
    gain: f64,
    /// β0, 1/(kg m²).
    prior: Vector3<f64>,
    state: ImmersionInertiaState,
}

shared_types::sample! {
    /// Estimates, and the previous step.
    pub struct ImmersionInertiaState {
        /// α̂.
        pub coupling: [f64; 3],
        /// β̂/β0.
        pub share: [f64; 3],
        /// ω of the previous step, rad/s.
        pub angular_velocity_body: [f64; 3],
        /// τ of the previous step, N m.
        pub torque_body: [f64; 3],
        /// `true` if the estimates may adapt to the motion since the previous step.
        pub has_previous: Flag,
        /// Explicit padding.
        pub pad0: [u8; 7],
    }
}

impl ImmersionInertia {
    /// Makes the law of a checked scenario.
    #[must_use]
    pub fn new(scenario: &Scenario) -> Self {
        let controller = &scenario.controller;
        let gains = controller.baseline.clone().unwrap_or_default();
        let [x, y, z] = controller.initial.inertia;
        Self {
            nominal: Nominal::new(&gains),
            mass: controller.initial.mass,
            rate_gain: gains.rate_gain,
            gain: gains.inertia_gain,
            prior: Vector3::new(1.0 / x, 1.0 / y, 1.0 / z),
            state: ImmersionInertiaState {
                coupling: [(y - z) / x, (z - x) / y, (x - y) / z],
                share: [1.0; 3],
                angular_velocity_body: [0.0; 3],
                torque_body: [0.0; 3],
                has_previous: Flag::CLEAR,
                pad0: [0; 7],
            },
        }
    }

    /// Returns the estimate of the inertia, kg m².
    #[must_use]
    pub fn inertia(&self) -> Vector3<f64> {
        let share = Vector3::from(self.state.share);
        self.prior.component_mul(&share).map(|beta| 1.0 / beta)
    }

    /// Steps the estimates to ω, `h` seconds after the previous step.
    fn adapt(&mut self, omega: &Vector3<f64>, h: f64) {
        let before = Vector3::from(self.state.angular_velocity_body);
        let gyroscopic = products(&((before + omega) * 0.5));
        let turning = self.prior.component_mul(&Vector3::from(self.state.torque_body));
        let ImmersionInertiaState { coupling, share, .. } = &mut self.state;
        for axis in 0..3 {
            let phi = [gyroscopic[axis], turning[axis]];
            let square = phi[0] * phi[0] + phi[1] * phi[1];
            if square == 0.0 {
                continue;
            }
            let explained = phi[0] * coupling[axis] + phi[1] * share[axis];
            let error = (omega[axis] - before[axis]) / h - explained;
            let step = -libm::expm1(-self.gain * square * h) / square * error;
            let estimates = [coupling[axis] + phi[0] * step, share[axis] + phi[1] * step];
            if estimates.iter().all(|number| number.is_finite()) {
                coupling[axis] = estimates[0];
                share[axis] = estimates[1].max(LEAST_SHARE);
            }
        }
    }
}

impl FlightLaw for ImmersionInertia {
    /// Adapts before it commands, if the motion allows it.
    fn command(&mut self, moment: &Moment<'_>) -> LawOutput {
        let Moment {
            measured,
            reference,
            elapsed,
            may_adapt,
            ..
        } = *moment;
        let omega = measured.angular_velocity_body;
        if may_adapt && self.state.has_previous.is_set() && elapsed > 0.0 {
            self.adapt(&omega, elapsed);
        }
        let zero = Vector3::zeros();
        let outer = self
            .nominal
            .command(&measured, reference, self.mass, &zero, &zero);
        let wanted = (outer.omega - omega) * self.rate_gain
            - Vector3::from(self.state.coupling).component_mul(&products(&omega));
        let torque = wanted.component_mul(&self.inertia());
        self.state = ImmersionInertiaState {
            angular_velocity_body: omega.into(),
            torque_body: torque.into(),
            has_previous: may_adapt.into(),
            ..self.state
        };
        LawOutput::of_torque(outer.thrust, torque, self.nominal.telemetry(&outer))
    }

    fn skip(&mut self, _elapsed: f64) {
        self.state.has_previous = Flag::CLEAR;
    }

    fn pause(&mut self) {
        self.skip(0.0);
    }

    fn save(&self) -> LawState {
        LawState::new(&self.state, None)
    }

    fn restore(&mut self, state: &LawState) {
        self.state = state.read();
    }

    fn record_layout(&self) -> String {
        layout_hash::<ImmersionInertiaState>()
    }
}

/// ωj ωk of each axis.
fn products(omega: &Vector3<f64>) -> Vector3<f64> {
    Vector3::new(omega.y * omega.z, omega.z * omega.x, omega.x * omega.y)
}
