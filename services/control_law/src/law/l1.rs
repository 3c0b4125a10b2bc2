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
//! because σ̂⁻ is the value that takes e^(−ah) ṽ⁻ away. So ṽ is no state, no leak makes it diverge, and
//!
//! ```text
//!     σ̂ = e^(−ah) ((V − V⁻)/h − u⁻)
//! ```

use nalgebra::Vector3;
use scenario::{Baseline as Gains, Controller};
use shared_types::sample::Flag;

use super::baseline::{DisturbanceEstimator, Motion};

/// Predictor, adaptation law and filter.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct L1 {
    /// a, 1/s.
    leak: f64,
    /// ωc, rad/s.
    bandwidth: f64,
}

shared_types::sample! {
    /// State of the augmentation.
    pub struct L1State {
        /// V⁻ in {I}, m/s.
        pub velocity_world: [f64; 3],
        /// u⁻ in {I}, m/s².
        pub modelled_acceleration: [f64; 3],
        /// c in {I}, m/s².
        pub filtered_world: [f64; 3],
        /// `true` if V⁻ and u⁻ are those of the previous step.
        pub has_previous: Flag,
        /// Explicit padding.
        pub pad0: [u8; 7],
    }
}

impl DisturbanceEstimator for L1 {
    type State = L1State;

    fn new(gains: &Gains, _controller: &Controller) -> Self {
        Self {
            leak: gains.l1_leak,
            bandwidth: gains.l1_bandwidth,
        }
    }

    fn adapt(&self, state: &mut L1State, motion: &Motion, elapsed: f64) {
        if state.has_previous.is_set() {
            let change = motion.velocity_world - Vector3::from(state.velocity_world);
            let unexplained = change / elapsed - Vector3::from(state.modelled_acceleration);
            let disturbance = unexplained * libm::exp(-self.leak * elapsed);
            let share = 1.0 - libm::exp(-self.bandwidth * elapsed);
            let filtered = self.compensation(state);
            state.filtered_world = (filtered + (disturbance - filtered) * share).into();
        }
        state.velocity_world = motion.velocity_world.into();
        state.modelled_acceleration = motion.modelled_acceleration.into();
        state.has_previous = true.into();
    }

    fn interrupt(&self, state: &mut L1State) {
        state.has_previous = Flag::CLEAR;
    }

    fn compensation(&self, state: &L1State) -> Vector3<f64> {
        state.filtered_world.into()
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
        let gains = Gains {
            l1_leak,
            ..Gains::default()
        };
        L1::new(&gains, &Controller::default())
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
            let law = law(leak);
            let mut state = law.initial();
            let compensated = motions.map(|(velocity, modelled)| {
                law.adapt(&mut state, &motion(velocity, modelled), HOLD);
                law.compensation(&state).x
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
    fn the_time_since_the_previous_step_counts() {
        let law = law(1.0);
        let mut state = law.initial();
        let mut time = 0.0;
        let least = libm::exp(-6.0 * HOLD);
        for elapsed in [0.0, 1.0, 1.0, 2.0, 1.0, 6.0, 0.5].map(|steps| steps * HOLD) {
            time += elapsed;
            law.adapt(&mut state, &motion(2.5 * time, 2.0), elapsed);
            let most = 0.5 * (1.0 - libm::exp(-15.0 * time));
            let found = law.compensation(&state).x;
            assert!((least * most..=most).contains(&found), "{found} after {time} s");
        }
    }

    #[test]
    fn after_an_interruption_it_continues_with_its_estimate() {
        let law = law(1.0);
        let mut state = law.initial();
        for step in 0..200 {
            law.adapt(&mut state, &motion(0.5 * HOLD * f64::from(step), 0.0), HOLD);
        }
        let before = law.compensation(&state);
        law.interrupt(&mut state);
        law.adapt(&mut state, &motion(-3.0, 0.0), HOLD);
        assert_eq!(law.compensation(&state), before);
        law.adapt(&mut state, &motion(-3.0 + 0.5 * HOLD, 0.0), HOLD);
        assert!((law.compensation(&state) - before).norm() < 1e-9);
    }
}
