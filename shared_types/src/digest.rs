//! Digest of an experiment, from which the golden hashes are made.

use crate::Topic;
use crate::sample::{CDR_HEADER, hex};
use crate::service::header_of;
use sha2::{Digest, Sha256};

/// Digest of an experiment: SHA-256 over topic, time and payload of every sample in the order of the log.
///
/// Each sample adds the topic's name and a zero byte, its time in ns and the payload's length (both as little-endian
/// 64-bit numbers), and the payload: CDR header and sample. The log's format has no effect.
#[derive(Clone, Default)]
pub struct ExperimentDigest {
    hash: Sha256,
}

impl ExperimentDigest {
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

    /// Returns the digest in lower-case hexadecimal.
    #[must_use]
    pub fn finish(self) -> String {
        hex(&self.hash.finalize())
    }
}
