//! Limits beyond which a vehicle counts as lost.

use std::f64::consts::{FRAC_PI_2, PI};

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{Flight, Scenario};
use crate::range::{positive, positive_up_to};

/// Default excess of the impact speed over the speed of descent, m/s: that of a fall of some centimetres.
const IMPACT_MARGIN: f64 = 1.0;

/// Limits beyond which a flight counts as lost, by the vehicle's true state.
///
/// They do not change the flight, except by `end_when_lost`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Judge {
    /// Distance from the path above which the vehicle is lost, m; until the vehicle has come within half of it, at least twice its distance at the start.
    #[schemars(transform = positive)]
    pub distance_max: f64,
    /// Angle between thrust and vertical above which the vehicle is lost, rad, once it has been upright within a tenth of `distance_max` of its path; π for never.
    #[schemars(transform = positive_up_to(PI), extend("x-hint" = "upside down is π, with which no attitude counts as lost"))]
    pub tilt_max: f64,
    /// Speed above which the vehicle is lost when it touches the ground, m/s; 1 m/s above `flight.landing_speed` unless stated.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(transform = positive)]
    pub impact_speed_max: Option<f64>,
    /// Time from the start of a phase, or of the flight along the path, until its steady state, s; 10 s, or half of a shorter phase, unless stated.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(transform = positive)]
    pub steady_after: Option<f64>,
    /// `true` if a flight in simulated time ends when the vehicle is lost, `false` if it continues to its planned end.
    pub end_when_lost: bool,
}

impl Default for Judge {
    fn default() -> Self {
        Self {
            distance_max: 5.0,
            tilt_max: FRAC_PI_2,
            impact_speed_max: None,
            steady_after: None,
            end_when_lost: false,
        }
    }
}

impl Judge {
    /// Returns the impact speed above which the vehicle is lost, m/s.
    #[must_use]
    pub fn impact_speed_max(&self, flight: &Flight) -> f64 {
        self.impact_speed_max
            .unwrap_or(flight.landing_speed + IMPACT_MARGIN)
    }
}

impl Scenario {
    /// Returns the limits of the scenario, or the defaults.
    #[must_use]
    pub fn limits_of_loss(&self) -> Judge {
        self.judge.unwrap_or_default()
    }
}
