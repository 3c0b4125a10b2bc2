//! Path and timing law.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::Curve;
use crate::range::{angle, moment, not_negative, positive};

/// Path, its speed, and the gains of the timing law.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Path {
    /// Path following, in which the path waits for the vehicle, or the paper's trajectory tracking.
    #[serde(default)]
    pub mode: PathMode,
    /// vd, desired rate of the path parameter, 1/s.
    #[serde(default = "default::speed")]
    #[schemars(transform = not_negative, extend("x-symbol" = "vd"))]
    pub speed: f64,
    /// k4, gain of the timing law (25), 1/s.
    #[serde(default = "default::k4")]
    #[schemars(transform = positive)]
    pub k4: f64,
    /// α1, position error below which the path moves at full speed, m.
    #[serde(default = "default::alpha1")]
    #[schemars(transform = positive, extend("x-symbol" = "α1"))]
    pub alpha1: f64,
    /// α2, position error above which the path stops, m.
    #[serde(default = "default::alpha2")]
    #[schemars(transform = positive, extend("x-symbol" = "α2"))]
    pub alpha2: f64,
    /// γ at the start of the flight.
    #[serde(default)]
    pub initial_gamma: f64,
    /// γ̇ at the start of the flight, 1/s; trajectory tracking begins at `speed` instead.
    #[serde(default)]
    pub initial_gamma_dot: f64,
    /// ψd, desired yaw, rad.
    #[serde(default)]
    #[schemars(transform = angle)]
    pub yaw: f64,
    /// Steps of the desired yaw, in chronological order.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub yaw_step: Vec<YawStep>,
    /// The curve pd(γ).
    pub curve: Curve,
}

impl Path {
    /// Makes a path along a curve with the paper's gains of the timing law.
    #[must_use]
    pub fn new(curve: Curve) -> Self {
        Self {
            mode: PathMode::default(),
            speed: default::speed(),
            k4: default::k4(),
            alpha1: default::alpha1(),
            alpha2: default::alpha2(),
            initial_gamma: 0.0,
            initial_gamma_dot: 0.0,
            yaw: 0.0,
            yaw_step: Vec::new(),
            curve,
        }
    }
}

/// Step of the desired yaw.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct YawStep {
    /// Time of the step, s.
    #[schemars(transform = moment)]
    pub at: f64,
    /// New ψd, rad.
    #[schemars(transform = angle)]
    pub yaw: f64,
}

/// Motion of the path parameter.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum PathMode {
    /// By the timing law (25): the path waits for the vehicle.
    #[default]
    Following,
    /// At constant rate, the paper's comparison: γ̇ = vd, γ̈ = 0.
    TrajectoryTracking,
}

mod default {
    pub(super) fn speed() -> f64 {
        1.0
    }

    pub(super) fn k4() -> f64 {
        1.0
    }

    pub(super) fn alpha1() -> f64 {
        0.5
    }

    pub(super) fn alpha2() -> f64 {
        1.5
    }
}
