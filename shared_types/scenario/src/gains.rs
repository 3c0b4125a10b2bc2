//! Default gains β and Λw, for which a sampled controller is stable.
//!
//! The theorem is about continuous time, where any β and Λw above 0 are valid. A controller that holds its torque over h
//! changes J z3 by −h (W w̃ + k3 σ(z3)/β) per step, and w̃ by h β Λw Wᵀz3. Two rules follow.
//!
//! # β
//!
//! Near z3 = 0 a step reduces z3 by the share h k3 σmax/(βJ): to 0 at 1, and above 2 it diverges. The default is 0.3, for J
//! of `controller.initial.inertia`, the controller's only information on the vehicle's inertia. The loop's rate must also
//! be at least a quarter of that of the attitude loop around it, g/δ. These limits give the range of J for which one β is
//! valid, a factor of 80 for the paper's gains.
//!
//! # Λw
//!
//! In the part ½ β z3ᵀJz3 + ½ Λw⁻¹‖w̃‖² of the Lyapunov function the terms with w̃ cancel in continuous time. In a step
//! ½ h² β² Λw ‖Wᵀz3‖² remains, which the damping h k3 z3ᵀσ(z3) must compensate:
//!
//! ```text
//!     Λw ≤ 2 k3 z3ᵀσ(z3) / (h β² ‖Wᵀz3‖²)
//! ```
//!
//! The worst case is a start with the thrust axis away from u. Then ‖ωd‖ = ω̄ = ū/δ with ū = g + k2 σmax, and while ‖ω‖
//! grows from 0 to ω̄ and ‖z3‖ = ω̄ − ‖ω‖ falls,
//!
//! * σ is saturated, so that z3ᵀσ(z3) ≈ σmax ‖z3‖;
//! * W is ζ̇/δ, in which ω turns ζ, and z2 drives it at the rate κ = (k1 + k2) σmax: ‖W‖ ≈ ω̄ (‖ω‖ + κ).
//!
//! ‖W‖² ‖z3‖ is largest at ‖ω‖ = (2 ω̄ − κ)/3, where it is 4/27 ω̄² (ω̄ + κ)³. Hence
//!
//! ```text
//!     Λw ≤ 27 k3 σmax / (2 h β² ω̄² (ω̄ + κ)³)
//! ```
//!
//! For any k1, k2, k3, σmax, δ, β and h, flights from all of SO(3) start to be lost at two to eight times this limit; the
//! default is half of it. With β from its rule, Λw grows with J², as the units of w require: vehicles that differ only in
//! J then rotate alike.

use super::{Controller, GRAVITY, Scenario};
use shared_types::service::seconds;
use shared_types::{Gains, ServiceId, Topic};

/// Share by which a step reduces z3 with the default β.
const DAMPED_PER_STEP: f64 = 0.3;

/// Default Λw as a share of its limit.
const SHARE_OF_LIMIT: f64 = 0.5;

impl Scenario {
    /// Returns β: as stated, or derived from `controller.initial.inertia`.
    #[must_use]
    pub fn beta(&self) -> f64 {
        let Controller { beta, initial, .. } = &self.controller;
        beta.unwrap_or_else(|| {
            let least = initial.inertia.into_iter().fold(f64::INFINITY, f64::min);
            self.beta_for(least)
        })
    }

    /// Returns the default β for a smallest moment of inertia, kg m².
    #[must_use]
    pub fn beta_for(&self, inertia: f64) -> f64 {
        rounded(self.torque_step() * self.controller.damping() / (DAMPED_PER_STEP * inertia))
    }

    /// Returns Λw: as stated, or derived from β and the other gains.
    #[must_use]
    pub fn lambda_inertia(&self) -> f64 {
        let stated = self.controller.lambda_inertia;
        stated.unwrap_or_else(|| self.default_lambda_inertia())
    }

    /// Returns the Λw that is derived from the other gains.
    #[must_use]
    pub fn default_lambda_inertia(&self) -> f64 {
        rounded(SHARE_OF_LIMIT * self.lambda_inertia_limit())
    }

    /// Returns the Λw up to which a step of the sampled estimator of w does not exceed the damping of k3.
    #[must_use]
    pub fn lambda_inertia_limit(&self) -> f64 {
        let Controller {
            k1,
            k2,
            delta,
            sigma_max,
            ..
        } = self.controller;
        let beta = self.beta();
        let fastest = (GRAVITY + k2 * sigma_max) / delta.abs(); // ω̄
        let driven = fastest + (k1 + k2) * sigma_max; // ω̄ + κ
        let adapted = fastest * fastest * driven * driven * driven;
        13.5 * self.controller.damping() / (self.controller_step() * beta * beta * adapted)
    }

    /// Returns the planned changes of gains, each with the tick from which it is in force, in ascending order.
    #[must_use]
    pub fn planned_gains(&self) -> Vec<(u64, Gains)> {
        let planned = self.controller.change.iter();
        planned
            .scan(self.gains(), |gains, change| {
                *gains = change.apply_to(gains);
                Some((self.tick_of(change.at), *gains))
            })
            .collect()
    }

    /// Returns the scenario with these gains stated, including derived ones.
    #[must_use]
    pub fn with_gains(&self, gains: &Gains) -> Self {
        Self {
            controller: self.controller.with_gains(gains),
            ..self.clone()
        }
    }

    /// Returns the duration of a command's hold, s.
    #[must_use]
    pub fn command_hold(&self) -> f64 {
        self.schedule().map_or(self.schedule.tick, |schedule| {
            seconds(schedule.time_ns(schedule.topic_rate(Topic::ControlCommand).period))
        })
    }

    /// Returns the time over which a torque is constant, s: the hold of a command, or a step of the roll-out over it.
    #[must_use]
    pub fn torque_step(&self) -> f64 {
        let hold = self.command_hold();
        let rates = self.controller.rates.as_ref();
        rates.map_or(hold, |rates| hold / rates.steps(hold))
    }

    /// Returns the time between two steps of the controller, the step of its estimators, s.
    #[must_use]
    pub fn controller_step(&self) -> f64 {
        self.schedule().map_or(self.schedule.tick, |schedule| {
            seconds(schedule.time_ns(schedule.service_rate(ServiceId::Controller).period))
        })
    }
}

impl Controller {
    /// Returns k3 σmax, the largest value of k3 σ(z3) about an axis.
    #[must_use]
    pub fn damping(&self) -> f64 {
        self.k3 * self.sigma_max
    }
}

/// Rounds a gain to three digits, so that a scenario with the displayed value gives the same flight.
fn rounded(gain: f64) -> f64 {
    format!("{gain:.2e}").parse().unwrap_or(gain)
}
