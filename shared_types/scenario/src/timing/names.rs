//! Names in scenarios: services, topics, and edges as `topic -> service`.

use super::Problem;
use crate::Key;
use shared_types::wiring::{ServiceId, Topic};

/// Input of a service, named `topic -> service` in scenarios.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct EdgeName {
    /// Consumer of the samples.
    pub service: ServiceId,
    /// Index of the input in the wiring table.
    pub input: usize,
    /// Consumed topic.
    pub topic: Topic,
}

impl EdgeName {
    /// Returns all edges, by service and input.
    pub fn all() -> impl Iterator<Item = Self> {
        edges_into(&ServiceId::ALL)
    }

    /// Returns all edges in the order by which they choose their random numbers: those of sensors follow all others, so that
    /// flights without sensors have the numbers of earlier versions.
    pub(crate) fn numbered() -> impl Iterator<Item = Self> {
        let is_of_flight_outdoors = |edge: &Self| edge.topic.is_of_flight_outdoors();
        let others = Self::all().filter(move |edge| !is_of_flight_outdoors(edge));
        others.chain(Self::all().filter(is_of_flight_outdoors))
    }

    /// Returns the edge from a topic to a service, if it exists.
    #[must_use]
    pub fn between(topic: Topic, service: ServiceId) -> Option<Self> {
        Self::all().find(|edge| (edge.topic, edge.service) == (topic, service))
    }

    /// Returns the edge with a name, if it exists.
    #[must_use]
    pub fn find(name: &str) -> Option<Self> {
        Self::all().find(|edge| edge.to_string() == name)
    }
}

impl std::fmt::Display for EdgeName {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        formatter.pad(&format!("{} -> {}", self.topic, self.service))
    }
}

/// Returns the edges to some services.
pub(crate) fn edges_into(services: &[ServiceId]) -> impl Iterator<Item = EdgeName> {
    services.iter().flat_map(|&service| {
        let inputs = service.inputs().iter().enumerate();
        inputs.map(move |(input, spec)| EdgeName {
            service,
            input,
            topic: spec.topic,
        })
    })
}

/// Returns the edges from each service of a walk to the next.
pub(super) fn edges_between(walk: &[ServiceId]) -> impl Iterator<Item = EdgeName> {
    walk.windows(2)
        .flat_map(|pair| edges_into(&pair[1..]).filter(|edge| edge.topic.publisher() == Some(pair[0])))
}

pub(crate) fn unknown_edge(key: Key, name: &str) -> Problem {
    let known: Vec<String> = EdgeName::all().map(|edge| edge.to_string()).collect();
    Problem::unknown_name(key, name, "edge", &known)
}

pub(super) fn unknown_schedulable(key: Key, name: &str) -> Problem {
    let services = ServiceId::ALL.iter().map(ToString::to_string);
    let topics = Topic::ALL.iter().filter(|topic| topic.publisher().is_some());
    let known: Vec<String> = services.chain(topics.map(ToString::to_string)).collect();
    Problem::unknown_name(key, name, "service or topic", &known)
}
