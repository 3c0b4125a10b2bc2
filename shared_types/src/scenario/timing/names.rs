//! The names that a scenario's schedule may use: services, topics, and edges as `topic -> service`.

use super::Problem;
use crate::scenario::Key;
use crate::wiring::{ServiceId, Topic};

/// An input of a service, as the scenario sees it.
#[derive(Clone, Copy, Debug)]
pub(super) struct Edge {
    pub(super) service: ServiceId,
    pub(super) input: usize,
    topic: Topic,
}

impl Edge {
    pub(super) fn name(self) -> String {
        format!("{} -> {}", self.topic, self.service)
    }
}

fn edges() -> impl Iterator<Item = Edge> {
    edges_into(&ServiceId::ALL)
}

/// The edges to some services.
pub(super) fn edges_into(services: &[ServiceId]) -> impl Iterator<Item = Edge> {
    services.iter().flat_map(|&service| {
        let inputs = service.inputs().iter().enumerate();
        inputs.map(move |(input, spec)| Edge {
            service,
            input,
            topic: spec.topic,
        })
    })
}

/// The edges from each service of a walk to the next.
pub(super) fn edges_between(walk: &[ServiceId]) -> impl Iterator<Item = Edge> {
    walk.windows(2)
        .flat_map(|pair| edges_into(&pair[1..]).filter(|edge| edge.topic.publisher() == Some(pair[0])))
}

pub(super) fn find_edge(name: &str) -> Option<Edge> {
    edges().find(|edge| edge.name() == name)
}

pub(super) fn unknown_edge(key: Key, name: &str) -> Problem {
    let known: Vec<String> = edges().map(Edge::name).collect();
    Problem::unknown_name(key, name, "edge", &known)
}

pub(super) fn unknown_schedulable(key: Key, name: &str) -> Problem {
    let services = ServiceId::ALL.iter().map(ToString::to_string);
    let topics = Topic::ALL.iter().filter(|topic| topic.publisher().is_some());
    let known: Vec<String> = services.chain(topics.map(ToString::to_string)).collect();
    Problem::unknown_name(key, name, "service or topic", &known)
}
