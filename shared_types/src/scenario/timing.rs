//! From the times of a scenario to the resolved schedule.

use super::{Problem, Scenario};
use crate::schedule::{MAX_PORTS, Rate, Schedule, default_latencies};
use crate::wiring::{ServiceId, Topic};

impl Scenario {
    /// The schedule that the scenario's times make.
    ///
    /// # Errors
    /// Every time that is not a whole number of ticks, every unknown name, and rates that do not fit together.
    pub fn schedule(&self) -> Result<Schedule, Vec<Problem>> {
        let mut problems = Vec::new();
        let timing = &self.schedule;
        if !(timing.tick >= 1e-6 && timing.tick <= 1.0) {
            return Err(vec![Problem::new(
                "schedule.tick",
                format!("the base tick is {} s", timing.tick),
                "choose a tick from 1e-6 s to 1 s; the paper's simulation uses 0.001",
            )]);
        }
        let tick_ns = to_nanoseconds(timing.tick);
        let mut ticks = |key: String, time: f64, least: u64| {
            whole_ticks(tick_ns, &key, time, least).unwrap_or_else(|problem| {
                problems.push(problem);
                least
            })
        };

        let last_tick = ticks("duration".to_owned(), self.duration, 1);
        for (index, change) in self.vehicle.change.iter().enumerate() {
            ticks(format!("vehicle.change.{index}.at"), change.at, 0);
        }
        let mut services = [Rate::EVERY_TICK; ServiceId::ALL.len()];
        let mut topics = [None; Topic::ALL.len()];
        let mut unknown = Vec::new();
        for (table, name, time, is_period) in timing
            .period
            .iter()
            .map(|(name, time)| ("period", name, *time, true))
            .chain(
                timing
                    .phase
                    .iter()
                    .map(|(name, time)| ("phase", name, *time, false)),
            )
        {
            let key = format!("schedule.{table}.{name}");
            let value = ticks(key.clone(), time, u64::from(is_period));
            let set = |rate: &mut Rate| {
                if is_period {
                    rate.period = value
                } else {
                    rate.phase = value
                }
            };
            if let Some(service) = ServiceId::from_name(name) {
                set(&mut services[service.index()]);
            } else if let Some(topic) = Topic::from_name(name).filter(|topic| topic.publisher().is_some()) {
                set(topics[topic.index()].get_or_insert(Rate {
                    period: 0,
                    phase: u64::MAX,
                }));
            } else {
                unknown.push(Problem::unknown_name(
                    key,
                    name,
                    "service or topic",
                    schedulable_names(),
                ));
            }
        }
        let mut latencies = default_latencies();
        for (edge, time) in &timing.latency {
            let key = format!("schedule.latency.{edge}");
            let value = ticks(key.clone(), *time, 0);
            match find_edge(edge) {
                Some((service, input)) => latencies[service.index()][input] = value,
                None => unknown.push(Problem::unknown_name(key, edge, "edge", edge_names())),
            }
        }
        problems.extend(unknown);
        if !problems.is_empty() {
            return Err(problems);
        }
        let topics = resolve_topics(topics, &services);
        Schedule::new(tick_ns, last_tick, services, topics, latencies).map_err(|error| {
            vec![Problem::new(
                "schedule",
                error.to_string(),
                "see `gerono check` for the schedule of a working scenario",
            )]
        })
    }

    /// Base tick of a time of this scenario that has been checked, such as that of a change.
    #[must_use]
    pub fn tick_of(&self, time: f64) -> u64 {
        whole_ticks(to_nanoseconds(self.schedule.tick), "", time, 0).unwrap_or(u64::MAX)
    }
}

/// A topic's rate is its publisher's unless the scenario states another.
fn resolve_topics(
    stated: [Option<Rate>; Topic::ALL.len()],
    services: &[Rate; ServiceId::ALL.len()],
) -> [Rate; Topic::ALL.len()] {
    Topic::ALL.map(|topic| {
        let inherited = topic
            .publisher()
            .map_or(Rate::EVERY_TICK, |publisher| services[publisher.index()]);
        stated[topic.index()].map_or(inherited, |rate| Rate {
            period: if rate.period == 0 {
                inherited.period
            } else {
                rate.period
            },
            phase: if rate.phase == u64::MAX {
                inherited.phase
            } else {
                rate.phase
            },
        })
    })
}

/// Name of an edge in a scenario.
fn edge_name(topic: Topic, service: ServiceId) -> String {
    format!("{topic} -> {service}")
}

fn edges() -> impl Iterator<Item = (ServiceId, usize, Topic)> {
    ServiceId::ALL.into_iter().flat_map(|service| {
        service
            .inputs()
            .iter()
            .enumerate()
            .map(move |(input, spec)| (service, input, spec.topic))
    })
}

fn find_edge(name: &str) -> Option<(ServiceId, usize)> {
    edges()
        .find(|&(service, _, topic)| edge_name(topic, service) == name)
        .map(|(service, input, _)| (service, input))
}

fn edge_names() -> Vec<String> {
    edges()
        .map(|(service, _, topic)| edge_name(topic, service))
        .collect()
}

fn schedulable_names() -> Vec<String> {
    let services = ServiceId::ALL.iter().map(ToString::to_string);
    services
        .chain(
            Topic::ALL
                .iter()
                .filter(|topic| topic.publisher().is_some())
                .map(ToString::to_string),
        )
        .collect()
}

#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "callers check that the time is small and not negative"
)]
fn to_nanoseconds(time: f64) -> u64 {
    libm::round(time * 1e9) as u64
}

/// A time as a whole number of ticks, at least `least` of them.
fn whole_ticks(tick_ns: u64, key: &str, time: f64, least: u64) -> Result<u64, Problem> {
    // A century in seconds: beyond it nanoseconds do not fit.
    if !(0.0..=3.2e9).contains(&time) {
        return Err(Problem::new(
            key,
            format!("{time} s is not a time of a flight"),
            "give a time of 0 s or more",
        ));
    }
    let nanoseconds = to_nanoseconds(time);
    let ticks = nanoseconds / tick_ns;
    let exact = nanoseconds.is_multiple_of(tick_ns) && (time * 1e9 - libm::round(time * 1e9)).abs() < 1e-3;
    if !exact {
        let tick = crate::service::seconds(tick_ns);
        let below = crate::service::seconds(ticks * tick_ns);
        let above = crate::service::seconds((ticks + 1) * tick_ns);
        return Err(Problem::new(
            key,
            format!("{time} s is not a whole number of base ticks of {tick} s"),
            format!("use {below} or {above}, or another `schedule.tick`"),
        ));
    }
    if ticks < least {
        return Err(Problem::new(
            key,
            format!("{time} s is less than one base tick"),
            "make it at least one tick long",
        ));
    }
    Ok(ticks)
}

const _: () = assert!(
    MAX_PORTS >= 4,
    "a service of the wiring table has up to four inputs"
);
