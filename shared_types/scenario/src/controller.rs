//! Gains and bounds of the control law.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{Baseline, LawKind, Scenario, Vector};
use shared_types::Gains;
use shared_types::wiring::ServiceId;

/// Gains, bounds and initial estimates of the adaptive law.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Controller {
    /// Control law: the paper's, or a baseline for comparison, which needs `rates`.
    #[serde(skip_serializing_if = "LawKind::is_adaptive")]
    pub law: LawKind,
    /// Gains of the baselines.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub baseline: Option<Baseline>,
    /// k1, gain on the position error.
    #[schemars(extend("x-tunable" = true))]
    pub k1: f64,
    /// k2, gain on the velocity error.
    #[schemars(extend("x-tunable" = true))]
    pub k2: f64,
    /// k3, gain on the angular velocity error.
    #[schemars(extend("x-tunable" = true))]
    pub k3: f64,
    /// β, weight of the angular velocity error in the Lyapunov function; follows from `initial.inertia` unless stated.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(extend("x-tunable" = true))]
    pub beta: Option<f64>,
    /// δ, the value to which the velocity error is driven along the thrust axis, m/s; not 0.
    pub delta: f64,
    /// σmax, level of the saturation; above δ/k1.
    pub sigma_max: f64,
    /// λm, adaptation gain of η̂; with 0 the estimate stays where it begins.
    #[schemars(extend("x-tunable" = true))]
    pub lambda_mass: f64,
    /// Diagonal of Λb, adaptation gains of b̂; with 0 the estimate stays where it begins.
    #[schemars(extend("x-tunable" = true))]
    pub lambda_disturbance: Vector,
    /// Λw is this times the identity, adaptation gain of ŵ; 0 holds the estimate; follows from the other gains unless stated.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(extend("x-tunable" = true))]
    pub lambda_inertia: Option<f64>,
    /// κ, weight of the prediction error beside z2 in the estimators of η and b, s; none in the paper.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(extend("x-tunable" = true))]
    pub prediction_gain: Option<f64>,
    /// Estimators of what repeats with the path in the disturbance; none in the paper.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub harmonics: Option<Harmonics>,
    /// `true` if the law uses the acceleration that the estimates do not explain as a part of b at once, as an observer
    /// would; an ablation, without a proof.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub disturbance_observer: bool,
    /// Known bounds of the unknown parameters.
    pub bounds: Bounds,
    /// Initial values of the estimates.
    pub initial: InitialEstimates,
    /// `true` if the law aims above the path by the offset at which δ makes the vehicle hang below it, so that z1 → 0;
    /// not in the paper.
    pub remove_offset: bool,
    /// Thrust and body rates in place of thrust and torque, for a vehicle with its own rate loop.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub rates: Option<RateCommand>,
    /// Gain γ of the immersion-and-invariance mass observer, which runs in parallel and is recorded, not used; none
    /// unless stated.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub observer_gain: Option<f64>,
    /// Planned changes of gains in flight.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub change: Vec<ControllerChange>,
    /// Names of the numbers that a plug-in or program in place of the controller publishes on `control/telemetry`.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub telemetry: Vec<String>,
}

/// Change of gains in flight: stated values take effect at once, the others stay as they are.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ControllerChange {
    /// Time of the change, s.
    pub at: f64,
    /// New k1.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub k1: Option<f64>,
    /// New k2.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub k2: Option<f64>,
    /// New k3.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub k3: Option<f64>,
    /// New β; stays as it is unless stated.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub beta: Option<f64>,
    /// New λm.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub lambda_mass: Option<f64>,
    /// New diagonal of Λb.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub lambda_disturbance: Option<Vector>,
    /// New Λw; stays as it is unless stated.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub lambda_inertia: Option<f64>,
    /// New κ, s.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub prediction_gain: Option<f64>,
}

impl ControllerChange {
    /// Returns the gains after the change.
    #[must_use]
    pub fn of(&self, gains: &Gains) -> Gains {
        Gains {
            k1: self.k1.unwrap_or(gains.k1),
            k2: self.k2.unwrap_or(gains.k2),
            k3: self.k3.unwrap_or(gains.k3),
            beta: self.beta.unwrap_or(gains.beta),
            lambda_mass: self.lambda_mass.unwrap_or(gains.lambda_mass),
            lambda_disturbance: self.lambda_disturbance.unwrap_or(gains.lambda_disturbance),
            lambda_inertia: self.lambda_inertia.unwrap_or(gains.lambda_inertia),
            prediction_gain: self.prediction_gain.unwrap_or(gains.prediction_gain),
        }
    }
}

/// Harmonics of the path's parameter in the disturbance.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Harmonics {
    /// N, their number.
    pub count: u8,
    /// λa, adaptation gain of each.
    pub gain: f64,
    /// Largest distance from the path at which they learn, m: what happens once is not to be learned as repeating.
    pub within: f64,
}

impl Harmonics {
    /// Largest number.
    pub const MOST: u8 = 8;
}

impl Default for Harmonics {
    fn default() -> Self {
        Self {
            count: Self::MOST,
            gain: 1.0,
            within: 0.3,
        }
    }
}

impl Default for Controller {
    fn default() -> Self {
        Self {
            law: LawKind::Adaptive,
            baseline: None,
            k1: 4.0,
            k2: 4.0,
            k3: 13.0,
            beta: None,
            delta: 0.1,
            sigma_max: 1.5,
            lambda_mass: 0.3,
            lambda_disturbance: [1.0; 3],
            lambda_inertia: None,
            prediction_gain: None,
            harmonics: None,
            disturbance_observer: false,
            bounds: Bounds::default(),
            initial: InitialEstimates::default(),
            remove_offset: false,
            rates: None,
            observer_gain: None,
            change: Vec::new(),
            telemetry: Vec::new(),
        }
    }
}

impl Controller {
    /// Returns σ⁻¹(δ/k1), the theorem's ultimate bound on ‖z1‖, m.
    #[must_use]
    pub fn ultimate_bound(&self) -> f64 {
        libm::atanh(self.delta.abs() / (self.k1 * self.sigma_max))
    }
}

impl Scenario {
    /// Returns the theorem's ultimate bound on the distance from the path, m. The theorem is about the paper's law
    /// alone: not about an external service, about estimators that are switched off, about gains that change in flight, or
    /// about a law that aims elsewhere (`remove_offset`).
    #[must_use]
    pub fn theorem_bound(&self) -> Option<f64> {
        let law = &self.controller;
        let learns = law.lambda_mass > 0.0 && law.lambda_disturbance.iter().all(|&gain| gain > 0.0);
        let is_ours = law.law.is_adaptive() && !self.is_foreign(ServiceId::Controller);
        (is_ours && learns && law.change.is_empty() && !law.remove_offset).then(|| law.ultimate_bound())
    }
}

/// Commands of body rates: the torque drives an artificial angular velocity, which is sent.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct RateCommand {
    /// kp of the yaw law (28), 1/s.
    pub yaw_kp: f64,
    /// ki of the yaw law (28), 1/s².
    pub yaw_ki: f64,
    /// Largest magnitude of the yaw law's integral term, rad/s: the largest drift that it is expected to compensate. It
    /// is frozen while the proportional term is larger.
    pub yaw_integral_max: f64,
    /// Step at which the law drives the artificial angular velocity over the hold of a frame, s.
    pub roll_out_step: f64,
    /// `true` if vehicle and path move along over the hold; if not the law uses their state at its beginning.
    pub roll_out: bool,
    /// `true` if the acceleration that the estimator sees and the estimates of mass and disturbance do not explain also
    /// acts on the vehicle of the roll-out.
    pub unexplained: bool,
    /// `true` if commands compensate for the modelled lags of thrust and rates.
    pub lag_inversion: bool,
}

impl Default for RateCommand {
    fn default() -> Self {
        Self {
            yaw_kp: 4.0,
            yaw_ki: 0.5,
            yaw_integral_max: 0.5,
            roll_out_step: 0.001,
            roll_out: true,
            unexplained: true,
            lag_inversion: true,
        }
    }
}

impl RateCommand {
    /// Returns the number of roll-out steps over a hold of so many seconds; a whole number.
    #[must_use]
    pub fn steps(&self, hold: f64) -> f64 {
        libm::round(hold / self.roll_out_step).max(1.0)
    }
}

/// Bounds of the unknown parameters (Assumption 1), and the excess of the smooth projection (5) over them.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Bounds {
    /// mmin, kg.
    pub mass_min: f64,
    /// mmax, kg.
    pub mass_max: f64,
    /// bmax of each component of b, m/s².
    pub disturbance: f64,
    /// ε of the projection of η̂, 1/kg; below 1/mmax.
    pub epsilon_eta: f64,
    /// ε of the projection of b̂, m/s².
    pub epsilon_disturbance: f64,
}

impl Default for Bounds {
    fn default() -> Self {
        Self {
            mass_min: 0.1,
            mass_max: 0.6,
            disturbance: 3.0,
            epsilon_eta: 0.01,
            epsilon_disturbance: 0.1,
        }
    }
}

/// Initial values of the estimates.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct InitialEstimates {
    /// 1/η̂, kg.
    pub mass: f64,
    /// Diagonal of J for the initial ŵ; β and Λw follow from it unless they are stated, kg m².
    pub inertia: Vector,
    /// b̂, m/s².
    pub disturbance: Vector,
}

impl Default for InitialEstimates {
    fn default() -> Self {
        Self {
            mass: 0.2,
            inertia: [6.5e-4, 6.5e-4, 13.0e-4],
            disturbance: [0.0; 3],
        }
    }
}
