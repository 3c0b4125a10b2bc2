//! Schedule: the steps of the services and the due samples at each, a timed dataflow that every process can compute.
//!
//! A service steps at the ticks `phase + n·period`; a topic is published at ticks of the same form, each of them a step
//! of its publisher; an edge (topic → consumer) delivers `latency` ticks after publication. So at any tick each
//! consumer can compute the due sample of each input, and in lock step waits for exactly that one: results cannot
//! depend on the scheduling of processes. Every cycle of edges contains a tick of delay.
//!
//! A planned outage of a service is a part of the schedule: at its ticks the service does not step, nothing is
//! published, and the due sample of its consumers is the last one before. So is a planned fault of an edge: late or
//! lost samples are due later or never. On an edge that no step of its consumer reads, no sample is ever due.

mod edge;
mod edge_fault;
mod operator;
mod outage_schedule;

use std::sync::Arc;

pub use edge::Edge;
pub use edge_fault::{Corruption, Draws, EdgeFault, EdgeFaultKind, Loss};
pub use operator::OperatorPlan;
pub use outage_schedule::{Outage, OutageKind, OutageSchedule};

use crate::sample::Header;
use crate::wiring::{InputSpec, OutputSpec, ServiceId, Topic};

/// Returns how many ticks before its delivery a sample acts in a service. The vehicle's step at a tick covers the time
/// since the tick before, so a frame acts from the tick before its delivery.
#[must_use]
pub fn acts_before_delivery(service: ServiceId) -> u64 {
    u64::from(service == ServiceId::Plant)
}

/// The ticks `phase + n·period`, n ≥ 0.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Rate {
    /// Distance of two occurrences, base ticks, at least 1.
    pub period: u64,
    /// First occurrence, base tick.
    pub phase: u64,
}

impl Rate {
    /// At every base tick.
    pub const EVERY_TICK: Self = Self { period: 1, phase: 0 };
    /// At no tick of any flight.
    pub const NEVER: Self = Self {
        period: 1,
        phase: u64::MAX,
    };

    /// Returns whether `tick` is one of the ticks.
    #[must_use]
    #[inline]
    pub fn occurs_at(self, tick: u64) -> bool {
        // Most periods are one: this avoids the division.
        if self.period == 1 {
            tick >= self.phase
        } else {
            tick >= self.phase && (tick - self.phase).is_multiple_of(self.period)
        }
    }

    /// Returns the last of the ticks that is not after `tick`.
    #[must_use]
    #[inline]
    pub fn last_at_or_before(self, tick: u64) -> Option<u64> {
        let since = tick.checked_sub(self.phase)?;
        Some(if self.period == 1 {
            tick
        } else {
            tick - since % self.period
        })
    }

    /// Returns the number of ticks before `tick`: the sequence number of an occurrence at `tick`.
    #[must_use]
    #[inline]
    pub fn count_before(self, tick: u64) -> u64 {
        let since = tick.saturating_sub(self.phase);
        if self.period == 1 {
            since
        } else {
            since.div_ceil(self.period)
        }
    }

    /// Returns whether every tick of `self` is one of `other`.
    #[must_use]
    pub fn is_within(self, other: Self) -> bool {
        other.occurs_at(self.phase) && self.period.is_multiple_of(other.period)
    }
}

/// Error of rates and latencies that form no schedule.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum ScheduleError {
    /// Services that wait for each other within one tick, in the order of the cycle.
    #[error(
        "the services {} wait for each other within one tick: give one edge of the cycle a latency of at least a tick",
        .0.iter().map(|service| service.name()).collect::<Vec<_>>().join(" → ")
    )]
    CycleWithoutDelay(Vec<ServiceId>),
    /// A topic is due at ticks at which its publisher does not step.
    #[error(
        "`{topic}` is due at ticks at which `{publisher}` does not step: make its period a multiple of the service's and let it begin on one of its steps"
    )]
    TopicWithoutStep {
        /// The topic.
        topic: Topic,
        /// The publisher.
        publisher: ServiceId,
    },
    /// The controller joins state and reference of equal ticks, but gets them of different ticks.
    #[error(
        "at tick {tick} the controller would join a state and a reference of different ticks: give `path_generator` and `controller` the same period, phase and input latencies"
    )]
    UnequalJoin {
        /// First tick at which the ticks differ.
        tick: u64,
    },
}

const SERVICES: usize = ServiceId::ALL.len();
const TOPICS: usize = Topic::ALL.len();

/// Largest number of inputs or outputs of a service.
pub const MAX_PORTS: usize = 7;

const _: () = {
    let mut service = 0;
    while service < SERVICES {
        let id = ServiceId::ALL[service];
        assert!(id.inputs().len() <= MAX_PORTS && id.outputs().len() <= MAX_PORTS);
        service += 1;
    }
};

/// The resolved schedule of a flight.
#[derive(Clone, Debug, PartialEq)]
pub struct Schedule {
    tick_ns: u64,
    last_tick: u64,
    services: [Rate; SERVICES],
    topics: [Rate; TOPICS],
    latencies: [[u64; MAX_PORTS]; SERVICES],
    order: [ServiceId; SERVICES],
    outages: [Arc<[Outage]>; SERVICES],
    edge_faults: [[Arc<[EdgeFault]>; MAX_PORTS]; SERVICES],
    operator: OperatorPlan,
    world_is_real: bool,
    unread: [[bool; MAX_PORTS]; SERVICES],
    has_telemetry: bool,
    has_sensors: bool,
    has_captures: bool,
    fuses_poses: bool,
    has_baseline: bool,
}

impl Schedule {
    /// Resolves and checks a schedule: `services` and `topics` by index, `latencies[service][input]` in ticks.
    ///
    /// # Errors
    /// [`ScheduleError`] if the rates and latencies do not fit together.
    pub fn new(
        tick_ns: u64,
        last_tick: u64,
        services: [Rate; SERVICES],
        topics: [Rate; TOPICS],
        latencies: [[u64; MAX_PORTS]; SERVICES],
    ) -> Result<Self, ScheduleError> {
        let order = topological_order(&latencies)?;
        let schedule = Self {
            tick_ns,
            last_tick,
            services,
            topics,
            latencies,
            order,
            outages: Default::default(),
            edge_faults: Default::default(),
            operator: OperatorPlan::FLYING,
            world_is_real: false,
            unread: [[false; MAX_PORTS]; SERVICES],
            has_telemetry: false,
            has_sensors: false,
            has_captures: true,
            fuses_poses: false,
            has_baseline: false,
        };
        for topic in Topic::ALL {
            if let Some(publisher) = topic.publisher()
                && !schedule
                    .topic_rate(topic)
                    .is_within(schedule.service_rate(publisher))
            {
                return Err(ScheduleError::TopicWithoutStep { topic, publisher });
            }
        }
        schedule.check_controller_join()?;
        Ok(schedule)
    }

    /// Returns the same schedule with planned outages of services, each service's in the order of time and apart.
    #[must_use]
    pub fn with_outages(mut self, outages: [Vec<Outage>; SERVICES]) -> Self {
        self.outages = outages.map(Arc::from);
        self
    }

    /// Returns the same schedule with planned faults of edges: of each service and input, in the order of time and
    /// apart.
    #[must_use]
    pub fn with_edge_faults(mut self, faults: [[Vec<EdgeFault>; MAX_PORTS]; SERVICES]) -> Self {
        self.edge_faults = faults.map(|inputs| inputs.map(Arc::from));
        self
    }

    /// Returns the same schedule with planned requests of the operator.
    #[must_use]
    pub fn with_operator(mut self, plan: OperatorPlan) -> Self {
        self.operator = plan;
        self
    }

    /// Returns the same schedule in a laboratory, where cameras observe a real vehicle in place of the simulated plant.
    #[must_use]
    pub fn with_real_world(mut self) -> Self {
        self.world_is_real = true;
        self
    }

    /// Returns the same schedule without unread inputs: `unread[service][input]`.
    #[must_use]
    pub fn with_unread_inputs(mut self, unread: [[bool; MAX_PORTS]; SERVICES]) -> Self {
        self.unread = unread;
        self
    }

    /// Returns the same schedule with the telemetry of a foreign controller.
    #[must_use]
    pub fn with_telemetry(mut self) -> Self {
        self.has_telemetry = true;
        self
    }

    /// Returns the same schedule with the sensors of flight outdoors.
    #[must_use]
    pub fn with_sensors(mut self) -> Self {
        self.has_sensors = true;
        self
    }

    /// Returns the same schedule with inertial navigation, which fuses the poses of cameras or flies where there are none.
    #[must_use]
    pub fn with_navigation(mut self, fuses_poses: bool) -> Self {
        (self.has_captures, self.fuses_poses) = (fuses_poses, fuses_poses);
        self
    }

    /// Returns the same schedule with a receiver of two antennas, whose baselines inertial navigation fuses.
    #[must_use]
    pub fn with_baseline(mut self) -> Self {
        self.has_baseline = true;
        self
    }

    /// Returns whether the flight has a topic: telemetry exists only if the scenario names its values, samples of sensors only
    /// if it states sensors, and poses and baselines with their innovations only if inertial navigation fuses them.
    #[must_use]
    pub fn has_topic(&self, topic: Topic) -> bool {
        match topic {
            Topic::ControlTelemetry => self.has_telemetry,
            // A missing output is the last of its service.
            Topic::PoseInnovations => self.fuses_poses || self.has_baseline,
            Topic::GnssBaseline | Topic::BaselineInnovations => self.has_baseline,
            topic if topic.is_of_flight_outdoors() => self.has_sensors,
            _ => true,
        }
    }

    /// Returns the topics of the flight that services publish.
    pub fn published_topics(&self) -> impl Iterator<Item = Topic> {
        let published = |topic: &Topic| topic.publisher().is_some() && self.has_topic(*topic);
        Topic::ALL.into_iter().filter(published)
    }

    /// Returns the outputs of a service that the flight has; a missing one is the last in the wiring table.
    pub fn outputs(&self, service: ServiceId) -> impl Iterator<Item = &'static OutputSpec> {
        let outputs = service.outputs().iter();
        outputs.filter(|output| self.has_topic(output.topic))
    }

    /// Returns the inputs of a service whose topics the flight has, with their places in the wiring table; missing ones are the
    /// last there.
    pub fn inputs(&self, service: ServiceId) -> impl Iterator<Item = (usize, &'static InputSpec)> {
        let inputs = service.inputs().iter().enumerate();
        inputs.filter(|(_, input)| self.has_topic(input.topic))
    }

    /// Returns whether steps of a service read an input. Samples of unread inputs are not due and not delivered.
    #[must_use]
    pub fn reads(&self, service: ServiceId, input: usize) -> bool {
        !self.unread[service.index()][input]
    }

    /// Returns the inputs that steps of a service read, with their places in the wiring table.
    pub fn inputs_read(&self, service: ServiceId) -> impl Iterator<Item = (usize, &'static InputSpec)> {
        let inputs = service.inputs().iter().enumerate();
        inputs.filter(move |&(input, _)| self.reads(service, input))
    }

    /// Returns the services whose steps read a topic, with the position of the input in each.
    pub fn readers(&self, topic: Topic) -> impl Iterator<Item = (ServiceId, usize)> {
        topic
            .consumers()
            .filter(|&(service, input)| self.reads(service, input))
    }

    /// Returns whether the plant is simulated. The truth of a real one is unknown, and is not published.
    #[must_use]
    pub fn simulates_the_world(&self) -> bool {
        !self.world_is_real
    }

    /// Returns the planned requests of the operator.
    #[must_use]
    pub fn operator(&self) -> OperatorPlan {
        self.operator
    }

    /// Returns whether faults are planned, so that publishers may run ahead until buffers are full.
    #[must_use]
    pub fn has_faults(&self) -> bool {
        let is_out = self.outages.iter().any(|outages| !outages.is_empty());
        is_out || self.edge_faults.iter().flatten().any(|faults| !faults.is_empty())
    }

    /// Creates a schedule in which every service steps and every topic is published at every tick, with the latencies
    /// of the wiring table.
    ///
    /// # Panics
    /// Never: the wiring table itself has no cycle without delay.
    #[must_use]
    pub fn ideal(tick_ns: u64, last_tick: u64) -> Self {
        let every = Rate::EVERY_TICK;
        Self::new(
            tick_ns,
            last_tick,
            [every; SERVICES],
            [every; TOPICS],
            default_latencies(),
        )
        .expect("the wiring table has no cycle without delay")
    }

    /// Returns the length of a base tick, ns.
    #[must_use]
    pub fn tick_ns(&self) -> u64 {
        self.tick_ns
    }

    /// Returns the flight's last tick; it begins with tick 0.
    #[must_use]
    pub fn last_tick(&self) -> u64 {
        self.last_tick
    }

    /// Returns the time of a tick since the start of the flight, ns.
    #[must_use]
    #[inline]
    pub fn time_ns(&self, tick: u64) -> u64 {
        tick * self.tick_ns
    }

    /// Returns the ticks at which a service steps.
    #[must_use]
    pub fn steps(&self, service: ServiceId) -> OutageSchedule {
        OutageSchedule::new(
            self.service_rate(service),
            Arc::clone(&self.outages[service.index()]),
        )
    }

    /// Returns the ticks at which a topic is published.
    #[must_use]
    pub fn publications(&self, topic: Topic) -> OutageSchedule {
        let is_unknown = match topic {
            Topic::VehicleTruth => self.world_is_real,
            Topic::MocapPose => !self.has_captures,
            _ => false,
        };
        if is_unknown || !self.has_topic(topic) {
            return OutageSchedule::never();
        }
        let outages = topic
            .publisher()
            .map(|publisher| Arc::clone(&self.outages[publisher.index()]));
        OutageSchedule::new(self.topic_rate(topic), outages.unwrap_or_default())
    }

    /// Returns the rate of a service's steps without outages.
    #[must_use]
    #[inline]
    pub fn service_rate(&self, service: ServiceId) -> Rate {
        self.services[service.index()]
    }

    /// Returns the rate of a topic's samples without outages.
    #[must_use]
    #[inline]
    pub fn topic_rate(&self, topic: Topic) -> Rate {
        self.topics[topic.index()]
    }

    /// Returns the transport latency of an input, ticks.
    #[must_use]
    #[inline]
    pub fn latency(&self, service: ServiceId, input: usize) -> u64 {
        self.latencies[service.index()][input]
    }

    /// Returns the transport latency of a topic to a service, ticks; 0 if the service does not consume it.
    #[must_use]
    pub fn latency_of(&self, service: ServiceId, topic: Topic) -> u64 {
        let input = service.inputs().iter().position(|input| input.topic == topic);
        input.map_or(0, |input| self.latency(service, input))
    }

    /// Returns the time from a sample's publication until it acts in an input, ticks: its latency, except for the
    /// vehicle.
    #[must_use]
    pub fn acts_after(&self, service: ServiceId, input: usize) -> u64 {
        self.latency(service, input)
            .saturating_sub(acts_before_delivery(service))
    }

    /// Returns the services in an order in which none waits for a later one within a tick.
    #[must_use]
    pub fn order(&self) -> &[ServiceId; SERVICES] {
        &self.order
    }

    /// Returns the edge of an input, for the queries of each step.
    #[must_use]
    pub fn edge(&self, service: ServiceId, input: usize) -> Edge {
        let topic = service.inputs()[input].topic;
        Edge {
            topic,
            latency: self.latency(service, input),
            published: if self.reads(service, input) {
                self.publications(topic)
            } else {
                OutageSchedule::never()
            },
            consumed: self.steps(service),
            faults: Arc::clone(&self.edge_faults[service.index()][input]),
        }
    }

    /// Returns the publication of a topic, for the queries of each step.
    #[must_use]
    pub fn publication(&self, topic: Topic) -> Publication {
        Publication {
            topic,
            ticks: self.publications(topic),
            tick_ns: self.tick_ns,
        }
    }

    /// Returns the header of the sample of a topic that is published at `tick`.
    #[must_use]
    pub fn header(&self, topic: Topic, tick: u64) -> Header {
        self.publication(topic).header(tick)
    }

    /// Returns the number of samples of a topic in the flight.
    #[must_use]
    pub fn sample_count(&self, topic: Topic) -> u64 {
        self.publications(topic).count_before(self.last_tick + 1)
    }

    /// Returns the oldest age of an input's newest sample at a step of its service without faults, ticks.
    ///
    /// With equal periods every step finds the sample equally old. Otherwise the steps occur at all distances from a
    /// publication that the greatest common divisor of the periods allows.
    #[must_use]
    pub fn ordinary_age(&self, service: ServiceId, input: usize) -> u64 {
        let published = self.topic_rate(service.inputs()[input].topic);
        let consumed = self.service_rate(service);
        let latency = self.latency(service, input);
        let spacing = greatest_common_divisor(published.period, consumed.period);
        let arrives = (published.phase + latency) % spacing;
        let first = (consumed.phase % spacing + spacing - arrives) % spacing;
        latency + published.period - spacing + first
    }

    /// Returns the maximum lead, in ticks, of an input's publisher over its consumer: it is limited by the delays and
    /// periods around any cycle of edges through both.
    #[must_use]
    pub fn run_ahead_ticks(&self) -> u64 {
        let late = self.edge_faults.iter().flatten().flat_map(|faults| faults.iter());
        let latencies: u64 =
            self.latencies.iter().flatten().sum::<u64>() + late.map(EdgeFault::ticks_late).sum::<u64>();
        let topics = Topic::ALL
            .into_iter()
            .filter(|&topic| topic == Topic::ControlTelemetry || self.has_topic(topic));
        let periods: u64 = self
            .services
            .iter()
            .chain(topics.map(|topic| &self.topics[topic.index()]))
            .map(|rate| rate.period + rate.phase)
            .sum();
        latencies + periods
    }

    /// Returns the size of an input's buffer with which no publisher waits for its consumer, samples.
    #[must_use]
    pub fn buffer_size(&self, topic: Topic) -> u64 {
        self.run_ahead_ticks() / self.topic_rate(topic).period + 2
    }

    fn check_controller_join(&self) -> Result<(), ScheduleError> {
        const CONTROLLER: ServiceId = ServiceId::Controller;
        let longest = [
            self.services.map(|rate| rate.period),
            self.services.map(|rate| rate.phase),
        ];
        let horizon = self.run_ahead_ticks() + 2 * longest.iter().flatten().sum::<u64>();
        let steps =
            (0..=horizon.min(self.last_tick)).filter(|&tick| self.service_rate(CONTROLLER).occurs_at(tick));
        for tick in steps {
            let due = |service, input, tick| self.edge(service, input).due_sample(tick);
            let reference = due(CONTROLLER, 1, tick);
            // The reference belongs to the time of the path generator's state, not to its tick.
            let referred = reference.and_then(|at| due(ServiceId::PathGenerator, 0, at));
            if reference.is_some() && referred != due(CONTROLLER, 0, tick) {
                return Err(ScheduleError::UnequalJoin { tick });
            }
        }
        Ok(())
    }
}

/// Output of a service in the schedule.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Publication {
    /// The topic that is published.
    pub topic: Topic,
    /// Ticks of its publication.
    pub ticks: OutageSchedule,
    tick_ns: u64,
}

impl Publication {
    /// Returns whether a sample is published at `tick`.
    #[must_use]
    #[inline]
    pub fn is_due(&self, tick: u64) -> bool {
        self.ticks.occurs_at(tick)
    }

    /// Returns the header of the sample that is published at `tick`.
    #[must_use]
    #[inline]
    pub fn header(&self, tick: u64) -> Header {
        Header {
            tick,
            stamp_ns: tick * self.tick_ns,
            seq: self.ticks.count_before(tick),
        }
    }
}

fn greatest_common_divisor(a: u64, b: u64) -> u64 {
    if b == 0 {
        a
    } else {
        greatest_common_divisor(b, a % b)
    }
}

/// Returns the latencies of the wiring table, ticks.
#[must_use]
pub fn default_latencies() -> [[u64; MAX_PORTS]; SERVICES] {
    let mut latencies = [[0; MAX_PORTS]; SERVICES];
    for service in ServiceId::ALL {
        for (latency, input) in latencies[service.index()].iter_mut().zip(service.inputs()) {
            *latency = input.default_latency_ticks;
        }
    }
    latencies
}

/// Orders the services along the edges without latency, or finds the services of a cycle of such edges.
fn topological_order(
    latencies: &[[u64; MAX_PORTS]; SERVICES],
) -> Result<[ServiceId; SERVICES], ScheduleError> {
    let waits_for = |service: ServiceId| {
        let inputs = service.inputs().iter().zip(&latencies[service.index()]);
        inputs
            .filter(|(_, latency)| **latency == 0)
            .filter_map(|(input, _)| input.topic.publisher())
    };
    let mut order = Vec::with_capacity(SERVICES);
    while order.len() < SERVICES {
        let mut left = ServiceId::ALL
            .into_iter()
            .filter(|service| !order.contains(service));
        match left
            .clone()
            .find(|&service| waits_for(service).all(|publisher| order.contains(&publisher)))
        {
            Some(service) => order.push(service),
            None => {
                let start = left.next().expect("some service is left");
                return Err(ScheduleError::CycleWithoutDelay(cycle_from(
                    start, &order, waits_for,
                )));
            }
        }
    }
    Ok(order.try_into().expect("every service once"))
}

fn cycle_from<I: Iterator<Item = ServiceId>>(
    start: ServiceId,
    done: &[ServiceId],
    waits_for: impl Fn(ServiceId) -> I,
) -> Vec<ServiceId> {
    let mut walk = vec![start];
    loop {
        let last = walk[walk.len() - 1];
        let next = waits_for(last)
            .find(|publisher| !done.contains(publisher))
            .expect("everyone left waits for someone left");
        if let Some(begin) = walk.iter().position(|&service| service == next) {
            let mut cycle = walk.split_off(begin);
            cycle.push(next);
            cycle.reverse();
            return cycle;
        }
        walk.push(next);
    }
}

#[cfg(test)]
mod tests;
