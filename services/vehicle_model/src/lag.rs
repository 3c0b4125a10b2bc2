//! First-order lags, ẋ = (u − x)/τ, exact while the input u is constant.
//!
//! ```text
//! x(t) = u + (x(0) − u) e^(−t/τ)        ẋ(t) = −(x(0) − u) e^(−t/τ)/τ        mean = u + (x(0) − u)(1 − e^(−t/τ)) τ/t
//! ```

use std::ops::{Add, Mul, Sub};

use crate::integrator::Stage;

/// A first-order lag.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lag {
    /// τ, s.
    time_constant: f64,
}

/// Lag over steps of a fixed length, with the exponentials of the three [`Stage`]s precomputed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LagOverStep {
    /// e^(−t/τ) at each [`Stage`].
    remaining: [f64; 3],
    /// 1/τ, 1/s; 0 without a lag, so that the slope is 0.
    rate: f64,
}

/// Response of a lag over one step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Approach {
    start: f64,
    target: f64,
    lag: LagOverStep,
}

/// Type that a lag can filter: a number or a vector.
pub trait Linear: Copy + Add<Output = Self> + Sub<Output = Self> + Mul<f64, Output = Self> {}

impl<V: Copy + Add<Output = V> + Sub<Output = V> + Mul<f64, Output = V>> Linear for V {}

/// Interpolates linearly: `from` at share 0, `to` at share 1.
#[must_use]
#[inline]
pub fn between<V: Linear>(from: V, to: V, share: f64) -> V {
    debug_assert!((0.0..=1.0).contains(&share), "{share:e} of a way");
    from + (to - from) * share
}

impl Lag {
    /// Makes a lag of time constant τ ≥ 0, s.
    #[must_use]
    pub const fn new(time_constant: f64) -> Self {
        Self { time_constant }
    }

    /// Returns whether there is no lag: τ = 0.
    #[must_use]
    #[inline]
    pub fn is_instant(self) -> bool {
        self.time_constant <= 0.0
    }

    /// Returns e^(−t/τ), the share of the distance to the target that remains after `t` s.
    #[must_use]
    #[inline]
    pub fn remaining(self, t: f64) -> f64 {
        if self.is_instant() {
            0.0
        } else {
            libm::exp(-t / self.time_constant)
        }
    }

    /// Returns 1 − e^(−t/τ), the share of the distance to the target that is covered after `t` s.
    #[must_use]
    #[inline]
    pub fn covered(self, t: f64) -> f64 {
        if self.is_instant() {
            1.0
        } else {
            -libm::expm1(-t / self.time_constant)
        }
    }

    /// Returns the response after `t` s to a constant `target`, from `start`.
    #[must_use]
    #[inline]
    pub fn end<V: Linear>(self, start: V, target: V, t: f64) -> V {
        between(target, start, self.remaining(t))
    }

    /// Returns the mean response over `t` > 0 s to a constant `target`, from `start`.
    #[must_use]
    #[inline]
    pub fn mean<V: Linear>(self, start: V, target: V, t: f64) -> V {
        between(target, start, self.covered(t) / (t / self.time_constant))
    }

    /// Returns the constant target with which the response moves from `start` to `end` within `t` > 0 s.
    #[must_use]
    #[inline]
    pub fn target(self, start: f64, end: f64, t: f64) -> f64 {
        if self.is_instant() {
            end
        } else {
            start + (end - start) / self.covered(t)
        }
    }

    /// Returns the lag over steps of `h` s.
    #[must_use]
    pub fn over(self, h: f64) -> LagOverStep {
        LagOverStep {
            remaining: [0.0, 0.5, 1.0].map(|share| self.remaining(share * h)),
            rate: if self.is_instant() {
                0.0
            } else {
                1.0 / self.time_constant
            },
        }
    }
}

impl LagOverStep {
    /// Returns the response from `start` towards `target` over a step.
    #[must_use]
    #[inline]
    pub fn approach(&self, start: f64, target: f64) -> Approach {
        Approach {
            start,
            target,
            lag: *self,
        }
    }
}

impl Approach {
    /// Returns x. Rounding never moves it past the target.
    #[must_use]
    #[inline]
    pub fn value(&self, stage: Stage) -> f64 {
        between(self.target, self.start, self.lag.remaining[stage as usize])
    }

    /// Returns ẋ, per second.
    #[must_use]
    #[inline]
    pub fn slope(&self, stage: Stage) -> f64 {
        -(self.start - self.target) * self.lag.remaining[stage as usize] * self.lag.rate
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const STAGES: [Stage; 3] = [Stage::Start, Stage::Middle, Stage::End];

    #[test]
    fn after_a_time_constant_a_gap_has_fallen_to_one_in_e() {
        let lag = Lag::new(0.03);
        assert!((lag.end(5.0, 2.0, 0.03) - (2.0 + 3.0 / std::f64::consts::E)).abs() < 1e-15);
    }

    #[test]
    fn without_a_lag_the_target_is_reached_before_the_step_has_begun() {
        let lag = Lag::new(0.0);
        let approach = lag.over(1e-3).approach(5.0, 2.0);
        for stage in STAGES {
            assert_eq!((approach.value(stage), approach.slope(stage)), (2.0, 0.0));
        }
        assert_eq!(
            [
                lag.end(5.0, 2.0, 1e-3),
                lag.mean(5.0, 2.0, 1e-3),
                lag.covered(1e-3)
            ],
            [2.0, 2.0, 1.0]
        );
        assert_eq!(lag.target(5.0, 2.0, 1e-3), 2.0);
    }

    proptest! {
        #[test]
        fn a_step_in_two_parts_is_the_whole_step(
            time_constant in 0.0..0.2f64, first in 1e-6..0.05f64, second in 1e-6..0.05f64,
            start in -5.0..5.0f64, target in -5.0..5.0f64,
        ) {
            let (lag, whole) = (Lag::new(time_constant), first + second);
            let middle = lag.end(start, target, first);
            prop_assert!((lag.end(middle, target, second) - lag.end(start, target, whole)).abs() < 1e-14);
            let way = first * lag.mean(start, target, first) + second * lag.mean(middle, target, second);
            prop_assert!((way - whole * lag.mean(start, target, whole)).abs() < 1e-15);
        }

        #[test]
        fn the_stages_of_a_step_are_its_parts(
            time_constant in 1e-3..1.0f64, h in 1e-6..0.05f64, start in -5.0..5.0f64, target in -5.0..5.0f64,
        ) {
            let lag = Lag::new(time_constant);
            let approach = lag.over(h).approach(start, target);
            let expected = [0.0, 0.5 * h, h].map(|t| lag.end(start, target, t));
            prop_assert_eq!(STAGES.map(|stage| approach.value(stage)), expected);
        }

        #[test]
        fn slope_mean_and_end_obey_the_differential_equation(
            time_constant in 1e-3..1.0f64, h in 1e-6..0.05f64, start in -5.0..5.0f64, target in -5.0..5.0f64,
        ) {
            let lag = Lag::new(time_constant);
            let approach = lag.over(h).approach(start, target);
            for stage in STAGES {
                let slope = (target - approach.value(stage)) / time_constant;
                prop_assert!((approach.slope(stage) - slope).abs() < 1e-14 * (1.0 + 5.0 / time_constant));
            }
            let rise = lag.end(start, target, h) - start;
            let integral = (target - lag.mean(start, target, h)) * h / time_constant;
            prop_assert!((rise - integral).abs() < 1e-13, "{rise:e} against {integral:e}");
        }

        #[test]
        fn the_covered_and_the_remaining_share_sum_to_one(time_constant in 0.0..1.0f64, t in 0.0..10.0f64) {
            let lag = Lag::new(time_constant);
            let shares = [lag.covered(t), lag.remaining(t)];
            prop_assert!(shares.iter().all(|share| (0.0..=1.0).contains(share)), "{:?}", shares);
            prop_assert!((shares[0] + shares[1] - 1.0).abs() < 1e-15);
        }

        #[test]
        fn a_value_that_follows_the_target_for_an_end_reaches_it(
            time_constant in 0.0..0.2f64, t in 1e-3..0.05f64, start in -5.0..5.0f64, end in -5.0..5.0f64,
        ) {
            let lag = Lag::new(time_constant);
            let target = lag.target(start, end, t);
            prop_assert!((lag.end(start, target, t) - end).abs() < 1e-14 * (1.0 + target.abs()));
        }

        #[test]
        fn a_value_never_leaves_the_way_to_its_target(exponent in -9..3i32, start in 0.0..5.0f64, steps in 1..50u32) {
            let lag = Lag::new(libm::pow(10.0, f64::from(exponent)));
            let after = |start: f64, target: f64| (0..steps).fold(start, |value, _| lag.end(value, target, 1e-3));
            let (down, up) = (after(start, 0.0), after(0.0, start));
            prop_assert!((0.0..=start).contains(&down), "{down:e}");
            prop_assert!((0.0..=start).contains(&up), "{up:e}");
        }
    }
}
