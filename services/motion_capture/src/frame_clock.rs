//! Frame clock: stamps for frames that have only numbers, by the period between frames.
//!
//! Such a sender captures at a constant rate, so that a frame's number determines its time. The arrival time does not:
//! packets that were held up arrive in one burst, and the oldest of them would count as new. The period is measured
//! between the frames with the smallest delay of two windows that are 2 to 16 s apart. Its remaining error is a drift that
//! [`RemoteClock`](crate::clock::RemoteClock) tracks.

/// Time for which arrivals are collected before the first stamp, ns.
const COLLECT_NS: u64 = 500_000_000;
/// Length of a window, which contributes its frame with the smallest delay, ns.
const WINDOW_NS: u64 = 500_000_000;
/// Minimum time between the two frames of a measurement of the period, ns.
const MIN_BASELINE_NS: u64 = 2_000_000_000;
/// Time after which the older of these frames is replaced, ns.
const GENERATION_NS: u64 = 8_000_000_000;
/// Maximum step of frame numbers within a sequence.
const MAX_STEP: u32 = 10_000;

/// Arrival of a frame.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Arrival {
    number: u32,
    arrived_ns: u64,
    /// Assigned stamp, ns.
    stamp_ns: i64,
}

/// Assigns stamps to frame numbers.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct FrameClock {
    newest: Option<Arrival>,
    /// Time between two frames, ns; 0 while it is not known.
    period_ns: f64,
    /// First frame of the measurement of the period, and its next replacement.
    origins: [Option<Arrival>; 2],
    window_end_ns: u64,
    /// Frame of the window with the smallest delay.
    best: Option<Arrival>,
}

impl FrameClock {
    /// Makes a clock that continues after a frame of this number and stamp (ns) with a known period (ns).
    pub(crate) fn after(number: u32, stamp_ns: i64, period_ns: f64) -> Self {
        let newest = Arrival {
            number,
            arrived_ns: 0,
            stamp_ns,
        };
        Self {
            newest: Some(newest),
            period_ns,
            ..Self::default()
        }
    }

    /// Returns the number and stamp of the newest frame and the period, ns; `None` while it is not known.
    pub(crate) fn newest(&self) -> Option<(u32, i64, f64)> {
        let newest = self.newest.filter(|_| self.period_ns > 0.0)?;
        Some((newest.number, newest.stamp_ns, self.period_ns))
    }

    /// Returns the stamp of the next frame, ns, from its number and arrival (ns of the local clock, never decreasing).
    #[expect(clippy::cast_possible_truncation, reason = "ten thousand frames are minutes")]
    pub(crate) fn stamp(&mut self, number: u32, arrived_ns: u64) -> Option<i64> {
        let mut frame = Arrival {
            number,
            arrived_ns,
            stamp_ns: 0,
        };
        let frames = self.newest.map(|newest| number.wrapping_sub(newest.number));
        let Some((newest, frames)) = self.newest.zip(frames.filter(|&frames| frames <= MAX_STEP)) else {
            *self = Self {
                newest: Some(frame),
                origins: [Some(frame), None],
                ..Self::default()
            };
            return None;
        };
        if self.period_ns == 0.0 {
            // The first period is measured over all arrivals so far.
            self.newest = Some(Arrival { number, ..newest });
            let [Some(origin), _] = self.origins else {
                return None;
            };
            if arrived_ns.saturating_sub(origin.arrived_ns) < COLLECT_NS {
                return None;
            }
            self.period_ns = period_ns(&origin, &frame);
            self.origins = [None; 2];
        } else {
            frame.stamp_ns = newest
                .stamp_ns
                .saturating_add((f64::from(frames) * self.period_ns) as i64);
        }
        self.newest = Some(frame);
        self.add(frame);
        Some(frame.stamp_ns)
    }

    /// Adds a stamped frame to the measurement of the period.
    fn add(&mut self, frame: Arrival) {
        if frame.arrived_ns >= self.window_end_ns {
            if let Some(best) = self.best.take() {
                self.close(best);
            }
            self.window_end_ns = frame.arrived_ns + WINDOW_NS;
        }
        if self.best.is_none_or(|best| frame.delay_ns() < best.delay_ns()) {
            self.best = Some(frame);
        }
    }

    /// Adds the best frame of a completed window.
    fn close(&mut self, best: Arrival) {
        let since = |origin: Arrival| best.arrived_ns.saturating_sub(origin.arrived_ns);
        let [first, next] = &mut self.origins;
        let origin = *first.get_or_insert(best);
        if since(origin) >= MIN_BASELINE_NS {
            self.period_ns = period_ns(&origin, &best);
        }
        if since(*next.get_or_insert(best)) >= GENERATION_NS {
            *first = next.replace(best);
        }
    }
}

impl Arrival {
    /// Returns the network delay up to a constant, ns.
    fn delay_ns(&self) -> i64 {
        self.arrived_ns.cast_signed().saturating_sub(self.stamp_ns)
    }
}

/// Returns the mean period between two frames, ns.
#[expect(clippy::cast_precision_loss, reason = "a time of seconds in ns is exact")]
fn period_ns(first: &Arrival, last: &Arrival) -> f64 {
    let frames = last.number.wrapping_sub(first.number).max(1);
    last.arrived_ns.saturating_sub(first.arrived_ns) as f64 / f64::from(frames)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::clock::{Mapped, RemoteClock};

    const MS: f64 = 1e6;

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]

        /// At any rate, with frames lost, late by chance and held up in bundles, a frame's time is known to 8 ms and a
        /// period, by which the best of each bundle may be late: 4 ms are overlooked by the clock's line, the rest is
        /// jitter, and drift by the error that such a bundle makes in the period.
        #[test]
        fn frames_that_are_held_up_have_the_time_at_which_they_would_have_come(
            rate in 50.0..250.0f64,
            first_number: u32,
            hold_ms in 20.0..55.0f64,
            lost in prop::collection::vec(0.0..1.0f64, 97),
            jitter in prop::collection::vec(0.0..1.0f64, 89),
        ) {
            let (mut clock, mut remote) = (FrameClock::default(), RemoteClock::new());
            let (mut worst_ns, mut known, mut heard, mut last_ns) = (0.0f64, 0, 0, 0);
            for index in 0..(30.0 * rate) as usize {
                if lost[index % 97] < 0.05 {
                    continue;
                }
                let sent_ns = 1e9 + index as f64 * 1e9 / rate;
                let seconds = 1e-9 * sent_ns;
                let hold_ns = hold_ms * MS;
                let held_ns = if (10.0..12.0).contains(&seconds) || (20.0..21.0).contains(&seconds) {
                    hold_ns - sent_ns % hold_ns
                } else {
                    0.0
                };
                last_ns = ((sent_ns + held_ns - 0.3 * MS * libm::log(1.0 - jitter[index % 89])) as u64).max(last_ns);
                let stamp_ns = clock.stamp(first_number.wrapping_add(index as u32), last_ns);
                let mapped = stamp_ns.map(|stamp_ns| remote.map(stamp_ns, last_ns));
                if seconds > 4.0 {
                    heard += 1;
                    if let Some(Mapped::At(at_ns)) = mapped {
                        known += 1;
                        worst_ns = worst_ns.max((at_ns as f64 - sent_ns).abs());
                    }
                }
            }
            prop_assert!(worst_ns < 1e9 / rate + 8.0 * MS, "{} ms", worst_ns / MS);
            prop_assert_eq!(known, heard);
            let error = clock.period_ns * rate * 1e-9 - 1.0;
            prop_assert!(error.abs() < 1e-3, "the period is wrong by {error}");
        }
    }

    #[test]
    fn a_sender_that_restarts_is_listened_to_again() {
        let mut clock = FrameClock::default();
        let mut stamps = |from: u32, from_ns: u64| {
            (0..100)
                .map(|index| clock.stamp(from + index, from_ns + u64::from(index) * 10_000_000))
                .collect::<Vec<_>>()
        };
        for from in [5_000_000, 7] {
            let stamps = stamps(from, 1_000_000_000 + u64::from(5_000_000 - from));
            assert_eq!(stamps.iter().filter(|stamp| stamp.is_none()).count(), 50);
            let gaps: Vec<i64> = stamps.into_iter().flatten().collect();
            assert!(
                gaps.windows(2).all(|pair| pair[1] - pair[0] == 10_000_000),
                "{gaps:?}"
            );
        }
    }
}
