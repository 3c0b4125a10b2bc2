//! Frames leave at exact times, from a thread of their own.
//!
//! Frame n is due at the start + n periods of `CLOCK_MONOTONIC`: an early or late frame does not move the next one. Whoever
//! wakes up after the next frame is due as well leaves out what is past, and counts it.
//!
//! The service's step only puts sticks into the [`Mailbox`]: four words of memory.

use std::io;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::thread::JoinHandle;

use hdrhistogram::Histogram;
use rustix::thread::clock_nanosleep_absolute;
use rustix::time::{ClockId, Timespec, clock_gettime};

use crate::link::RadioLink;
use crate::port::Counts;
use crate::sticks::{Mailbox, Sticks};

/// Longest lateness that is told apart, ns.
const LONGEST_NS: u64 = 1_000_000_000;

/// Time of `CLOCK_MONOTONIC`, ns.
#[must_use]
#[inline]
pub fn monotonic_ns() -> u64 {
    let now = clock_gettime(ClockId::Monotonic);
    u64::try_from(now.tv_sec).unwrap_or(0) * 1_000_000_000 + u64::try_from(now.tv_nsec).unwrap_or(0)
}

/// What a sender has done, when it has ended.
#[derive(Clone, Debug)]
pub struct LinkReport {
    /// What became of the frames.
    pub counts: Counts,
    /// Frames that were not sent, so that the receiver's failsafe acts.
    pub silent: u64,
    /// Frames left out because the thread woke up too late.
    pub left_out: u64,
    /// How much later than due frames were handed to the system, ns.
    pub lateness_ns: Histogram<u64>,
}

/// What others may know of a sender meanwhile.
#[derive(Debug, Default)]
struct Shared {
    mailbox: Mailbox,
    stop: AtomicBool,
    sent: AtomicU64,
    dropped: AtomicU64,
    silent: AtomicU64,
    losses: AtomicU64,
    recoveries: AtomicU64,
    left_out: AtomicU64,
    is_open: AtomicBool,
}

/// How a sender is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Condition {
    /// Whether there is something that takes frames.
    pub is_open: bool,
    /// Frames on their way.
    pub sent: u64,
    /// Frames dropped.
    pub dropped: u64,
    /// Frames that were not sent, so that the receiver's failsafe acts.
    pub silent: u64,
    /// How often the device or connection was lost.
    pub losses: u64,
    /// How often it was found again.
    pub recoveries: u64,
    /// Frames left out because the thread woke up too late.
    pub left_out: u64,
}

/// A thread that sends frames.
#[derive(Debug)]
pub struct Sender {
    shared: Arc<Shared>,
    thread: JoinHandle<LinkReport>,
}

impl Sender {
    /// Begins to send a frame every `period_ns`.
    ///
    /// # Errors
    /// What the system says if it gives no thread.
    pub fn start(link: RadioLink, period_ns: u64) -> io::Result<Self> {
        let shared = Arc::new(Shared::default());
        shared.is_open.store(link.port().is_open(), Ordering::Relaxed);
        let for_thread = Arc::clone(&shared);
        let thread = std::thread::Builder::new()
            .name("radio_link".to_owned())
            .spawn(move || send_until_stopped(link, period_ns.max(1), &for_thread))?;
        Ok(Self { shared, thread })
    }

    /// Gives the newest sticks. Neither waits nor makes a system call but for the time.
    #[inline]
    pub fn put(&self, sticks: &Sticks) {
        self.shared.mailbox.put(sticks, monotonic_ns());
    }

    /// How it is.
    #[must_use]
    pub fn condition(&self) -> Condition {
        // What was sent before a frame was left out is seen with it.
        let silent = self.shared.silent.load(Ordering::Acquire);
        Condition {
            is_open: self.shared.is_open.load(Ordering::Relaxed),
            sent: self.shared.sent.load(Ordering::Relaxed),
            dropped: self.shared.dropped.load(Ordering::Relaxed),
            silent,
            losses: self.shared.losses.load(Ordering::Relaxed),
            recoveries: self.shared.recoveries.load(Ordering::Relaxed),
            left_out: self.shared.left_out.load(Ordering::Relaxed),
        }
    }

    /// Ends after one more frame, with the sticks that were put last. Who was flying has put sticks at rest before.
    ///
    /// # Errors
    /// If the thread has panicked.
    pub fn stop(self) -> std::thread::Result<LinkReport> {
        self.shared.stop.store(true, Ordering::Release);
        self.thread.join()
    }
}

/// When frames are due.
#[derive(Clone, Copy, Debug)]
struct Pace {
    period_ns: u64,
    due_ns: u64,
    left_out: u64,
}

impl Pace {
    /// The next frame is the first that is due after now.
    #[inline]
    fn advance(&mut self, now_ns: u64) {
        let past = now_ns.saturating_sub(self.due_ns) / self.period_ns;
        self.left_out += past;
        self.due_ns += (past + 1) * self.period_ns;
    }
}

fn send_until_stopped(mut link: RadioLink, period_ns: u64, shared: &Shared) -> LinkReport {
    let mut lateness_ns = Histogram::new_with_bounds(1, LONGEST_NS, 3).expect("the bounds are in order");
    let mut pace = Pace {
        period_ns,
        due_ns: monotonic_ns(),
        left_out: 0,
    };
    let mut newest = None;
    let mut is_last = false;
    while !is_last {
        // What was put before is sent after.
        is_last = shared.stop.load(Ordering::Acquire);
        sleep_until(pace.due_ns);
        newest = shared.mailbox.look().or(newest);
        let now_ns = monotonic_ns();
        link.transmit(newest, now_ns);
        lateness_ns.saturating_record(now_ns.saturating_sub(pace.due_ns));
        let counts = link.port().counts();
        shared.sent.store(counts.sent, Ordering::Relaxed);
        shared
            .dropped
            .store(counts.busy + counts.closed, Ordering::Relaxed);
        shared.losses.store(counts.losses, Ordering::Relaxed);
        shared.recoveries.store(counts.recoveries, Ordering::Relaxed);
        shared.left_out.store(pace.left_out, Ordering::Relaxed);
        shared.silent.store(link.silent(), Ordering::Release);
        shared.is_open.store(link.port().is_open(), Ordering::Relaxed);
        pace.advance(monotonic_ns());
    }
    LinkReport {
        counts: link.port().counts(),
        silent: link.silent(),
        left_out: pace.left_out,
        lateness_ns,
    }
}

fn sleep_until(due_ns: u64) {
    let (seconds, nanoseconds) = (due_ns / 1_000_000_000, due_ns % 1_000_000_000);
    let due = Timespec {
        tv_sec: i64::try_from(seconds).unwrap_or(i64::MAX),
        tv_nsec: i64::try_from(nanoseconds).unwrap_or(0),
    };
    // A signal wakes up early; the frame is still due then.
    while clock_nanosleep_absolute(ClockId::Monotonic, &due).is_err() {}
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_late_frame_does_not_move_the_next_and_what_is_past_is_left_out() {
        let mut pace = Pace {
            period_ns: 10,
            due_ns: 100,
            left_out: 0,
        };
        for (now, due, left_out) in [
            (101, 110, 0),
            (110, 120, 0),
            (129, 130, 0),
            (165, 170, 3),
            (170, 180, 3),
        ] {
            pace.advance(now);
            assert_eq!((pace.due_ns, pace.left_out), (due, left_out));
        }
    }
}
