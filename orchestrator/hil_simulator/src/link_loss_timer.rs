//! Detection of link loss by the vehicle.

/// Time without a frame after which the vehicle declares link loss and stops its motors, ns.
pub const LOST_AFTER_NS: u64 = 500_000_000;

/// Timer since the last frame.
#[derive(Debug, Default)]
pub(super) struct LinkLossTimer {
    /// Time of the last frame, ns of `CLOCK_MONOTONIC`; `None` before the first, and after a loss.
    heard_at_ns: Option<u64>,
    losses: u64,
}

impl LinkLossTimer {
    /// Restarts at a frame.
    pub(super) fn ends_at(&mut self, now_ns: u64) {
        self.heard_at_ns = Some(now_ns);
    }

    /// Returns whether the link is lost by a time, once for each loss.
    pub(super) fn becomes_too_long(&mut self, at_ns: u64) -> bool {
        let is_lost = |heard_at: &mut u64| at_ns.saturating_sub(*heard_at) > LOST_AFTER_NS;
        let becomes = self.heard_at_ns.take_if(is_lost).is_some();
        self.losses += u64::from(becomes);
        becomes
    }

    /// Returns the number of losses.
    pub(super) fn losses(&self) -> u64 {
        self.losses
    }
}
