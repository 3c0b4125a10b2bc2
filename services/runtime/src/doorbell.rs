//! Doorbells: eventfds that the orchestrator makes and all services inherit, so that they survive a restart.

use std::os::fd::{AsFd, BorrowedFd, OwnedFd};

use rustix::event::{EventfdFlags, PollFd, PollFlags, eventfd, poll};

use crate::flight_clock::deadline;

/// A service's doorbell. Whoever publishes for the service rings it; a ring is a hint, never data.
#[derive(Debug)]
pub struct Doorbell(OwnedFd);

impl Doorbell {
    /// Makes a doorbell.
    ///
    /// # Errors
    /// If no file descriptor is left.
    pub fn create() -> std::io::Result<Self> {
        Ok(Self(eventfd(0, EventfdFlags::CLOEXEC)?))
    }

    /// Takes over an inherited doorbell.
    #[must_use]
    pub fn inherited(file: OwnedFd) -> Self {
        Self(file)
    }

    /// Wakes whoever sleeps on the doorbell.
    #[inline]
    pub fn ring(&self) {
        // The only failure is a full counter, and then it has been ringing 2^64 times already.
        let _ = rustix::io::write(&self.0, &1u64.to_ne_bytes());
    }

    /// Sleeps until somebody rings, or returns at once if somebody has; takes all rings back.
    #[inline]
    pub fn sleep(&self) {
        // An interrupted sleep is a ring like any other: everything is looked at again.
        let _ = rustix::io::read(&self.0, &mut [0u8; 8]);
    }

    /// Sleeps as [`Self::sleep`] does, but no longer than this, ns.
    #[inline]
    pub fn sleep_up_to(&self, limit_ns: u64) {
        let limit = deadline(limit_ns);
        let mut file = [PollFd::new(&self.0, PollFlags::IN)];
        // As above, an interruption is a ring.
        if poll(&mut file, Some(&limit)).is_ok_and(|rung| rung > 0) {
            self.sleep();
        }
    }
}

impl AsFd for Doorbell {
    fn as_fd(&self) -> BorrowedFd<'_> {
        self.0.as_fd()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_sleep_with_a_limit_ends_with_a_ring_or_without() {
        let doorbell = Doorbell::create().unwrap();
        doorbell.sleep_up_to(1);
        doorbell.ring();
        doorbell.sleep_up_to(u64::MAX);
        doorbell.ring();
        doorbell.sleep();
    }
}
