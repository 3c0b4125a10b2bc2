//! Simulated cameras.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::Vector;

/// The motion-capture system's imperfections. Its rate and latency are those of `mocap/pose` in the schedule.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Cameras {
    /// Standard deviation of each component of the position, m.
    pub position_deviation: f64,
    /// Standard deviation of the attitude about each axis, rad.
    pub attitude_deviation: f64,
    /// How much earlier than at its tick a frame may be exposed, s: evenly spread between 0 and this.
    pub jitter: f64,
    /// Whether frames carry the time of their exposure; if not, that of their tick.
    pub jitter_stamped: bool,
    /// Share of the frames in which the body is not found, 0 to 1.
    pub frame_loss: f64,
    /// When the body is hidden, in the order of time.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub occlusion: Vec<Occlusion>,
    /// When markers are taken for others, in the order of time.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub marker_swap: Vec<MarkerSwap>,
}

impl Default for Cameras {
    fn default() -> Self {
        Self {
            position_deviation: 3e-4,
            attitude_deviation: 2e-3,
            jitter: 0.0,
            jitter_stamped: true,
            frame_loss: 0.0,
            occlusion: Vec::new(),
            marker_swap: Vec::new(),
        }
    }
}

/// A while in which the cameras do not see the body.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Occlusion {
    /// From when, s.
    pub at: f64,
    /// How long, s.
    pub lasts: f64,
}

/// A while in which the cameras take markers for others: the pose jumps, and says nothing of it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct MarkerSwap {
    /// From when, s.
    pub at: f64,
    /// How long, s.
    pub lasts: f64,
    /// By how much the position is wrong in {I}, m.
    #[serde(default)]
    pub position: Vector,
    /// By what rotation the attitude is wrong, axis times angle in {B}, rad.
    #[serde(default)]
    pub rotation: Vector,
}
