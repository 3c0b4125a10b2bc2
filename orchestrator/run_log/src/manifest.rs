//! Manifest of a log: the facts that determined its results.

use std::collections::BTreeMap;
use std::ops::Range;

use scenario::{MOVED_KEYS, Scenario};
use serde_json::Value;
use sha2::{Digest, Sha256};
use shared_types::Topic;
use shared_types::sample::hex;

/// Version of the format of a run log; raised when older readers would misread newer logs.
pub const FORMAT_VERSION: u32 = 1;

const FORMAT_KEY: &str = "format_version";
const SCENARIO_KEY: &str = "scenario";
const CHECKSUM_KEY: &str = "scenario_sha256";
const SEED_KEY: &str = "seed";
const LAYOUT_PREFIX: &str = "layout/";

/// Name of the metadata record of a copy for viewers, which is not a log.
pub(super) const COPY_RECORD_NAME: &str = "gerono_view";

/// The facts that determine a run's results, and nothing else: no wall clock, no path, nothing of the machine.
#[derive(Clone, Debug, PartialEq)]
pub struct Manifest {
    /// The flown scenario with its seed, without the sections on the use of the machine.
    pub scenario: Scenario,
    /// Layout hashes of the topics whose samples were recorded in an earlier layout.
    earlier_layouts: BTreeMap<Topic, String>,
}

/// Reason why a log has no valid manifest of this program.
#[derive(Debug, thiserror::Error)]
pub enum ManifestProblem {
    /// It is missing.
    #[error("it cannot be found")]
    Absent,
    /// The log has another format.
    #[error("it is of format version {0}")]
    Version(String),
    /// Samples of these types have another layout.
    #[error("it states other layouts of {}", .0.join(", "))]
    Layouts(Vec<&'static str>),
    /// It lacks an entry of this name.
    #[error("its manifest has no `{0}`")]
    Incomplete(&'static str),
    /// Its scenario is invalid.
    #[error("its scenario cannot be read: {0}")]
    Scenario(#[from] serde_json::Error),
    /// Its scenario has changed.
    #[error("its scenario is not what was written: checksum or seed differ")]
    Altered,
}

impl Manifest {
    /// Name of the metadata record that holds the manifest.
    pub(super) const RECORD_NAME: &str = "gerono";

    /// Makes the manifest of a flight of `scenario`.
    #[must_use]
    pub fn new(scenario: &Scenario) -> Self {
        Self {
            scenario: scenario.experiment(),
            earlier_layouts: BTreeMap::new(),
        }
    }

    /// Returns the bytes of a topic's samples that were padding when the flight was recorded and belong to a member now.
    #[must_use]
    pub fn padding(&self, topic: Topic) -> Range<usize> {
        let layout = self.earlier_layouts.get(&topic);
        layout
            .and_then(|layout| topic.padding_in(layout))
            .unwrap_or_default()
    }

    /// Converts to MCAP metadata: the scenario as JSON with its checksum, because MCAP has none for metadata in an unclosed
    /// log; the seed, for users; version and layout hashes.
    pub(super) fn to_metadata(&self) -> BTreeMap<String, String> {
        let scenario = self.scenario.to_json();
        let layouts = topics_of(&self.scenario).map(|topic| {
            let earlier = self.earlier_layouts.get(&topic).cloned();
            (layout_key(topic), earlier.unwrap_or_else(|| topic.layout_hash()))
        });
        let mut metadata: BTreeMap<_, _> = layouts.collect();
        metadata.insert(FORMAT_KEY.to_owned(), FORMAT_VERSION.to_string());
        metadata.insert(CHECKSUM_KEY.to_owned(), checksum(&scenario));
        metadata.insert(SCENARIO_KEY.to_owned(), scenario);
        metadata.insert(SEED_KEY.to_owned(), self.scenario.seed.to_string());
        metadata
    }

    /// Converts from MCAP metadata. Checks layouts before the scenario: they are the better reason for an invalid one.
    pub(super) fn from_metadata(metadata: &BTreeMap<String, String>) -> Result<Self, ManifestProblem> {
        let get = |key| metadata.get(key).ok_or(ManifestProblem::Incomplete(key));
        let version = get(FORMAT_KEY)?;
        if *version != FORMAT_VERSION.to_string() {
            return Err(ManifestProblem::Version(version.clone()));
        }
        let (mut differing, mut earlier_layouts) = (Vec::new(), BTreeMap::new());
        for topic in Topic::ALL {
            match metadata.get(&layout_key(topic)) {
                None if topic == Topic::ControlTelemetry || topic.is_of_flight_outdoors() => {}
                Some(layout) if *layout == topic.layout_hash() => {}
                Some(layout) if topic.padding_in(layout).is_some() => {
                    earlier_layouts.insert(topic, layout.clone());
                }
                _ => differing.push(topic.msg_name()),
            }
        }
        if !differing.is_empty() {
            return Err(ManifestProblem::Layouts(differing));
        }
        let text = get(SCENARIO_KEY)?;
        let scenario = scenario_in(text)?;
        // Earlier programs wrote no checksum.
        let is_as_written = metadata
            .get(CHECKSUM_KEY)
            .is_none_or(|sum| *sum == checksum(text));
        if !is_as_written || *get(SEED_KEY)? != scenario.seed.to_string() {
            return Err(ManifestProblem::Altered);
        }
        Ok(Self {
            scenario,
            earlier_layouts,
        })
    }
}

/// Returns the topics of the log of a flight of `scenario`, in their order.
pub fn topics_of(scenario: &Scenario) -> impl Iterator<Item = Topic> + use<> {
    let has_topic = Topic::ALL.map(|topic| scenario.has_topic(topic));
    Topic::ALL
        .into_iter()
        .filter(move |topic| has_topic[topic.index()])
}

/// Parses the scenario of a manifest. Earlier versions had some of its keys elsewhere.
fn scenario_in(text: &str) -> serde_json::Result<Scenario> {
    let mut stated: Value = serde_json::from_str(text)?;
    for (then, key, now) in MOVED_KEYS {
        let table = stated.get_mut(then).and_then(Value::as_object_mut);
        if let Some(moved) = table.and_then(|table| table.remove(key)) {
            stated[now][key] = moved;
        }
    }
    Scenario::from_json(stated)
}

fn checksum(scenario: &str) -> String {
    hex(&Sha256::digest(scenario))
}

fn layout_key(topic: Topic) -> String {
    format!("{LAYOUT_PREFIX}{topic}")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::test_flight::scenario;

    #[test]
    fn logs_of_earlier_programs_have_their_source_of_poses_where_it_is_now() {
        let mut earlier = serde_json::to_value(scenario(0.001, 1.0)).unwrap();
        earlier["estimator"] = serde_json::json!({"source": "replay", "recording": "runs/x", "kalman": {}});
        let read = scenario_in(&earlier.to_string()).unwrap();
        assert_eq!(read.recorded_captures(), Some("runs/x"));
    }
}
