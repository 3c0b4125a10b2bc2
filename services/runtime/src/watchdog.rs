//! Ends work inside iceoryx2 that takes too long: it waits without an end for shared memory that was truncated, and may
//! never come out of memory that was overwritten.
//!
//! The thread that works says what it is at; a second thread looks now and then whether it is still at the same piece.
//! That thread counts its own looks and not the time: a process that was stopped, or a machine that slept, has not
//! worked too long. A thread that only waits, on its own bell or for a message, is not at work.
//!
//! A service process that has not flown yet also ends when its orchestrator is gone. In flight others see to that: the
//! system in simulated time ([`crate::deployment::die_with_parent`]), the service itself in real time
//! ([`crate::orchestrator_watchdog`]).

use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::Duration;

use crate::crash;

/// Pause between two looks.
const LOOK: Duration = Duration::from_millis(500);

/// How often in a row the same piece of work may be seen.
const LOOKS: u32 = 40;

/// Stack of the second thread, bytes: it may be locked in memory.
const STACK: usize = 128 << 10;

/// What a process may be at.
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

    /// What it is called in a message.
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

    /// Why it is given up, in words.
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

/// What a thread is at: the number of the piece of work in the upper bits, its [`Work`] or 0 in the lowest byte.
#[derive(Debug, Default)]
struct WorkCell(AtomicU64);

const KIND_BITS: u32 = 8;

impl WorkCell {
    const fn new() -> Self {
        Self(AtomicU64::new(0))
    }

    /// Begins another piece of work, of this kind or none; the kind before. Only one thread works at a desk, and the
    /// watchdog needs nothing but this word: relaxed accesses will do.
    #[inline]
    fn begin(&self, kind: u8) -> u8 {
        let before = self.0.load(Ordering::Relaxed);
        let number = (before >> KIND_BITS).wrapping_add(1);
        self.0
            .store(number << KIND_BITS | u64::from(kind), Ordering::Relaxed);
        before as u8
    }
}

/// Notices that the work at a desk does not end.
#[derive(Debug, Default)]
struct WorkLimits {
    seen: u64,
    looks: u32,
}

impl WorkLimits {
    /// Looks at a desk; the work that has taken too long, if it has.
    fn look(&mut self, desk: &WorkCell) -> Option<Work> {
        let now = desk.0.load(Ordering::Relaxed);
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

/// That of the thread that does the work of this process.
static DESK: WorkCell = WorkCell::new();

/// Whether this process is a service in flight, or was.
static HAS_FLOWN: AtomicBool = AtomicBool::new(false);

/// Says that this process is at another piece of work.
#[inline]
pub fn work(work: Work) {
    DESK.begin(work as u8);
}

/// Says that this process waits, which may take as long as it likes.
#[inline]
pub fn rest() {
    DESK.begin(0);
}

/// Does a piece of work, as a part of another one or alone.
#[inline]
pub fn during<T>(work: Work, act: impl FnOnce() -> T) -> T {
    let before = DESK.begin(work as u8);
    let result = act();
    DESK.begin(before);
    result
}

/// Waits in the middle of some work, if any.
#[inline]
pub fn while_resting<T>(act: impl FnOnce() -> T) -> T {
    let before = DESK.begin(0);
    let result = act();
    DESK.begin(before);
    result
}

/// Says that this service flies: from now on it may outlive its orchestrator.
pub fn take_off() {
    HAS_FLOWN.store(true, Ordering::Relaxed);
}

/// Watches over a service process: ends it when its work takes too long, after the orchestrator was told why by `tell`, and
/// when that `is_alone` says so before the service flies.
///
/// # Errors
/// If the system has no thread left.
pub fn watch_service(
    tell: impl Fn(String) + Send + 'static,
    is_alone: impl Fn() -> bool + Send + 'static,
) -> std::io::Result<()> {
    let mut patience = WorkLimits::default();
    start(move || {
        if let Some(work) = patience.look(&DESK) {
            tell(work.complaint());
            crash::die();
        }
        if !HAS_FLOWN.load(Ordering::Relaxed) && is_alone() {
            crash::die();
        }
    })
}

/// Watches over an orchestrator: calls `give_up`, which is not to return, when its work takes too long.
///
/// # Errors
/// If the system has no thread left.
pub fn watch_orchestrator(give_up: impl Fn(Work) + Send + 'static) -> std::io::Result<()> {
    let mut patience = WorkLimits::default();
    start(move || {
        if let Some(work) = patience.look(&DESK) {
            give_up(work);
        }
    })
}

fn start(mut look: impl FnMut() + Send + 'static) -> std::io::Result<()> {
    let look_now_and_then = move || {
        loop {
            std::thread::sleep(LOOK);
            look();
        }
    };
    let thread = std::thread::Builder::new()
        .name("watchdog".to_owned())
        .stack_size(STACK);
    thread.spawn(look_now_and_then).map(drop)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn work_that_does_not_end_is_noticed_after_as_many_looks_and_named() {
        let (desk, mut patience) = (WorkCell::new(), WorkLimits::default());
        for work in Work::ALL {
            desk.begin(work as u8);
            // The first look sees that it is another piece of work.
            let found = (0..=LOOKS).map(|_| patience.look(&desk)).collect::<Vec<_>>();
            assert_eq!(found.iter().flatten().copied().collect::<Vec<_>>(), [work]);
            assert_eq!(found.last(), Some(&Some(work)));
        }
    }

    #[test]
    fn another_piece_of_the_same_work_and_rest_are_no_work_that_does_not_end() {
        let (desk, mut patience) = (WorkCell::new(), WorkLimits::default());
        for _ in 0..3 * LOOKS {
            desk.begin(Work::Step as u8);
            assert_eq!(patience.look(&desk), None);
        }
        desk.begin(0);
        assert!((0..3 * LOOKS).all(|_| patience.look(&desk).is_none()));
    }

    #[test]
    fn work_within_work_goes_back_to_it() {
        let desk = WorkCell::new();
        assert_eq!(desk.begin(Work::Step as u8), 0);
        let before = desk.begin(Work::CleanUp as u8);
        assert_eq!(before, Work::Step as u8);
        desk.begin(before);
        assert_eq!(desk.0.load(Ordering::Relaxed) as u8, Work::Step as u8);
    }
}
