//! Watchdog over work in code of others that takes too long: a plug-in may never return from a step, and iceoryx2 waits
//! without an end for shared memory that was truncated, and may never return from memory that was overwritten.
//!
//! The working thread names its current work. A second thread checks now and then whether that is still the same piece.
//! It counts its checks and not the time: a process that was stopped, or a machine that slept, has not worked too long.
//! A thread that only waits, on its doorbell or for a message, does not work.

use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

/// Pause between two checks.
const LOOK: Duration = Duration::from_millis(500);

/// Checks in a row that may find the same piece of work.
const LOOKS: u32 = 40;

/// Stack of the second thread, bytes: it may be locked in memory.
const STACK: usize = 128 << 10;

/// Kind of work of a process.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum Work {
    /// It joins the run's shared memory.
    Join = 1,
    /// It opens or makes topics.
    Topics = 2,
    /// It makes its ports or connects them.
    Ports = 3,
    /// It frees what dead processes held.
    CleanUp = 4,
    /// It receives, computes and publishes.
    Step = 5,
    /// It receives what others have published.
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

    /// Returns its name in messages.
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

    /// Returns the reason for giving it up, in words.
    #[must_use]
    pub fn complaint(self) -> String {
        format!(
            "{} has taken longer than {} s: the run's shared memory was damaged or truncated by another program, or the \
             machine is overloaded",
            self.name(),
            LOOK.as_secs_f64() * f64::from(LOOKS)
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

    /// Begins another piece of work, of this kind or none. Returns the kind before. Only one thread writes a cell, and
    /// the watchdog reads nothing but this word: relaxed order suffices.
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
    looks: u32,
}

impl WorkLimits {
    /// Checks a cell. Returns the work that has taken too long, if any.
    fn look(&mut self, cell: &WorkCell) -> Option<Work> {
        let now = cell.0.load(Ordering::Relaxed);
        let kind = usize::from(now as u8);
        if kind == 0 || now != self.seen {
            (self.seen, self.looks) = (now, 0);
            return None;
        }
        self.looks += 1;
        let work = Work::ALL.get(kind - 1).copied();
        work.filter(|_| self.looks >= LOOKS)
    }
}

/// Work of the thread that does the work of this process.
static CURRENT_WORK: WorkCell = WorkCell::new();

/// Records that this process begins another piece of work.
#[inline]
pub fn work(work: Work) {
    CURRENT_WORK.begin(work as u8);
}

/// Records that this process waits, which may take any time.
#[inline]
pub fn rest() {
    CURRENT_WORK.begin(0);
}

/// Does a piece of work, as a part of another one or alone.
#[inline]
pub fn during<T>(work: Work, act: impl FnOnce() -> T) -> T {
    let before = CURRENT_WORK.begin(work as u8);
    let result = act();
    CURRENT_WORK.begin(before);
    result
}

/// Waits in the middle of some work, if any.
#[inline]
pub fn while_resting<T>(act: impl FnOnce() -> T) -> T {
    let before = CURRENT_WORK.begin(0);
    let result = act();
    CURRENT_WORK.begin(before);
    result
}

/// Watches over the work of this process from a thread of its own: calls `check` now and then with the work that has taken too
/// long, if any.
///
/// # Errors
/// If the system has no thread left.
pub fn watch(mut check: impl FnMut(Option<Work>) + Send + 'static) -> std::io::Result<()> {
    let mut limits = WorkLimits::default();
    let check_now_and_then = move || {
        loop {
            std::thread::sleep(LOOK);
            check(limits.look(&CURRENT_WORK));
        }
    };
    let thread = std::thread::Builder::new()
        .name("watchdog".to_owned())
        .stack_size(STACK);
    thread.spawn(check_now_and_then).map(drop)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn endless_work_is_found_and_named_after_the_limit_of_checks() {
        let (cell, mut limits) = (WorkCell::new(), WorkLimits::default());
        for work in Work::ALL {
            cell.begin(work as u8);
            // The first look sees that it is another piece of work.
            let found = (0..=LOOKS).map(|_| limits.look(&cell)).collect::<Vec<_>>();
            assert_eq!(found.iter().flatten().copied().collect::<Vec<_>>(), [work]);
            assert_eq!(found.last(), Some(&Some(work)));
        }
    }

    #[test]
    fn repeated_work_and_rest_are_not_endless_work() {
        let (cell, mut limits) = (WorkCell::new(), WorkLimits::default());
        for _ in 0..3 * LOOKS {
            cell.begin(Work::Step as u8);
            assert_eq!(limits.look(&cell), None);
        }
        cell.begin(0);
        assert!((0..3 * LOOKS).all(|_| limits.look(&cell).is_none()));
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
