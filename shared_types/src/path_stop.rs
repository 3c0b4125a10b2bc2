//! Stop of a path, the same for all services.
//!
//! The path generator stops the path when the vehicle is not tracked. The controller does so when no references arrive
//! ([`Coasted`]), and a path generator that restarts after such a gap continues from where the controller has brought
//! the path.

/// Duration of dead reckoning after which the path generator begins to bring the path to rest, s.
pub const BRAKE_AFTER: f64 = 0.1;
/// Duration of the stop, s. Throughout it the vehicle is not tracked: after a shorter one it stays tilted by what a
/// lost frame would have turned it, and at the end of a longer one its velocity is known less well.
pub const BRAKE: f64 = 0.7;

/// Stop of a rate: the quintic with the rate and the acceleration of its begin, and zero at its end.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Stop {
    rate: f64,
    acceleration: f64,
    duration: f64,
}

/// Largest initial deceleration of a stop, in units of rate by duration: with more the rate would change its sign. For
/// k units the rate is (1 − x)³ (1 + (3 − k) x + (6 − 3 k) x²) of the initial one.
const STEEPEST_BEGIN: f64 = 2.5;

impl Stop {
    /// Creates a stop of a duration, s, from a rate, 1/s, and its derivative, 1/s². The rate never changes its sign: a
    /// deceleration that is too large for that is limited.
    #[must_use]
    pub fn new([rate, acceleration]: [f64; 2], duration: f64) -> Self {
        let steepest = STEEPEST_BEGIN * rate.abs() / duration;
        Self {
            rate,
            acceleration: if rate * acceleration > 0.0 {
                acceleration
            } else {
                acceleration.max(-steepest).min(steepest)
            },
            duration,
        }
    }

    /// Returns the rate at the begin, 1/s, and its derivative, 1/s².
    #[must_use]
    pub fn begin(&self) -> [f64; 2] {
        [self.rate, self.acceleration]
    }

    /// Returns the rate and its first two derivatives some seconds after the begin.
    #[must_use]
    pub fn at(&self, since_begin: f64) -> [f64; 3] {
        let Self {
            rate,
            acceleration,
            duration,
        } = *self;
        let x = since_begin / duration;
        if x >= 1.0 {
            return [0.0; 3];
        }
        let (x2, x3) = (x * x, x * x * x);
        let slope = acceleration * duration;
        [
            rate * (1.0 - x3 * (10.0 - x * (15.0 - 6.0 * x)))
                + slope * (x - x3 * (6.0 - x * (8.0 - 3.0 * x))),
            (-30.0 * rate * x2 * (1.0 - x) * (1.0 - x) + slope * (1.0 - x2 * (18.0 - x * (32.0 - 15.0 * x))))
                / duration,
            (-60.0 * rate * x * (1.0 - x * (3.0 - 2.0 * x)) - slope * x * (36.0 - x * (96.0 - 60.0 * x)))
                / (duration * duration),
        ]
    }

    /// Returns the change of the parameter, the integral of the rate, some seconds after the begin.
    #[must_use]
    pub fn way(&self, since_begin: f64) -> f64 {
        let Self {
            rate,
            acceleration,
            duration,
        } = *self;
        let x = (since_begin / duration).clamp(0.0, 1.0);
        let (x2, x4) = (x * x, x * x * x * x);
        duration
            * (rate * (x - x4 * (2.5 - x * (3.0 - x)))
                + acceleration * duration * (0.5 * x2 - x4 * (1.5 - x * (1.6 - 0.5 * x))))
    }
}

/// Parameter and rates of a path without references: it continues at its acceleration, at most until it rests, and then
/// stops.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Coasted {
    /// Change of the parameter.
    pub way: f64,
    /// The rate and its first two derivatives.
    pub rates: [f64; 3],
    /// The stop in progress, with the time since its begin, s.
    pub stop: Option<(Stop, f64)>,
}

impl Coasted {
    /// Extrapolates a path from its last reference, `elapsed` seconds ago, with its rate (1/s) and the derivative of it
    /// (1/s²). The path continues for `goes_on_for` (s) before its stop.
    #[must_use]
    pub fn after(elapsed: f64, [rate, acceleration]: [f64; 2], goes_on_for: f64) -> Self {
        let rests_after = if rate * acceleration < 0.0 {
            -rate / acceleration
        } else {
            f64::INFINITY
        };
        let time = elapsed.min(goes_on_for).min(rests_after);
        let way = time * (rate + 0.5 * time * acceleration);
        if time >= rests_after {
            return Self {
                way,
                rates: [0.0; 3],
                stop: None,
            };
        }
        let rate = rate + time * acceleration;
        if elapsed <= goes_on_for {
            return Self {
                way,
                rates: [rate, acceleration, 0.0],
                stop: None,
            };
        }
        let stop = Stop::new([rate, acceleration], BRAKE);
        let since_begin = elapsed - time;
        Self {
            way: way + stop.way(since_begin),
            rates: stop.at(since_begin),
            stop: Some((stop, since_begin)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// The derivative at `x` by central differences of fourth order.
    fn derivative(f: impl Fn(f64) -> f64, x: f64) -> f64 {
        let h = 1e-3;
        (8.0 * (f(x + h) - f(x - h)) - (f(x + 2.0 * h) - f(x - 2.0 * h))) / (12.0 * h)
    }

    proptest! {
        #[test]
        fn a_coasting_path_never_turns_back_and_comes_to_rest(
            rate in 0.001..2.0f64, acceleration in -8.0..2.0f64, goes_on_for in 0.0..0.5f64, share in 0.01..0.99f64,
        ) {
            let after = |elapsed| Coasted::after(elapsed, [rate, acceleration], goes_on_for);
            prop_assert_eq!(after(0.0).way, 0.0);
            let (mut before, mut time) = (after(0.0).way, 0.0);
            while time < goes_on_for + BRAKE + 0.1 {
                time += 0.01;
                let now = after(time);
                prop_assert!(now.rates[0] > -1e-12 && now.way >= before - 1e-12, "{time}: {now:?}");
                // The rate is that of the way.
                let at = time - 0.01 * share;
                let [late, early] = [at + 1e-6, at - 1e-6].map(|at| after(at).way);
                prop_assert!(((late - early) / 2e-6 - after(at).rates[0]).abs() < 1e-4, "{at}");
                before = now.way;
            }
            prop_assert_eq!(after(time).rates, [0.0; 3]);
        }

        #[test]
        fn a_stop_begins_as_it_was_and_ends_at_rest(
            rate in 0.0..2.0f64, acceleration in -4.0..4.0f64, duration in 0.2..5.0f64, share in 0.01..0.99f64,
        ) {
            let stop = Stop::new([rate, acceleration], duration);
            let steepest = -2.5 * rate / duration;
            let [begin, slope, curvature] = stop.at(0.0);
            prop_assert_eq!((begin, curvature.abs()), (rate, 0.0));
            let expected = if rate == 0.0 { 0.0 } else { acceleration.max(steepest) };
            prop_assert!((slope - expected).abs() < 1e-14);
            let near_end = stop.at(duration * (1.0 - 1e-7));
            let small = 1e-4 * (1.0 + 1.0 / (duration * duration));
            prop_assert!(near_end.iter().all(|value| value.abs() < small), "{:?}", near_end);
            prop_assert_eq!(stop.at(duration), [0.0; 3]);
            let at = share * duration;
            let [rate_at, first, second] = stop.at(at);
            prop_assert!(rate_at > -1e-12, "{rate_at}");
            // The steps of the difference quotient are a thousandth of the stop's length.
            let scaled = |place: usize| derivative(|x| stop.at(x * duration)[place], share) / duration;
            let way = derivative(|x| stop.way(x * duration), share) / duration;
            prop_assert!((way - stop.at(at)[0]).abs() < 1e-6, "{way}");
            prop_assert_eq!(stop.way(2.0 * duration), stop.way(duration));
            prop_assert!((first - scaled(0)).abs() < 1e-6 / duration);
            prop_assert!((second - scaled(1)).abs() < 1e-5 / (duration * duration));
        }
    }
}
