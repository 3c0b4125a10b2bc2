//! Prediction of the size of a flight's log.

use shared_types::Schedule;
use shared_types::sample::CDR_HEADER;

/// Overhead of a message, bytes: frame and fields of its record, the CDR header, its entry in the index of its chunk.
const BESIDE_THE_SAMPLE: u64 = (1 + 8) + (2 + 4 + 8 + 8) + CDR_HEADER.len() as u64 + (8 + 8);

/// Returns the size of the uncompressed `run.mcap` of a complete flight, bytes, without some 10 kB of manifest and schemas.
#[must_use]
pub fn predicted_bytes(schedule: &Schedule) -> u64 {
    schedule
        .published_topics()
        .map(|topic| schedule.sample_count(topic) * (topic.kind().size as u64 + BESIDE_THE_SAMPLE))
        .sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Compression;
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
            Compression::None,
            flown,
        );
        let predicted = predicted_bytes(&schedule);
        let beside = written.bytes.abs_diff(predicted);
        assert!(
            beside < written.bytes / 100,
            "{predicted} was predicted, {} written",
            written.bytes
        );
    }
}
