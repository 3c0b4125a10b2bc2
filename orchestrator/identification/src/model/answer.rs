//! Delay from a command to its answer in the captures, and its parts.

use serde::Serialize;

use super::report::Quantity;

/// Delay and lags of the model, estimated together, and the sums that a slow motion shows, s.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Answer {
    /// Delay of the radio link alone: the key of the scenario.
    pub radio_latency: Quantity,
    /// Time constant of the body rates.
    pub rate_lag: Quantity,
    /// Time constant of the thrust.
    pub thrust_lag: Quantity,
    /// From sending a frame to the body rates that it commands.
    pub to_rate: Quantity,
    /// From sending a frame to the thrust that it commands.
    pub to_thrust: Quantity,
    /// Median of the time from a capture to its arrival at the estimator, s, by the captures' stamps.
    pub capture_age: f64,
}
