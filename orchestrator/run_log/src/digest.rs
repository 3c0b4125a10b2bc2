//! Digest of a recorded experiment.

use std::path::Path;

use shared_types::digest::ExperimentDigest;

use super::reader::{LogReadError, LogReader};

/// Returns the digest of a log: equal for equal experiments, on any machine.
///
/// # Errors
/// [`LogReadError`], also for an incomplete log.
pub fn digest(path: &Path) -> Result<String, LogReadError> {
    let mut reader = LogReader::open(path)?;
    let mut digest = ExperimentDigest::default();
    while let Some(logged) = reader.next_sample()? {
        digest.update(logged.topic, logged.bytes);
    }
    Ok(digest.finish())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Compression;
    use crate::test_flight::{record, record_samples, samples, scenario};
    use shared_types::Topic;

    #[test]
    fn the_digest_depends_neither_on_compression_nor_on_the_manifest() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("run.mcap");
        let mut scenario = scenario(0.01, 1.0);
        let mut expected = ExperimentDigest::default();
        for (topic, bytes) in samples(&scenario.schedule().unwrap()) {
            expected.update(topic, &bytes);
        }
        let expected = expected.finish();
        for compression in [Compression::None, Compression::Lz4, Compression::Zstd] {
            scenario.description.push('!');
            record(&path, &scenario, compression);
            assert_eq!(digest(&path).unwrap(), expected);
        }
    }

    #[test]
    fn the_digest_sees_every_byte_the_order_and_the_end() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("run.mcap");
        let scenario = scenario(0.1, 1.0);
        let all: Vec<_> = samples(&scenario.schedule().unwrap()).collect();
        let digest_of = |samples: Vec<(Topic, Vec<u8>)>| {
            record_samples(&path, &scenario, Compression::None, samples.into_iter());
            digest(&path).unwrap()
        };
        let mut digests = vec![digest_of(all.clone())];
        let mut changed = all.clone();
        *changed[12].1.last_mut().unwrap() ^= 1;
        digests.push(digest_of(changed));
        let mut swapped = all.clone();
        swapped.swap(1, 2);
        digests.push(digest_of(swapped));
        let mut shorter = all.clone();
        shorter.pop();
        digests.push(digest_of(shorter));
        assert!(
            digests
                .iter()
                .all(|digest| digest.len() == 64 && digest.chars().all(|digit| digit.is_ascii_hexdigit()))
        );
        digests.sort();
        digests.dedup();
        assert_eq!(digests.len(), 4);
    }
}
