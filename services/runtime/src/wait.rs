//! Waiting for a sample in lock-step: look first, yield, then sleep on the doorbell.
//!
//! With the processes of the ring on one core, one `sched_yield` lets the publisher run and costs half of a sleep, if they
//! have come to the ring's order ([`crate::ring_order`]) and nobody else is on the core ([`crate::wait_policy`]).
//!
//! A wake-up is never lost: the consumer announces whom it sleeps for, then looks again; a publisher
//! publishes, then looks for the announcement. Only the consumer takes its announcement back.
//!
//! No sleep is without an end. The orchestrator rings every doorbell when the run is to end, and every second
//! besides; should it die, the system kills the sleeper ([`crate::deployment::die_with_parent`]).

use std::sync::Arc;
use std::sync::atomic::{Ordering, fence};
use std::time::Instant;

use shared_types::ExternalServices;
use shared_types::ServiceId;

use crate::control::Channel;
use crate::deployment::Scheduler;
use crate::doorbell::Doorbell;
use crate::ring_order::RingOrder;
use crate::shared_page::{Cell, SharedPage};
use crate::wait_policy::{self, WaitPolicy};
use crate::watchdog;

/// In whatever order the ring's five are, the turn comes round to all within fewer.
const YIELDS: u32 = 16;

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
    external_services: ExternalServices,
    order: RingOrder,
    leader: Option<WaitPolicy>,
}

impl Waiter {
    /// Joins the ring. `doorbells` are those of all services, in the order of the wiring table; `external_services` do not announce
    /// that they sleep.
    #[must_use]
    pub fn new(
        me: ServiceId,
        page: Arc<SharedPage>,
        doorbells: Vec<Doorbell>,
        channel: Channel,
        scheduler: Scheduler,
        external_services: ExternalServices,
    ) -> Self {
        // Under `SCHED_FIFO` nobody else has the core, and yielding pays without a verdict.
        let leads = me == ServiceId::ALL[0] && scheduler != Scheduler::Fifo;
        let leader = leads.then(WaitPolicy::default);
        Self {
            me,
            page,
            doorbells: doorbells.into(),
            channel,
            scheduler,
            external_services,
            order: RingOrder::new(me, scheduler),
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

    /// Which services are external programs.
    #[must_use]
    pub fn external_services(&self) -> ExternalServices {
        self.external_services
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
        &self.page.control_block().cells[self.me.index()]
    }

    /// Whether the run is to end.
    #[must_use]
    #[inline]
    pub fn is_stopping(&self) -> bool {
        self.page.control_block().stopping.load(Ordering::Relaxed) != 0
    }

    /// Rings the doorbells of those services that sleep for a publication of this one, and those of external services in any case.
    #[inline]
    pub fn wake(&self, consumers: &[ServiceId]) {
        // Publications before, announcements after: pairs with the fence in `sleep_for`.
        fence(Ordering::SeqCst);
        let mine = announcement(self.me);
        for consumer in consumers {
            let cell = &self.page.control_block().cells[consumer.index()];
            if cell.waiting_for.load(Ordering::Relaxed) == mine || self.external_services[consumer.index()] {
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
            leader.pass_verdict(self.page.control_block(), wait_policy::is_yield_slow);
        }
        let is_here = self.yield_for(&mut arrived)?;
        if let Some(leader) = &mut self.leader {
            leader.count_lap(self.page.control_block(), Instant::now());
        }
        if is_here {
            Cell::count(&self.cell().yields);
            return Ok(());
        }
        Cell::count(&self.cell().blocks);
        let result = self.sleep_for(publisher, &mut arrived);
        self.cell().waiting_for.store(0, Ordering::Relaxed);
        if let Some(leader) = &mut self.leader {
            leader.begin_lap(Instant::now());
        }
        result
    }

    #[inline]
    fn has_stepped(&self, publisher: ServiceId, tick: u64) -> bool {
        let cell = &self.page.control_block().cells[publisher.index()];
        cell.steps_until.load(Ordering::Relaxed) > tick
    }

    #[inline]
    fn yield_for<E>(&mut self, arrived: &mut impl FnMut() -> Result<bool, E>) -> Result<bool, E> {
        for _ in 0..YIELDS {
            if !self.may_yield() {
                return Ok(false);
            }
            self.order.yield_core();
            if arrived()? {
                return Ok(true);
            }
            self.order.was_in_vain();
            wait_policy::count_miss(self.page.control_block());
        }
        Ok(false)
    }

    #[inline]
    fn may_yield(&self) -> bool {
        self.scheduler == Scheduler::Fifo || wait_policy::is_to_yield(self.page.control_block())
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
            watchdog::while_resting(|| self.doorbells[self.me.index()].sleep());
        }
    }
}

/// What a service announces while it sleeps for a publication of `publisher`.
#[must_use]
#[inline]
pub fn announcement(publisher: ServiceId) -> u32 {
    1 + u32::try_from(publisher.index()).expect("few services")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn waiter(me: ServiceId) -> Waiter {
        let page = Arc::new(SharedPage::create().unwrap());
        let (channel, _orchestrator) = Channel::pair().unwrap();
        let doorbells = ServiceId::ALL
            .iter()
            .map(|_| Doorbell::create().unwrap())
            .collect();
        Waiter::new(
            me,
            page,
            doorbells,
            channel,
            Scheduler::Fair,
            ExternalServices::default(),
        )
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
        let plant = &waiter.page.control_block().cells[ServiceId::Plant.index()];
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
        waiter.page.control_block().stopping.store(1, Ordering::Relaxed);
        assert_eq!(
            waiter.wait(ServiceId::RcOutput, 0, || Ok(false)),
            Err(Interrupted)
        );
    }
}
