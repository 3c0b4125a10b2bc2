//! Wait policy: whether services that wait in lock step yield their core or sleep.
//!
//! With another load on the core, a yield gives away a slice of milliseconds. With a publisher on another core, or in
//! an order that cannot be the ring's, yields are wasted. So one process, the leader, decides for all services through
//! the control block. A wasted yield is a miss. A lap of the ring that takes too long counts as the misses that would
//! have taken that time. Above `MISS_LIMIT` misses within `VERDICT_WAITS` waits of the leader, all services only sleep,
//! for a time that grows fourfold each time. Before they yield again, the leader tries it alone.
//!
//! All accesses are relaxed. The words are counts and a hint: an old value makes a service sleep or yield once too
//! often, and a count lost at a reset delays the next decision. Neither can change a sample.

use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

use crate::shared_page::ControlBlock;

/// Value of the control block's `block_only` with which no decision permits yields again.
pub const BLOCK_ALWAYS: u32 = 2;

/// Four misses per wait cost as much as the sleeps that the yields replace.
const MISS_LIMIT: u32 = 4 * VERDICT_WAITS;
const VERDICT_WAITS: u32 = 256;
const LONGEST_BLOCKING: u32 = 65_536;
/// Longer than the turns of all services take without another load on the core.
const SLOW_LAP: Duration = Duration::from_micros(300);
/// Part of a slow lap that counts as one wasted yield.
const MISS: Duration = Duration::from_micros(8);

/// Returns whether waiting services may yield. It follows the leader's decision, and also the count of misses, so that
/// no service waits for the leader's next turn.
#[inline]
pub(crate) fn is_to_yield(block: &ControlBlock) -> bool {
    block.block_only.load(Ordering::Relaxed) == 0 && block.misses.load(Ordering::Relaxed) <= MISS_LIMIT
}

/// Counts a wasted yield. One atomic addition, because all services count on the same word.
#[inline]
pub(crate) fn count_miss(block: &ControlBlock) {
    block.misses.fetch_add(1, Ordering::Relaxed);
}

/// Yields once and returns whether another load kept the core for long.
pub(crate) fn is_yield_slow() -> bool {
    let before = Instant::now();
    rustix::thread::sched_yield();
    before.elapsed() > SLOW_LAP
}

/// The leader's decision for all services whether yielding pays.
#[derive(Debug)]
pub(crate) struct WaitPolicy {
    waits_left: u32,
    blocking_waits: u32,
    lap_began: Instant,
}

impl Default for WaitPolicy {
    fn default() -> Self {
        Self {
            waits_left: VERDICT_WAITS,
            blocking_waits: VERDICT_WAITS,
            lap_began: Instant::now(),
        }
    }
}

impl WaitPolicy {
    /// Lets all services sleep, or yield again, when it is time to. `is_yield_slow` tells whether another load keeps
    /// the core for long when this process yields.
    #[inline]
    pub(crate) fn pass_verdict(&mut self, block: &ControlBlock, is_yield_slow: impl FnOnce() -> bool) {
        if block.block_only.load(Ordering::Relaxed) == BLOCK_ALWAYS {
            return;
        }
        if block.misses.load(Ordering::Relaxed) > MISS_LIMIT {
            self.let_all_sleep(block);
        }
        self.waits_left -= 1;
        if self.waits_left == 0 {
            let were_sleeping = block.block_only.load(Ordering::Relaxed) != 0;
            if were_sleeping && is_yield_slow() {
                // Only the leader has paid for the test.
                self.let_all_sleep(block);
                return;
            }
            block.block_only.store(0, Ordering::Relaxed);
            block.misses.store(0, Ordering::Relaxed);
            if !were_sleeping {
                // A quiet time is over: the next load is a new one.
                self.blocking_waits = (self.blocking_waits / 4).max(VERDICT_WAITS);
            }
            self.waits_left = VERDICT_WAITS;
        }
    }

    /// Begins to time a lap, in which the turn passes through the whole ring.
    pub(crate) fn begin_lap(&mut self, now: Instant) {
        self.lap_began = now;
    }

    /// Counts the excess of the lap's duration and begins the next lap: the clock is read once a lap.
    #[inline]
    pub(crate) fn count_lap(&mut self, block: &ControlBlock, now: Instant) {
        let lap = now - self.lap_began;
        self.begin_lap(now);
        if lap > SLOW_LAP {
            let misses = u32::try_from(lap.as_nanos() / MISS.as_nanos()).unwrap_or(MISS_LIMIT);
            block.misses.fetch_add(misses, Ordering::Relaxed);
        }
    }

    #[cold]
    fn let_all_sleep(&mut self, block: &ControlBlock) {
        block.block_only.store(1, Ordering::Relaxed);
        block.misses.store(0, Ordering::Relaxed);
        self.waits_left = self.blocking_waits;
        self.blocking_waits = (4 * self.blocking_waits).min(LONGEST_BLOCKING);
    }
}

#[cfg(test)]
mod tests {
    use crate::shared_page::SharedPage;

    use super::*;

    #[test]
    fn many_misses_stop_all_yields_for_ever_longer_times() {
        let page = SharedPage::create().unwrap();
        let mut leader = WaitPolicy::default();
        let mut spells = Vec::new();
        for _ in 0..3 {
            page.control_block()
                .misses
                .store(MISS_LIMIT + 1, Ordering::Relaxed);
            let mut waits = 0;
            loop {
                leader.pass_verdict(page.control_block(), || false);
                waits += 1;
                if page.control_block().block_only.load(Ordering::Relaxed) == 0 {
                    break;
                }
            }
            spells.push(waits);
        }
        assert_eq!(spells, [VERDICT_WAITS, 4 * VERDICT_WAITS, 16 * VERDICT_WAITS]);
    }

    #[test]
    fn services_keep_sleeping_while_a_yield_is_slow() {
        let page = SharedPage::create().unwrap();
        let mut leader = WaitPolicy::default();
        page.control_block()
            .misses
            .store(MISS_LIMIT + 1, Ordering::Relaxed);
        let mut probes = Vec::new();
        for wait in 1..=5 * VERDICT_WAITS {
            leader.pass_verdict(page.control_block(), || {
                probes.push(wait);
                true
            });
            assert_eq!(page.control_block().block_only.load(Ordering::Relaxed), 1);
        }
        assert_eq!(probes, [VERDICT_WAITS, 5 * VERDICT_WAITS]);
    }

    #[test]
    fn one_lap_as_long_as_many_turns_exceeds_the_limit() {
        let page = SharedPage::create().unwrap();
        let mut leader = WaitPolicy::default();
        let began = Instant::now();
        leader.begin_lap(began);
        leader.count_lap(page.control_block(), began + SLOW_LAP);
        assert_eq!(page.control_block().misses.load(Ordering::Relaxed), 0);
        leader.count_lap(page.control_block(), began + SLOW_LAP + Duration::from_millis(14));
        assert!(page.control_block().misses.load(Ordering::Relaxed) > MISS_LIMIT);
    }

    #[test]
    fn a_few_misses_change_nothing() {
        let page = SharedPage::create().unwrap();
        let mut leader = WaitPolicy::default();
        for _ in 0..10 * VERDICT_WAITS {
            page.control_block().misses.store(MISS_LIMIT, Ordering::Relaxed);
            leader.pass_verdict(page.control_block(), || false);
            assert_eq!(page.control_block().block_only.load(Ordering::Relaxed), 0);
        }
    }
}
