//! L1 adaptive augmentation of the nominal loop (Wu et al., L1Quad, arXiv 2302.07208), with compensation along all axes.
//!
//! A predictor of the velocity with the piecewise-constant adaptation law, and a low-pass filter:
//!
//! ```text
//!     v̂ ← v̂ + h (g e3 − η0 T n + σ̂ − a (v̂ − V))
//!     σ̂ = −a e^(−ah)/(1 − e^(−ah)) (v̂ − V)
//!     c ← c + (1 − e^(−ωc h)) (σ̂ − c)
//! ```
//!
//! Memory: v̂, σ̂, c.

use nalgebra::Vector3;
use scenario::Baseline as Stated;

use super::Memory;
use super::baseline::{Baseline, Motion, save_vector, vector_at};

/// Predictor, adaptation law and filter.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct L1 {
    /// a, 1/s.
    leak: f64,
    /// ωc, rad/s.
    bandwidth: f64,
    /// v̂ in {I}, m/s; of no meaning without `has_velocity`.
    velocity: Vector3<f64>,
    /// σ̂ in {I}, m/s².
    disturbance: Vector3<f64>,
    /// c in {I}, m/s².
    filtered: Vector3<f64>,
    has_velocity: bool,
}

impl L1 {
    /// Makes the augmentation of a scenario.
    #[must_use]
    pub fn new(stated: &Stated) -> Self {
        Self {
            leak: stated.l1_leak,
            bandwidth: stated.l1_bandwidth,
            velocity: Vector3::zeros(),
            disturbance: Vector3::zeros(),
            filtered: Vector3::zeros(),
            has_velocity: false,
        }
    }
}

impl Baseline for L1 {
    fn learn(&mut self, seen: &Motion, h: f64) {
        if self.has_velocity {
            let error = self.velocity - seen.velocity_world;
            let fading = libm::exp(-self.leak * h);
            self.disturbance = error * (-self.leak * fading / (1.0 - fading));
            let share = 1.0 - libm::exp(-self.bandwidth * h);
            self.filtered += (self.disturbance - self.filtered) * share;
        } else {
            self.velocity = seen.velocity_world;
            self.has_velocity = true;
        }
        let error = self.velocity - seen.velocity_world;
        let acceleration = seen.modelled_acceleration + self.disturbance - error * self.leak;
        self.velocity += acceleration * h;
    }

    fn rest(&mut self) {
        self.has_velocity = false;
    }

    fn compensation(&self) -> Vector3<f64> {
        self.filtered
    }

    fn is_finite(&self) -> bool {
        let vectors = [self.velocity, self.disturbance, self.filtered];
        vectors.iter().flatten().all(|number| number.is_finite())
    }

    fn save(&self, memory: &mut Memory) {
        let velocity = if self.has_velocity {
            self.velocity
        } else {
            Vector3::repeat(NONE)
        };
        for (index, vector) in [velocity, self.disturbance, self.filtered].iter().enumerate() {
            save_vector(memory, 3 * index, vector);
        }
    }

    fn restore(&mut self, memory: &Memory) {
        self.has_velocity = memory[0] < NONE;
        self.velocity = if self.has_velocity {
            vector_at(memory, 0)
        } else {
            Vector3::zeros()
        };
        self.disturbance = vector_at(memory, 3);
        self.filtered = vector_at(memory, 6);
    }
}

/// Component of a velocity that no vehicle has, m/s: there is no v̂.
const NONE: f64 = f64::MAX;
