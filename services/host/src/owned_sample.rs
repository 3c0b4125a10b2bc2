//! Sample in separate memory: whole words, because samples are read in place.

use shared_types::Topic;
use zerocopy::IntoBytes;

/// Place of one sample of a topic, laid out once.
#[derive(Clone, Debug)]
pub struct OwnedSample {
    words: Box<[u64]>,
    /// Size of the sample, bytes.
    size: usize,
}

impl OwnedSample {
    /// Makes a place for samples of `topic`; zeroed.
    #[must_use]
    pub fn of(topic: Topic) -> Self {
        let size = topic.kind().size;
        Self {
            words: vec![0; size.div_ceil(size_of::<u64>())].into_boxed_slice(),
            size,
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
        &self.words.as_bytes()[..self.size]
    }

    /// Returns the sample, to be written.
    #[must_use]
    #[inline]
    pub fn bytes_mut(&mut self) -> &mut [u8] {
        &mut self.words.as_mut_bytes()[..self.size]
    }
}
