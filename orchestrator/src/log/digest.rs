//! The digest of an experiment: what the golden hashes are made of.

use std::path::Path;

use sha2::{Digest, Sha256};
use shared_types::Topic;
use shared_types::sample::hex;
use shared_types::service::header_of;

use super::framing::CDR_HEADER;
use super::reader::{LogReadError, LogReader};

/// SHA-256 over topic, time and payload of every message in order.
///
/// Each message adds the topic's name and a zero byte, the log time in ns and the payload's length (both as
/// little-endian 64-bit numbers), and the payload: CDR header and sample. Chunks, compression and manifest do not count.
#[derive(Clone, Default)]
pub struct LogDigest {
    hash: Sha256,
}

impl LogDigest {
    /// Adds a sample.
    pub fn update(&mut self, topic: Topic, bytes: &[u8]) {
        let payload_bytes = (CDR_HEADER.len() + bytes.len()) as u64;
        self.hash.update(topic.name().as_bytes());
        self.hash.update([0]);
        self.hash.update(header_of(bytes).stamp_ns.to_le_bytes());
        self.hash.update(payload_bytes.to_le_bytes());
        self.hash.update(CDR_HEADER);
        self.hash.update(bytes);
    }

    /// The digest in lower-case hexadecimal.
    #[must_use]
    pub fn finish(self) -> String {
        hex(&self.hash.finalize())
    }
}

/// The digest of a log: equal for equal experiments, on any machine.
///
/// # Errors
/// [`LogReadError`], also for an incomplete log.
pub fn digest(path: &Path) -> Result<String, LogReadError> {
    let mut reader = LogReader::open(path)?;
    let mut digest = LogDigest::default();
    while let Some(logged) = reader.next_sample()? {
        digest.update(logged.topic, logged.bytes);
    }
    Ok(digest.finish())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::log::Compression;
    use crate::log::test_flight::{record, record_samples, samples, scenario};

    #[test]
    fn the_digest_depends_neither_on_compression_nor_on_the_manifest() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("run.mcap");
        let mut scenario = scenario(0.01, 1.0);
        let mut expected = LogDigest::default();
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
        changed[12].1[100] ^= 1;
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
