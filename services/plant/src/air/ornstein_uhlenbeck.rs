//! Correlated noise: an Ornstein–Uhlenbeck process for each component, exact over a tick.
//!
//! ```text
//! dx = −x/τ dt + σ √(2/τ) dW        x(t+h) = e^(−h/τ) x(t) + σ √(1 − e^(−2h/τ)) n,  n ~ N(0, 1)
//! ```
//!
//! σ standard deviation, τ correlation time, s. The process starts from its stationary distribution, so that
//! E[x(t) x(t+s)] = σ² e^(−|s|/τ) for any h (D. T. Gillespie, "Exact numerical simulation of the
//! Ornstein–Uhlenbeck process and its integral", 1996).

use nalgebra::Vector3;
use shared_types::noise::Noise;
use vehicle_model::lag::Lag;

/// Three independent processes of equal deviation and correlation time.
#[derive(Clone, Debug)]
pub struct OrnsteinUhlenbeck {
    /// e^(−h/τ).
    decay: f64,
    /// σ √(1 − e^(−2h/τ)).
    noise_gain: f64,
    noise: Noise,
    value: Vector3<f64>,
}

impl OrnsteinUhlenbeck {
    /// Makes the process at tick 0, with ticks of h = `tick` s. A correlation time of 0 gives white noise.
    #[must_use]
    pub fn new(deviation: f64, correlation_time: f64, tick: f64, mut noise: Noise) -> Self {
        let lag = Lag::new(correlation_time);
        Self {
            decay: lag.remaining(tick),
            noise_gain: deviation * lag.covered(2.0 * tick).sqrt(),
            value: noise.at(0).normal3() * deviation,
            noise,
        }
    }

    /// Advances by a tick, to `tick`.
    pub fn advance(&mut self, tick: u64) {
        self.value = self.value * self.decay + self.noise.at(tick).normal3() * self.noise_gain;
    }

    /// Returns x.
    #[must_use]
    pub fn value(&self) -> Vector3<f64> {
        self.value
    }

    /// Restores x.
    pub fn restore(&mut self, value: Vector3<f64>) {
        self.value = value;
    }
}
