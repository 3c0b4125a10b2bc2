//! One step of a service, the same in every host.

use shared_types::checkpoint::Checkpoint;
use shared_types::schedule::{Edge, MAX_PORTS, OperatorPlan, OutageKind, OutageSchedule, Publication, Rate};
use shared_types::service::{ErasedService, InputView, OutputSlot};
use shared_types::{Header, Now, Schedule, ServiceId, Topic};

/// A number that is not finite, found before its publication.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error, serde::Serialize, serde::Deserialize)]
#[error(
    "`{service}` computed a number that is not finite at tick {tick}: `{field}` of `{topic}`; \
     it was not published. Look at the last ticks of the log for what led to it"
)]
pub struct NonFinite {
    /// Name of the service that computed the number.
    pub service: String,
    /// Tick of the step.
    pub tick: u64,
    /// Name of the topic.
    pub topic: String,
    /// Field of the sample.
    pub field: String,
}

/// Inputs of a service during a step.
pub type Views<'a> = [InputView<'a>; MAX_PORTS];

/// Outputs of a service during a step.
pub type Slots<'a> = [OutputSlot<'a>; MAX_PORTS];

/// Schedule of one service, looked up once before the flight.
#[derive(Clone, Debug)]
pub struct Timetable {
    /// The service.
    pub service: ServiceId,
    /// Ticks of the steps.
    pub steps: OutageSchedule,
    /// Inputs whose topics the flight has, in the order of the wiring table; those of missing topics are the last.
    pub inputs: Vec<Edge>,
    /// Outputs, in the order of the wiring table.
    pub outputs: Vec<Publication>,
    /// `true` if the service executes late steps instead of skipping them: the simulated plant, whose time does not stand
    /// still.
    pub catches_up: bool,
    /// `true` if the service reads every sample, also those that arrived while it was late: the estimator, whose state
    /// depends on all sent frames. Other services read only the newest one.
    pub reads_every_sample: bool,
    tick_ns: u64,
    operator: OperatorPlan,
}

impl Timetable {
    /// Makes the timetable of a service.
    #[must_use]
    pub fn new(schedule: &Schedule, service: ServiceId) -> Self {
        let outputs = service.outputs().iter();
        let inputs = schedule.inputs(service);
        Self {
            service,
            steps: schedule.steps(service),
            inputs: inputs.map(|(input, _)| schedule.edge(service, input)).collect(),
            outputs: outputs.map(|output| schedule.publication(output.topic)).collect(),
            catches_up: service.is_the_world() && schedule.simulates_the_world(),
            reads_every_sample: service == ServiceId::Estimator,
            tick_ns: schedule.tick_ns(),
            operator: schedule.operator(),
        }
    }

    /// Returns the tick of the oldest sample of an input that a process needs whose state includes all steps before
    /// `next_tick`; `None` if the newest sample suffices. `seen` is the sample that the last of these steps read. It may be
    /// older than the due one, which may have arrived late.
    #[must_use]
    pub fn first_needed(&self, edge: &Edge, next_tick: u64, seen: Option<u64>) -> Option<u64> {
        if self.catches_up {
            return edge.due_sample(next_tick);
        }
        self.reads_every_sample.then(|| seen.map_or(0, |seen| seen + 1))
    }

    /// Returns the time of the step at `tick`, with the time since the previous step.
    #[must_use]
    #[inline]
    pub fn now(&self, tick: u64) -> Now {
        let elapsed_ticks = if self.steps.is_unbroken() {
            let Rate { period, phase } = self.steps.rate;
            if tick > phase { period } else { 0 }
        } else {
            self.elapsed_ticks(tick)
        };
        Now {
            tick,
            time_ns: tick * self.tick_ns,
            elapsed_ns: elapsed_ticks * self.tick_ns,
            operator: self.operator.at(tick),
        }
    }

    /// Returns the time of the step at `tick` in real time. `previous` is the tick of the last step that the service's state
    /// includes.
    #[must_use]
    #[inline]
    pub fn now_after(&self, previous: Option<u64>, tick: u64) -> Now {
        let elapsed_ticks = previous.map_or(0, |previous| tick - previous);
        Now {
            elapsed_ns: elapsed_ticks * self.tick_ns,
            ..self.now(tick)
        }
    }

    /// Returns the number of ticks since the last step that the service's state includes.
    #[cold]
    fn elapsed_ticks(&self, tick: u64) -> u64 {
        let previous = tick
            .checked_sub(1)
            .and_then(|before| self.steps.last_at_or_before(before));
        match previous {
            Some(previous) if !self.forgets_between(previous, tick) => tick - previous,
            _ => 0,
        }
    }

    /// Returns whether the service loses its state between its steps at `previous` and `tick`.
    #[must_use]
    pub fn forgets_between(&self, previous: u64, tick: u64) -> bool {
        let mut outages = self.steps.outages_between(previous, tick);
        outages.any(|outage| outage.fate == OutageKind::DiesAndForgets)
    }

    /// Returns whether the service's process is to die after its step at `tick`, before the one at `next`, if any.
    #[must_use]
    #[inline]
    pub fn dies_after(&self, tick: u64, next: Option<u64>) -> bool {
        if self.steps.is_unbroken() {
            return false;
        }
        let mut outages = self.steps.outages_between(tick, next.unwrap_or(u64::MAX));
        outages.any(|outage| outage.fate != OutageKind::Frozen)
    }

    /// Returns whether the step at `tick` is a cold start.
    #[must_use]
    #[inline]
    pub fn is_cold_start_at(&self, tick: u64) -> bool {
        !self.steps.is_unbroken() && tick > 0 && self.elapsed_ticks(tick) == 0
    }

    /// Restores the state of `service` from a checkpoint, unless the next step is a cold start. Returns whether it did.
    pub fn resume(&self, service: &mut dyn ErasedService, checkpoint: &Checkpoint) -> bool {
        let next = self.steps.first_at_or_after(checkpoint.next_tick);
        let is_warm = !next.is_some_and(|next| self.is_cold_start_at(next));
        if is_warm {
            service.restore(&checkpoint.state);
        }
        is_warm
    }

    /// Steps `service` at `tick` and checks the outputs.
    ///
    /// # Errors
    /// [`NonFinite`] if an output holds a number that is not finite.
    #[inline]
    pub fn step(
        &self,
        service: &mut dyn ErasedService,
        tick: u64,
        views: &Views<'_>,
        slots: &mut Slots<'_>,
    ) -> Result<(), NonFinite> {
        self.step_at(service, &self.now(tick), views, slots)
    }

    /// Steps `service` at a time that the host determines, and checks the outputs.
    ///
    /// # Errors
    /// [`NonFinite`] if an output holds a number that is not finite.
    #[inline]
    pub fn step_at(
        &self,
        service: &mut dyn ErasedService,
        now: &Now,
        views: &Views<'_>,
        slots: &mut Slots<'_>,
    ) -> Result<(), NonFinite> {
        let (inputs, outputs) = (self.service.inputs().len(), self.outputs.len());
        debug_assert!(
            slots.iter().enumerate().all(|(at, slot)| slot.bytes.is_some()
                == self.outputs.get(at).is_some_and(|output| output.is_due(now.tick))),
            "exactly the due outputs have memory"
        );
        service.step(now, &views[..inputs], &mut slots[..outputs]);
        for (slot, output) in slots.iter().zip(&self.outputs) {
            if let Some(bytes) = slot.bytes.as_deref() {
                self.examine(now.tick, output.topic, bytes)?;
            }
        }
        Ok(())
    }

    /// Checks a sample that the service wrote at `tick`.
    ///
    /// # Errors
    /// [`NonFinite`] if it holds a number that is not finite.
    #[inline]
    pub fn examine(&self, tick: u64, topic: Topic, bytes: &[u8]) -> Result<(), NonFinite> {
        match topic.kind().first_non_finite_field(bytes) {
            None => Ok(()),
            Some(field) => Err(self.non_finite(tick, topic, field)),
        }
    }

    #[cold]
    fn non_finite(&self, tick: u64, topic: Topic, field: &str) -> NonFinite {
        NonFinite {
            service: self.service.to_string(),
            tick,
            topic: topic.to_string(),
            field: field.to_owned(),
        }
    }
}

/// Sorts the services of a flight in the order of their steps in a tick.
///
/// # Panics
/// If they are not exactly those of the wiring table.
pub(crate) fn put_in_order(services: &mut [Box<dyn ErasedService>], schedule: &Schedule) {
    let order = schedule.order();
    services.sort_by_key(|service| order.iter().position(|&other| other == service.id()));
    let ids = services.iter().map(|service| service.id());
    assert!(ids.eq(order.iter().copied()), "one of each service");
}

/// Returns the step to execute: the newest from `due` to `now`, or `due`. Two kinds of steps are never skipped: the newest
/// one that publishes an output, and the one at which an `unseen` sample becomes due that the service must read.
#[must_use]
pub fn next_step(timetable: &Timetable, due: u64, now: u64, unseen: Option<u64>) -> u64 {
    let Some(newest) = timetable
        .steps
        .last_at_or_before(now)
        .filter(|&newest| newest > due)
    else {
        return due;
    };
    let publications = timetable.outputs.iter();
    let to_be_published = publications
        .filter_map(|output| output.ticks.last_at_or_before(now))
        .filter(|&tick| tick >= due);
    let to_take_in = unseen
        .and_then(|tick| timetable.steps.first_at_or_after(tick.max(due)))
        .filter(|&tick| tick <= now);
    to_be_published.chain(to_take_in).min().unwrap_or(newest)
}

/// Returns the order in which a step waits for its inputs: the publisher that steps last comes first. When its sample has
/// arrived, the other ones have too, so that a step sleeps once and not once an input.
#[must_use]
pub fn waiting_order(schedule: &Schedule, edge: &Edge, publisher: ServiceId) -> impl Ord + use<> {
    let place = schedule.order().iter().position(|&service| service == publisher);
    std::cmp::Reverse((edge.latency == 0, place))
}

/// Prepares a due output: zeroes the memory and writes the header.
#[inline]
pub fn prepared(topic: Topic, header: Header, bytes: &mut [u8]) -> OutputSlot<'_> {
    topic.kind().prepare(bytes, header);
    OutputSlot { bytes: Some(bytes) }
}
