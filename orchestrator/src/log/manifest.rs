//! What determined the results in a log, inside the log.

use std::collections::BTreeMap;

use shared_types::Topic;
use shared_types::scenario::Scenario;

/// Version of the arrangement of a run log; raised when older readers would misread newer logs.
pub const FORMAT_VERSION: u32 = 1;

const FORMAT_KEY: &str = "format_version";
const SCENARIO_KEY: &str = "scenario";
const SEED_KEY: &str = "seed";
const LAYOUT_PREFIX: &str = "layout/";

/// What determines a run's results, and nothing else: no wall clock, no path, nothing of the machine.
#[derive(Clone, Debug, PartialEq)]
pub struct Manifest {
    /// The scenario as flown, seed included; without what says how the machine is used.
    pub scenario: Scenario,
}

/// Why metadata of a log is no manifest of this program.
#[derive(Debug)]
pub(super) enum ManifestProblem {
    /// The log is arranged in another way.
    Version(String),
    /// Samples of these types are laid out in another way.
    Layouts(Vec<&'static str>),
    /// A part is missing or makes no sense.
    Broken(String),
}

impl Manifest {
    /// Name of the metadata record that holds the manifest.
    pub(super) const RECORD_NAME: &str = "gerono";

    /// The manifest of a flight of `scenario`.
    #[must_use]
    pub fn new(scenario: &Scenario) -> Self {
        Self {
            scenario: scenario.experiment(),
        }
    }

    /// As MCAP metadata: the scenario as JSON; beside it, for people, the seed; version and layout hashes.
    pub(super) fn to_metadata(&self) -> BTreeMap<String, String> {
        let scenario = serde_json::to_string(&self.scenario).expect("a scenario has only string keys");
        let layouts = Topic::ALL.map(|topic| (layout_key(topic), topic.layout_hash()));
        let mut metadata = BTreeMap::from(layouts);
        metadata.insert(FORMAT_KEY.to_owned(), FORMAT_VERSION.to_string());
        metadata.insert(SCENARIO_KEY.to_owned(), scenario);
        metadata.insert(SEED_KEY.to_owned(), self.scenario.seed.to_string());
        metadata
    }

    /// Back from MCAP metadata. Layouts come before the scenario: they tell more about why it makes no sense.
    pub(super) fn from_metadata(metadata: &BTreeMap<String, String>) -> Result<Self, ManifestProblem> {
        let get = |key: &str| {
            metadata
                .get(key)
                .ok_or_else(|| ManifestProblem::Broken(format!("its manifest has no `{key}`")))
        };
        let version = get(FORMAT_KEY)?;
        if *version != FORMAT_VERSION.to_string() {
            return Err(ManifestProblem::Version(version.clone()));
        }
        let differing: Vec<_> = Topic::ALL
            .into_iter()
            .filter(|&topic| metadata.get(&layout_key(topic)) != Some(&topic.layout_hash()))
            .map(Topic::msg_name)
            .collect();
        if !differing.is_empty() {
            return Err(ManifestProblem::Layouts(differing));
        }
        let scenario = serde_json::from_str(get(SCENARIO_KEY)?)
            .map_err(|error| ManifestProblem::Broken(format!("its scenario cannot be read: {error}")))?;
        Ok(Self { scenario })
    }
}

fn layout_key(topic: Topic) -> String {
    format!("{LAYOUT_PREFIX}{topic}")
}
