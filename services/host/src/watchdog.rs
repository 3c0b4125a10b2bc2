//! Watchdog over third-party code that takes too long: a plug-in may never return from a step, and iceoryx2 waits without a
//! timeout for truncated shared memory, and may never return after other programs have overwritten it.
//!
//! The working thread records its current piece of work. A second thread checks periodically whether it has changed. It
//! counts checks instead of time, so that neither a stopped process nor a suspended machine triggers it. A thread that
//! waits on its doorbell or for a message is idle.

use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

/// Period of the checks.
const CHECK_PERIOD: Duration = Duration::from_millis(500);

/// Number of successive checks with the same piece of work that count as a hang.
const MAX_CHECKS: u32 = 40;

/// Stack of the second thread, bytes: small, because it may be locked in memory.
const STACK: usize = 128 << 10;

/// Kind of work of a process.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum Work {
    /// Joining the run's shared memory.
    Join = 1,
    /// Opening or creating topics.
    Topics = 2,
    /// Making or connecting ports.
    Ports = 3,
    /// Freeing the resources of dead processes.
    CleanUp = 4,
    /// Receiving, computing and publishing.
    Step = 5,
    /// Receiving the samples of other processes.
    Receive = 6,
}

impl Work {
    const ALL: [Self; 6] = [
        Self::Join,
        Self::Topics,
        Self::Ports,
        Self::CleanUp,
        Self::Step,
        Self::Receive,
    ];

    /// Returns the name in messages.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Join => "joining the run",
            Self::Topics => "opening the topics",
            Self::Ports => "connecting the ports",
            Self::CleanUp => "freeing what dead processes held",
            Self::Step => "a step",
            Self::Receive => "receiving samples",
        }
    }

    /// Returns the message of the hang.
    #[must_use]
    pub fn complaint(self) -> String {
        format!(
            "{} has taken longer than {} s: the run's shared memory was damaged or truncated by another program, or the \
             machine is overloaded",
            self.name(),
            CHECK_PERIOD.as_secs_f64() * f64::from(MAX_CHECKS)
        )
    }
}

/// Current work of a thread: the number of the piece of work in the upper bits, its [`Work`] or 0 in the lowest byte.
#[derive(Debug, Default)]
struct WorkCell(AtomicU64);

const KIND_BITS: u32 = 8;

impl WorkCell {
    const fn new() -> Self {
        Self(AtomicU64::new(0))
    }

    /// Begins another piece of work of this kind, or none. Returns the previous kind. Only one thread writes a cell, and the
    /// watchdog reads only this word: relaxed order suffices.
    #[inline]
    fn begin(&self, kind: u8) -> u8 {
        let before = self.0.load(Ordering::Relaxed);
        let number = (before >> KIND_BITS).wrapping_add(1);
        self.0
            .store(number << KIND_BITS | u64::from(kind), Ordering::Relaxed);
        before as u8
    }
}

/// Detector of work that does not end.
#[derive(Debug, Default)]
struct WorkLimits {
    seen: u64,
    checks: u32,
}

impl WorkLimits {
    /// Checks a cell. Returns the work that has taken too long, if any.
    fn check(&mut self, cell: &WorkCell) -> Option<Work> {
        let now = cell.0.load(Ordering::Relaxed);
        let kind = usize::from(now as u8);
        if kind == 0 || now != self.seen {
            (self.seen, self.checks) = (now, 0);
            return None;
        }
        self.checks += 1;
        let work = Work::ALL.get(kind - 1).copied();
        work.filter(|_| self.checks >= MAX_CHECKS)
    }
}

/// Current work of this process's working thread.
static CURRENT_WORK: WorkCell = WorkCell::new();

/// Records that this process begins another piece of work.
#[inline]
pub fn work(work: Work) {
    CURRENT_WORK.begin(work as u8);
}

/// Records that this process waits, for any time.
#[inline]
pub fn idle() {
    CURRENT_WORK.begin(0);
}

/// Does a piece of work, alone or as a part of another one.
#[inline]
pub fn during<T>(work: Work, act: impl FnOnce() -> T) -> T {
    let before = CURRENT_WORK.begin(work as u8);
    let result = act();
    CURRENT_WORK.begin(before);
    result
}

/// Waits, also in the middle of a piece of work.
#[inline]
pub fn while_idle<T>(act: impl FnOnce() -> T) -> T {
    let before = CURRENT_WORK.begin(0);
    let result = act();
    CURRENT_WORK.begin(before);
    result
}

/// Starts a thread that calls `check` periodically, with the work that has taken too long, if any.
///
/// # Errors
/// If the system has no thread left.
pub fn watch(mut check: impl FnMut(Option<Work>) + Send + 'static) -> std::io::Result<()> {
    let mut limits = WorkLimits::default();
    let check_periodically = move || {
        loop {
            std::thread::sleep(CHECK_PERIOD);
            check(limits.check(&CURRENT_WORK));
        }
    };
    let thread = std::thread::Builder::new()
        .name("watchdog".to_owned())
        .stack_size(STACK);
    thread.spawn(check_periodically).map(drop)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn endless_work_is_found_and_named_after_the_limit_of_checks() {
        let (cell, mut limits) = (WorkCell::new(), WorkLimits::default());
        for work in Work::ALL {
            cell.begin(work as u8);
            // The first check finds another piece of work.
            let found = (0..=MAX_CHECKS).map(|_| limits.check(&cell)).collect::<Vec<_>>();
            assert_eq!(found.iter().flatten().copied().collect::<Vec<_>>(), [work]);
            assert_eq!(found.last(), Some(&Some(work)));
        }
    }

    #[test]
    fn repeated_work_and_rest_are_not_endless_work() {
        let (cell, mut limits) = (WorkCell::new(), WorkLimits::default());
        for _ in 0..3 * MAX_CHECKS {
            cell.begin(Work::Step as u8);
            assert_eq!(limits.check(&cell), None);
        }
        cell.begin(0);
        assert!((0..3 * MAX_CHECKS).all(|_| limits.check(&cell).is_none()));
    }

    #[test]
    fn inner_work_returns_to_the_outer_work() {
        let cell = WorkCell::new();
        assert_eq!(cell.begin(Work::Step as u8), 0);
        let before = cell.begin(Work::CleanUp as u8);
        assert_eq!(before, Work::Step as u8);
        cell.begin(before);
        assert_eq!(cell.0.load(Ordering::Relaxed) as u8, Work::Step as u8);
    }
}
