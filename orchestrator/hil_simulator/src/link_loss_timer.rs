//! Detection of link loss by the vehicle.

/// Time without a frame after which the vehicle declares link loss and stops its motors, ns.
pub const LOST_AFTER_NS: u64 = 500_000_000;

/// Timer since the last frame.
#[derive(Debug, Default)]
pub(super) struct LinkLossTimer {
    /// Time of the last frame, ns of `CLOCK_MONOTONIC`; `None` before the first, and after a loss.
    last_frame_ns: Option<u64>,
    losses: u64,
}

impl LinkLossTimer {
    /// Restarts the timer at a frame.
    pub(super) fn restart(&mut self, now_ns: u64) {
        self.last_frame_ns = Some(now_ns);
    }

    /// Returns `true` once for each loss, at the first time at which the link is lost.
    pub(super) fn expires(&mut self, at_ns: u64) -> bool {
        let is_lost = |last_frame: &mut u64| at_ns.saturating_sub(*last_frame) > LOST_AFTER_NS;
        let expires = self.last_frame_ns.take_if(is_lost).is_some();
        self.losses += u64::from(expires);
        expires
    }

    /// Returns the number of losses.
    pub(super) fn losses(&self) -> u64 {
        self.losses
    }
}
