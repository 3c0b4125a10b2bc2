//! Simulated cameras.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::Vector;
use crate::range::{length, moment, not_negative, share};

/// Imperfections of the motion-capture system. Its rate and latency are those of `mocap/pose` in the schedule.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Cameras {
    /// Standard deviation of each component of the position, m.
    #[schemars(transform = not_negative)]
    pub position_deviation: f64,
    /// Standard deviation of the attitude about each axis, rad.
    #[schemars(transform = not_negative)]
    pub attitude_deviation: f64,
    /// Largest lead of a frame's exposure over its tick, s: evenly distributed between 0 and this.
    #[schemars(transform = not_negative)]
    pub jitter: f64,
    /// `true` if frames carry the time of their exposure; if not, that of their tick.
    pub jitter_stamped: bool,
    /// Share of the frames in which the body is not found.
    #[schemars(transform = share)]
    pub frame_loss: f64,
    /// Times in which the body is hidden, in order.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub occlusion: Vec<Occlusion>,
    /// Times in which markers are swapped, in order.
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

/// Time in which the cameras do not see the body.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Occlusion {
    /// Begin, s.
    #[schemars(transform = moment)]
    pub at: f64,
    /// Duration, s.
    #[schemars(transform = length)]
    pub lasts: f64,
}

/// Time in which markers are swapped: the pose jumps, without a sign of it in the capture.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct MarkerSwap {
    /// Begin, s.
    #[schemars(transform = moment)]
    pub at: f64,
    /// Duration, s.
    #[schemars(transform = length)]
    pub lasts: f64,
    /// Error of the position in {I}, m.
    #[serde(default)]
    pub position: Vector,
    /// Error of the attitude, axis times angle in {B}, rad.
    #[serde(default)]
    pub rotation: Vector,
}
