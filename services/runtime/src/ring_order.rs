//! The order in which processes that yield get their core.
//!
//! A fair scheduler gives the core to those who do nothing but yield by turns, in an order that stays: that of their
//! deadlines, each of which moves on by one time slice with a yield. In the order of the ring one yield hands on the turn.
//! In another one it takes up to four, and the order in which processes wake is not the ring's.
//!
//! So whoever has yielded in vain a few times yields with a slice of another length once, by which it comes to another
//! place among the others. Nobody needs to know where that is: those who come to their places stop yielding in vain, and
//! once all have, the order stays. Five processes find it within some hundred rounds.
//!
//! Slices can be chosen since Linux 6.12. Where they cannot, or where a sandbox refuses it, the order stays as it is.

use shared_types::ServiceId;

use crate::deployment::{self, Scheduler};

/// Yields in vain before another place is tried. Others move as well: whoever moves at once is in their way.
const PATIENCE: u32 = 4;

/// A process's place in the order.
#[derive(Debug)]
pub struct RingOrder {
    /// Length of the process's slice, ns; none if it cannot be chosen.
    usual_slice: Option<u64>,
    in_vain: u32,
    draws: Draws,
}

impl RingOrder {
    /// The place at which `me` begins under `scheduler`. Under `SCHED_FIFO` the order in which processes begin is strict
    /// and nobody changes places.
    #[must_use]
    pub fn new(me: ServiceId, scheduler: Scheduler) -> Self {
        let is_fair = scheduler != Scheduler::Fifo;
        Self {
            usual_slice: is_fair.then(deployment::slice).and_then(Result::ok),
            in_vain: 0,
            draws: Draws::new(me),
        }
    }

    /// Yields, and comes to another place by it if that has been in vain often enough.
    #[inline]
    pub fn yield_core(&mut self) {
        if self.in_vain < PATIENCE {
            rustix::thread::sched_yield();
        } else {
            self.in_vain = 0;
            self.change_place();
        }
    }

    /// Says that the last yield was in vain.
    #[inline]
    pub fn was_in_vain(&mut self) {
        self.in_vain += 1;
    }

    #[cold]
    fn change_place(&mut self) {
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

/// Numbers that are spread evenly, and differently for each process. Nothing that is computed depends on them.
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
    fn who_has_changed_places_has_the_slice_of_all_again() {
        let mut order = RingOrder::new(ServiceId::Controller, Scheduler::Fair);
        let usual = deployment::slice().unwrap();
        assert_eq!(order.usual_slice, Some(usual));
        for _ in 0..10 * PATIENCE {
            order.yield_core();
            order.was_in_vain();
            assert_eq!(deployment::slice().unwrap(), usual);
        }
        assert_eq!(
            order.draws.last,
            order.draws.step.wrapping_mul(10),
            "it has moved"
        );
    }

    #[test]
    fn under_fifo_nobody_changes_places() {
        let mut order = RingOrder::new(ServiceId::Controller, Scheduler::Fifo);
        for _ in 0..10 * PATIENCE {
            order.was_in_vain();
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
