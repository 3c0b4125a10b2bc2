//! Simulated cameras.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::Vector;
use crate::range::{between, length, moment, not_negative, share};

/// Imperfections of the motion-capture system. Its rate and latency are those of `mocap/pose` in the schedule.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Cameras {
    /// Standard deviation of each component of the position, m.
    #[schemars(transform = between(0.0, 1.0), extend("x-hint" = "in m: 0.3 mm are 3e-4"))]
    pub position_deviation: f64,
    /// Standard deviation of the attitude about each axis, rad.
    #[schemars(transform = between(0.0, 1.0), extend("x-hint" = "in rad: 0.1° is 1.7e-3"))]
    pub attitude_deviation: f64,
    /// Maximum lead of a frame's exposure over its tick, s; uniformly distributed from 0.
    #[schemars(transform = not_negative)]
    pub jitter: f64,
    /// `true` if frames carry the time of their exposure, `false` for that of their tick.
    pub jitter_stamped: bool,
    /// Share of the frames in which the body is not tracked.
    #[schemars(transform = share)]
    pub frame_loss: f64,
    /// Space that the cameras see; all of it unless stated. Outside of it the body is not tracked.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub volume: Option<Volume>,
    /// Occlusions of the body, in chronological order.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub occlusion: Vec<Occlusion>,
    /// Marker swaps, in chronological order.
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
            volume: None,
            occlusion: Vec::new(),
            marker_swap: Vec::new(),
        }
    }
}

/// Box in {I}.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Volume {
    /// Corner with the smallest coordinates in {I}, m; an upper corner, because z points down.
    pub min: Vector,
    /// Corner with the largest coordinates in {I}, m.
    pub max: Vector,
}

impl Volume {
    /// Returns whether a position in {I}, m, is in the box.
    #[must_use]
    pub fn contains(&self, position: &Vector) -> bool {
        (0..3).all(|axis| (self.min[axis]..=self.max[axis]).contains(&position[axis]))
    }
}

/// Interval in which the body is occluded.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Occlusion {
    /// Start, s.
    #[schemars(transform = moment)]
    pub at: f64,
    /// Duration, s.
    #[schemars(transform = length)]
    pub lasts: f64,
}

/// Interval in which markers are swapped: the pose is wrong, and the capture does not show it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct MarkerSwap {
    /// Start, s.
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
