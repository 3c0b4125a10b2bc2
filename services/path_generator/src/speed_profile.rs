//! Speed profile: smooth increase of a rate from rest.
//!
//! The step s(x) = 35x⁴ − 84x⁵ + 70x⁶ − 20x⁷ increases from 0 at x = 0 to 1 at x = 1. Its first three derivatives are 0 at
//! both ends, so that the motion is C³. Its maximum slope is 35/16.

/// s and its first three derivatives at a point; constant before 0 and after 1.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Step {
    /// s.
    pub value: f64,
    /// s′.
    pub slope: f64,
    /// s″.
    pub curvature: f64,
    /// s‴.
    pub third: f64,
}

impl Step {
    /// Returns the step at `x`.
    #[must_use]
    pub fn at(x: f64) -> Self {
        if x <= 0.0 || x >= 1.0 {
            return Self {
                value: if x <= 0.0 { 0.0 } else { 1.0 },
                slope: 0.0,
                curvature: 0.0,
                third: 0.0,
            };
        }
        let q = x * (1.0 - x);
        let x4 = x * x * x * x;
        Self {
            value: x4 * (35.0 + x * (-84.0 + x * (70.0 - 20.0 * x))),
            slope: 140.0 * q * q * q,
            curvature: 420.0 * q * q * (1.0 - 2.0 * x),
            third: 840.0 * q * (1.0 - 5.0 * q),
        }
    }

    /// Returns the integral of s from 0 to `x`.
    #[must_use]
    pub fn integral(x: f64) -> f64 {
        if x <= 0.0 {
            return 0.0;
        }
        if x >= 1.0 {
            return 0.5 + (x - 1.0);
        }
        x * x * x * x * x * (7.0 + x * (-14.0 + x * (10.0 - 2.5 * x)))
    }
}

/// w, the share of full speed, from 0 at rest to 1.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SpeedProfile {
    /// w.
    pub value: f64,
    /// ẇ, 1/s.
    pub rate: f64,
    /// ẅ, 1/s².
    pub acceleration: f64,
}

impl SpeedProfile {
    /// Full speed.
    pub const FULL: Self = Self {
        value: 1.0,
        rate: 0.0,
        acceleration: 0.0,
    };

    /// Returns the profile `since_start` s after the start, for full speed `duration` s after it.
    #[must_use]
    pub fn from_rest(since_start: f64, duration: f64) -> Self {
        let step = Step::at(since_start / duration);
        Self {
            value: step.value,
            rate: step.slope / duration,
            acceleration: step.curvature / (duration * duration),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use scenario::{MOST_CURVED, STEEPEST};

    /// The derivative at `x` by central differences of fourth order.
    fn derivative(f: impl Fn(f64) -> f64, x: f64) -> f64 {
        let h = 1e-3;
        (8.0 * (f(x + h) - f(x - h)) - (f(x + 2.0 * h) - f(x - 2.0 * h))) / (12.0 * h)
    }

    proptest! {
        #[test]
        fn the_steps_derivatives_are_its_derivatives(x in 0.01..0.99f64) {
            let step = Step::at(x);
            for (got, wanted) in [
                (step.value, derivative(Step::integral, x)),
                (step.slope, derivative(|x| Step::at(x).value, x)),
                (step.curvature, derivative(|x| Step::at(x).slope, x)),
                (step.third, derivative(|x| Step::at(x).curvature, x)),
            ] {
                prop_assert!((got - wanted).abs() < 1e-7, "{} {}", got, wanted);
            }
            prop_assert!((0.0..=1.0).contains(&step.value));
            prop_assert!((0.0..=STEEPEST).contains(&step.slope));
            prop_assert!(step.curvature.abs() <= MOST_CURVED);
        }
    }

    #[test]
    fn the_ends_are_flat() {
        for (x, value) in [(-1.0, 0.0), (0.0, 0.0), (1.0, 1.0), (7.0, 1.0)] {
            let flat = Step {
                value,
                slope: 0.0,
                curvature: 0.0,
                third: 0.0,
            };
            assert_eq!(Step::at(x), flat);
        }
        let before = Step::at(1.0 - 1e-9);
        assert!(before.third.abs() < 1e-5 && (before.value - 1.0).abs() < 1e-12);
        assert!((Step::integral(1.0 - 1e-9) - 0.5).abs() < 1e-8);
    }

    #[test]
    fn a_profile_goes_from_rest_to_full() {
        assert_eq!(
            SpeedProfile::from_rest(0.0, 2.0),
            SpeedProfile {
                value: 0.0,
                rate: 0.0,
                acceleration: 0.0
            }
        );
        assert_eq!(SpeedProfile::from_rest(2.0, 2.0), SpeedProfile::FULL);
    }
}
