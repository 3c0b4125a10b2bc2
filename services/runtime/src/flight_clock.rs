//! Clock of a flight in real time: base ticks on `CLOCK_MONOTONIC`, the same for all processes of a run.

use std::time::Duration;

use rustix::thread::clock_nanosleep_absolute;
use rustix::time::{ClockId, Timespec, clock_gettime};

const NANOSECONDS: u64 = 1_000_000_000;

/// Conversion between ticks and times.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FlightClock {
    /// Time at which tick 0 begins, ns of `CLOCK_MONOTONIC`.
    pub start_ns: u64,
    /// Length of a tick, ns.
    pub tick_ns: u64,
}

impl FlightClock {
    /// Makes a clock whose tick 0 begins after `delay`.
    #[must_use]
    pub fn starting_in(delay: Duration, tick_ns: u64) -> Self {
        let delay_ns = u64::try_from(delay.as_nanos()).unwrap_or(u64::MAX);
        Self {
            start_ns: monotonic_ns().saturating_add(delay_ns),
            tick_ns,
        }
    }

    /// Returns the time since tick 0 began, ns; 0 before.
    #[must_use]
    #[inline]
    pub fn elapsed_ns(&self) -> u64 {
        monotonic_ns().saturating_sub(self.start_ns)
    }

    /// Returns the current tick; 0 before the start.
    #[must_use]
    #[inline]
    pub fn tick(&self) -> u64 {
        self.elapsed_ns() / self.tick_ns
    }

    /// Returns the time at which a tick begins, ns of `CLOCK_MONOTONIC`.
    #[must_use]
    #[inline]
    pub fn begins_at(&self, tick: u64) -> u64 {
        self.start_ns.saturating_add(tick.saturating_mul(self.tick_ns))
    }
}

/// Converts a time of `CLOCK_MONOTONIC`, or a duration, in ns, to the type of the system's sleeps.
#[must_use]
#[inline]
pub fn deadline(at_ns: u64) -> Timespec {
    Timespec {
        tv_sec: (at_ns / NANOSECONDS).cast_signed(),
        tv_nsec: (at_ns % NANOSECONDS).cast_signed(),
    }
}

/// Returns the time of `CLOCK_MONOTONIC`, ns.
#[must_use]
#[inline]
pub fn monotonic_ns() -> u64 {
    let now = clock_gettime(ClockId::Monotonic);
    now.tv_sec.cast_unsigned() * NANOSECONDS + now.tv_nsec.cast_unsigned()
}

/// Sleeps until a time of `CLOCK_MONOTONIC`, ns, or a signal.
#[inline]
pub fn nap_until(at_ns: u64) {
    // A caller that depends on the time reads the clock again.
    let _interrupted = clock_nanosleep_absolute(ClockId::Monotonic, &deadline(at_ns));
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn a_tick_begins_where_the_one_before_ends(tick_ns in 1u64..100_000_000, tick in 0u64..1_000_000_000) {
            let clock = FlightClock { start_ns: 7, tick_ns };
            prop_assert_eq!(clock.begins_at(tick) + tick_ns, clock.begins_at(tick + 1));
            let deadline = deadline(clock.begins_at(tick));
            let whole = deadline.tv_sec.cast_unsigned() * NANOSECONDS + deadline.tv_nsec.cast_unsigned();
            prop_assert_eq!(whole, 7 + tick * tick_ns);
            prop_assert!((0..1_000_000_000).contains(&deadline.tv_nsec));
        }
    }

    #[test]
    fn before_its_start_no_time_has_passed() {
        let clock = FlightClock::starting_in(Duration::from_secs(3600), 1_000_000);
        assert_eq!((clock.elapsed_ns(), clock.tick()), (0, 0));
        let running = FlightClock { start_ns: 0, ..clock };
        let before = running.elapsed_ns();
        assert!(before > 0 && running.elapsed_ns() >= before);
    }
}
