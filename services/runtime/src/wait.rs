//! Waiting for a sample in lock step: check, yield, then sleep on the doorbell.
//!
//! With the processes of the ring on one core, one `sched_yield` runs the publisher and costs half of a sleep. That requires
//! processes in the ring's order ([`crate::ring_order`]) and no other load on the core ([`crate::wait_policy`]).
//!
//! A wake-up is never lost: the consumer announces the publisher that it sleeps for, then checks again. A publisher
//! publishes, then checks for the announcement. Only the consumer clears its announcement.
//!
//! Every sleep ends: the orchestrator rings every doorbell at the end of the run, and also every second. If the
//! orchestrator dies, the system kills the sleeping process ([`crate::deployment::die_with_parent`]).

use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::Instant;

use shared_types::ExternalServices;
use shared_types::ServiceId;

use crate::announcement::{Published, announce, withdraw};
use crate::control::Channel;
use crate::deployment::Scheduler;
use crate::doorbell::Doorbell;
use crate::ring_order::RingOrder;
use crate::shared_page::{Cell, SharedPage};
use crate::wait_policy::{self, WaitPolicy};
use host::watchdog;

/// Maximum number of yields: all five processes of the ring run within fewer, in any order.
const YIELDS: u32 = 16;

/// End of a wait by the end of the run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Interrupted;

/// Waiting of a service in the ring of services that wait for each other.
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
    /// Joins the ring. `doorbells` are those of all services, in the order of the wiring table; `external_services` do
    /// not announce their sleep.
    #[must_use]
    pub fn new(
        me: ServiceId,
        page: Arc<SharedPage>,
        doorbells: Vec<Doorbell>,
        channel: Channel,
        scheduler: Scheduler,
        external_services: ExternalServices,
    ) -> Self {
        // Under `SCHED_FIFO` no other load runs on the core, and a yield is always cheaper.
        let is_leader = me == ServiceId::ALL[0] && scheduler != Scheduler::Fifo;
        let leader = is_leader.then(WaitPolicy::default);
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

    /// Returns the control block's page.
    #[must_use]
    pub fn page(&self) -> &Arc<SharedPage> {
        &self.page
    }

    /// Returns the doorbells of all services, in the order of the wiring table.
    #[must_use]
    pub fn doorbells(&self) -> Arc<[Doorbell]> {
        Arc::clone(&self.doorbells)
    }

    /// Returns the set of external services.
    #[must_use]
    pub fn external_services(&self) -> ExternalServices {
        self.external_services
    }

    /// Returns the control channel to the orchestrator.
    #[must_use]
    pub fn channel(&self) -> &Channel {
        &self.channel
    }

    /// Returns this service's words of the control block.
    #[must_use]
    #[inline]
    pub fn cell(&self) -> &Cell {
        &self.page.control_block().cells[self.me.index()]
    }

    /// Returns whether the run is to end.
    #[must_use]
    #[inline]
    pub fn is_stopping(&self) -> bool {
        self.page.control_block().stopping.load(Ordering::Relaxed) != 0
    }

    /// Rings the doorbells of the consumers that sleep for a publication of this service, and those of external services in
    /// any case.
    #[inline]
    pub fn wake(&self, consumers: &[ServiceId]) {
        let published = Published::now();
        let mine = announcement(self.me);
        for consumer in consumers {
            let cell = &self.page.control_block().cells[consumer.index()];
            if published.is_awaited(&cell.waiting_for, mine) || self.external_services[consumer.index()] {
                self.doorbells[consumer.index()].ring();
            }
        }
    }

    /// Waits until `arrived` reports the sample that `publisher` publishes at tick `due`.
    ///
    /// # Errors
    /// The error of `arrived`, or [`Interrupted`].
    pub fn wait<E: From<Interrupted>>(
        &mut self,
        publisher: ServiceId,
        due: u64,
        mut arrived: impl FnMut() -> Result<bool, E>,
    ) -> Result<(), E> {
        // No check for a sample that has not been published; one published just now is found at the next check.
        if self.has_stepped(publisher, due) && arrived()? {
            return Ok(());
        }
        if let Some(leader) = &mut self.leader {
            leader.update(self.page.control_block(), wait_policy::is_yield_slow);
        }
        let has_arrived = self.yield_for(&mut arrived)?;
        if let Some(leader) = &mut self.leader {
            leader.count_lap(self.page.control_block(), Instant::now());
        }
        if has_arrived {
            Cell::count(&self.cell().yields);
            return Ok(());
        }
        Cell::count(&self.cell().blocks);
        let result = self.sleep_for(publisher, &mut arrived);
        withdraw(&self.cell().waiting_for);
        if let Some(leader) = &mut self.leader {
            leader.begin_lap(Instant::now());
        }
        result
    }

    #[inline]
    fn has_stepped(&self, publisher: ServiceId, tick: u64) -> bool {
        let cell = &self.page.control_block().cells[publisher.index()];
        // Relaxed: only a hint when to check. The port itself orders the sample's bytes.
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
            self.order.count_wasted();
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
        announce(&self.cell().waiting_for, announcement(publisher));
        loop {
            if arrived()? {
                return Ok(());
            }
            if self.is_stopping() {
                return Err(Interrupted.into());
            }
            watchdog::while_idle(|| self.doorbells[self.me.index()].sleep());
        }
    }
}

/// Returns the word that a service announces while it sleeps for a publication of `publisher`.
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
        // The sample arrives right after the last look before the sleep; the doorbell has rung by then.
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
    fn a_published_sample_is_taken_without_a_yield() {
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
