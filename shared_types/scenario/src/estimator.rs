//! State estimator.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::vehicle::is_zero_number;
use crate::range::{not_negative, positive, positive_up_to};

/// State estimator.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Estimator {
    /// Error-state Kalman filter.
    pub kalman: Kalman,
}

/// Error-state Kalman filter on poses and sent frames, with prediction to the time at which the next frame takes effect.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Kalman {
    /// Standard deviation of a captured position, each component, m.
    #[schemars(transform = positive_up_to(0.1), extend("x-hint" = "3e-4 is usual"))]
    pub position_deviation: f64,
    /// Standard deviation of a captured attitude about each axis, rad.
    #[schemars(transform = positive)]
    pub attitude_deviation: f64,
    /// Spectral density of the disturbance's drift, each component, (m/s³)²/Hz.
    #[schemars(transform = not_negative)]
    pub disturbance_drift: f64,
    /// Spectral density of the acceleration's noise, each component, (m/s²)²/Hz.
    #[schemars(transform = not_negative)]
    pub acceleration_noise: f64,
    /// Spectral density of the body rates' noise about each axis, (rad/s)²/Hz.
    #[schemars(transform = not_negative)]
    pub rate_noise: f64,
    /// Spectral density of the body rates' bias drift about each axis, (rad/s²)²/Hz.
    #[schemars(transform = not_negative)]
    pub rate_bias_drift: f64,
    /// Standard deviation of each component of `model.marker_offset`, m; above 0 the filter estimates the offset.
    #[serde(skip_serializing_if = "is_zero_number")]
    #[schemars(transform = not_negative)]
    pub marker_offset_deviation: f64,
    /// Spectral density of the drift of an estimated offset, each component, (m/s)²/Hz: an added load moves the centre of
    /// mass.
    #[serde(skip_serializing_if = "is_default_offset_drift")]
    #[schemars(transform = not_negative)]
    pub marker_offset_drift: f64,
    /// Squared Mahalanobis distance above which a capture is rejected as an outlier.
    #[schemars(transform = positive)]
    pub gate: f64,
    /// Time of consecutive rejected captures after which the filter restarts from one, s.
    #[schemars(transform = not_negative)]
    pub restart_after: f64,
    /// Time for which the state counts as tracked without a capture, s.
    #[schemars(transform = not_negative)]
    pub coast: f64,
    /// `true` to predict the state to the time at which the next frame takes effect, `false` for that of the last capture.
    pub prediction: bool,
}

/// Default drift of an estimated offset, (m/s)²/Hz: 2 cm in 1000 s.
const DEFAULT_OFFSET_DRIFT: f64 = 4e-7;

fn is_default_offset_drift(drift: &f64) -> bool {
    *drift == DEFAULT_OFFSET_DRIFT
}

impl Default for Kalman {
    fn default() -> Self {
        Self {
            position_deviation: 3e-4,
            attitude_deviation: 2e-3,
            disturbance_drift: 0.3,
            acceleration_noise: 1e-5,
            rate_noise: 2e-4,
            rate_bias_drift: 1e-3,
            marker_offset_deviation: 0.0,
            marker_offset_drift: DEFAULT_OFFSET_DRIFT,
            gate: 60.0,
            restart_after: 0.3,
            coast: 0.25,
            prediction: true,
        }
    }
}
