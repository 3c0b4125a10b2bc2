//! Prediction of the size of a flight's log.

use scenario::{Recorded, Scenario};
use shared_types::sample::CDR_HEADER;
use shared_types::{Schedule, Topic};

/// Overhead of a message, bytes: frame and fields of its record, the CDR header, its entry in the index of its chunk.
const BESIDE_THE_SAMPLE: u64 = (1 + 8) + (2 + 4 + 8 + 8) + CDR_HEADER.len() as u64 + (8 + 8);

/// Returns the size of the uncompressed `run.mcap` of a complete flight, bytes, without some 10 kB of manifest and schemas.
#[must_use]
pub fn predicted_bytes(scenario: &Scenario, schedule: &Schedule) -> u64 {
    let recorded = Recorded::of_topics(scenario);
    let of_topic = |topic: Topic| {
        let samples = recorded[topic.index()].count_before(schedule.sample_count(topic));
        samples * (topic.kind().size as u64 + BESIDE_THE_SAMPLE)
    };
    schedule.published_topics().map(of_topic).sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::test_flight::{record_samples, samples, scenario};

    #[test]
    fn a_log_has_the_size_that_was_predicted() {
        let folder = tempfile::tempdir().unwrap();
        let scenario = scenario(0.001, 2.0);
        let schedule = scenario.schedule().unwrap();
        let flown = samples(&schedule).filter(|(topic, _)| topic.publisher().is_some());
        let written = record_samples(
            &folder.path().join("run.mcap"),
            &scenario,
            crate::Compression::None,
            flown,
        );
        let predicted = predicted_bytes(&scenario, &schedule);
        let bytes = written.bytes;
        assert!(
            bytes.abs_diff(predicted) < bytes / 100,
            "{predicted}, not {bytes}"
        );
    }
}
