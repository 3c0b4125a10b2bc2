//! Remote clock: offset and drift of the sender's clock, from stamps and arrival times alone.
//!
//! Network delay only makes packets late, never early. So each window of half a second contributes its packet with the
//! smallest delay. A line below these points relates the clocks: its slope is the median of the slopes between points far
//! apart, which is robust against a few bad windows.
//!
//! Failure policy: a stamp is mapped if its time is known to 60 ms.
//!
//! | arrival relative to the line | response |
//! | --- | --- |
//! | up to 60 ms early | the line was too high: it is lowered to this packet |
//! | up to 60 ms late | mapped by the line |
//! | all packets of two windows more than 4 ms late | the delay has increased, or the clock was set back: the line is raised to the packet with the smallest delay |
//! | more than 60 ms early or late | rejected; if 25 more stamps agree on another offset than disagree, over at least 50 ms, the sender's clock was set, and the estimate restarts |
//!
//! Lowering or raising the line keeps its slope and discards earlier points.

/// Length of a window, ns.
const WINDOW_NS: u64 = 500_000_000;
/// Number of stored windows.
const WINDOWS: usize = 64;
/// Minimum number of windows for a slope; with fewer, the slope is 0 and only [`WINDOWS_WITHOUT_SLOPE`] windows count.
const WINDOWS_FOR_SLOPE: usize = WINDOWS / 2;
/// Number of windows that count without a slope: few, so that drift is negligible within them.
const WINDOWS_WITHOUT_SLOPE: usize = 2;
/// Maximum drift of a quartz clock, s/s.
const MAX_DRIFT: f64 = 1e-4;
/// Lead of a packet over the line that an error of the slope cannot explain, ns.
const EARLY_NS: i64 = 2_000_000;
/// Maximum distance of an accepted packet from the line, ns.
const MAX_DISTANCE_NS: i64 = 60_000_000;
/// Maximum lag of a window's best packet behind the line, ns.
const WINDOW_LATE_NS: i64 = 4_000_000;
/// Consecutive late windows after which the line is raised.
const LATE_WINDOWS: u32 = 2;
/// Majority of agreeing rejected stamps after which their offset is adopted.
const CONFIRMATIONS: u32 = 25;
/// Minimum time over which they arrive, ns: packets that were held up arrive in one burst.
const CONFIRMED_FOR_NS: u64 = 50_000_000;
/// Maximum difference of agreeing offsets, ns.
const AGREEMENT_NS: i64 = 20_000_000;
/// Time for which stamps are collected before the first is mapped, ns.
const COLLECT_NS: u64 = 200_000_000;

/// Outcome of a stamp.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Mapped {
    /// The stamp's time on the local clock, ns, assuming that the fastest packet had no delay.
    At(i64),
    /// There are not enough stamps yet.
    Collecting,
    /// The stamp is too far from the line.
    Rejected,
    /// The sender's clock was set; the estimate has restarted.
    Stepped,
}

/// Arrival and offset of a packet.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Point {
    arrived_ns: u64,
    /// Arrival minus stamp.
    offset_ns: i64,
}

/// Line that relates the clocks.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ClockLine {
    /// Arrival of a packet on the line, ns of the local clock.
    pub arrived_ns: u64,
    /// Arrival minus stamp of that packet, ns.
    pub offset_ns: i64,
    /// Rate at which the local clock gains on the sender's.
    pub slope: f64,
}

/// Offset and drift of a sender's clock.
#[derive(Clone, Debug, PartialEq)]
pub struct RemoteClock {
    started_ns: Option<u64>,
    /// `true` once stamps are mapped.
    is_settled: bool,
    window_end_ns: u64,
    window: Option<Point>,
    points: [Option<Point>; WINDOWS],
    count: usize,
    slope: f64,
    /// A point on the line.
    anchor: Option<Point>,
    late_windows: u32,
    rejected: u32,
    rejected_offset_ns: i64,
    /// Arrival of the first rejected stamp, ns.
    rejected_since_ns: u64,
}

impl Default for RemoteClock {
    fn default() -> Self {
        Self::new()
    }
}

impl RemoteClock {
    /// Makes an estimate without data.
    #[must_use]
    pub fn new() -> Self {
        Self {
            started_ns: None,
            is_settled: false,
            window_end_ns: 0,
            window: None,
            points: [None; WINDOWS],
            count: 0,
            slope: 0.0,
            anchor: None,
            late_windows: 0,
            rejected: 0,
            rejected_offset_ns: 0,
            rejected_since_ns: 0,
        }
    }

    /// Makes an estimate that starts from a line.
    #[must_use]
    pub fn with_line(line: ClockLine) -> Self {
        let mut clock = Self {
            started_ns: Some(0),
            is_settled: true,
            slope: line.slope,
            ..Self::new()
        };
        clock.restart_at(Point {
            arrived_ns: line.arrived_ns,
            offset_ns: line.offset_ns,
        });
        clock
    }

    /// Returns the line; `None` while stamps are not mapped.
    #[must_use]
    pub fn line(&self) -> Option<ClockLine> {
        let Point {
            arrived_ns,
            offset_ns,
        } = self.anchor.filter(|_| self.is_settled)?;
        Some(ClockLine {
            arrived_ns,
            offset_ns,
            slope: self.slope,
        })
    }

    /// Returns the rate at which the local clock gains on the sender's, s/s.
    #[must_use]
    pub fn drift(&self) -> f64 {
        self.slope
    }

    /// Updates the estimate by a packet's stamp (ns of the sender's clock) and arrival (ns of the local clock, never
    /// decreasing), and maps the stamp.
    pub fn map(&mut self, sent_ns: i64, arrived_ns: u64) -> Mapped {
        let Some(offset_ns) = i64::try_from(arrived_ns)
            .ok()
            .and_then(|arrived| arrived.checked_sub(sent_ns))
        else {
            return Mapped::Rejected;
        };
        let point = Point {
            arrived_ns,
            offset_ns,
        };
        let Some(started_ns) = self.started_ns else {
            self.begin(point);
            return Mapped::Collecting;
        };
        let late_ns = offset_ns.saturating_sub(self.offset_ns(arrived_ns));
        if !(-MAX_DISTANCE_NS..=MAX_DISTANCE_NS).contains(&late_ns) {
            return self.reject(point);
        }
        self.rejected = 0;
        if late_ns < -EARLY_NS {
            self.restart_at(point);
        } else {
            self.accept(point);
        }
        if arrived_ns.saturating_sub(started_ns) < COLLECT_NS {
            return Mapped::Collecting;
        }
        self.is_settled = true;
        Mapped::At(sent_ns.saturating_add(self.offset_ns(arrived_ns)))
    }

    fn begin(&mut self, point: Point) {
        *self = Self {
            started_ns: Some(point.arrived_ns),
            window_end_ns: point.arrived_ns + WINDOW_NS,
            window: Some(point),
            ..Self::new()
        };
        self.fit();
    }

    fn reject(&mut self, point: Point) -> Mapped {
        let agrees = self.rejected > 0
            && point.offset_ns.abs_diff(self.rejected_offset_ns) <= AGREEMENT_NS.unsigned_abs();
        // Majority vote (Boyer and Moore): a packet that is late by chance cancels one confirmation, not all of them, and a
        // wrong stamp cannot outvote the right ones. The smallest offset represents those that agree: a late packet would
        // be too far from half of the others.
        if agrees {
            self.rejected += 1;
            self.rejected_offset_ns = self.rejected_offset_ns.min(point.offset_ns);
        } else if self.rejected > 1 {
            self.rejected -= 1;
        } else {
            self.rejected = 1;
            self.rejected_offset_ns = point.offset_ns;
            self.rejected_since_ns = point.arrived_ns;
        }
        let lasts_ns = point.arrived_ns.saturating_sub(self.rejected_since_ns);
        if self.rejected < CONFIRMATIONS || lasts_ns < CONFIRMED_FOR_NS {
            return Mapped::Rejected;
        }
        self.begin(point);
        Mapped::Stepped
    }

    /// Moves the line to a point and discards the earlier points.
    fn restart_at(&mut self, point: Point) {
        self.points = [None; WINDOWS];
        self.count = 0;
        self.late_windows = 0;
        self.window = Some(point);
        self.window_end_ns = point.arrived_ns + WINDOW_NS;
        self.anchor = Some(point);
    }

    /// Adds an accepted point.
    fn accept(&mut self, point: Point) {
        if point.arrived_ns >= self.window_end_ns {
            if let Some(best) = self.window.take() {
                self.close(best);
            }
            self.window_end_ns = point.arrived_ns + WINDOW_NS;
            self.window = Some(point);
            self.fit();
        } else if self
            .window
            .is_none_or(|best| point.offset_ns < self.through(best, point.arrived_ns))
        {
            self.window = Some(point);
            if self.offset_ns(point.arrived_ns) > point.offset_ns {
                self.anchor = Some(point);
            }
        }
    }

    /// Adds the best point of a completed window.
    fn close(&mut self, best: Point) {
        let line_ns = self.offset_ns(best.arrived_ns);
        let is_late = self.count > 0 && best.offset_ns - line_ns > WINDOW_LATE_NS;
        self.late_windows = if is_late { self.late_windows + 1 } else { 0 };
        if self.late_windows >= LATE_WINDOWS {
            self.restart_at(best);
        }
        if self.late_windows == 0 {
            self.points[self.count % WINDOWS] = Some(best);
            self.count += 1;
        }
    }

    /// Fits the line: its slope to points far apart, its height to the lowest point.
    fn fit(&mut self) {
        self.slope = self.fitted_slope().unwrap_or(self.slope);
        let stored = if self.count < WINDOWS_FOR_SLOPE {
            WINDOWS_WITHOUT_SLOPE
        } else {
            WINDOWS
        };
        let oldest = self.count.saturating_sub(stored);
        let points = (oldest..self.count).map(|index| self.points[index % WINDOWS]);
        let candidates = points.chain([self.window]).flatten();
        // The lowest point, compared at a common time.
        let at_ns = self.window_end_ns;
        self.anchor = candidates.min_by_key(|point| self.through(*point, at_ns));
    }

    /// Returns the median of the slopes between points that are half of the stored time apart.
    fn fitted_slope(&self) -> Option<f64> {
        let known = self.count.min(WINDOWS);
        if known < WINDOWS_FOR_SLOPE {
            return None;
        }
        let oldest = self.count - known;
        let apart = known / 2;
        let mut slopes = [0.0; WINDOWS / 2];
        let mut count = 0;
        for index in oldest..self.count - apart {
            if let (Some(first), Some(second)) = (
                self.points[index % WINDOWS],
                self.points[(index + apart) % WINDOWS],
            ) && count < slopes.len()
            {
                slopes[count] = slope(first, second);
                count += 1;
            }
        }
        let slopes = &mut slopes[..count];
        slopes.sort_unstable_by(f64::total_cmp);
        Some(slopes.get(count / 2)?.clamp(-MAX_DRIFT, MAX_DRIFT))
    }

    /// Returns the offset on the line at a time, ns: that of a packet without delay.
    fn offset_ns(&self, at_ns: u64) -> i64 {
        self.anchor.map_or(0, |anchor| self.through(anchor, at_ns))
    }

    /// Returns the offset at a time on the line through a point, ns.
    #[expect(
        clippy::cast_possible_truncation,
        reason = "a drift of minutes is below a second"
    )]
    #[expect(clippy::cast_precision_loss, reason = "a time of minutes in ns is exact")]
    fn through(&self, point: Point, at_ns: u64) -> i64 {
        let later_ns = i128::from(at_ns) - i128::from(point.arrived_ns);
        point
            .offset_ns
            .saturating_add((later_ns as f64 * self.slope) as i64)
    }
}

#[expect(
    clippy::cast_precision_loss,
    reason = "differences of minutes in ns are exact"
)]
fn slope(first: Point, second: Point) -> f64 {
    let rise = second.offset_ns.saturating_sub(first.offset_ns) as f64;
    let run = second.arrived_ns.saturating_sub(first.arrived_ns).max(1) as f64;
    rise / run
}

#[cfg(test)]
mod tests;
