//! Reserved file descriptors for restarts.
//!
//! A restart opens files: the clean-up those of the dead process in shared memory, the start a channel to the new process,
//! and the recorder connections to its ports. Without free descriptors the clean-up would stop half-way, and iceoryx2 does
//! not complete it later: the successor would have no room for its ports. What a restart keeps open takes the place of what
//! was open for the dead process.

use std::os::fd::OwnedFd;
use std::time::{Duration, Instant};

use rustix::fs::{Mode, OFlags, open};
use rustix::io::Errno;

/// Number of reserved descriptors: enough to restart all services at once.
const COUNT: usize = 64;

/// Time in which a restart has opened what it needs.
const SETTLED: Duration = Duration::from_secs(1);

/// Reserved descriptors, all open on /dev/null.
#[derive(Debug)]
pub(super) struct DescriptorReserve {
    reserved: Vec<OwnedFd>,
    lent_at: Option<Instant>,
}

impl DescriptorReserve {
    /// Reserves them, if this process may open as many files.
    pub(super) fn new() -> Self {
        let mut reserve = Self {
            reserved: Vec::new(),
            lent_at: None,
        };
        reserve.fill();
        reserve
    }

    /// Frees them for a restart.
    pub(super) fn lend(&mut self) {
        self.reserved.clear();
        self.lent_at = Some(Instant::now());
    }

    /// Reserves them again once a restart has what it needs.
    pub(super) fn refill(&mut self) {
        if self.lent_at.is_some_and(|lent_at| lent_at.elapsed() > SETTLED) {
            self.fill();
        }
    }

    /// Reserves all or none, which is tried again after a while: part of them would be the last ones, which others need.
    fn fill(&mut self) {
        let opened: Result<Vec<_>, _> = std::iter::repeat_with(reserved_descriptor).take(COUNT).collect();
        self.lent_at = opened.is_err().then(Instant::now);
        self.reserved = opened.unwrap_or_default();
    }
}

/// Opens a file that is never read, for its descriptor.
pub(crate) fn reserved_descriptor() -> Result<OwnedFd, Errno> {
    open("/dev/null", OFlags::RDONLY | OFlags::CLOEXEC, Mode::empty())
}
