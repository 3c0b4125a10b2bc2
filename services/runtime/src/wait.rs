//! Waiting for a sample in lock-step: look first, yield once, then sleep on the doorbell.
//!
//! With the processes of the ring on one core, one `sched_yield` usually lets the publisher run and costs a
//! third of a sleep. With a foreign load on the core every yield gives away a slice of milliseconds instead.
//! Hence an adaptive verdict that one process, the leader, passes for all through the shared page: everybody
//! counts misses (a fruitless yield counts 1, a slow one 21); over `MISS_LIMIT` of them within
//! `VERDICT_WAITS` waits of the leader, all only sleep for a while that grows fourfold each time.
//!
//! A wake-up is never lost: the consumer announces whom it sleeps for, then looks again; a publisher
//! publishes, then looks for the announcement. Only the consumer takes its announcement back.
//!
//! No sleep is without an end. The orchestrator rings every doorbell when the run is to end, and every second
//! besides; should it die, the system kills the sleeper ([`crate::deployment::die_with_parent`]).

use std::sync::Arc;
use std::sync::atomic::{Ordering, fence};
use std::time::{Duration, Instant};

use shared_types::ServiceId;
use shared_types::scenario::Guests;

use crate::control::Channel;
use crate::deployment::Scheduler;
use crate::doorbell::Doorbell;
use crate::shared_page::{Cell, SharedPage};

/// Value of the shared page's `block_only` with which no verdict lets anybody yield again.
pub const BLOCK_ALWAYS: u32 = 2;

const MISS_LIMIT: u32 = 40;
const SLOW_YIELD: Duration = Duration::from_micros(300);
const SLOW_YIELD_MISSES: u32 = 21;
const VERDICT_WAITS: u32 = 256;
const LONGEST_BLOCKING: u32 = 65_536;
/// Under `SCHED_FIFO` the ring's order is strict and yields never leave it: a few more pay.
const FIFO_YIELDS: u32 = 16;

/// The wait ended without what was waited for: the run ends.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Interrupted;

/// A service's place in the ring of those who wait for each other.
pub struct Waiter {
    me: ServiceId,
    page: Arc<SharedPage>,
    doorbells: Arc<[Doorbell]>,
    channel: Channel,
    scheduler: Scheduler,
    guests: Guests,
    leader: Option<Leader>,
}

impl Waiter {
    /// Joins the ring. `doorbells` are those of all services, in the order of the wiring table; `guests` do not announce
    /// that they sleep.
    #[must_use]
    pub fn new(
        me: ServiceId,
        page: Arc<SharedPage>,
        doorbells: Vec<Doorbell>,
        channel: Channel,
        scheduler: Scheduler,
        guests: Guests,
    ) -> Self {
        let leader = (me == ServiceId::ALL[0]).then(Leader::default);
        Self {
            me,
            page,
            doorbells: doorbells.into(),
            channel,
            scheduler,
            guests,
            leader,
        }
    }

    /// The words that the run shares.
    #[must_use]
    pub fn page(&self) -> &Arc<SharedPage> {
        &self.page
    }

    /// The doorbells of all services, in the order of the wiring table.
    #[must_use]
    pub fn doorbells(&self) -> Arc<[Doorbell]> {
        Arc::clone(&self.doorbells)
    }

    /// The line to the orchestrator.
    #[must_use]
    pub fn channel(&self) -> &Channel {
        &self.channel
    }

    /// This service's words of the shared page.
    #[must_use]
    #[inline]
    pub fn cell(&self) -> &Cell {
        &self.page.words().cells[self.me.index()]
    }

    /// Whether the run is to end.
    #[must_use]
    #[inline]
    pub fn is_stopping(&self) -> bool {
        self.page.words().stopping.load(Ordering::Relaxed) != 0
    }

    /// Rings the doorbells of those services that sleep for a publication of this one, and those of guests in any case.
    #[inline]
    pub fn wake(&self, consumers: &[ServiceId]) {
        // Publications before, announcements after: pairs with the fence in `sleep_for`.
        fence(Ordering::SeqCst);
        let mine = announcement(self.me);
        for consumer in consumers {
            let cell = &self.page.words().cells[consumer.index()];
            if cell.waiting_for.load(Ordering::Relaxed) == mine || self.guests[consumer.index()] {
                self.doorbells[consumer.index()].ring();
            }
        }
    }

    /// Waits until `arrived` says that the sample which `publisher` publishes at tick `due` is here.
    ///
    /// # Errors
    /// What `arrived` says, or that the wait was [`Interrupted`].
    pub fn wait<E: From<Interrupted>>(
        &mut self,
        publisher: ServiceId,
        due: u64,
        mut arrived: impl FnMut() -> Result<bool, E>,
    ) -> Result<(), E> {
        // Nobody looks for what has not been published; what has been this very moment is seen a look later.
        if self.has_stepped(publisher, due) && arrived()? {
            return Ok(());
        }
        if let Some(leader) = &mut self.leader {
            leader.pass_verdict(&self.page);
        }
        if self.yield_for(&mut arrived)? {
            Cell::count(&self.cell().yields);
            return Ok(());
        }
        Cell::count(&self.cell().blocks);
        let result = self.sleep_for(publisher, &mut arrived);
        self.cell().waiting_for.store(0, Ordering::Relaxed);
        result
    }

    #[inline]
    fn has_stepped(&self, publisher: ServiceId, tick: u64) -> bool {
        let cell = &self.page.words().cells[publisher.index()];
        cell.steps_until.load(Ordering::Relaxed) > tick
    }

    #[inline]
    fn yield_for<E>(&self, arrived: &mut impl FnMut() -> Result<bool, E>) -> Result<bool, E> {
        if self.scheduler == Scheduler::Fifo {
            return self.yield_under_fifo(arrived);
        }
        let words = self.page.words();
        // The leader's verdict, or the evidence for it: a slow yield costs a tick or two, so nobody waits
        // for the leader to come round.
        if words.block_only.load(Ordering::Relaxed) != 0 || words.misses.load(Ordering::Relaxed) > MISS_LIMIT
        {
            return Ok(false);
        }
        let before = Instant::now();
        rustix::thread::sched_yield();
        let slow = before.elapsed() > SLOW_YIELD;
        let here = arrived()?;
        if slow {
            words.misses.fetch_add(SLOW_YIELD_MISSES, Ordering::Relaxed);
        } else if !here {
            words.misses.fetch_add(1, Ordering::Relaxed);
        }
        Ok(here)
    }

    fn yield_under_fifo<E>(&self, arrived: &mut impl FnMut() -> Result<bool, E>) -> Result<bool, E> {
        for _ in 0..FIFO_YIELDS {
            rustix::thread::sched_yield();
            if arrived()? {
                return Ok(true);
            }
        }
        Ok(false)
    }

    fn sleep_for<E: From<Interrupted>>(
        &self,
        publisher: ServiceId,
        arrived: &mut impl FnMut() -> Result<bool, E>,
    ) -> Result<(), E> {
        self.cell()
            .waiting_for
            .store(announcement(publisher), Ordering::Relaxed);
        // Announcement before, every look after: pairs with the fence in `wake`.
        fence(Ordering::SeqCst);
        loop {
            if arrived()? {
                return Ok(());
            }
            if self.is_stopping() {
                return Err(Interrupted.into());
            }
            self.doorbells[self.me.index()].sleep();
        }
    }
}

/// What a service announces while it sleeps for a publication of `publisher`.
#[must_use]
#[inline]
pub fn announcement(publisher: ServiceId) -> u32 {
    1 + u32::try_from(publisher.index()).expect("few services")
}

/// Decides for all whether yielding pays.
#[derive(Debug)]
struct Leader {
    waits_left: u32,
    blocking_waits: u32,
}

impl Default for Leader {
    fn default() -> Self {
        Self {
            waits_left: VERDICT_WAITS,
            blocking_waits: VERDICT_WAITS,
        }
    }
}

impl Leader {
    #[inline]
    fn pass_verdict(&mut self, page: &SharedPage) {
        let words = page.words();
        if words.block_only.load(Ordering::Relaxed) == BLOCK_ALWAYS {
            return;
        }
        if words.misses.load(Ordering::Relaxed) > MISS_LIMIT {
            words.block_only.store(1, Ordering::Relaxed);
            words.misses.store(0, Ordering::Relaxed);
            self.waits_left = self.blocking_waits;
            self.blocking_waits = (4 * self.blocking_waits).min(LONGEST_BLOCKING);
        }
        self.waits_left -= 1;
        if self.waits_left == 0 {
            let was_blocking = words.block_only.swap(0, Ordering::Relaxed) != 0;
            words.misses.store(0, Ordering::Relaxed);
            if !was_blocking {
                // A quiet spell is over: the next load is a new one.
                self.blocking_waits = (self.blocking_waits / 4).max(VERDICT_WAITS);
            }
            self.waits_left = VERDICT_WAITS;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn many_misses_stop_everyone_from_yielding_for_ever_longer_whiles() {
        let page = SharedPage::create().unwrap();
        let mut leader = Leader::default();
        let mut spells = Vec::new();
        for _ in 0..3 {
            page.words().misses.store(MISS_LIMIT + 1, Ordering::Relaxed);
            let mut waits = 0;
            loop {
                leader.pass_verdict(&page);
                waits += 1;
                if page.words().block_only.load(Ordering::Relaxed) == 0 {
                    break;
                }
            }
            spells.push(waits);
        }
        assert_eq!(spells, [VERDICT_WAITS, 4 * VERDICT_WAITS, 16 * VERDICT_WAITS]);
    }

    #[test]
    fn a_few_misses_do_not() {
        let page = SharedPage::create().unwrap();
        let mut leader = Leader::default();
        for _ in 0..10 * VERDICT_WAITS {
            page.words().misses.store(MISS_LIMIT, Ordering::Relaxed);
            leader.pass_verdict(&page);
            assert_eq!(page.words().block_only.load(Ordering::Relaxed), 0);
        }
    }

    fn waiter(me: ServiceId) -> Waiter {
        let page = Arc::new(SharedPage::create().unwrap());
        let (channel, _orchestrator) = Channel::pair().unwrap();
        let doorbells = ServiceId::ALL
            .iter()
            .map(|_| Doorbell::create().unwrap())
            .collect();
        Waiter::new(me, page, doorbells, channel, Scheduler::Fair, Guests::default())
    }

    #[test]
    fn a_wake_up_between_the_announcement_and_the_sleep_is_not_lost() {
        let mut waiter = waiter(ServiceId::Estimator);
        let mut looks = 0;
        // The sample comes right after the last look before the sleep; the doorbell has rung by then.
        waiter.doorbells[ServiceId::Estimator.index()].ring();
        let arrived = || {
            looks += 1;
            Ok::<_, Interrupted>(looks > 2)
        };
        waiter.wait(ServiceId::Plant, 0, arrived).unwrap();
        assert_eq!(looks, 3);
        assert_eq!(waiter.cell().waiting_for.load(Ordering::Relaxed), 0);
    }

    #[test]
    fn what_was_published_is_looked_for_at_once() {
        let mut waiter = waiter(ServiceId::Estimator);
        let plant = &waiter.page.words().cells[ServiceId::Plant.index()];
        plant.steps_until.store(8, Ordering::Relaxed);
        waiter
            .wait(ServiceId::Plant, 7, || Ok::<_, Interrupted>(true))
            .unwrap();
        assert_eq!(waiter.cell().yields.load(Ordering::Relaxed), 0);
        waiter
            .wait(ServiceId::Plant, 8, || Ok::<_, Interrupted>(true))
            .unwrap();
        assert_eq!(waiter.cell().yields.load(Ordering::Relaxed), 1);
    }

    #[test]
    fn a_sleeper_ends_with_the_run() {
        let mut waiter = waiter(ServiceId::Plant);
        waiter.page.words().stopping.store(1, Ordering::Relaxed);
        assert_eq!(
            waiter.wait(ServiceId::RcOutput, 0, || Ok(false)),
            Err(Interrupted)
        );
    }
}
