//! Model of vehicle and links, used by estimator and controller.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::Vector;
use super::vehicle::is_zero;
use crate::range::{between, from_0_to_below, positive};
use crate::timing::LONGEST_FLIGHT;

/// Maximum latency of a model, s: the vehicle cannot be predicted over a longer time.
const LONGEST_PREDICTION: f64 = 0.2;

/// Model of the vehicle and of the links that estimator and controller use.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Model {
    /// Mass, kg.
    #[schemars(transform = positive, extend("x-symbol" = "M"))]
    pub mass: f64,
    /// Edges of the cuboid that models the vehicle, along each body axis, m: its J is Ji = M(lj² + lk²)/12.
    #[schemars(transform = between(0.001, 5.0), extend("x-symbol" = "l", "x-hint" = "in m: 176 mm are 0.176"))]
    pub size: Vector,
    /// Time constant of the thrust, s.
    #[schemars(transform = from_0_to_below(1.0), extend("x-hint" = "0.03 is usual"))]
    pub thrust_lag: f64,
    /// Time constant of the body rates, s.
    #[schemars(transform = from_0_to_below(1.0), extend("x-hint" = "0.02 is usual"))]
    pub rate_lag: f64,
    /// Time from the transmission of a frame until it takes effect, s.
    #[schemars(transform = between(0.0, LONGEST_PREDICTION), extend("x-ticks" = LONGEST_FLIGHT))]
    pub radio_latency: f64,
    /// Time from a capture's exposure to its arrival, s; from the captures' stamps unless stated.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(transform = between(0.0, LONGEST_PREDICTION), extend("x-ticks" = LONGEST_FLIGHT))]
    pub capture_latency: Option<f64>,
    /// Point that the cameras track, relative to the centre of mass, in {B}, m.
    #[serde(skip_serializing_if = "is_zero")]
    #[schemars(transform = between(-2.0, 2.0), extend("x-hint" = "in m: 30 mm are 0.03"))]
    pub marker_offset: Vector,
}

impl Default for Model {
    fn default() -> Self {
        Self {
            mass: 0.2,
            size: [0.14, 0.14, 0.14],
            thrust_lag: 0.03,
            rate_lag: 0.02,
            radio_latency: 0.005,
            capture_latency: None,
            marker_offset: [0.0; 3],
        }
    }
}

impl Model {
    /// Returns the diagonal of J of the cuboid, kg m² (Remark 2).
    #[must_use]
    pub fn inertia(&self) -> Vector {
        let [x, y, z] = self.size.map(|edge| edge * edge * self.mass / 12.0);
        [y + z, x + z, x + y]
    }
}
