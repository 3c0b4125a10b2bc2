//! Conversion of a scenario's times, s, to the schedule, in whole base ticks.

mod faults;
pub(super) mod names;
pub(super) mod ticks;
mod unread;

use std::collections::BTreeMap;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use ticks::TickReader;

use super::{Key, Problem, Scenario};
use crate::range::{between, not_negative, positive};
use shared_types::schedule::{
    MAX_PORTS, Rate, Schedule, ScheduleError, acts_before_delivery, default_latencies,
};
use shared_types::wiring::{ServiceId, Topic};

const SERVICES: usize = ServiceId::ALL.len();
const TOPICS: usize = Topic::ALL.len();

/// Maximum length of a flight, base ticks: more than a day at the default tick.
pub(crate) const LONGEST_FLIGHT: u64 = 100_000_000;

/// Maximum period, phase and latency, base ticks: they determine how far services run ahead, and thus the size of buffers
/// in shared memory.
pub(crate) const LONGEST_DELAY: u64 = 10_000;

/// Base tick, rates and transport latencies, s. Every time is a whole number of base ticks.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Timing {
    /// Base tick h, s.
    #[schemars(transform = between(1e-6, 1.0), extend("x-hint" = "a whole number of nanoseconds; the default is 0.001"))]
    pub tick: f64,
    /// Period of a service or topic, by name, s; one tick, or that of a topic's publisher, unless stated.
    #[schemars(transform = positive)]
    pub period: BTreeMap<String, f64>,
    /// First step of a service or first sample of a topic, by name, s; 0 unless stated.
    #[schemars(transform = not_negative)]
    pub phase: BTreeMap<String, f64>,
    /// Transport latency of an edge, by `"topic -> service"`, s; as in the wiring table unless stated. That of `"rc/frame -> plant"` is the time from the transmission of a frame until it takes effect, 0 unless stated.
    #[schemars(transform = not_negative)]
    pub latency: BTreeMap<String, f64>,
}

impl Default for Timing {
    fn default() -> Self {
        Self {
            tick: 0.001,
            period: BTreeMap::new(),
            phase: BTreeMap::new(),
            latency: BTreeMap::new(),
        }
    }
}

impl Scenario {
    /// Computes the schedule.
    ///
    /// # Errors
    /// Every period, phase or latency that is not a whole number of ticks, every unknown name, and inconsistent rates.
    /// [`problems`](Self::problems) checks the times of events.
    pub fn schedule(&self) -> Result<Schedule, Vec<Problem>> {
        let mut reader = TickReader::new(self.schedule.tick).map_err(|problem| vec![problem])?;
        let root = Key::root();
        let last_tick = reader.read(&root.then("duration"), self.duration, 1..=LONGEST_FLIGHT);
        let (services, topics) = self.schedule.rates(&mut reader).resolved();
        let latencies = self.schedule.latencies(&mut reader);
        let tick_ns = reader.finish()?;
        Schedule::new(tick_ns, last_tick, services, topics, latencies)
            .map(|schedule| {
                let mut schedule = schedule
                    .with_outages(self.outages())
                    .with_edge_faults(self.edge_faults())
                    .with_operator(self.operator_plan())
                    .with_unread_inputs(self.unread_inputs());
                if !self.controller.telemetry.is_empty() {
                    schedule = schedule.with_telemetry();
                }
                if self.sensors.is_some() {
                    schedule = schedule.with_sensors();
                }
                if let Some(fuses_poses) = self.fuses_poses() {
                    schedule = schedule.with_navigation(fuses_poses);
                }
                if self.has_topic(Topic::GnssBaseline) {
                    schedule = schedule.with_baseline();
                }
                if !self.pose_source().is_simulated() || self.real_receivers().is_some() {
                    schedule = schedule.with_real_world();
                }
                schedule
            })
            .map_err(|error| vec![self.schedule.explain(&error)])
    }

    /// Returns the base tick of a checked time of this scenario, such as that of a change.
    #[must_use]
    pub fn tick_of(&self, time: f64) -> u64 {
        TickReader::new(self.schedule.tick)
            .ok()
            .and_then(|reader| reader.whole_ticks(time, 0..=LONGEST_FLIGHT).ok())
            .unwrap_or(u64::MAX)
    }
}

/// Stated rate of a service or topic.
#[derive(Clone, Copy, Debug, Default)]
struct StatedRate {
    period: Option<u64>,
    phase: Option<u64>,
}

impl StatedRate {
    fn or(self, inherited: Rate) -> Rate {
        Rate {
            period: self.period.unwrap_or(inherited.period),
            phase: self.phase.unwrap_or(inherited.phase),
        }
    }
}

/// Stated rates of all services and topics.
#[derive(Debug, Default)]
struct StatedRates {
    services: [StatedRate; SERVICES],
    topics: [StatedRate; TOPICS],
}

impl StatedRates {
    /// Returns the rate of a service or a topic with a publisher, by name.
    fn rate_mut(&mut self, name: &str) -> Option<&mut StatedRate> {
        if let Some(service) = ServiceId::from_name(name) {
            return Some(&mut self.services[service.index()]);
        }
        let topic = Topic::from_name(name).filter(|topic| topic.publisher().is_some())?;
        Some(&mut self.topics[topic.index()])
    }

    /// Resolves the rates: unless stated, a service steps at every tick, and a topic has its publisher's rate.
    fn resolved(self) -> ([Rate; SERVICES], [Rate; TOPICS]) {
        let services = self.services.map(|stated| stated.or(Rate::EVERY_TICK));
        let topics = Topic::ALL.map(|topic| {
            let inherited = topic
                .publisher()
                .map_or(Rate::EVERY_TICK, |publisher| services[publisher.index()]);
            self.topics[topic.index()].or(inherited)
        });
        (services, topics)
    }
}

impl Timing {
    fn rates(&self, reader: &mut TickReader) -> StatedRates {
        let mut rates = StatedRates::default();
        for (name, &time) in &self.period {
            let key = key_of("period", name);
            match rates.rate_mut(name) {
                Some(rate) => rate.period = Some(reader.read(&key, time, 1..=LONGEST_DELAY)),
                None => reader.refuse(names::unknown_schedulable(key, name)),
            }
        }
        for (name, &time) in &self.phase {
            let key = key_of("phase", name);
            match rates.rate_mut(name) {
                Some(rate) => rate.phase = Some(reader.read(&key, time, 0..=LONGEST_DELAY)),
                None => reader.refuse(names::unknown_schedulable(key, name)),
            }
        }
        rates
    }

    fn latencies(&self, reader: &mut TickReader) -> [[u64; MAX_PORTS]; SERVICES] {
        let mut latencies = default_latencies();
        for (name, &time) in &self.latency {
            let key = key_of("latency", name);
            match names::EdgeName::find(name) {
                Some(edge) => {
                    let acts_before = acts_before_delivery(edge.service);
                    let ticks = reader.read(&key, time, 0..=LONGEST_DELAY - acts_before);
                    latencies[edge.service.index()][edge.input] = ticks + acts_before;
                }
                None => reader.refuse(names::unknown_edge(key, name)),
            }
        }
        latencies
    }

    /// Converts an error of the schedule to a problem at the stated time that is most likely wrong.
    fn explain(&self, error: &ScheduleError) -> Problem {
        let (key, fix) = match error {
            ScheduleError::CycleWithoutDelay(cycle) => {
                let edges = names::edges_between(cycle).map(|edge| edge.to_string());
                let key = self.first_stated(edges.map(|name| ("latency", name)));
                (key, "give this edge a latency of at least one tick".to_owned())
            }
            ScheduleError::TopicWithoutStep { topic, publisher } => {
                let names = [topic.to_string(), publisher.to_string()];
                let tables = ["period", "phase"];
                let candidates = names
                    .into_iter()
                    .flat_map(|name| tables.map(|table| (table, name.clone())));
                let fix = format!("make the period of `{topic}` a multiple of that of `{publisher}`");
                (self.first_stated(candidates), fix)
            }
            ScheduleError::UnequalJoin { .. } => {
                let services = [ServiceId::PathGenerator, ServiceId::Controller];
                let topics = [Topic::VehicleState, Topic::PathReference];
                let names = services
                    .map(ServiceId::name)
                    .into_iter()
                    .chain(topics.map(Topic::name));
                let rates = names.flat_map(|name| ["period", "phase"].map(|table| (table, name.to_owned())));
                let edges = names::edges_into(&services).map(|edge| ("latency", edge.to_string()));
                (
                    self.first_stated(rates.chain(edges)),
                    "give both services the same times, or leave them out".to_owned(),
                )
            }
        };
        Problem::new(key, error.to_string(), fix)
    }

    /// Returns the key of the first of these times that is stated.
    fn first_stated(&self, mut times: impl Iterator<Item = (&'static str, String)>) -> Key {
        let is_stated = |(table, name): &(&str, String)| match *table {
            "period" => self.period.contains_key(name),
            "phase" => self.phase.contains_key(name),
            _ => self.latency.contains_key(name),
        };
        times
            .find(is_stated)
            .map_or_else(schedule_key, |(table, name)| key_of(table, &name))
    }
}

fn schedule_key() -> Key {
    Key::root().then("schedule")
}

fn key_of(table: &str, name: &str) -> Key {
    schedule_key().then(table).then(name)
}

#[cfg(test)]
mod tests;
