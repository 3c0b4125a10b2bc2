//! Rate, latency and jitter of arrivals over the last complete second.
//!
//! A second with an outage, a gap of several periods, says nothing of the rate at which the system sends: it is not judged. If every
//! second has one, they are. The first figures come after a quarter of a second if the rate is in its band then, so that they are
//! there when the poses have settled; any other rate is judged by a whole second, because a socket may have kept packets before.

use shared_types::capture_figures::CaptureFigures;

/// Length of a window, ns.
const WINDOW_NS: u64 = 1_000_000_000;

/// Length of the first window if its rate is in the band, ns.
const FIRST_WINDOW_NS: u64 = WINDOW_NS / 4;

/// Periods of the slowest stated rate above which a gap between frames is an outage.
const OUTAGE_PERIODS: f64 = 5.0;

/// Figures of a second.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Second {
    /// Frame rate, Hz.
    pub rate: f64,
    /// Mean time from capture to arrival of the accepted poses, s; 0 without any.
    pub latency: f64,
    /// Maximum time from capture to arrival, s.
    pub latency_max: f64,
    /// Standard deviation of the time between frames, s.
    pub jitter: f64,
}

/// Mean and variance of a sequence of numbers.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Moments {
    count: f64,
    mean: f64,
    squares: f64,
}

impl Moments {
    /// Adds a number.
    pub fn push(&mut self, value: f64) {
        self.count += 1.0;
        let from_mean = value - self.mean;
        self.mean += from_mean / self.count;
        self.squares += from_mean * (value - self.mean);
    }

    /// Returns the mean; 0 without numbers.
    #[must_use]
    pub fn mean(&self) -> f64 {
        self.mean
    }

    /// Returns the standard deviation; 0 with fewer than two numbers.
    #[must_use]
    pub fn deviation(&self) -> f64 {
        if self.count < 2.0 {
            return 0.0;
        }
        (self.squares / (self.count - 1.0)).sqrt()
    }
}

/// Statistics of arrivals.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Figures {
    band: [f64; 2],
    started_ns: Option<u64>,
    arrived_ns: u64,
    frames: u32,
    between: Moments,
    latency: Moments,
    latency_max: f64,
    /// `true` if the window has an outage.
    has_outage: bool,
    /// `true` if the window before had one.
    had_outage: bool,
    last: Option<Second>,
}

impl Figures {
    /// Makes empty statistics. A rate outside the band (Hz) counts as a warning.
    #[must_use]
    pub fn new(band: [f64; 2]) -> Self {
        Self {
            band,
            started_ns: None,
            arrived_ns: 0,
            frames: 0,
            between: Moments::default(),
            latency: Moments::default(),
            latency_max: 0.0,
            has_outage: false,
            had_outage: false,
            last: None,
        }
    }

    /// Returns the figures of the last complete second without an outage; `None` before the first.
    #[must_use]
    pub fn last(&self) -> Option<&Second> {
        self.last.as_ref()
    }

    /// Returns whether the rate of that second was in the band.
    #[must_use]
    pub fn is_rate_good(&self) -> bool {
        self.last.is_some_and(|second| self.is_in_band(second.rate))
    }

    fn is_in_band(&self, rate: f64) -> bool {
        (self.band[0]..=self.band[1]).contains(&rate)
    }

    /// Adds the arrival of a frame.
    pub(crate) fn add_arrival(&mut self, arrived_ns: u64, counts: &mut CaptureFigures) {
        if let Some(started_ns) = self.started_ns {
            let gap = seconds(arrived_ns.saturating_sub(self.arrived_ns));
            self.has_outage |= gap * self.band[0] > OUTAGE_PERIODS;
            self.between.push(gap);
            self.frames += 1;
            let lasts_ns = arrived_ns.saturating_sub(started_ns);
            let rate = f64::from(self.frames) / seconds(lasts_ns);
            let is_first = self.last.is_none() && !self.has_outage && self.is_in_band(rate);
            if lasts_ns >= WINDOW_NS || is_first && lasts_ns >= FIRST_WINDOW_NS {
                if !self.has_outage || self.had_outage {
                    self.last = Some(Second {
                        rate,
                        latency: self.latency.mean(),
                        latency_max: self.latency_max,
                        jitter: self.between.deviation(),
                    });
                    counts.rate_warnings += u64::from(!self.is_rate_good());
                }
                *self = Self {
                    last: self.last,
                    started_ns: Some(arrived_ns),
                    had_outage: self.has_outage,
                    ..Self::new(self.band)
                };
            }
        } else {
            self.started_ns = Some(arrived_ns);
        }
        self.arrived_ns = arrived_ns;
    }

    /// Adds the latency of an accepted pose.
    pub(crate) fn add_latency(&mut self, latency_ns: u64) {
        let latency = seconds(latency_ns);
        self.latency.push(latency);
        self.latency_max = self.latency_max.max(latency);
    }
}

#[expect(clippy::cast_precision_loss, reason = "seconds in ns are exact")]
fn seconds(ns: u64) -> f64 {
    ns as f64 * 1e-9
}

#[cfg(test)]
mod tests {
    use super::*;
    use zerocopy::FromZeros;

    const MS: u64 = 1_000_000;

    /// Frames that arrive at times, with a stated rate of 90 to 110 Hz.
    struct Arrivals {
        now_ns: u64,
        figures: Figures,
        counts: CaptureFigures,
    }

    impl Arrivals {
        fn new() -> Self {
            Self {
                now_ns: 7_000 * MS,
                figures: Figures::new([90.0, 110.0]),
                counts: CaptureFigures::new_zeroed(),
            }
        }

        /// Adds frames, each so long after the one before.
        fn come(&mut self, frames: u32, after_ms: u64) {
            for _ in 0..frames {
                self.now_ns += after_ms * MS;
                self.figures.add_arrival(self.now_ns, &mut self.counts);
            }
        }

        fn rate(&self) -> f64 {
            self.figures.last().map_or(0.0, |second| second.rate)
        }
    }

    #[test]
    fn a_second_with_an_outage_is_not_the_rate_of_the_system() {
        for (before, outage_ms) in [(1, 100), (40, 600), (70, 1000), (99, 1000), (100, 5000)] {
            let mut arrivals = Arrivals::new();
            arrivals.come(150 + before, 10);
            arrivals.come(1, outage_ms);
            for _ in 0..350 {
                arrivals.come(1, 10);
                assert!(
                    (arrivals.rate() - 100.0).abs() < 1.0,
                    "{before}: {}",
                    arrivals.rate()
                );
            }
            assert_eq!(arrivals.counts.rate_warnings, 0, "{before} {outage_ms}");
        }
    }

    #[test]
    fn a_system_that_is_slow_or_has_gaps_in_every_second_is_judged() {
        for period_ms in [20, 50, 200, 2000] {
            let mut arrivals = Arrivals::new();
            arrivals.come(300, 10);
            arrivals.come(1 + 3500 / period_ms as u32, period_ms);
            let rate = 1e3 / period_ms as f64;
            assert!(
                (arrivals.rate() - rate).abs() < 0.05 * rate,
                "{}",
                arrivals.rate()
            );
            assert!(arrivals.counts.rate_warnings > 0);
        }
        let mut arrivals = Arrivals::new();
        for _ in 0..4 {
            arrivals.come(60, 10);
            arrivals.come(1, 500);
        }
        assert!(arrivals.rate() < 70.0 && arrivals.counts.rate_warnings > 0);
    }

    #[test]
    fn a_good_rate_is_known_within_the_time_of_settling_and_a_bad_one_after_a_second() {
        let mut arrivals = Arrivals::new();
        arrivals.come(30, 10);
        assert!((arrivals.rate() - 100.0).abs() < 1.0, "{}", arrivals.rate());
        let mut slow = Arrivals::new();
        slow.come(49, 20);
        assert_eq!((slow.rate(), slow.counts.rate_warnings), (0.0, 0));
        slow.come(3, 20);
        assert!((slow.rate() - 50.0).abs() < 1.0 && slow.counts.rate_warnings == 1);
    }
}
