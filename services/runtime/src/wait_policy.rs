//! Whether those who wait in lock-step yield or sleep.
//!
//! With a foreign load on the core a yield gives away a slice of milliseconds. With a publisher on another core, or in an
//! order that cannot be the ring's, yields are in vain. Hence a verdict that one process, the leader, passes for all
//! through the shared page: a yield in vain is a miss, and a lap of the turn that takes too long is as many as would have
//! taken that time. Over `MISS_LIMIT` of them within `VERDICT_WAITS` waits of the leader, all only sleep, for a while
//! that grows fourfold each time. Before they yield again, the leader tries it alone.

use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

use crate::shared_page::ControlBlock;

/// Value of the shared page's `block_only` with which no verdict lets anybody yield again.
pub const BLOCK_ALWAYS: u32 = 2;

/// Four misses a wait cost as much as the sleeps that the yields replace.
const MISS_LIMIT: u32 = 4 * VERDICT_WAITS;
const VERDICT_WAITS: u32 = 256;
const LONGEST_BLOCKING: u32 = 65_536;
/// Longer than the turns of all take, but for what is not theirs.
const SLOW_LAP: Duration = Duration::from_micros(300);
/// What of a slow lap is as bad as a yield in vain.
const MISS: Duration = Duration::from_micros(8);

/// Whether those who wait may yield: the leader's verdict, or the evidence for it, so that nobody waits for the leader to
/// come round.
#[inline]
pub(crate) fn is_to_yield(block: &ControlBlock) -> bool {
    block.block_only.load(Ordering::Relaxed) == 0 && block.misses.load(Ordering::Relaxed) <= MISS_LIMIT
}

/// Counts a yield in vain.
#[inline]
pub(crate) fn count_miss(block: &ControlBlock) {
    block.misses.fetch_add(1, Ordering::Relaxed);
}

/// Whether somebody else keeps the core for long when this process yields. Tries it.
pub(crate) fn is_yield_slow() -> bool {
    let before = Instant::now();
    rustix::thread::sched_yield();
    before.elapsed() > SLOW_LAP
}

/// Decides for all whether yielding pays.
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
    /// Lets all sleep, or yield again, if it is time to. `is_yield_slow` tells whether somebody else keeps the core for
    /// long when this process yields.
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
                // Only the leader has paid for it.
                self.let_all_sleep(block);
                return;
            }
            block.block_only.store(0, Ordering::Relaxed);
            block.misses.store(0, Ordering::Relaxed);
            if !were_sleeping {
                // A quiet spell is over: the next load is a new one.
                self.blocking_waits = (self.blocking_waits / 4).max(VERDICT_WAITS);
            }
            self.waits_left = VERDICT_WAITS;
        }
    }

    /// Begins to time a lap, in which the turn goes round once.
    pub(crate) fn begin_lap(&mut self, now: Instant) {
        self.lap_began = now;
    }

    /// Counts what the lap took too long, and begins the next one: the clock is read once a lap.
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
    fn many_misses_stop_everyone_from_yielding_for_ever_longer_whiles() {
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
    fn where_a_yield_is_slow_they_go_on_sleeping() {
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
    fn a_lap_that_takes_as_long_as_many_turns_is_enough() {
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
    fn a_few_misses_do_not() {
        let page = SharedPage::create().unwrap();
        let mut leader = WaitPolicy::default();
        for _ in 0..10 * VERDICT_WAITS {
            page.control_block().misses.store(MISS_LIMIT, Ordering::Relaxed);
            leader.pass_verdict(page.control_block(), || false);
            assert_eq!(page.control_block().block_only.load(Ordering::Relaxed), 0);
        }
    }
}
