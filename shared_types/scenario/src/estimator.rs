//! State estimator.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::vehicle::is_none_of_it;
use crate::range::{not_negative, positive};

/// State estimator.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Estimator {
    /// Error-state Kalman filter.
    pub kalman: Kalman,
}

/// Error-state Kalman filter on poses and the frames already sent, with prediction to the time at which the next frame
/// acts.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Kalman {
    /// Standard deviation of a captured position, each component, m.
    #[schemars(transform = positive)]
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
    #[serde(skip_serializing_if = "is_none_of_it")]
    #[schemars(transform = not_negative)]
    pub marker_offset_deviation: f64,
    /// Spectral density of the drift of an estimated offset, each component, (m/s)²/Hz: a load that is laid on moves the
    /// centre of mass.
    #[serde(skip_serializing_if = "is_the_usual_drift")]
    #[schemars(transform = not_negative)]
    pub marker_offset_drift: f64,
    /// Squared Mahalanobis distance above which a capture is refused as an outlier.
    #[schemars(transform = positive)]
    pub gate: f64,
    /// Time for which captures may be refused in a row before the filter restarts from one, s.
    #[schemars(transform = not_negative)]
    pub restart_after: f64,
    /// Time for which the state counts as tracked without a capture, s.
    #[schemars(transform = not_negative)]
    pub coast: f64,
    /// `true` if the state is predicted to the time at which the next frame acts; if not it is that of the last
    /// capture.
    pub prediction: bool,
}

/// Drift of an estimated offset unless stated, (m/s)²/Hz: 2 cm in 1000 s.
const USUAL_OFFSET_DRIFT: f64 = 4e-7;

fn is_the_usual_drift(drift: &f64) -> bool {
    *drift == USUAL_OFFSET_DRIFT
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
            marker_offset_drift: USUAL_OFFSET_DRIFT,
            gate: 60.0,
            restart_after: 0.3,
            coast: 0.25,
            prediction: true,
        }
    }
}
