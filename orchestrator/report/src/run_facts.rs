//! Facts of the run that the log does not hold, from `summary.json` beside it.

use std::path::Path;

use serde::{Deserialize, Serialize};
use serde_json::Value;

use metrics::summary::Summary;
use run_log::run_folder::read_summary_beside;
use scenario_file::printable::printable;

/// Facts of the run; a field that the summary lacks has its default.
#[derive(Clone, Debug, Default, PartialEq, Deserialize, Serialize)]
#[serde(default)]
pub(super) struct RunFacts {
    /// Name of the scenario.
    scenario: String,
    /// Name of the host.
    host: String,
    outcome: String,
    /// Reason of the outcome.
    reason: String,
    /// Wall time of the flight, s.
    wall_seconds: Option<f64>,
    /// Timing of a flight in real time.
    pub(super) timing: Option<Value>,
}

impl RunFacts {
    /// Returns how a run ended that was not flown to its end.
    fn early_end(&self) -> Option<String> {
        matches!(self.outcome.as_str(), "failed" | "interrupted").then(|| {
            let reason = printable(&self.reason);
            match reason.is_empty() {
                true => format!("the run: {}", self.outcome),
                false => format!("the run: {}: {reason}", self.outcome),
            }
        })
    }
}

/// Returns how a flight went other than as planned; empty if it did not.
pub(super) fn misfortunes(facts: Option<&RunFacts>, summary: &Summary) -> String {
    let early_end = facts.and_then(RunFacts::early_end);
    let told: Vec<_> = early_end.into_iter().chain(summary.misfortunes()).collect();
    told.join("; ")
}

/// Reads the facts beside a log. `None` if there is no valid summary.
pub(super) fn beside(log: &Path) -> Option<RunFacts> {
    read_summary_beside(log)
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
        assert_eq!(facts.early_end(), None);
        assert_eq!((facts.host.as_str(), facts.timing), ("lockstep", None));
        std::fs::write(&summary, "{\"outcome\": \"failed\", \"reason\": \"gave up\"}").unwrap();
        let ended = beside(&log).unwrap().early_end();
        assert_eq!(ended.as_deref(), Some("the run: failed: gave up"));
        std::fs::write(&summary, "no summary").unwrap();
        assert_eq!(beside(&log), None);
    }
}
