//! Counts of frames by their outcome.

/// Frames by outcome, since the feed began. Each frame counts once: in `believed`, or in one of the reasons after it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct FeedCounts {
    /// Frames that contained the vehicle or could have.
    pub frames: u64,
    /// Frames whose pose was accepted.
    pub believed: u64,
    /// Without the vehicle's body.
    pub absent: u64,
    /// With the body, which was not seen.
    pub occluded: u64,
    /// With a pose of which a part does not change: cameras have noise, so it is stale.
    pub frozen: u64,
    /// With a number or stamp that has come before.
    pub repeated: u64,
    /// Behind a newer one.
    pub late: u64,
    /// With an impossible stamp.
    pub mistimed: u64,
    /// Before poses and clock had settled, at the start and after a jump.
    pub unsettled: u64,
    /// With a place where the vehicle cannot be, or an attitude that it cannot have.
    pub jumped: u64,
    /// With a pose where another body was.
    pub exchanged: u64,
    /// Restarts of the clock's estimate.
    pub clock_steps: u64,
    /// Frames that never came, by their numbers; not in `frames`.
    pub lost: u64,
    /// Restarts of the frame numbers.
    pub restarted: u64,
    /// Acceptances of a place, the first included.
    pub settled: u64,
    /// Windows of a second whose rate was outside the stated band.
    pub rate_warnings: u64,
}

impl FeedCounts {
    /// Returns names and values, in the order in which they are shown.
    #[must_use]
    pub fn named(&self) -> [(&'static str, u64); 16] {
        [
            ("frames", self.frames),
            ("believed", self.believed),
            ("absent", self.absent),
            ("occluded", self.occluded),
            ("frozen", self.frozen),
            ("repeated", self.repeated),
            ("late", self.late),
            ("mistimed", self.mistimed),
            ("unsettled", self.unsettled),
            ("jumped", self.jumped),
            ("exchanged", self.exchanged),
            ("clock steps", self.clock_steps),
            ("lost", self.lost),
            ("restarted", self.restarted),
            ("settled", self.settled),
            ("rate warnings", self.rate_warnings),
        ]
    }

    /// Returns the number of frames whose pose was refused, for all reasons.
    #[must_use]
    pub fn dropped(&self) -> u64 {
        self.absent
            + self.occluded
            + self.frozen
            + self.repeated
            + self.late
            + self.mistimed
            + self.unsettled
            + self.jumped
            + self.exchanged
            + self.clock_steps
    }
}
