//! Data of a live flight for observers: its description, and the newest sample of every topic.
//!
//! The orchestrator receives these samples anyway. An observer requests them from it, so the services are not affected:
//! no port, buffer or shared memory is created for an observer.

use std::collections::BTreeMap;

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use runtime::control::Host;
use scenario::Scenario;
use serde::{Deserialize, Deserializer, Serialize, Serializer};
use shared_types::{Published, ServiceId, Topic};

use scenario_file::printable::printable;

/// Returns run, scenario and radio link in a line: `run 130-0, Fig. 7 in a laboratory, crsf on /dev/ttyUSB0`. Control
/// characters in texts of the scenario are replaced.
#[must_use]
pub fn identity(run: &str, scenario: &Scenario) -> String {
    let mut parts = vec![format!("run {run}")];
    parts.extend(
        Some(&scenario.description)
            .filter(|text| !text.is_empty())
            .cloned(),
    );
    parts.push(link_of(scenario));
    let parts: Vec<_> = parts.iter().map(|part| printable(part).into_owned()).collect();
    parts.join(", ")
}

fn link_of(scenario: &Scenario) -> String {
    if let Some(program) = scenario.program_of(ServiceId::RcOutput) {
        let name = program.first().map_or("", String::as_str);
        return format!("frames to the program `{name}`");
    }
    let Some(link) = scenario.radio_link() else {
        return "a simulated radio link".to_owned();
    };
    let transmitter = scenario
        .rc_output
        .as_ref()
        .and_then(|link| link.transmitter.as_ref());
    let end = transmitter.and_then(|end| {
        let ends = [&end.device, &end.tcp, &end.udp, &end.uri];
        ends.into_iter().find_map(Option::as_ref)
    });
    match end {
        Some(end) => format!("{} on {end}", link.name()),
        None => link.name().to_owned(),
    }
}

/// Description of a flight.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Description {
    /// The scenario as flown.
    pub scenario: Scenario,
    pub host: Host,
    /// Start time of tick 0, ns of `CLOCK_MONOTONIC`; `None` in simulated time.
    pub start_ns: Option<u64>,
    /// Layout hash of every published topic, by name.
    pub layouts: BTreeMap<String, String>,
}

impl Description {
    /// Creates the description of a flight that publishes these topics.
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

    /// Returns the first topic whose layout differs in this program: the run is of another build.
    #[must_use]
    pub fn unreadable(&self) -> Option<&str> {
        let is_ours = |(name, hash): &(&String, &String)| {
            Topic::from_name(name).is_some_and(|topic| topic.layout_hash() == **hash)
        };
        let foreign = self.layouts.iter().find(|layout| !is_ours(layout));
        foreign.map(|(name, _)| name.as_str())
    }
}

/// Newest sample of every topic that has one.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct NewestSamples {
    samples: Vec<NewestSample>,
}

/// Sample as in shared memory.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct NewestSample {
    topic: String,
    #[serde(serialize_with = "to_text", deserialize_with = "from_text")]
    bytes: Vec<u8>,
}

impl NewestSamples {
    /// Collects the newest sample of each topic.
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

    /// Returns the bytes of a topic's sample, if their number is that of its type.
    #[must_use]
    pub fn bytes(&self, topic: Topic) -> Option<&[u8]> {
        let sample = self.samples.iter().find(|sample| sample.topic == topic.name())?;
        (sample.bytes.len() == topic.kind().size).then_some(&*sample.bytes)
    }

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

    /// Returns the largest tick of the samples.
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
    use scenario::{RadioProtocol, RcLink, Transmitter};
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
    fn a_run_is_named_with_its_scenario_and_link_in_one_line() {
        let mut scenario = scenario(0.001, 1.0);
        scenario.description = "Fig. 7\nin a laboratory".to_owned();
        assert_eq!(
            identity("130-0", &scenario),
            r"run 130-0, Fig. 7\u000ain a laboratory, a simulated radio link"
        );
        scenario.rc_output = Some(RcLink {
            link: RadioProtocol::Crsf,
            transmitter: Some(Transmitter {
                device: Some("/dev/ttyUSB0".to_owned()),
                ..Transmitter::default()
            }),
            ..RcLink::default()
        });
        scenario.description.clear();
        assert_eq!(identity("130-0", &scenario), "run 130-0, crsf on /dev/ttyUSB0");
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
