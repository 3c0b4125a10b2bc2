//! Facts that only the run itself knew: `summary.json` beside the log, as far as it is there.

use std::path::Path;

use serde::{Deserialize, Serialize};
use serde_json::Value;

use run_log::run_folder::summary_text_beside;

/// The page's facts about the run.
#[derive(Clone, Debug, Default, PartialEq, Deserialize, Serialize)]
#[serde(default)]
pub(super) struct RunFacts {
    /// Name of the scenario.
    scenario: String,
    /// Which host flew it.
    host: String,
    /// The outcome of the run.
    outcome: String,
    /// Why, in words.
    reason: String,
    /// Wall time of the flight, s.
    wall_seconds: Option<f64>,
    /// The timing of the flight, if it was flown in real time.
    pub(super) timing: Option<Value>,
}

/// Reads them; none if the log lies alone, or beside something else.
pub(super) fn beside(log: &Path) -> Option<RunFacts> {
    serde_json::from_str(&summary_text_beside(log)?).ok()
}

#[cfg(test)]
#[expect(clippy::disallowed_methods, reason = "tests make their own files")]
mod tests {
    use super::*;

    #[test]
    fn what_is_known_is_read_and_what_is_not_is_none() {
        let folder = tempfile::tempdir().unwrap();
        let log = folder.path().join("run.mcap");
        assert_eq!(beside(&log), None);
        let summary = folder.path().join("summary.json");
        std::fs::write(&summary, "{\"host\": \"lockstep\", \"phases\": []}").unwrap();
        let facts = beside(&log).unwrap();
        assert_eq!((facts.host.as_str(), facts.timing), ("lockstep", None));
        std::fs::write(&summary, "no summary").unwrap();
        assert_eq!(beside(&log), None);
    }
}
