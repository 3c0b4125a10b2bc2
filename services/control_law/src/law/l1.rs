//! L1 adaptive augmentation of the nominal loop (Wu et al., L1Quad, arXiv 2302.07208), with compensation along all axes.
//!
//! A predictor of the velocity with the piecewise-constant adaptation law, and a low-pass filter:
//!
//! ```text
//!     v̂˙ = u + σ̂ − a (v̂ − V)                          u = g e3 − η0 T n
//!     σ̂  = −a e^(−ah)/(1 − e^(−ah)) (v̂ − V)           at each step
//!     c ← c + (1 − e^(−ωc h)) (σ̂ − c)
//! ```
//!
//! Over a step of h seconds u and σ̂ are held, and V is a straight line from V⁻ to V. Then ṽ = v̂ − V ends, exactly, at
//!
//! ```text
//!     ṽ = e^(−ah) ṽ⁻ + (1 − e^(−ah))/a (σ̂⁻ + u⁻ − (V − V⁻)/h) = (1 − e^(−ah))/a (u⁻ − (V − V⁻)/h)
//! ```
//!
//! because σ̂⁻ is the value that takes e^(−ah) ṽ⁻ away. So ṽ needs no memory, no leak makes it diverge, and
//!
//! ```text
//!     σ̂ = e^(−ah) ((V − V⁻)/h − u⁻)
//! ```
//!
//! Memory: V⁻, u⁻, c, and whether there was a step before.

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
    /// V⁻ in {I}, m/s, and u⁻ in {I}, m/s², if there was a step before.
    before: Option<[Vector3<f64>; 2]>,
    /// c in {I}, m/s².
    filtered: Vector3<f64>,
}

impl L1 {
    /// Makes the augmentation of a scenario.
    #[must_use]
    pub fn new(stated: &Stated) -> Self {
        Self {
            leak: stated.l1_leak,
            bandwidth: stated.l1_bandwidth,
            before: None,
            filtered: Vector3::zeros(),
        }
    }
}

impl Baseline for L1 {
    fn learn(&mut self, seen: &Motion, elapsed: f64) {
        if let Some([velocity, modelled]) = self.before {
            let unexplained = (seen.velocity_world - velocity) / elapsed - modelled;
            let disturbance = unexplained * libm::exp(-self.leak * elapsed);
            let share = 1.0 - libm::exp(-self.bandwidth * elapsed);
            self.filtered += (disturbance - self.filtered) * share;
        }
        self.before = Some([seen.velocity_world, seen.modelled_acceleration]);
    }

    fn rest(&mut self) {
        self.before = None;
    }

    fn compensation(&self) -> Vector3<f64> {
        self.filtered
    }

    fn is_finite(&self) -> bool {
        let vectors = self.before.iter().flatten().chain([&self.filtered]);
        vectors.flatten().all(|number| number.is_finite())
    }

    fn save(&self, memory: &mut Memory) {
        let [velocity, modelled] = self.before.unwrap_or_default();
        for (index, vector) in [velocity, modelled, self.filtered].iter().enumerate() {
            save_vector(memory, 3 * index, vector);
        }
        memory[9] = f64::from(u8::from(self.before.is_some()));
    }

    fn restore(&mut self, memory: &Memory) {
        self.before = (memory[9] != 0.0).then(|| [vector_at(memory, 0), vector_at(memory, 3)]);
        self.filtered = vector_at(memory, 6);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::law::nominal::Tracking;

    const HOLD: f64 = 0.022;

    fn motion(velocity: f64, modelled: f64) -> Motion {
        let zero = Vector3::zeros();
        Motion {
            tracking: Tracking {
                position_error: zero,
                velocity_error: zero,
                is_limited: false,
            },
            velocity_world: Vector3::x() * velocity,
            modelled_acceleration: Vector3::x() * modelled,
            residual: zero,
            thrust_axis_world: Vector3::z(),
            thrust: 1.96,
        }
    }

    fn law(l1_leak: f64) -> L1 {
        L1::new(&Stated {
            l1_leak,
            ..Stated::default()
        })
    }

    /// v̂, V and 1 as one linear system, stepped by scipy.linalg.expm with the published σ̂; ωc = 15 rad/s.
    #[test]
    fn the_compensation_is_that_of_the_published_law_whatever_its_leak() {
        let motions = [
            (0.0, 0.4),
            (0.013, 0.9),
            (0.031, -0.3),
            (0.028, 0.2),
            (0.055, 1.1),
            (0.049, -0.6),
            (0.09, 0.5),
        ];
        for (leak, third, last) in [
            (1.0, 0.055950794589883925, 0.5728267228601313),
            (10.0, 0.045900345140648016, 0.4699297745061909),
            (80.0, 0.009840166547130543, 0.10074406265196849),
            (200.0, 0.0007022067774495198, 0.007189224211112594),
        ] {
            let mut law = law(leak);
            let compensated = motions.map(|(velocity, modelled)| {
                law.learn(&motion(velocity, modelled), HOLD);
                law.compensation().x
            });
            for (found, expected) in [(compensated[3], third), (compensated[6], last)] {
                assert!(
                    (found / expected - 1.0).abs() < 1e-12,
                    "{leak}: {found}, not {expected}"
                );
            }
        }
    }

    /// A push of 0.5 m/s² on a vehicle that accelerates by 2 m/s²: a longer step explains no more of it, and less by its
    /// e^(−ah) only.
    #[test]
    fn the_time_since_the_step_before_counts() {
        let mut law = law(1.0);
        let mut time = 0.0;
        let least = libm::exp(-6.0 * HOLD);
        for elapsed in [0.0, 1.0, 1.0, 2.0, 1.0, 6.0, 0.5].map(|steps| steps * HOLD) {
            time += elapsed;
            law.learn(&motion(2.5 * time, 2.0), elapsed);
            let most = 0.5 * (1.0 - libm::exp(-15.0 * time));
            let found = law.compensation().x;
            assert!((least * most..=most).contains(&found), "{found} after {time} s");
        }
    }

    #[test]
    fn after_a_rest_it_goes_on_with_what_it_has_learned() {
        let mut law = law(1.0);
        for step in 0..200 {
            law.learn(&motion(0.5 * HOLD * f64::from(step), 0.0), HOLD);
        }
        let learned = law.compensation();
        law.rest();
        law.learn(&motion(-3.0, 0.0), HOLD);
        assert_eq!(law.compensation(), learned);
        law.learn(&motion(-3.0 + 0.5 * HOLD, 0.0), HOLD);
        assert!((law.compensation() - learned).norm() < 1e-9);
    }
}
