//! Yaw law (28): ωz = −kp (ψ − ψd) − ki ∫(ψ − ψd) dt.
//!
//! The torque (20) leaves the third component of the angular velocity free; this law sets it. ψ − ψd is the shorter way
//! around, in [−π, π]. The integral compensates for drifts of the rate, and its term never exceeds the largest expected
//! drift. Errors whose proportional term is larger come from steps of ψd: then the integral is frozen, so that it has
//! nothing to unwind when the vehicle has turned.

use std::f64::consts::PI;

use scenario::RateCommand;
use shared_types::rotation::roll_pitch_yaw;

use nalgebra::Matrix3;

/// Yaw law with its gains.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct YawLaw {
    /// kp, 1/s.
    pub kp: f64,
    /// ki, 1/s².
    pub ki: f64,
    /// Largest magnitude of ki ∫(ψ − ψd) dt, and of the kp (ψ − ψd) that is integrated, rad/s.
    pub integral_max: f64,
    /// Largest magnitude of ωz, rad/s.
    pub rate_max: f64,
}

/// Output of the yaw law at one moment.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct YawCommand {
    /// ωz, rad/s.
    pub rate: f64,
    /// ki ∫(ψ − ψd) dt up to this moment, rad/s.
    pub integral: f64,
}

impl YawLaw {
    /// Makes the yaw law of a scenario for a link that carries yaw rates up to `rate_max` (rad/s).
    #[must_use]
    pub fn new(rates: &RateCommand, rate_max: f64) -> Self {
        Self {
            kp: rates.yaw_kp,
            ki: rates.yaw_ki,
            integral_max: rates.yaw_integral_max,
            rate_max,
        }
    }

    /// Returns ωz for an attitude and ψd (rad), with the `integral` (rad/s) of the step before, `elapsed` seconds ago.
    #[must_use]
    pub fn command(
        &self,
        world_from_body: &Matrix3<f64>,
        desired: f64,
        integral: f64,
        elapsed: f64,
    ) -> YawCommand {
        let [_, _, yaw] = roll_pitch_yaw(world_from_body);
        let error = shorter_way(yaw - desired);
        let proportional = self.kp * error;
        let wanted = -proportional - integral;
        let grown = if proportional.abs() > self.integral_max {
            integral
        } else {
            integral + self.ki * error * elapsed
        };
        YawCommand {
            rate: wanted.clamp(-self.rate_max, self.rate_max),
            integral: grown.clamp(-self.integral_max, self.integral_max),
        }
    }
}

/// Returns an angle (rad) as the shorter way around, in [−π, π].
#[must_use]
pub fn shorter_way(angle: f64) -> f64 {
    angle - 2.0 * PI * libm::rint(angle / (2.0 * PI))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use shared_types::rotation::from_roll_pitch_yaw;

    const LAW: YawLaw = YawLaw {
        kp: 4.0,
        ki: 0.5,
        integral_max: 0.5,
        rate_max: 8.0,
    };

    proptest! {
        #[test]
        fn the_vehicle_turns_the_shorter_way(yaw in -3.1..3.1f64, desired in -20.0..20.0f64) {
            let r = from_roll_pitch_yaw([0.1, -0.05, yaw]);
            let rate = LAW.command(&r, desired, 0.0, 0.02).rate;
            let error = libm::atan2(libm::sin(yaw - desired), libm::cos(yaw - desired));
            prop_assume!(error.abs() < 3.1);
            prop_assert!((rate + (4.0 * error).clamp(-8.0, 8.0)).abs() < 1e-9, "{} {}", rate, error);
        }

        #[test]
        fn the_integral_is_frozen_while_the_vehicle_turns(error in 0.13..3.0f64, integral in -0.4..0.4f64) {
            let r = from_roll_pitch_yaw([0.0, 0.0, error]);
            prop_assert_eq!(LAW.command(&r, 0.0, integral, 0.02).integral, integral);
            let near = from_roll_pitch_yaw([0.0, 0.0, 0.1]);
            prop_assert!(LAW.command(&near, 0.0, integral, 0.02).integral > integral);
        }
    }

    #[test]
    fn steps_that_are_left_out_are_integrated_as_the_time_that_they_are() {
        let near = from_roll_pitch_yaw([0.0, 0.0, 0.1]);
        let once = LAW.command(&near, 0.0, 0.0, 0.12).integral;
        let six = (0..6).fold(0.0, |integral, _| {
            LAW.command(&near, 0.0, integral, 0.02).integral
        });
        // ki e t
        assert!((once - 0.5 * 0.1 * 0.12).abs() < 1e-15, "{once}");
        assert!((six - once).abs() < 1e-15, "{six} {once}");
        assert_eq!(LAW.command(&near, 0.0, 0.2, 0.0).integral, 0.2);
    }

    #[test]
    fn a_constant_drift_of_the_rate_is_integrated_away() {
        let (mut yaw, mut integral) = (0.3, 0.0);
        for _ in 0..3000 {
            let command = LAW.command(&from_roll_pitch_yaw([0.0, 0.0, yaw]), 0.0, integral, 0.02);
            integral = command.integral;
            yaw += (command.rate + 0.2) * 0.02;
        }
        assert!(yaw.abs() < 1e-3, "{yaw}");
        assert!((integral - 0.2).abs() < 1e-3, "{integral}");
    }

    #[test]
    fn the_integral_term_never_passes_its_limit() {
        let r = from_roll_pitch_yaw([0.0, 0.0, 0.12]);
        let integral = (0..10_000).fold(0.0, |integral, _| LAW.command(&r, 0.0, integral, 0.02).integral);
        assert_eq!(integral, 0.5);
    }
}
