//! First-order lags, stepped exactly while what they follow rests.

use std::ops::{Add, Mul, Sub};

/// ẋ = (target − x)/τ.
#[derive(Clone, Copy, Debug)]
pub struct Lag {
    /// τ, time constant, s; 0 follows at once.
    pub time_constant: f64,
}

/// A lag over a step during which its target rests: which share of the distance from the target is left.
#[derive(Clone, Copy, Debug)]
pub struct LagStep {
    /// At the end: e^(−h/τ).
    left_at_end: f64,
    /// In the mean over the step: (1 − e^(−h/τ)) τ/h.
    left_in_mean: f64,
}

impl Lag {
    /// The lag over a step of `h` > 0, s.
    #[must_use]
    #[inline]
    pub fn over(self, h: f64) -> LagStep {
        if self.time_constant <= 0.0 {
            return LagStep {
                left_at_end: 0.0,
                left_in_mean: 0.0,
            };
        }
        let ratio = h / self.time_constant;
        LagStep {
            left_at_end: libm::exp(-ratio),
            left_in_mean: -libm::expm1(-ratio) / ratio,
        }
    }
}

impl LagStep {
    /// Where a value that follows `target` from `start` on is at the end of the step.
    #[must_use]
    #[inline]
    pub fn end<V>(self, start: V, target: V) -> V
    where
        V: Copy + Add<Output = V> + Sub<Output = V> + Mul<f64, Output = V>,
    {
        target + (start - target) * self.left_at_end
    }

    /// The mean over the step of a value that follows `target` from `start` on.
    #[must_use]
    #[inline]
    pub fn mean<V>(self, start: V, target: V) -> V
    where
        V: Copy + Add<Output = V> + Sub<Output = V> + Mul<f64, Output = V>,
    {
        target + (start - target) * self.left_in_mean
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn a_step_in_two_parts_is_the_whole_step(
            time_constant in 0.0..0.2f64, first in 1e-6..0.05f64, second in 1e-6..0.05f64,
            start in -5.0..5.0f64, target in -5.0..5.0f64,
        ) {
            let lag = Lag { time_constant };
            let middle = lag.over(first).end(start, target);
            let whole = lag.over(first + second);
            prop_assert!((lag.over(second).end(middle, target) - whole.end(start, target)).abs() < 1e-14);
            let way = first * lag.over(first).mean(start, target) + second * lag.over(second).mean(middle, target);
            prop_assert!((way - (first + second) * whole.mean(start, target)).abs() < 1e-15);
        }

        #[test]
        fn mean_and_end_obey_the_differential_equation(
            time_constant in 1e-3..0.2f64, h in 1e-6..0.05f64, start in -5.0..5.0f64, target in -5.0..5.0f64,
        ) {
            // The integral of ẋ = (target − x)/τ over the step.
            let step = Lag { time_constant }.over(h);
            let rise = step.end(start, target) - start;
            let integral = (target - step.mean(start, target)) * h / time_constant;
            prop_assert!((rise - integral).abs() < 1e-13, "{rise:e} against {integral:e}");
        }
    }

    #[test]
    fn a_lag_without_time_constant_follows_at_once() {
        let step = Lag { time_constant: 0.0 }.over(0.001);
        assert_eq!([step.end(3.0, 1.0), step.mean(3.0, 1.0)], [1.0, 1.0]);
    }

    #[test]
    fn after_one_time_constant_a_share_of_one_over_e_is_left() {
        let step = Lag { time_constant: 0.03 }.over(0.03);
        assert!((step.end(1.0, 0.0) - 1.0 / std::f64::consts::E).abs() < 1e-16);
    }
}
