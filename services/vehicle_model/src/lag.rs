//! First-order lags, ẏ = (u − y)/τ, exact over a tick in which the input u is held.
//!
//! ```text
//! y(t) = u + (y(0) − u) e^(−t/τ)        ẏ(t) = −(y(0) − u) e^(−t/τ)/τ
//! ```
//!
//! The times within a tick at which a step asks are three, so that the exponentials are taken once a flight.

use crate::integrator::Stage;

/// A lag as seen over ticks of one length.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lag {
    /// e^(−t/τ) at each [`Stage`] of a tick.
    decay: [f64; 3],
    /// 1/τ, 1/s; 0 without a lag, where no gap is left to close.
    rate: f64,
}

/// What goes through a lag, over a tick.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Approach {
    target: f64,
    /// y(0) − u.
    gap: f64,
    lag: Lag,
}

impl Lag {
    /// The lag of time constant τ over ticks of h, both in s; τ = 0 follows at once.
    #[must_use]
    pub fn new(time_constant: f64, tick: f64) -> Self {
        if time_constant > 0.0 {
            Self {
                decay: [0.0, 0.5, 1.0].map(|share| libm::exp(-share * tick / time_constant)),
                rate: 1.0 / time_constant,
            }
        } else {
            Self {
                decay: [0.0; 3],
                rate: 0.0,
            }
        }
    }

    /// The way of a value from `start` towards `target`, over a tick.
    #[must_use]
    #[inline]
    pub fn approach(&self, start: f64, target: f64) -> Approach {
        Approach {
            target,
            gap: start - target,
            lag: *self,
        }
    }
}

impl Approach {
    /// y, which lies between start and target to the last bit.
    #[must_use]
    #[inline]
    pub fn value(&self, stage: Stage) -> f64 {
        self.target + self.gap * self.lag.decay[stage as usize]
    }

    /// ẏ, per second.
    #[must_use]
    #[inline]
    pub fn slope(&self, stage: Stage) -> f64 {
        -self.gap * self.lag.decay[stage as usize] * self.lag.rate
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// The value after so many ticks towards a target.
    fn after(lag: &Lag, ticks: u32, start: f64, target: f64) -> f64 {
        (0..ticks).fold(start, |value, _| lag.approach(value, target).value(Stage::End))
    }

    #[test]
    fn after_a_time_constant_a_gap_has_fallen_to_one_in_e() {
        let left = after(&Lag::new(0.03, 1e-3), 30, 5.0, 2.0) - 2.0;
        assert!((left - 3.0 / std::f64::consts::E).abs() < 1e-14);
    }

    #[test]
    fn without_a_lag_the_target_is_reached_before_the_tick_has_begun() {
        let approach = Lag::new(0.0, 1e-3).approach(5.0, 2.0);
        for stage in [Stage::Begin, Stage::Middle, Stage::End] {
            assert_eq!((approach.value(stage), approach.slope(stage)), (2.0, 0.0));
        }
    }

    proptest! {
        #[test]
        fn two_half_ticks_are_a_tick(tau in 1e-3..1.0f64, start in -5.0..5.0f64, target in -5.0..5.0f64) {
            let whole = Lag::new(tau, 1e-2).approach(start, target);
            let half = Lag::new(tau, 5e-3);
            prop_assert!((whole.value(Stage::Middle) - after(&half, 1, start, target)).abs() < 1e-14);
            prop_assert!((whole.value(Stage::End) - after(&half, 2, start, target)).abs() < 1e-14);
            prop_assert_eq!(whole.value(Stage::Begin), target + (start - target));
        }

        #[test]
        fn the_slope_is_that_of_the_differential_equation(tau in 1e-3..1.0f64, start in -5.0..5.0f64, target in -5.0..5.0f64) {
            let approach = Lag::new(tau, 1e-3).approach(start, target);
            for stage in [Stage::Begin, Stage::Middle, Stage::End] {
                let expected = (target - approach.value(stage)) / tau;
                prop_assert!((approach.slope(stage) - expected).abs() < 1e-14 * (1.0 + 5.0 / tau));
            }
        }

        #[test]
        fn a_value_never_leaves_the_way_to_its_target(exponent in -9..3i32, start in 0.0..5.0f64, ticks in 1..50u32) {
            let lag = Lag::new(libm::pow(10.0, f64::from(exponent)), 1e-3);
            let down = after(&lag, ticks, start, 0.0);
            prop_assert!((0.0..=start).contains(&down), "{down:e}");
            let up = after(&lag, ticks, 0.0, start);
            prop_assert!((0.0..=start).contains(&up), "{up:e}");
        }
    }
}
