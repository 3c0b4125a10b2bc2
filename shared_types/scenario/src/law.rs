//! Choice of the control law, and the gains of the baselines.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use shared_types::Gains;

use crate::range::{not_negative, positive};

/// Control law of a flight.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum LawKind {
    /// The paper's adaptive law.
    #[default]
    Adaptive,
    /// Geometric PID on SE(3).
    GeometricPid,
    /// The geometric law with L1 adaptive augmentation.
    L1,
    /// The geometric law with incremental dynamic inversion on the filter's acceleration.
    Indi,
    /// The geometric law with Neural-Fly's composite adaptation of a constant.
    NfConstant,
    /// PX4's cascade.
    Px4,
    /// The geometric law with a mass estimate by immersion and invariance, in the style of the paper's ref. \[30\].
    ImmersionMass,
    /// Torque with an inertia estimate by immersion and invariance, in the style of the paper's ref. \[29\]; for commands of torque.
    ImmersionInertia,
    /// Nonlinear model predictive control.
    Nmpc,
}

impl LawKind {
    /// Returns whether this law uses a key of `[controller]`, given by its segments.
    #[must_use]
    pub fn uses(self, key: &[&str]) -> bool {
        match key {
            ["delta" | "sigma_max" | "remove_offset", ..] => self.is_adaptive(),
            [gain, ..] if Gains::NAMES.contains(gain) => self.is_adaptive(),
            ["baseline", name, ..] => self.uses_baseline_gain(name),
            [
                "rates",
                "roll_out" | "roll_out_step" | "unexplained" | "lag_inversion",
            ] => self != Self::Nmpc,
            _ => true,
        }
    }

    fn uses_baseline_gain(self, gain: &str) -> bool {
        match gain {
            "position_gain" | "velocity_gain" => !matches!(self, Self::Adaptive | Self::Px4 | Self::Nmpc),
            "attitude_gain" => !matches!(self, Self::Adaptive | Self::Nmpc),
            "disturbance_max" => matches!(self, Self::GeometricPid | Self::NfConstant | Self::Px4),
            "integral_gain" => self == Self::GeometricPid,
            "l1_leak" | "l1_bandwidth" => self == Self::L1,
            "composite_tracking_gain" | "composite_prediction_gain" => self == Self::NfConstant,
            "cascade_scale" => self == Self::Px4,
            "immersion_gain" => self == Self::ImmersionMass,
            "rate_gain" | "inertia_gain" => self == Self::ImmersionInertia,
            "nmpc_rate_weight" => self == Self::Nmpc,
            _ => !self.is_adaptive(),
        }
    }

    /// Returns whether this is the paper's law.
    #[must_use]
    pub fn is_adaptive(&self) -> bool {
        *self == Self::Adaptive
    }

    /// Returns whether this law can only command torque.
    #[must_use]
    pub fn commands_torque(&self) -> bool {
        *self == Self::ImmersionInertia
    }
}

/// Gains of the baselines. They share the nominal loop; each has one free gain.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Baseline {
    /// Kp, gain on the position error, 1/s².
    #[schemars(transform = positive)]
    pub position_gain: f64,
    /// Kv, gain on the velocity error, 1/s.
    #[schemars(transform = positive)]
    pub velocity_gain: f64,
    /// kR, rate of the attitude loop, 1/s.
    #[schemars(transform = positive)]
    pub attitude_gain: f64,
    /// Saturation of the position error, m; integrals are frozen above it. None unless stated.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(transform = positive)]
    pub error_limit: Option<f64>,
    /// Maximum component of an integral or an estimate of the disturbance, m/s².
    #[schemars(transform = positive)]
    pub disturbance_max: f64,
    /// Integral gain of `geometric_pid`, 1/s².
    #[schemars(transform = not_negative)]
    pub integral_gain: f64,
    /// Leakage a of the predictor of `l1`, 1/s.
    #[schemars(transform = positive)]
    pub l1_leak: f64,
    /// Bandwidth ωc of the filter of `l1`, rad/s.
    #[schemars(transform = positive)]
    pub l1_bandwidth: f64,
    /// Gain p of `nf_constant` on the tracking error, 1/s².
    #[schemars(transform = not_negative)]
    pub composite_tracking_gain: f64,
    /// Gain p/r of `nf_constant` on the prediction error, 1/s.
    #[schemars(transform = not_negative)]
    pub composite_prediction_gain: f64,
    /// Factor on the rates of PX4's position and velocity loops for `px4`.
    #[schemars(transform = positive)]
    pub cascade_scale: f64,
    /// Gain γ of the mass estimate of `immersion_mass`, 1/(N² s).
    #[schemars(transform = not_negative)]
    pub immersion_gain: f64,
    /// Rate kω of the angular velocity loop of `immersion_inertia`, 1/s.
    #[schemars(transform = positive)]
    pub rate_gain: f64,
    /// Gain γ of the inertia estimate of `immersion_inertia`, s³.
    #[schemars(transform = not_negative)]
    pub inertia_gain: f64,
    /// Weight of the commanded rates of `nmpc`, relative to 1000 for the position error.
    #[schemars(transform = positive)]
    pub nmpc_rate_weight: f64,
}

impl Default for Baseline {
    fn default() -> Self {
        Self {
            position_gain: 36.0,
            velocity_gain: 12.0,
            attitude_gain: 39.24,
            error_limit: None,
            disturbance_max: 9.0,
            integral_gain: 18.0,
            l1_leak: 1.0,
            l1_bandwidth: 15.0,
            composite_tracking_gain: 8.0,
            composite_prediction_gain: 15.0,
            cascade_scale: 4.0,
            immersion_gain: 0.5,
            rate_gain: 150.0,
            inertia_gain: 0.01,
            nmpc_rate_weight: 0.05,
        }
    }
}
