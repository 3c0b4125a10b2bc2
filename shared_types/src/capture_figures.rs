//! Performance of a laboratory's motion capture: the counts of its frames by their outcome, in the driver and in the
//! machine's record.

use std::borrow::Cow;

crate::sample! {
    /// The performance of a laboratory's motion capture; all counts since the start of the process that listens to it.
    pub struct CaptureFigures {
        /// Wall time since the start of the run, ns.
        pub time_ns: u64,
        #[values(
            HEALTH_UNKNOWN = 0, HEALTH_SILENT = 1, HEALTH_ABSENT = 2, HEALTH_SETTLING = 3, HEALTH_GOOD = 4,
            HEALTH_DOUBTFUL = 5
        )]
        /// Nobody has listened yet, nothing has come, no frame had the vehicle, its poses were not believed yet; the last
        /// frame had a pose that was believed, or none.
        pub health: u32,
        /// Length of the reason, bytes.
        pub reason_length: u32,
        /// Time at which the last pose that was believed arrived, ns since the start of the flight; 0 before the first.
        pub believed_at_ns: u64,
        /// Frames a second in the last whole second in which any came, Hz; 0 before the first.
        pub rate: f64,
        /// Mean time from capture to arrival in that second, s.
        pub latency: f64,
        /// Largest such time, s.
        pub latency_max: f64,
        /// Standard deviation of the time between frames, s.
        pub jitter: f64,
        /// Drift of the sender's clock against the local one, per unit.
        pub drift: f64,
        /// Frames that told of the vehicle or could have.
        pub frames: u64,
        /// Frames whose pose was believed.
        pub believed: u64,
        /// Frames without the vehicle's body.
        pub absent: u64,
        /// Frames in which the body was not seen.
        pub occluded: u64,
        /// Frames with a pose equal to the one before.
        pub frozen: u64,
        /// Frames that had been there.
        pub repeated: u64,
        /// Frames behind a newer one.
        pub late: u64,
        /// Frames with a stamp that cannot be true.
        pub mistimed: u64,
        /// Frames before poses and clock had settled.
        pub unsettled: u64,
        /// Frames with a place where the vehicle cannot be, or an attitude that it cannot have.
        pub jumped: u64,
        /// Frames with a pose where another body was.
        pub exchanged: u64,
        /// Number of jumps of the sender's clock that were followed.
        pub clock_steps: u64,
        /// Frames that never came.
        pub lost: u64,
        /// Number of times that the numbers of frames started again.
        pub restarted: u64,
        /// Number of times that a place was believed at last.
        pub settled: u64,
        /// Seconds whose rate was outside the stated band.
        pub rate_warnings: u64,
        /// Packets, or messages of a stream, that could not be read.
        pub malformed: u64,
        /// Poses of the vehicle that were refused for their values: not a number, no rotation, no place in a laboratory.
        pub refused: u64,
        /// The same of other bodies.
        pub others_refused: u64,
        /// Packets from others than the server.
        pub foreign: u64,
        /// Connections that were made, or servers that answered.
        pub connections: u64,
        /// Connections that ended or could not be made, and errors of a socket.
        pub failures: u64,
        /// Reasons of the refusals in words, each with its count; after the text zeros.
        pub reason: [u8; 200],
    }
}

impl CaptureFigures {
    /// Returns the reasons of the refusals in words; empty if nothing was refused.
    #[must_use]
    pub fn reason(&self) -> Cow<'_, str> {
        let length = (self.reason_length as usize).min(self.reason.len());
        String::from_utf8_lossy(&self.reason[..length])
    }

    /// Returns names and counts of the frames' outcomes, in the order in which they are shown.
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

    /// Returns those of the names and counts that are of refused poses.
    fn drops(&self) -> [(&'static str, u64); 10] {
        let [
            _frames,
            _believed,
            drops @ ..,
            _lost,
            _restarted,
            _settled,
            _warnings,
        ] = self.named();
        drops
    }

    /// Returns the outcomes of frames whose pose was refused in words, each with its count; empty if none was.
    #[must_use]
    pub fn drops_in_words(&self) -> String {
        let some = self.drops().into_iter().filter(|(_, count)| *count > 0);
        let words: Vec<_> = some.map(|(name, count)| format!("{name} {count}")).collect();
        words.join(", ")
    }

    /// Returns the number of frames whose pose was refused, for all reasons.
    #[must_use]
    pub fn dropped(&self) -> u64 {
        self.drops().map(|(_, count)| count).iter().sum()
    }
}
