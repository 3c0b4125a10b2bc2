//! Wait policy: whether services that wait in lock step yield their core or sleep.
//!
//! Under other load on the core, a yield costs a slice of milliseconds. With a publisher on another core, or in an order
//! that cannot become the ring's, yields are wasted. So one process, the leader, decides for all services through the
//! control block. A wasted yield counts as a miss, and a lap of the ring that takes too long as the misses of the same
//! duration. After more than `MISS_LIMIT` misses within `DECISION_WAITS` waits of the leader, all services only sleep, for
//! a time that grows fourfold each time. Before they yield again, the leader tries one yield.
//!
//! All accesses are relaxed. The words are counts and a hint: an old value causes one sleep or yield too many, and a count
//! lost at a reset delays the next decision. Neither can change a sample.

use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

use crate::shared_page::ControlBlock;

/// Value of the control block's `block_only` that disables yields for the whole run.
pub const BLOCK_ALWAYS: u32 = 2;

/// Four misses per wait cost as much as the sleeps that the yields replace.
const MISS_LIMIT: u32 = 4 * DECISION_WAITS;
const DECISION_WAITS: u32 = 256;
const LONGEST_BLOCKING: u32 = 65_536;
/// Longer than a lap of all services without other load on the core.
const SLOW_LAP: Duration = Duration::from_micros(300);
/// Part of a slow lap that counts as one wasted yield.
const MISS: Duration = Duration::from_micros(8);

/// Returns whether waiting services may yield: by the leader's decision, and by the count of misses, which takes effect
/// before the leader's next decision.
#[inline]
pub(crate) fn is_to_yield(block: &ControlBlock) -> bool {
    block.block_only.load(Ordering::Relaxed) == 0 && block.misses.load(Ordering::Relaxed) <= MISS_LIMIT
}

/// Counts a wasted yield. One atomic addition, because all services count on the same word.
#[inline]
pub(crate) fn count_miss(block: &ControlBlock) {
    block.misses.fetch_add(1, Ordering::Relaxed);
}

/// Yields once. Returns whether other load occupied the core for long.
pub(crate) fn is_yield_slow() -> bool {
    let before = Instant::now();
    rustix::thread::sched_yield();
    before.elapsed() > SLOW_LAP
}

/// The leader's decision for all services whether to yield.
#[derive(Debug)]
pub(crate) struct WaitPolicy {
    waits_left: u32,
    blocking_waits: u32,
    lap_began: Instant,
}

impl Default for WaitPolicy {
    fn default() -> Self {
        Self {
            waits_left: DECISION_WAITS,
            blocking_waits: DECISION_WAITS,
            lap_began: Instant::now(),
        }
    }
}

impl WaitPolicy {
    /// Updates the decision if one is due. `is_yield_slow` yields and returns whether other load occupied the core for long.
    #[inline]
    pub(crate) fn update(&mut self, block: &ControlBlock, is_yield_slow: impl FnOnce() -> bool) {
        if block.block_only.load(Ordering::Relaxed) == BLOCK_ALWAYS {
            return;
        }
        if block.misses.load(Ordering::Relaxed) > MISS_LIMIT {
            self.disable_yields(block);
        }
        self.waits_left -= 1;
        if self.waits_left == 0 {
            let was_disabled = block.block_only.load(Ordering::Relaxed) != 0;
            if was_disabled && is_yield_slow() {
                // The trial cost only the leader time.
                self.disable_yields(block);
                return;
            }
            block.block_only.store(0, Ordering::Relaxed);
            block.misses.store(0, Ordering::Relaxed);
            if !was_disabled {
                // No load for a whole period: the back-off shrinks.
                self.blocking_waits = (self.blocking_waits / 4).max(DECISION_WAITS);
            }
            self.waits_left = DECISION_WAITS;
        }
    }

    /// Begins the timing of a lap, in which every service of the ring runs once.
    pub(crate) fn begin_lap(&mut self, now: Instant) {
        self.lap_began = now;
    }

    /// Counts the misses of a slow lap and begins the next one, with one reading of the clock.
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
    fn disable_yields(&mut self, block: &ControlBlock) {
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
                leader.update(page.control_block(), || false);
                waits += 1;
                if page.control_block().block_only.load(Ordering::Relaxed) == 0 {
                    break;
                }
            }
            spells.push(waits);
        }
        assert_eq!(spells, [DECISION_WAITS, 4 * DECISION_WAITS, 16 * DECISION_WAITS]);
    }

    #[test]
    fn services_keep_sleeping_while_a_yield_is_slow() {
        let page = SharedPage::create().unwrap();
        let mut leader = WaitPolicy::default();
        page.control_block()
            .misses
            .store(MISS_LIMIT + 1, Ordering::Relaxed);
        let mut probes = Vec::new();
        for wait in 1..=5 * DECISION_WAITS {
            leader.update(page.control_block(), || {
                probes.push(wait);
                true
            });
            assert_eq!(page.control_block().block_only.load(Ordering::Relaxed), 1);
        }
        assert_eq!(probes, [DECISION_WAITS, 5 * DECISION_WAITS]);
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
        for _ in 0..10 * DECISION_WAITS {
            page.control_block().misses.store(MISS_LIMIT, Ordering::Relaxed);
            leader.update(page.control_block(), || false);
            assert_eq!(page.control_block().block_only.load(Ordering::Relaxed), 0);
        }
    }
}
