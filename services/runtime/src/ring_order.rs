//! Order in which yielding processes get their core.
//!
//! A fair scheduler runs processes that only yield in a fixed cyclic order: that of their deadlines, each of which advances
//! by one time slice with a yield. In the order of the ring, one yield hands the core to the next publisher. In another order
//! up to four yields are needed, and processes do not wake in the order of the ring.
//!
//! So a process that has wasted a few yields yields once with a slice of another length, which changes its position in the
//! order. No process needs its position: in the right position it wastes no more yields, and once all positions are right,
//! the order is stable. Five processes converge within some hundred rounds.
//!
//! Slices can be chosen since Linux 6.12. On older systems, or in a sandbox that refuses the call, the order does not change.

use shared_types::ServiceId;

use crate::deployment::{self, Scheduler};

/// Wasted yields before a process changes its position. If all processes moved at once, the order would not converge.
const WASTED_LIMIT: u32 = 4;

/// Position of a process in the order.
#[derive(Debug)]
pub struct RingOrder {
    /// Length of the process's slice, ns; `None` if it cannot be chosen.
    usual_slice: Option<u64>,
    wasted: u32,
    draws: Draws,
}

impl RingOrder {
    /// Makes the initial position of `me` under `scheduler`. Under `SCHED_FIFO` the order is strict and positions do not
    /// change.
    #[must_use]
    pub fn new(me: ServiceId, scheduler: Scheduler) -> Self {
        let is_fair = scheduler != Scheduler::Fifo;
        Self {
            usual_slice: is_fair.then(deployment::slice).and_then(Result::ok),
            wasted: 0,
            draws: Draws::new(me),
        }
    }

    /// Yields. After enough wasted yields it also changes the position.
    #[inline]
    pub fn yield_core(&mut self) {
        if self.wasted < WASTED_LIMIT {
            rustix::thread::sched_yield();
        } else {
            self.wasted = 0;
            self.change_position();
        }
    }

    /// Counts the last yield as wasted.
    #[inline]
    pub fn count_wasted(&mut self) {
        self.wasted += 1;
    }

    #[cold]
    fn change_position(&mut self) {
        let drawn = self.usual_slice.map(|usual| (usual, self.draws.below(usual)));
        let chosen = drawn.filter(|&(_, slice)| deployment::use_slice(slice).is_ok());
        rustix::thread::sched_yield();
        if let Some((usual, _)) = chosen
            && deployment::use_slice(usual).is_err()
        {
            self.usual_slice = None;
        }
    }
}

/// Low-discrepancy sequence, different for each process. No result depends on it.
#[derive(Debug)]
struct Draws {
    last: u64,
    step: u64,
}

/// 2⁶⁴ over the golden ratio: its multiples, modulo 2⁶⁴, leave no large gap.
const GOLDEN: u64 = 0x9E37_79B9_7F4A_7C15;

impl Draws {
    fn new(me: ServiceId) -> Self {
        let step = GOLDEN.wrapping_mul(2 * me.index() as u64 + 1);
        Self { last: step, step }
    }

    fn below(&mut self, limit: u64) -> u64 {
        self.last = self.last.wrapping_add(self.step);
        let scaled = (u128::from(self.last) * u128::from(limit)) >> u64::BITS;
        u64::try_from(scaled).expect("less than the limit")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_process_that_has_changed_places_has_the_usual_slice_again() {
        let mut order = RingOrder::new(ServiceId::Controller, Scheduler::Fair);
        let usual = deployment::slice().unwrap();
        assert_eq!(order.usual_slice, Some(usual));
        for _ in 0..10 * WASTED_LIMIT {
            order.yield_core();
            order.count_wasted();
            assert_eq!(deployment::slice().unwrap(), usual);
        }
        assert_eq!(
            order.draws.last,
            order.draws.step.wrapping_mul(10),
            "it has moved"
        );
    }

    #[test]
    fn under_fifo_no_process_changes_places() {
        let mut order = RingOrder::new(ServiceId::Controller, Scheduler::Fifo);
        for _ in 0..10 * WASTED_LIMIT {
            order.count_wasted();
            order.yield_core();
        }
        assert_eq!(order.draws.last, order.draws.step);
    }

    #[test]
    fn draws_of_all_processes_are_spread_over_the_whole_range() {
        for me in ServiceId::ALL {
            let mut draws = Draws::new(me);
            let mut tenths = [0; 10];
            for _ in 0..1000 {
                tenths[usize::try_from(draws.below(3_000_000) / 300_000).unwrap()] += 1;
            }
            assert!(
                tenths.iter().all(|&count| (90..=110).contains(&count)),
                "{tenths:?}"
            );
        }
    }
}
