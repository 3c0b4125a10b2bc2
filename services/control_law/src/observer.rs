//! Mass observer by immersion and invariance, for comparison with the adaptive law's estimate. It runs in parallel; its
//! output is recorded, not used. It follows the style of the paper's ref. \[30\], which was not available.
//!
//! With v the velocity in {I}, r3 = R e3, T the thrust and θ = 1/m,
//!
//! ```text
//! θ̄  = θ̂ − γ T r3ᵀv
//! θ̂˙ = γ Ṫ r3ᵀv + γ T ṙ3ᵀv + γ T r3ᵀ(g e3 − θ̄ T r3)
//! ```
//!
//! and so, without wind, z = θ̄ − θ obeys ż = −γ T² z. T is held from frame to frame and jumps between. θ̄ does not
//! jump, since the terms in Ṫ and ṙ3 of both lines cancel. So θ̄ is the state, and is stepped by
//!
//! ```text
//! θ̄˙ = γ T (r3ᵀ g e3 − θ̄ T) − γ T r3ᵀ v̇
//! ```
//!
//! over a hold, exactly in θ̄ and with the mean of r3 over the hold.

use nalgebra::Vector3;
use scenario::GRAVITY;
use shared_types::sample::Flag;
use zerocopy::FromZeros;

/// Observer with its gain.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MassObserver {
    /// γ, 1/(N² s).
    pub gain: f64,
    /// Estimate, and the previous sample.
    pub state: ObserverState,
}

shared_types::sample! {
    /// State of an observer.
    pub struct ObserverState {
        /// θ̄, estimate of 1/m, 1/kg.
        pub theta: f64,
        /// Previous sample.
        pub previous: ObserverSample,
        /// `true` if there is a previous sample.
        pub has_previous: Flag,
        /// Explicit padding.
        pub pad0: [u8; 7],
    }

    /// Measurement and command at one moment.
    pub struct ObserverSample {
        /// v in {I}, m/s.
        pub velocity_world: [f64; 3],
        /// r3 = R e3 in {I}.
        pub thrust_axis_world: [f64; 3],
        /// T commanded from this moment on, after limits, N.
        pub thrust: f64,
    }
}

impl MassObserver {
    /// Makes an observer that begins with a mass (kg).
    #[must_use]
    pub fn new(gain: f64, mass: f64) -> Self {
        Self {
            gain,
            state: ObserverState::new(mass),
        }
    }

    /// Steps by `elapsed` seconds to a new sample.
    pub fn step(&mut self, now: &ObserverSample, elapsed: f64) {
        self.state.step(self.gain, now, elapsed);
    }

    /// Returns the estimate of the mass, kg.
    #[must_use]
    pub fn mass(&self) -> f64 {
        1.0 / self.state.theta
    }
}

impl ObserverState {
    /// Makes the state of an observer that begins with a mass (kg).
    #[must_use]
    pub fn new(mass: f64) -> Self {
        Self {
            theta: 1.0 / mass,
            ..Self::new_zeroed()
        }
    }

    /// Steps by `elapsed` seconds to a new sample, with γ (1/(N² s)).
    pub fn step(&mut self, gain: f64, now: &ObserverSample, elapsed: f64) {
        let before = self.previous;
        let thrust = before.thrust;
        if self.has_previous.is_set() && thrust > 0.0 {
            let r3 = (Vector3::from(before.thrust_axis_world) + Vector3::from(now.thrust_axis_world)) * 0.5;
            let acceleration =
                (Vector3::from(now.velocity_world) - Vector3::from(before.velocity_world)) / elapsed;
            let measured = r3.dot(&(Vector3::z() * GRAVITY - acceleration)); // θT + noise
            let forgetting = libm::exp(-gain * thrust * thrust * elapsed);
            self.theta = forgetting * self.theta + (1.0 - forgetting) * (measured / thrust);
        }
        (self.previous, self.has_previous) = (*now, true.into());
    }

    /// Drops the previous sample, after a time without samples.
    pub fn interrupt(&mut self) {
        self.has_previous = Flag::CLEAR;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use shared_types::rotation;

    /// A mass point under thrust, sampled every 22 ms.
    fn flown(gain: f64, wind: f64, seconds: f64) -> Vec<(f64, f64)> {
        let (mass, h, fine) = (0.2, 0.022, 100);
        let mut observer = MassObserver::new(gain, 0.25);
        let (mut velocity, mut time) = (Vector3::zeros(), 0.0);
        let mut errors = Vec::new();
        while time < seconds {
            let attitude =
                |t: f64| rotation::exp(&Vector3::new(0.2 * libm::sin(t), 0.1 * libm::cos(2.0 * t), 0.0));
            let thrust = mass * GRAVITY * (1.0 + 0.2 * libm::sin(3.0 * time));
            let r3 = attitude(time).column(2).into_owned();
            observer.step(
                &ObserverSample {
                    velocity_world: velocity.into(),
                    thrust_axis_world: r3.into(),
                    thrust,
                },
                h,
            );
            errors.push((time, observer.state.theta - 1.0 / mass));
            for step in 0..fine {
                let t = time + (f64::from(step) + 0.5) * h / f64::from(fine);
                let a = Vector3::z() * (GRAVITY + wind) - attitude(t).column(2) * (thrust / mass);
                velocity += a * (h / f64::from(fine));
            }
            time += h;
        }
        errors
    }

    #[test]
    fn without_wind_the_error_decays_at_gamma_times_thrust_squared() {
        let gain = 0.1;
        let errors = flown(gain, 0.0, 10.0);
        let mut expected = errors[0].1;
        for pair in errors.windows(2) {
            let thrust = 0.2 * GRAVITY * (1.0 + 0.2 * libm::sin(3.0 * pair[0].0));
            expected *= libm::exp(-gain * thrust * thrust * (pair[1].0 - pair[0].0));
            // The rest is the error of the mean of r3 over a hold.
            assert!((pair[1].1 - expected).abs() < 2e-4, "{} {expected}", pair[1].1);
        }
        assert!(errors.last().unwrap().1.abs() < 0.03 * errors[0].1.abs());
    }

    #[test]
    fn a_wind_along_the_thrust_appears_as_mass() {
        // −bz/T: in hover it cannot be distinguished from mass.
        let (_, error) = *flown(0.5, 0.5, 40.0).last().unwrap();
        assert!((error + 0.5 / (0.2 * GRAVITY)).abs() < 0.06, "{error}");
    }

    #[test]
    fn a_hold_without_thrust_leaves_the_estimate() {
        let mut observer = MassObserver::new(0.1, 0.25);
        let sample = ObserverSample {
            velocity_world: [0.0; 3],
            thrust_axis_world: [0.0, 0.0, 1.0],
            thrust: 0.0,
        };
        observer.step(&sample, 0.022);
        observer.step(
            &ObserverSample {
                velocity_world: [0.0, 0.0, 1.0],
                ..sample
            },
            0.022,
        );
        assert_eq!(observer.state.theta, 4.0);
    }
}
