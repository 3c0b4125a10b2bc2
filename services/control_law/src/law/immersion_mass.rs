//! PD with an estimate of the mass by immersion and invariance, in the style of the paper's ref. \[30\].
//!
//! The nominal loop with the mass of the [observer](crate::observer), which explains everything along the thrust axis by
//! the mass; nothing compensates a disturbance. Memory: θ̂, v, r3, T of the last hold, and whether there was one.

use nalgebra::Vector3;
use scenario::Bounds;

use super::Memory;
use super::baseline::{Baseline, Motion, save_vector, vector_at};
use crate::observer::{MassObserver, ObserverSample};

/// Estimate of the mass.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ImmersionMass {
    observer: MassObserver,
    /// Range of θ̂, 1/kg.
    range: [f64; 2],
}

impl ImmersionMass {
    /// Makes the estimate of a scenario, with γ, 1/(N² s), and the prior mass, kg.
    #[must_use]
    pub fn new(gain: f64, prior_mass: f64, bounds: &Bounds) -> Self {
        Self {
            observer: MassObserver::new(gain, prior_mass),
            range: [1.0 / bounds.mass_max, 1.0 / bounds.mass_min],
        }
    }
}

impl Baseline for ImmersionMass {
    fn learn(&mut self, seen: &Motion, elapsed: f64) {
        let sample = ObserverSample {
            velocity_world: seen.velocity_world,
            thrust_axis_world: seen.thrust_axis_world,
            thrust: seen.thrust,
        };
        self.observer.step(sample, elapsed);
        self.observer.theta = self.observer.theta.clamp(self.range[0], self.range[1]);
    }

    fn rest(&mut self) {
        self.observer.interrupt();
    }

    fn compensation(&self) -> Vector3<f64> {
        Vector3::zeros()
    }

    fn mass(&self) -> Option<f64> {
        Some(1.0 / self.observer.theta)
    }

    fn is_finite(&self) -> bool {
        self.observer.theta.is_finite()
    }

    fn save(&self, memory: &mut Memory) {
        let before = self.observer.previous.unwrap_or(ObserverSample::NOTHING);
        memory[0] = self.observer.theta;
        save_vector(memory, 1, &before.velocity_world);
        save_vector(memory, 4, &before.thrust_axis_world);
        memory[7] = before.thrust;
        memory[8] = f64::from(u8::from(self.observer.previous.is_some()));
    }

    fn restore(&mut self, memory: &Memory) {
        self.observer.theta = memory[0];
        self.observer.previous = (memory[8] != 0.0).then(|| ObserverSample {
            velocity_world: vector_at(memory, 1),
            thrust_axis_world: vector_at(memory, 4),
            thrust: memory[7],
        });
    }
}
