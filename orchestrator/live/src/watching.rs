//! The flight itself as a watcher sees it: what is flown, and the newest sample of every topic.
//!
//! The orchestrator has received these samples anyway. A watcher asks it for them, so no service learns of a watcher: no
//! port, no buffer and no place in shared memory is made for one.

use std::collections::BTreeMap;

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use runtime::control::Host;
use scenario::Scenario;
use serde::{Deserialize, Deserializer, Serialize, Serializer};
use shared_types::{Published, Topic};

/// What a run flies.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Description {
    /// The scenario as flown.
    pub scenario: Scenario,
    /// The host of its steps.
    pub host: Host,
    /// When tick 0 began, ns of `CLOCK_MONOTONIC`; none in simulated time.
    pub start_ns: Option<u64>,
    /// Layout hash of every published topic, by name.
    pub layouts: BTreeMap<String, String>,
}

impl Description {
    /// Returns the description of a flight that publishes these topics.
    #[must_use]
    pub fn new(
        scenario: &Scenario,
        host: Host,
        start_ns: Option<u64>,
        topics: impl Iterator<Item = Topic>,
    ) -> Self {
        Self {
            scenario: scenario.clone(),
            host,
            start_ns,
            layouts: topics
                .map(|topic| (topic.name().to_owned(), topic.layout_hash()))
                .collect(),
        }
    }

    /// Returns the first topic whose samples this program would read wrongly: the run is of another build.
    #[must_use]
    pub fn unreadable(&self) -> Option<&str> {
        let is_ours = |(name, hash): &(&String, &String)| {
            Topic::from_name(name).is_some_and(|topic| topic.layout_hash() == **hash)
        };
        let foreign = self.layouts.iter().find(|layout| !is_ours(layout));
        foreign.map(|(name, _)| name.as_str())
    }
}

/// The newest sample of every topic that has one.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct NewestSamples {
    samples: Vec<NewestSample>,
}

/// A sample as it is in shared memory.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct NewestSample {
    topic: String,
    #[serde(serialize_with = "to_text", deserialize_with = "from_text")]
    bytes: Vec<u8>,
}

impl NewestSamples {
    /// Gathers them from what is known of each topic.
    #[must_use]
    pub fn of<'a>(newest: impl Fn(Topic) -> Option<&'a [u8]>) -> Self {
        let sample = |topic: Topic| {
            Some(NewestSample {
                topic: topic.name().to_owned(),
                bytes: newest(topic)?.to_vec(),
            })
        };
        Self {
            samples: Topic::ALL.into_iter().filter_map(sample).collect(),
        }
    }

    /// Returns the bytes of the sample of a topic, as many as its type has.
    #[must_use]
    pub fn bytes(&self, topic: Topic) -> Option<&[u8]> {
        let sample = self.samples.iter().find(|sample| sample.topic == topic.name())?;
        (sample.bytes.len() == topic.kind().size).then_some(&*sample.bytes)
    }

    /// Returns the sample of a topic.
    #[must_use]
    pub fn get<T: Published>(&self) -> Option<T> {
        T::read_from_bytes(self.bytes(T::TOPIC)?).ok()
    }

    /// Returns the topics that have a sample, in the order of the log.
    pub fn topics(&self) -> impl Iterator<Item = Topic> {
        Topic::ALL
            .into_iter()
            .filter(|topic| self.bytes(*topic).is_some())
    }

    /// Returns the tick of the newest sample of all.
    #[must_use]
    pub fn tick(&self) -> Option<u64> {
        let tick = |topic| Some(shared_types::service::header_of(self.bytes(topic)?).tick);
        Topic::ALL.into_iter().filter_map(tick).max()
    }
}

fn to_text<S: Serializer>(bytes: &[u8], serializer: S) -> Result<S::Ok, S::Error> {
    serializer.serialize_str(&STANDARD.encode(bytes))
}

fn from_text<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Vec<u8>, D::Error> {
    let text = <std::borrow::Cow<'_, str>>::deserialize(deserializer)?;
    STANDARD.decode(&*text).map_err(serde::de::Error::custom)
}

#[cfg(test)]
mod tests {
    use super::*;
    use run_log::test_flight::scenario;
    use shared_types::samples::{ControlErrors, VehicleTruth};
    use zerocopy::{FromZeros, IntoBytes};

    #[test]
    fn samples_come_back_to_the_bit_also_those_that_are_not_finite() {
        let mut truth = VehicleTruth::new_zeroed();
        truth.header.tick = 4711;
        truth.position_world = [f64::NAN, -0.0, f64::MIN_POSITIVE];
        let newest = NewestSamples::of(|topic| (topic == Topic::VehicleTruth).then_some(truth.as_bytes()));
        let text = serde_json::to_string(&newest).unwrap();
        let read: NewestSamples = serde_json::from_str(&text).unwrap();
        assert_eq!(read.bytes(Topic::VehicleTruth), Some(truth.as_bytes()));
        assert_eq!(read.get::<VehicleTruth>().unwrap().as_bytes(), truth.as_bytes());
        assert_eq!(read.tick(), Some(4711));
        assert_eq!(read.topics().collect::<Vec<_>>(), [Topic::VehicleTruth]);
    }

    #[test]
    fn bytes_of_another_length_are_no_sample() {
        let newest = NewestSamples::of(|_| Some(&[0; 8]));
        assert_eq!(newest.bytes(Topic::ControlErrors), None);
        assert!(newest.get::<ControlErrors>().is_none());
        assert_eq!(newest.tick(), None);
    }

    #[test]
    fn a_run_of_another_build_is_told_by_the_topic_that_differs() {
        let scenario = scenario(0.001, 1.0);
        let topics = [Topic::VehicleTruth, Topic::PathReference];
        let mut description = Description::new(&scenario, Host::LockStep, None, topics.into_iter());
        assert_eq!(description.unreadable(), None);
        let text = serde_json::to_string(&description).unwrap();
        assert_eq!(serde_json::from_str::<Description>(&text).unwrap(), description);
        description
            .layouts
            .insert("path/reference".to_owned(), "0".to_owned());
        assert_eq!(description.unreadable(), Some("path/reference"));
        description.layouts = [("new/topic".to_owned(), "0".to_owned())].into();
        assert_eq!(description.unreadable(), Some("new/topic"));
    }
}
