//! Sample in private memory, aligned to words, because samples are read in place.

use shared_types::Topic;
use zerocopy::IntoBytes;

/// Memory of one sample of a topic.
#[derive(Clone, Debug)]
pub struct OwnedSample {
    words: Box<[u64]>,
}

impl OwnedSample {
    /// Makes a zeroed sample of `topic`.
    #[must_use]
    pub fn zeroed(topic: Topic) -> Self {
        // Samples are whole words: see `SampleKind::of`.
        let words = topic.kind().size / size_of::<u64>();
        Self {
            words: vec![0; words].into_boxed_slice(),
        }
    }

    /// Copies a sample of `topic`.
    #[must_use]
    pub fn copy_of(topic: Topic, bytes: &[u8]) -> Self {
        let mut copy = Self::zeroed(topic);
        copy.bytes_mut().copy_from_slice(bytes);
        copy
    }

    /// Returns the sample.
    #[must_use]
    #[inline]
    pub fn bytes(&self) -> &[u8] {
        self.words.as_bytes()
    }

    /// Returns the sample for writing.
    #[must_use]
    #[inline]
    pub fn bytes_mut(&mut self) -> &mut [u8] {
        self.words.as_mut_bytes()
    }
}
