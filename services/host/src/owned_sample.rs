//! Sample in separate memory: whole words, because samples are read in place.

use shared_types::Topic;
use zerocopy::IntoBytes;

/// Place of one sample of a topic, laid out once.
#[derive(Clone, Debug)]
pub struct OwnedSample {
    words: Box<[u64]>,
}

impl OwnedSample {
    /// Makes a place for samples of `topic`; zeroed.
    #[must_use]
    pub fn of(topic: Topic) -> Self {
        // Samples are whole words: see `SampleKind::of`.
        let words = topic.kind().size / size_of::<u64>();
        Self {
            words: vec![0; words].into_boxed_slice(),
        }
    }

    /// Copies a sample of `topic`.
    #[must_use]
    pub fn copy_of(topic: Topic, bytes: &[u8]) -> Self {
        let mut copy = Self::of(topic);
        copy.bytes_mut().copy_from_slice(bytes);
        copy
    }

    /// Returns the sample.
    #[must_use]
    #[inline]
    pub fn bytes(&self) -> &[u8] {
        self.words.as_bytes()
    }

    /// Returns the sample, to be written.
    #[must_use]
    #[inline]
    pub fn bytes_mut(&mut self) -> &mut [u8] {
        self.words.as_mut_bytes()
    }
}
