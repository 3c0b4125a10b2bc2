//! Rate, latency and jitter of arrivals over the last complete second.

use shared_types::capture_figures::CaptureFigures;

/// Length of a window, ns.
const WINDOW_NS: u64 = 1_000_000_000;

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
            last: None,
        }
    }

    /// Returns the figures of the last complete second with an arrival; `None` before the first.
    #[must_use]
    pub fn last(&self) -> Option<&Second> {
        self.last.as_ref()
    }

    /// Returns whether the rate of that second was in the band.
    #[must_use]
    pub fn is_rate_good(&self) -> bool {
        self.last
            .is_some_and(|second| (self.band[0]..=self.band[1]).contains(&second.rate))
    }

    /// Adds the arrival of a frame.
    pub(crate) fn add_arrival(&mut self, arrived_ns: u64, counts: &mut CaptureFigures) {
        if let Some(started_ns) = self.started_ns {
            self.between
                .push(seconds(arrived_ns.saturating_sub(self.arrived_ns)));
            self.frames += 1;
            if arrived_ns.saturating_sub(started_ns) >= WINDOW_NS {
                self.last = Some(Second {
                    rate: f64::from(self.frames) / seconds(arrived_ns - started_ns),
                    latency: self.latency.mean(),
                    latency_max: self.latency_max,
                    jitter: self.between.deviation(),
                });
                counts.rate_warnings += u64::from(!self.is_rate_good());
                *self = Self {
                    last: self.last,
                    started_ns: Some(arrived_ns),
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
