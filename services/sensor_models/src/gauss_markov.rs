//! Slowly varying error: a first-order Gauss–Markov process of unit variance for each component, exact over any step.
//!
//! ```text
//! dx = −x/τ dt + √(2/τ) dW        x(t+h) = e^(−h/τ) x(t) + √(1 − e^(−2h/τ)) n,  n ~ N(0, 1)
//! ```
//!
//! An error of standard deviation σ is σ x. It is stationary from the start: x(0) ~ N(0, 1), so that
//! E[x(t) x(t+s)] = e^(−|s|/τ) for any h (D. T. Gillespie, "Exact numerical simulation of the Ornstein–Uhlenbeck process
//! and its integral", 1996). As x has no unit, σ and τ may change on the way, as those of a receiver do that loses its
//! fixed ambiguities: the error then jumps with σ.

use nalgebra::Vector3;
use vehicle_model::lag::Lag;

/// Returns x a time `h` (s) after it was `value`, with independent standard normal numbers `draw`.
#[must_use]
pub fn advanced(value: Vector3<f64>, correlation_time: f64, h: f64, draw: Vector3<f64>) -> Vector3<f64> {
    let lag = Lag::new(correlation_time);
    value * lag.remaining(h) + draw * lag.covered(2.0 * h).sqrt()
}
