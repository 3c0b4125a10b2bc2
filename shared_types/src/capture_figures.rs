//! Statistics of a laboratory's motion capture: frames counted by their outcome, for the driver and the record of the
//! machine.

use std::borrow::Cow;

/// Lateness above which a capture counts as late, ns.
pub const LATE_NS: u64 = 5_000_000;

crate::sample! {
    /// Statistics of a laboratory's motion capture. All counts are since the start of the receiving process.
    pub struct CaptureFigures {
        /// Wall time since the start of the run, ns.
        pub time_ns: u64,
        #[values(
            HEALTH_UNKNOWN = 0, HEALTH_SILENT = 1, HEALTH_ABSENT = 2, HEALTH_SETTLING = 3, HEALTH_GOOD = 4,
            HEALTH_DOUBTFUL = 5
        )]
        /// Not started yet, nothing received, no frame with the vehicle, its poses not accepted yet; the last frame had
        /// an accepted pose, or none.
        pub health: u32,
        /// Length of the reason, bytes.
        pub reason_length: u32,
        /// Arrival time of the last accepted pose, ns since the start of the flight; 0 before the first.
        pub believed_at_ns: u64,
        /// Frame rate in the last whole second with frames, Hz; 0 before the first.
        pub rate: f64,
        /// Mean time from capture to arrival in that second, s.
        pub latency: f64,
        /// Largest such time, s.
        pub latency_max: f64,
        /// Standard deviation of the time between frames, s.
        pub jitter: f64,
        /// Drift of the sender's clock against the local one, per unit.
        pub drift: f64,
        /// Frames that contain the vehicle or could have.
        pub frames: u64,
        /// Frames whose pose was accepted.
        pub believed: u64,
        /// Frames without the vehicle's body.
        pub absent: u64,
        /// Frames in which the body was occluded.
        pub occluded: u64,
        /// Frames with a pose equal to the one before.
        pub frozen: u64,
        /// Frames received before.
        pub repeated: u64,
        /// Frames older than one before.
        pub late: u64,
        /// Frames with an impossible timestamp.
        pub mistimed: u64,
        /// Frames before poses and clock had settled.
        pub unsettled: u64,
        /// Frames with a position or an attitude that the vehicle cannot have reached.
        pub jumped: u64,
        /// Frames with a pose at which another body was.
        pub exchanged: u64,
        /// Number of jumps of the sender's clock that were followed.
        pub clock_steps: u64,
        /// Frames that were never received.
        pub lost: u64,
        /// Number of times that the frame numbers restarted.
        pub restarted: u64,
        /// Number of times that poses were accepted after settling.
        pub settled: u64,
        /// Seconds whose rate was outside the stated band.
        pub rate_warnings: u64,
        /// Packets, or messages of a stream, that could not be read.
        pub malformed: u64,
        /// Poses of the vehicle refused for their values: not a number, not a rotation, not a position in a laboratory.
        pub refused: u64,
        /// Refused poses of other bodies.
        pub others_refused: u64,
        /// Packets from other senders than the server.
        pub foreign: u64,
        /// Connections established, or servers that answered.
        pub connections: u64,
        /// Connections that ended or could not be established, and socket errors.
        pub failures: u64,
        /// Reasons of the refusals as text, each with its count, filled up with zeros.
        pub reason: [u8; 200],
    }
}

impl CaptureFigures {
    /// Returns the reasons of the refusals; empty without refusals.
    #[must_use]
    pub fn reason(&self) -> Cow<'_, str> {
        let length = (self.reason_length as usize).min(self.reason.len());
        String::from_utf8_lossy(&self.reason[..length])
    }

    /// Returns the frames' outcomes with their counts, in the order of display.
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

    /// Returns the outcomes that refuse a pose, with their counts.
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

    /// Returns the outcomes that refused poses as text, each with its count; empty if there are none.
    #[must_use]
    pub fn drops_in_words(&self) -> String {
        let some = self.drops().into_iter().filter(|(_, count)| *count > 0);
        let words: Vec<_> = some.map(|(name, count)| format!("{name} {count}")).collect();
        words.join(", ")
    }

    /// Returns the number of frames whose pose was refused.
    #[must_use]
    pub fn dropped(&self) -> u64 {
        self.drops().map(|(_, count)| count).iter().sum()
    }
}
