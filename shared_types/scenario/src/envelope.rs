//! Flight envelope: limits on vehicle and controller that the transmitter enforces independently of the controller.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::Vector;
use crate::range::{between, positive, positive_up_to};
use shared_types::samples::RcFrame;

/// Limits that the transmitter checks on its inputs while it sends commands, each with an action.
///
/// Commands never exceed their limits, independent of the action: they are saturated.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Envelope {
    /// Time for which a limit must be exceeded continuously before its action, s.
    #[schemars(transform = between(0.0, 5.0), extend("x-hint" = "in s: 50 ms are 0.05"))]
    pub after: f64,
    /// Maximum time from the request to land until the vehicle is disarmed, s; then it is killed.
    #[schemars(transform = positive_up_to(3600.0), extend("x-hint" = "in s: 20000 ms are 20.0"))]
    pub land_within: f64,
    /// Box that the vehicle must not leave.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub r#box: Option<Fence>,
    /// Maximum angle between thrust and vertical, rad.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub tilt: Option<Limit>,
    /// Maximum speed, m/s.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub speed: Option<Limit>,
    /// Required accuracy of the estimated state.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub estimate: Option<EstimateLimit>,
    /// Maximum commanded thrust, N; the minimum is 0.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub thrust: Option<Limit>,
    /// Maximum commanded torque about each body axis, N m.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub torque: Option<VectorLimit>,
    /// Maximum commanded body rate about each axis, rad/s.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub rates: Option<VectorLimit>,
}

/// Action for an exceeded limit.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Action {
    /// Frames carry a warning.
    Warn,
    /// The vehicle must land.
    Land,
    /// The motors stop permanently.
    Kill,
}

/// Limit of a number.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Limit {
    /// Maximum value.
    #[schemars(transform = positive)]
    pub max: f64,
    /// Action above it.
    pub action: Action,
}

/// Limits of the magnitudes of a vector's components.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct VectorLimit {
    /// Maximum magnitudes.
    #[schemars(transform = positive)]
    pub max: Vector,
    /// Action above any of them.
    pub action: Action,
}

/// Box in {I} that the vehicle must not leave.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Fence {
    /// Corner with the smallest coordinates in {I}, m; an upper corner, because z points down.
    pub min: Vector,
    /// Corner with the largest coordinates in {I}, m.
    pub max: Vector,
    /// Distance outside of the box at which a landing vehicle is killed, m.
    #[serde(default = "default_margin")]
    #[schemars(transform = between(0.0, 20.0), extend("x-hint" = "in m: 50 cm are 0.5"))]
    pub margin: f64,
    /// Action outside of the box.
    pub action: Action,
}

impl Fence {
    /// Returns the distance of a position from the box, m; 0 inside.
    #[must_use]
    pub fn distance_outside(&self, position: &Vector) -> f64 {
        let beyond = |axis: usize| {
            let [below, above] = [self.min[axis] - position[axis], position[axis] - self.max[axis]];
            below.max(above).max(0.0)
        };
        let [x, y, z] = [beyond(0), beyond(1), beyond(2)];
        (x * x + y * y + z * z).sqrt()
    }
}

/// Required accuracy of the estimated state.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct EstimateLimit {
    /// Maximum standard deviation of the position, m.
    #[schemars(transform = between(0.001, 20.0), extend("x-hint" = "in m: 5 cm are 0.05"))]
    pub position_sigma: f64,
    /// Action above it, and if the state is missing, not tracked or too old.
    pub action: Action,
}

fn default_margin() -> f64 {
    0.5
}

impl Default for Envelope {
    fn default() -> Self {
        Self {
            after: 0.05,
            land_within: 20.0,
            r#box: None,
            tilt: None,
            speed: None,
            estimate: None,
            thrust: None,
            torque: None,
            rates: None,
        }
    }
}

impl Action {
    /// Returns the action's code in frames.
    #[must_use]
    pub fn code(self) -> u8 {
        match self {
            Self::Warn => RcFrame::ACTION_WARN,
            Self::Land => RcFrame::ACTION_LAND,
            Self::Kill => RcFrame::ACTION_KILL,
        }
    }
}

impl Envelope {
    /// Returns the names and actions of the stated limits.
    #[must_use]
    pub fn actions(&self) -> Vec<(&'static str, Action)> {
        let number = |limit: &Option<Limit>| limit.as_ref().map(|limit| limit.action);
        let vector = |limit: &Option<VectorLimit>| limit.as_ref().map(|limit| limit.action);
        let all = [
            ("box", self.r#box.as_ref().map(|fence| fence.action)),
            ("tilt", number(&self.tilt)),
            ("speed", number(&self.speed)),
            ("estimate", self.estimate.as_ref().map(|limit| limit.action)),
            ("thrust", number(&self.thrust)),
            ("torque", vector(&self.torque)),
            ("rates", vector(&self.rates)),
        ];
        all.into_iter()
            .filter_map(|(name, action)| Some((name, action?)))
            .collect()
    }
}
