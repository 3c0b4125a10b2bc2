//! Remote clock: offset and drift of the sender's clock, from stamps and arrival times alone.
//!
//! A packet is late by chance, never early. So of each half second only the packet counts that came soonest after its
//! stamp. A line below such points relates the clocks: its slope is the median of the slopes between points far apart,
//! which a few bad windows do not move.
//!
//! Failure policy: a stamp whose time is known to 60 ms is mapped.
//!
//! | arrival beside the line | response |
//! | --- | --- |
//! | up to 60 ms early | the line was too high: it goes through this packet from now on |
//! | up to 60 ms late | mapped by the line |
//! | all packets of two windows more than 4 ms late | the way has become longer, or the clock was set back: the line is raised to the soonest of them |
//! | earlier or later by more than 60 ms | refused; if more of them agree on another offset than do not, by 25 within 50 ms or more, the sender's clock was set, and the estimate restarts |
//!
//! Lowering or raising the line keeps its slope; points from before do not count any more.

/// Length of a window, ns.
const WINDOW_NS: u64 = 500_000_000;
/// Windows that are remembered.
const WINDOWS: usize = 64;
/// Windows below which the slope counts as 0, and points are kept for [`SHORT_MEMORY`] windows only.
const WINDOWS_FOR_SLOPE: usize = WINDOWS / 2;
/// Windows that count without a slope: within them no clock drifts far.
const SHORT_MEMORY: usize = 2;
/// Largest drift of a quartz, per unit.
const LARGEST_DRIFT: f64 = 1e-4;
/// Lead of a packet over the line that no error of the slope explains, ns.
const EARLY_NS: i64 = 2_000_000;
/// Largest distance of a packet from the line without a refusal, ns.
const LARGEST_NS: i64 = 60_000_000;
/// Largest lag of a window's soonest packet behind the line, ns.
const WINDOW_LATE_NS: i64 = 4_000_000;
/// Windows in a row that are later after which the line is raised.
const LATE_WINDOWS: u32 = 2;
/// Refused stamps that agree, beyond those that do not, after which they are accepted.
const CONFIRMATIONS: u32 = 25;
/// Time from the first to the last of them, ns, at least: packets that something has held up come together.
const CONFIRMED_FOR_NS: u64 = 50_000_000;
/// Largest distance of offsets that agree, ns.
const AGREEMENT_NS: i64 = 20_000_000;
/// Time for which stamps are collected before the first is mapped, ns.
const LISTEN_NS: u64 = 200_000_000;

/// Outcome of a stamp.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Mapped {
    /// The stamp's time on the local clock, if the packet that came soonest took no time, ns.
    At(i64),
    /// There are not enough stamps yet.
    Listening,
    /// The stamp is too far from the line.
    Doubted,
    /// The sender's clock was set; the estimate has restarted.
    Stepped,
}

/// The soonest packet of a window.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Point {
    arrived_ns: u64,
    /// Arrival minus stamp.
    offset_ns: i64,
}

/// Line that relates the clocks.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct ClockLine {
    /// Arrival of a packet on the line, ns of the local clock.
    pub(crate) arrived_ns: u64,
    /// Its arrival minus its stamp, ns.
    pub(crate) offset_ns: i64,
    /// Rate at which the local clock gains on the sender's.
    pub(crate) slope: f64,
}

/// Offset and drift of a sender's clock.
#[derive(Clone, Debug, PartialEq)]
pub struct RemoteClock {
    began_ns: Option<u64>,
    /// `true` once stamps are mapped.
    is_settled: bool,
    window_end_ns: u64,
    window: Option<Point>,
    points: [Option<Point>; WINDOWS],
    count: usize,
    slope: f64,
    /// The point through which the line goes.
    anchor: Option<Point>,
    late_windows: u32,
    doubted: u32,
    doubted_offset_ns: i64,
    /// Arrival of the first of them, ns.
    doubted_since_ns: u64,
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
            began_ns: None,
            is_settled: false,
            window_end_ns: 0,
            window: None,
            points: [None; WINDOWS],
            count: 0,
            slope: 0.0,
            anchor: None,
            late_windows: 0,
            doubted: 0,
            doubted_offset_ns: 0,
            doubted_since_ns: 0,
        }
    }

    /// Makes the estimate that goes on with a line.
    pub(crate) fn with_line(line: ClockLine) -> Self {
        let mut clock = Self {
            began_ns: Some(0),
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
    pub(crate) fn line(&self) -> Option<ClockLine> {
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

    /// Returns the rate at which the local clock gains on the sender's, per unit.
    #[must_use]
    pub fn drift(&self) -> f64 {
        self.slope
    }

    /// Takes a packet's stamp (ns of the sender's clock) and arrival (ns of the local clock, never falling).
    pub fn hear(&mut self, sent_ns: i64, arrived_ns: u64) -> Mapped {
        let Some(offset_ns) = i64::try_from(arrived_ns)
            .ok()
            .and_then(|arrived| arrived.checked_sub(sent_ns))
        else {
            return Mapped::Doubted;
        };
        let point = Point {
            arrived_ns,
            offset_ns,
        };
        let Some(began_ns) = self.began_ns else {
            self.begin(point);
            return Mapped::Listening;
        };
        let late_ns = offset_ns.saturating_sub(self.offset_ns(arrived_ns));
        if !(-LARGEST_NS..=LARGEST_NS).contains(&late_ns) {
            return self.doubt(point);
        }
        self.doubted = 0;
        if late_ns < -EARLY_NS {
            self.restart_at(point);
        } else {
            self.take(point);
        }
        if arrived_ns.saturating_sub(began_ns) < LISTEN_NS {
            return Mapped::Listening;
        }
        self.is_settled = true;
        Mapped::At(sent_ns.saturating_add(self.offset_ns(arrived_ns)))
    }

    fn begin(&mut self, point: Point) {
        *self = Self {
            began_ns: Some(point.arrived_ns),
            window_end_ns: point.arrived_ns + WINDOW_NS,
            window: Some(point),
            ..Self::new()
        };
        self.fit();
    }

    fn doubt(&mut self, point: Point) -> Mapped {
        let agrees = self.doubted > 0
            && point.offset_ns.abs_diff(self.doubted_offset_ns) <= AGREEMENT_NS.unsigned_abs();
        // A majority vote (Boyer and Moore): a packet that is late by chance takes back one confirmation and not all of
        // them, and a wrong stamp cannot stand against the right ones. The soonest packet stands for those that agree, or
        // one that was late itself would be so far from half of the others that they never agree.
        if agrees {
            self.doubted += 1;
            self.doubted_offset_ns = self.doubted_offset_ns.min(point.offset_ns);
        } else if self.doubted > 1 {
            self.doubted -= 1;
        } else {
            self.doubted = 1;
            self.doubted_offset_ns = point.offset_ns;
            self.doubted_since_ns = point.arrived_ns;
        }
        let lasts_ns = point.arrived_ns.saturating_sub(self.doubted_since_ns);
        if self.doubted < CONFIRMATIONS || lasts_ns < CONFIRMED_FOR_NS {
            return Mapped::Doubted;
        }
        self.begin(point);
        Mapped::Stepped
    }

    /// Leads the line through a point, without those before it.
    fn restart_at(&mut self, point: Point) {
        self.points = [None; WINDOWS];
        self.count = 0;
        self.late_windows = 0;
        self.window = Some(point);
        self.window_end_ns = point.arrived_ns + WINDOW_NS;
        self.anchor = Some(point);
    }

    /// Takes an accepted point.
    fn take(&mut self, point: Point) {
        if point.arrived_ns >= self.window_end_ns {
            if let Some(soonest) = self.window.take() {
                self.close(soonest);
            }
            self.window_end_ns = point.arrived_ns + WINDOW_NS;
            self.window = Some(point);
            self.fit();
        } else if self
            .window
            .is_none_or(|soonest| point.offset_ns < self.through(soonest, point.arrived_ns))
        {
            self.window = Some(point);
            if self.offset_ns(point.arrived_ns) > point.offset_ns {
                self.anchor = Some(point);
            }
        }
    }

    /// Takes the soonest point of a window that has ended.
    fn close(&mut self, soonest: Point) {
        let line_ns = self.offset_ns(soonest.arrived_ns);
        let is_late = self.count > 0 && soonest.offset_ns - line_ns > WINDOW_LATE_NS;
        self.late_windows = if is_late { self.late_windows + 1 } else { 0 };
        if self.late_windows >= LATE_WINDOWS {
            self.restart_at(soonest);
        }
        if self.late_windows == 0 {
            self.points[self.count % WINDOWS] = Some(soonest);
            self.count += 1;
        }
    }

    /// Fits the line: its slope by the points far apart, its height by the soonest.
    fn fit(&mut self) {
        self.slope = self.fitted_slope().unwrap_or(self.slope);
        let remembered = if self.count < WINDOWS_FOR_SLOPE {
            SHORT_MEMORY
        } else {
            WINDOWS
        };
        let oldest = self.count.saturating_sub(remembered);
        let points = (oldest..self.count).map(|index| self.points[index % WINDOWS]);
        let candidates = points.chain([self.window]).flatten();
        // The line through the lowest point, compared at one time.
        let at_ns = self.window_end_ns;
        self.anchor = candidates.min_by_key(|point| self.through(*point, at_ns));
    }

    /// Returns the median of the slopes between points that are half of the kept time apart.
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
        Some(slopes.get(count / 2)?.clamp(-LARGEST_DRIFT, LARGEST_DRIFT))
    }

    /// Returns the smallest possible offset of a packet that arrives at a time, ns.
    fn offset_ns(&self, at_ns: u64) -> i64 {
        self.anchor.map_or(0, |anchor| self.through(anchor, at_ns))
    }

    /// Returns the offset at a time, on the line through a point, ns.
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
