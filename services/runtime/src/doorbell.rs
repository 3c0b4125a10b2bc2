//! Doorbells: eventfds that the orchestrator makes and all services inherit, so that they survive a restart.
//!
//! Ringing never blocks: an external service could fill the counter of a doorbell, and must not stop the process that
//! rings.

use std::os::fd::{AsFd, BorrowedFd, OwnedFd};

use rustix::event::{EventfdFlags, PollFd, PollFlags, eventfd, poll};

use crate::flight_clock::deadline;

/// Doorbell of a service. A publisher rings it after a publication for the service; a ring is a hint and carries no data.
#[derive(Debug)]
pub struct Doorbell(OwnedFd);

impl Doorbell {
    /// Makes a doorbell.
    ///
    /// # Errors
    /// If no file descriptor is left.
    pub fn create() -> std::io::Result<Self> {
        Ok(Self(eventfd(0, EventfdFlags::CLOEXEC | EventfdFlags::NONBLOCK)?))
    }

    /// Takes over an inherited doorbell.
    #[must_use]
    pub fn inherited(file: OwnedFd) -> Self {
        Self(file)
    }

    /// Wakes the service that sleeps on the doorbell.
    #[inline]
    pub fn ring(&self) {
        // The only failure is a full counter, which wakes the sleeper as well.
        let _ = rustix::io::write(&self.0, &1u64.to_ne_bytes());
    }

    /// Sleeps until a ring, or returns at once if one is pending; clears all rings.
    #[inline]
    pub fn sleep(&self) {
        // An interrupted sleep is like a ring: the caller checks all its conditions again.
        let _ = poll(&mut [PollFd::new(&self.0, PollFlags::IN)], None);
        self.clear();
    }

    /// Sleeps as [`Self::sleep`] does, with a timeout in ns.
    #[inline]
    pub fn sleep_with_timeout(&self, timeout_ns: u64) {
        let timeout = deadline(timeout_ns);
        let mut file = [PollFd::new(&self.0, PollFlags::IN)];
        // As above, an interruption is like a ring.
        if poll(&mut file, Some(&timeout)).is_ok_and(|rung| rung > 0) {
            self.clear();
        }
    }

    /// Clears all rings. Without a ring it has no effect.
    #[inline]
    fn clear(&self) {
        let _ = rustix::io::read(&self.0, &mut [0u8; 8]);
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
    fn a_full_counter_blocks_no_ring_and_wakes_the_sleeper() {
        let doorbell = Doorbell::create().unwrap();
        rustix::io::write(&doorbell, &(u64::MAX - 1).to_ne_bytes()).unwrap();
        doorbell.ring();
        doorbell.sleep();
        doorbell.ring();
        doorbell.sleep();
        let nothing = rustix::io::read(&doorbell, &mut [0u8; 8]);
        assert_eq!(
            nothing,
            Err(rustix::io::Errno::AGAIN),
            "both sleeps cleared all rings"
        );
    }

    #[test]
    fn a_sleep_with_a_limit_ends_with_a_ring_or_without() {
        let doorbell = Doorbell::create().unwrap();
        doorbell.sleep_with_timeout(1);
        doorbell.ring();
        doorbell.sleep_with_timeout(u64::MAX);
        doorbell.ring();
        doorbell.sleep();
    }
}
