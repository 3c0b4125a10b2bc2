//! Whether a vehicle still hears who flies it.

/// LinkLossTimer after which a vehicle takes who flies it for lost and lets its motors rest, ns.
pub const LOST_AFTER_NS: u64 = 500_000_000;

/// Since when nothing has been heard.
#[derive(Debug, Default)]
pub(super) struct LinkLossTimer {
    /// Time at which something was heard last, ns of `CLOCK_MONOTONIC`; `None` before the first, and once it has been missed.
    heard_at_ns: Option<u64>,
    losses: u64,
}

impl LinkLossTimer {
    /// Something was heard.
    pub(super) fn ends_at(&mut self, now_ns: u64) {
        self.heard_at_ns = Some(now_ns);
    }

    /// Returns whether it has become too long by a time; says so once.
    pub(super) fn becomes_too_long(&mut self, at_ns: u64) -> bool {
        let is_lost = |heard_at: &mut u64| at_ns.saturating_sub(*heard_at) > LOST_AFTER_NS;
        let becomes = self.heard_at_ns.take_if(is_lost).is_some();
        self.losses += u64::from(becomes);
        becomes
    }

    /// Returns how often it has.
    pub(super) fn losses(&self) -> u64 {
        self.losses
    }
}
