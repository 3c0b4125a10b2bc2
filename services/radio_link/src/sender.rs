//! Sender: a thread that sends frames at exact times.
//!
//! Frame n is due at the start + n periods of `CLOCK_MONOTONIC`: a late frame does not delay the next one. If the thread
//! wakes up when further frames are due, it skips and counts the overdue ones.
//!
//! The service's step only writes sticks into the [`SticksCell`]: four words of memory.

use std::io;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU32, AtomicU64, Ordering};
use std::thread::JoinHandle;

use hdrhistogram::Histogram;
use rustix::thread::clock_nanosleep_absolute;
use rustix::time::{ClockId, Timespec, clock_gettime};
use shared_types::battery::BatteryReading;

use crate::link::RadioLink;
use crate::port::Counts;
use crate::sticks::{Sticks, SticksCell};

/// Upper bound of the measured lateness, ns.
const LONGEST_NS: u64 = 1_000_000_000;

/// Returns the time of `CLOCK_MONOTONIC`, ns.
#[must_use]
#[inline]
pub fn monotonic_ns() -> u64 {
    let now = clock_gettime(ClockId::Monotonic);
    u64::try_from(now.tv_sec).unwrap_or(0) * 1_000_000_000 + u64::try_from(now.tv_nsec).unwrap_or(0)
}

/// Final report of a sender.
#[derive(Clone, Debug)]
pub struct LinkReport {
    /// Outcomes of the frames.
    pub counts: Counts,
    /// Frames withheld to trigger the receiver's failsafe.
    pub silent: u64,
    /// Frames skipped because the thread woke up too late.
    pub left_out: u64,
    /// The battery at the end, as a status word; 0 without a voltage.
    pub battery: u32,
    /// Lateness of frames at the call to the kernel, ns.
    pub lateness_ns: Histogram<u64>,
}

/// State that a sender shares with other threads.
#[derive(Debug, Default)]
struct Shared {
    cell: SticksCell,
    stop: AtomicBool,
    sent: AtomicU64,
    dropped: AtomicU64,
    silent: AtomicU64,
    losses: AtomicU64,
    recoveries: AtomicU64,
    left_out: AtomicU64,
    battery: AtomicU32,
    is_open: AtomicBool,
}

/// Condition of a sender.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Condition {
    /// `true` if the port is open.
    pub is_open: bool,
    /// Frames accepted by the kernel.
    pub sent: u64,
    /// Frames dropped.
    pub dropped: u64,
    /// Frames withheld to trigger the receiver's failsafe.
    pub silent: u64,
    /// Losses of the device or connection.
    pub losses: u64,
    /// Recoveries of the device or connection.
    pub recoveries: u64,
    /// Frames skipped because the thread woke up too late.
    pub left_out: u64,
    /// The battery as a status word; 0 before the first voltage.
    pub battery: u32,
}

/// Thread that sends frames.
#[derive(Debug)]
pub struct Sender {
    shared: Arc<Shared>,
    thread: JoinHandle<LinkReport>,
}

impl Sender {
    /// Starts a thread that sends a frame every `period_ns`.
    ///
    /// # Errors
    /// If the thread cannot be created.
    pub fn start(link: RadioLink, period_ns: u64) -> io::Result<Self> {
        let shared = Arc::new(Shared::default());
        shared.is_open.store(link.port().is_open(), Ordering::Relaxed);
        let battery = link
            .battery(monotonic_ns())
            .as_ref()
            .map_or(0, BatteryReading::to_word);
        shared.battery.store(battery, Ordering::Relaxed);
        let for_thread = Arc::clone(&shared);
        let thread = std::thread::Builder::new()
            .name("radio_link".to_owned())
            .spawn(move || send_until_stopped(link, period_ns.max(1), &for_thread))?;
        Ok(Self { shared, thread })
    }

    /// Sets the sticks to send. Never blocks, and makes no system call other than reading the clock.
    #[inline]
    pub fn set(&self, sticks: &Sticks) {
        self.shared.cell.write(sticks, monotonic_ns());
    }

    /// Returns the condition of the sender.
    #[must_use]
    pub fn condition(&self) -> Condition {
        // Acquire: pairs with the Release store of `silent`, after which `sent` does not change until frames resume.
        // Otherwise the condition could show a withheld frame without the frames sent before it.
        let silent = self.shared.silent.load(Ordering::Acquire);
        Condition {
            is_open: self.shared.is_open.load(Ordering::Relaxed),
            sent: self.shared.sent.load(Ordering::Relaxed),
            dropped: self.shared.dropped.load(Ordering::Relaxed),
            silent,
            losses: self.shared.losses.load(Ordering::Relaxed),
            recoveries: self.shared.recoveries.load(Ordering::Relaxed),
            left_out: self.shared.left_out.load(Ordering::Relaxed),
            battery: self.shared.battery.load(Ordering::Relaxed),
        }
    }

    /// Stops the thread after one more frame with the last sticks. In flight, the caller must first set sticks that stop
    /// the motors.
    ///
    /// # Errors
    /// If the thread panicked.
    pub fn stop(self) -> std::thread::Result<LinkReport> {
        self.shared.stop.store(true, Ordering::Release);
        self.thread.join()
    }
}

/// Schedule of frames.
#[derive(Clone, Copy, Debug)]
struct Pace {
    period_ns: u64,
    due_ns: u64,
    left_out: u64,
}

impl Pace {
    /// Advances to the first frame that is due after now.
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
        // Acquire: pairs with the Release store in `stop`, so that the last frame carries the sticks written before it.
        // Otherwise it could carry older sticks that let the motors turn.
        is_last = shared.stop.load(Ordering::Acquire);
        sleep_until(pace.due_ns);
        newest = shared.cell.read().or(newest);
        let now_ns = monotonic_ns();
        link.transmit(newest, now_ns);
        let battery = link.battery(now_ns).as_ref().map_or(0, BatteryReading::to_word);
        shared.battery.store(battery, Ordering::Relaxed);
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
        battery: link
            .battery(monotonic_ns())
            .as_ref()
            .map_or(0, BatteryReading::to_word),
        lateness_ns,
    }
}

fn sleep_until(due_ns: u64) {
    let (seconds, nanoseconds) = (due_ns / 1_000_000_000, due_ns % 1_000_000_000);
    let due = Timespec {
        tv_sec: i64::try_from(seconds).unwrap_or(i64::MAX),
        tv_nsec: i64::try_from(nanoseconds).unwrap_or(0),
    };
    // A signal can interrupt the sleep.
    while clock_nanosleep_absolute(ClockId::Monotonic, &due).is_err() {}
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_late_frame_does_not_move_the_next_and_overdue_frames_are_skipped() {
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
