//! Timing law (22)–(25): the speed of the path depends on ‖z1‖, so that the path waits for a distant vehicle.
//!
//! ```text
//! γ̇d = vd ψ(‖z1‖)
//! z4 = γ̇ − γ̇d                                            (22)
//! γ̈d = vd ψ′ ‖z1‖˙
//! γ̈  = γ̈d − k4 z4                                        (25)
//! γ⃛  = vd (ψ″ (‖z1‖˙)² + ψ′ ‖z1‖¨) − k4 (γ̈ − γ̈d)  =  c0 + c1 ‖z1‖¨
//! ```
//!
//! From rest, a [`SpeedProfile`] w replaces vd by w(t) vd, and
//!
//! ```text
//! γ̈d = ẇ vd ψ + w vd ψ′ ‖z1‖˙
//! γ⃛d = ẅ vd ψ + 2ẇ vd ψ′ ‖z1‖˙ + w vd (ψ″ (‖z1‖˙)² + ψ′ ‖z1‖¨)
//! ```
//!
//! ‖z1‖¨ contains the unknown acceleration of the vehicle, which only the controller estimates: γ⃛ is published as c0 and c1.
//! Where ψ is flat the terms in ‖z1‖˙ are not evaluated, which avoids a division by ‖z1‖ = 0.

use nalgebra::Vector3;

use crate::bump::{Bump, TransitionError};
use crate::speed_profile::SpeedProfile;

/// Motion of γ at an instant.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PathRates {
    /// γ̇, 1/s.
    pub gamma_dot: f64,
    /// γ̈, 1/s².
    pub gamma_ddot: f64,
    /// γ̇d, 1/s.
    pub gamma_dot_desired: f64,
    /// γ̈d, 1/s².
    pub gamma_ddot_desired: f64,
    /// c0 of γ⃛ = c0 + c1 ‖z1‖¨, 1/s³.
    pub gamma_dddot_constant: f64,
    /// c1 of γ⃛ = c0 + c1 ‖z1‖¨, 1/(m s).
    pub gamma_dddot_slope: f64,
}

impl PathRates {
    /// Returns the rates of a constant γ̇, 1/s, independent of the vehicle.
    #[must_use]
    pub fn steady(gamma_dot: f64) -> Self {
        Self::stated([gamma_dot, 0.0, 0.0])
    }

    /// Returns the rates of these γ̇ (1/s), γ̈ (1/s²) and γ⃛ (1/s³), independent of the vehicle.
    #[must_use]
    pub fn stated([gamma_dot, gamma_ddot, gamma_dddot]: [f64; 3]) -> Self {
        Self {
            gamma_dot,
            gamma_ddot,
            gamma_dot_desired: gamma_dot,
            gamma_ddot_desired: gamma_ddot,
            gamma_dddot_constant: gamma_dddot,
            gamma_dddot_slope: 0.0,
        }
    }
}

/// Timing law with its gains.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TimingLaw {
    /// vd, 1/s.
    speed: f64,
    /// k4, 1/s.
    k4: f64,
    /// ψ.
    bump: Bump,
}

impl TimingLaw {
    /// Makes the timing law of a scenario's path.
    ///
    /// # Errors
    /// [`TransitionError`] unless 0 ≤ α1 < α2.
    pub fn new(path: &scenario::Path) -> Result<Self, TransitionError> {
        Ok(Self {
            speed: path.speed,
            k4: path.k4,
            bump: Bump::new(path.alpha1, path.alpha2)?,
        })
    }

    /// Evaluates the law at z1 = p − pd(γ) (7), ż1 = ṗ − pd′γ̇ and γ̇.
    #[must_use]
    pub fn rates(&self, z1: &Vector3<f64>, z1_dot: &Vector3<f64>, gamma_dot: f64) -> PathRates {
        self.paced(&SpeedProfile::FULL, z1, z1_dot, gamma_dot)
    }

    /// Evaluates the law with a speed profile.
    #[must_use]
    pub fn paced(
        &self,
        profile: &SpeedProfile,
        z1: &Vector3<f64>,
        z1_dot: &Vector3<f64>,
        gamma_dot: f64,
    ) -> PathRates {
        let Self { speed, k4, bump } = *self;
        let [vd, vd_dot, vd_ddot] = [profile.value, profile.rate, profile.acceleration].map(|w| w * speed);
        let z1_norm = z1.norm();
        let psi = bump.at(z1_norm);
        let z1_norm_dot = if psi.is_flat() {
            0.0
        } else {
            z1.dot(z1_dot) / z1_norm
        };

        let gamma_dot_desired = vd * psi.value;
        let z4 = gamma_dot - gamma_dot_desired; // (22)
        let gamma_ddot_desired = vd_dot * psi.value + vd * psi.slope * z1_norm_dot;
        let gamma_ddot = gamma_ddot_desired - k4 * z4; // (25)
        PathRates {
            gamma_dot,
            gamma_ddot,
            gamma_dot_desired,
            gamma_ddot_desired,
            gamma_dddot_constant: vd_ddot * psi.value
                + 2.0 * vd_dot * psi.slope * z1_norm_dot
                + vd * psi.curvature * z1_norm_dot * z1_norm_dot
                - k4 * (gamma_ddot - gamma_ddot_desired),
            gamma_dddot_slope: vd * psi.slope,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::curve::{Curve, TiltedEight};
    use proptest::prelude::*;

    fn paper() -> TimingLaw {
        TimingLaw {
            speed: 1.0,
            k4: 1.0,
            bump: Bump::new(0.5, 1.5).unwrap(),
        }
    }

    /// A vehicle on some smooth way near the paper's eight: p, ṗ, p̈ at a time.
    fn vehicle(time: f64, phase: f64, distance: f64) -> [Vector3<f64>; 3] {
        let (sine, cosine) = libm::sincos(0.7 * time + phase);
        let center = Vector3::new(0.2, -0.3, -1.1);
        [
            center + Vector3::new(cosine, 0.5 * sine, -0.4 * sine) * distance,
            Vector3::new(-sine, 0.5 * cosine, -0.4 * cosine) * (0.7 * distance),
            Vector3::new(-cosine, -0.5 * sine, 0.4 * sine) * (0.49 * distance),
        ]
    }

    proptest! {
        #[test]
        fn the_split_third_derivative_is_that_of_the_second_along_the_motion(
            gamma in -10.0..10.0f64, gamma_dot in -1.0..2.0f64, phase in 0.0..6.3f64, distance in 0.2..2.0f64,
            since_start in 0.1..3.0f64,
        ) {
            let law = paper();
            let eight = Curve::TiltedEight(TiltedEight::new(&Default::default()));
            let rates = |time: f64, gamma: f64, gamma_dot: f64| {
                let [p, p_dot, _] = vehicle(time, phase, distance);
                let point = eight.at(gamma);
                let profile = SpeedProfile::from_rest(since_start + time, 2.0);
                law.paced(&profile, &(p - point.position), &(p_dot - point.derivative1 * gamma_dot), gamma_dot)
            };
            let now = rates(0.0, gamma, gamma_dot);
            // γ̈ is a function of (t, γ, γ̇), which move by (1, γ̇, γ̈).
            let along = |h: f64| rates(h, gamma + h * gamma_dot, gamma_dot + h * now.gamma_ddot).gamma_ddot;
            let h = 2e-5;
            let numerical = (8.0 * (along(h) - along(-h)) - (along(2.0 * h) - along(-2.0 * h))) / (12.0 * h);

            let ([p, p_dot, p_ddot], point) = (vehicle(0.0, phase, distance), eight.at(gamma));
            let z1 = p - point.position;
            let z1_dot = p_dot - point.derivative1 * gamma_dot;
            let z1_ddot =
                p_ddot - point.derivative2 * (gamma_dot * gamma_dot) - point.derivative1 * now.gamma_ddot;
            let (n, z1_z1_dot) = (z1.norm(), z1.dot(&z1_dot));
            let z1_norm_ddot =
                (z1_dot.norm_squared() + z1.dot(&z1_ddot)) / n - z1_z1_dot * z1_z1_dot / (n * n * n);
            let analytic = now.gamma_dddot_constant + now.gamma_dddot_slope * z1_norm_ddot;
            prop_assert!((analytic - numerical).abs() < 1e-8 * (1.0 + analytic.abs()), "{} {}", analytic, numerical);
        }

        #[test]
        fn near_the_path_the_rate_error_decays_at_k4_for_any_motion_of_the_vehicle(
            z1 in proptest::array::uniform3(-0.28..0.28f64),
            z1_dot in proptest::array::uniform3(-1e3..1e3f64),
            gamma_dot in -3.0..3.0f64,
        ) {
            // ‖z1‖ < α1: ż4 = γ̈ − γ̈d = −k4 z4, z̈4 = γ⃛ − γ⃛d = k4² z4.
            let law = TimingLaw { speed: 0.8, k4: 2.0, ..paper() };
            let rates = law.rates(&z1.into(), &z1_dot.into(), gamma_dot);
            let z4 = gamma_dot - 0.8;
            prop_assert_eq!(rates.gamma_dot_desired, 0.8);
            prop_assert_eq!(rates.gamma_ddot_desired, 0.0);
            prop_assert_eq!(rates.gamma_ddot, -2.0 * z4);
            prop_assert_eq!(rates.gamma_dddot_constant, 4.0 * z4);
            prop_assert_eq!(rates.gamma_dddot_slope, 0.0);
        }

        #[test]
        fn far_from_the_path_the_law_brings_it_to_rest(
            direction in proptest::array::uniform3(-1.0..1.0f64), distance in 1.5..1e12f64, gamma_dot in -3.0..3.0f64,
        ) {
            let direction = Vector3::from(direction);
            prop_assume!(direction.norm() > 0.1);
            let z1 = direction * (distance * (1.0 + 1e-15) / direction.norm());
            prop_assume!(z1.norm() >= 1.5);
            let rates = paper().rates(&z1, &Vector3::new(1e150, -1e150, 1e150), gamma_dot);
            prop_assert_eq!(rates.gamma_dot_desired, 0.0);
            prop_assert_eq!((rates.gamma_ddot, rates.gamma_dddot_constant), (-gamma_dot, gamma_dot));
            prop_assert_eq!(rates.gamma_dddot_slope, 0.0);
        }
    }

    #[test]
    fn on_the_path_and_at_both_ends_of_the_transition_the_speed_of_the_error_does_not_enter() {
        for (distance, desired) in [(0.0, 1.0), (0.5, 1.0), (1.5, 0.0)] {
            let z1 = Vector3::new(distance, 0.0, 0.0);
            // Infinite, so that any use of it would show.
            let z1_dot = Vector3::repeat(f64::INFINITY);
            let rates = paper().rates(&z1, &z1_dot, 0.25);
            let z4 = 0.25 - desired;
            let expected = PathRates {
                gamma_dot: 0.25,
                gamma_ddot: -z4,
                gamma_dot_desired: desired,
                gamma_ddot_desired: 0.0,
                gamma_dddot_constant: z4,
                gamma_dddot_slope: 0.0,
            };
            assert_eq!(rates, expected, "‖z1‖ = {distance}");
        }
    }

    #[test]
    fn in_the_transition_an_approaching_vehicle_speeds_the_path_up() {
        // The middle: ψ = ½, ψ′ = −1, ψ″ = 0; the vehicle comes closer at 0.3 m/s.
        let rates = paper().rates(&Vector3::new(0.0, 1.0, 0.0), &Vector3::new(7.0, -0.3, 2.0), 0.5);
        let got = [
            rates.gamma_dot_desired,
            rates.gamma_ddot,
            rates.gamma_dddot_constant,
            rates.gamma_dddot_slope,
        ];
        assert_eq!(got, [0.5, 0.3, 0.0, -1.0]);
    }
}
