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

/// The observer.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MassObserver {
    /// γ, 1/(N² s).
    pub gain: f64,
    /// θ̄, estimate of 1/m, 1/kg.
    pub theta: f64,
    /// Sample of its previous step, if there was one.
    pub previous: Option<ObserverSample>,
}

/// Measurement and command at one moment.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ObserverSample {
    /// v in {I}, m/s.
    pub velocity_world: Vector3<f64>,
    /// r3 = R e3 in {I}.
    pub thrust_axis_world: Vector3<f64>,
    /// T commanded from this moment on, after limits, N.
    pub thrust: f64,
}

impl ObserverSample {
    /// Placeholder for a moment without a sample.
    pub const NOTHING: Self = Self {
        velocity_world: Vector3::new(0.0, 0.0, 0.0),
        thrust_axis_world: Vector3::new(0.0, 0.0, 0.0),
        thrust: 0.0,
    };
}

impl MassObserver {
    /// Makes an observer that begins with a mass (kg).
    #[must_use]
    pub fn new(gain: f64, mass: f64) -> Self {
        Self {
            gain,
            theta: 1.0 / mass,
            previous: None,
        }
    }

    /// Steps by `elapsed` seconds to a new sample.
    pub fn step(&mut self, now: ObserverSample, elapsed: f64) {
        if let Some(before) = self.previous {
            let (gamma, thrust) = (self.gain, before.thrust);
            let r3 = (before.thrust_axis_world + now.thrust_axis_world) * 0.5;
            let acceleration = (now.velocity_world - before.velocity_world) / elapsed;
            let seen = r3.dot(&(Vector3::z() * GRAVITY - acceleration)); // θT + noise
            let forgetting = libm::exp(-gamma * thrust * thrust * elapsed);
            if thrust > 0.0 {
                self.theta = forgetting * self.theta + (1.0 - forgetting) * (seen / thrust);
            }
        }
        self.previous = Some(now);
    }

    /// Drops the previous sample, after a time without samples.
    pub fn interrupt(&mut self) {
        self.previous = None;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use shared_types::rotation;

    /// A mass point under thrust, seen every 22 ms.
    fn flown(gain: f64, wind: f64, seconds: f64) -> Vec<(f64, f64)> {
        let (mass, h, fine) = (0.2, 0.022, 100);
        let mut observer = MassObserver::new(gain, 0.25);
        let (mut velocity, mut time) = (Vector3::zeros(), 0.0);
        let mut seen = Vec::new();
        while time < seconds {
            let attitude =
                |t: f64| rotation::exp(&Vector3::new(0.2 * libm::sin(t), 0.1 * libm::cos(2.0 * t), 0.0));
            let thrust = mass * GRAVITY * (1.0 + 0.2 * libm::sin(3.0 * time));
            let r3 = attitude(time).column(2).into_owned();
            observer.step(
                ObserverSample {
                    velocity_world: velocity,
                    thrust_axis_world: r3,
                    thrust,
                },
                h,
            );
            seen.push((time, observer.theta - 1.0 / mass));
            for step in 0..fine {
                let t = time + (f64::from(step) + 0.5) * h / f64::from(fine);
                let a = Vector3::z() * (GRAVITY + wind) - attitude(t).column(2) * (thrust / mass);
                velocity += a * (h / f64::from(fine));
            }
            time += h;
        }
        seen
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
    fn a_wind_along_the_thrust_is_taken_for_mass() {
        // −bz/T: in hover it cannot be distinguished from mass.
        let (_, error) = *flown(0.5, 0.5, 40.0).last().unwrap();
        assert!((error + 0.5 / (0.2 * GRAVITY)).abs() < 0.06, "{error}");
    }

    #[test]
    fn a_hold_without_thrust_teaches_nothing() {
        let mut observer = MassObserver::new(0.1, 0.25);
        let sight = ObserverSample {
            velocity_world: Vector3::zeros(),
            thrust_axis_world: Vector3::z(),
            thrust: 0.0,
        };
        observer.step(sight, 0.022);
        observer.step(
            ObserverSample {
                velocity_world: Vector3::z(),
                ..sight
            },
            0.022,
        );
        assert_eq!(observer.theta, 4.0);
    }
}
