//! Doorbells: eventfds that the orchestrator makes and all services inherit, so that they survive a restart.

use std::os::fd::{AsFd, BorrowedFd, OwnedFd};

use rustix::event::{EventfdFlags, eventfd};

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
}

impl AsFd for Doorbell {
    fn as_fd(&self) -> BorrowedFd<'_> {
        self.0.as_fd()
    }
}
