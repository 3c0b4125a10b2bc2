//! Ring of the latest samples of a topic, by their place in its sequence, in memory that is allocated once.

use shared_types::Topic;
use zerocopy::IntoBytes;

/// A ring of samples of one topic.
#[derive(Clone, Debug)]
pub struct SampleRing {
    /// One sample after the other, in whole words, because samples are read in place.
    words: Box<[u64]>,
    /// Size of a sample, words.
    size: usize,
    /// Number of samples, a power of two, minus one.
    mask: u64,
}

impl SampleRing {
    /// Makes a ring that holds the latest `depth` samples of `topic`, or more.
    ///
    /// # Panics
    /// If that is more memory than can be addressed.
    #[must_use]
    pub fn new(topic: Topic, depth: u64) -> Self {
        // Samples are whole words: see `SampleKind::of`.
        let size = topic.kind().size / size_of::<u64>();
        let depth = depth.next_power_of_two();
        let samples = usize::try_from(depth).expect("that many samples can be addressed");
        Self {
            words: vec![0; samples * size].into_boxed_slice(),
            size,
            mask: depth - 1,
        }
    }

    /// Returns the number of samples that it holds.
    #[must_use]
    #[inline]
    pub fn depth(&self) -> u64 {
        self.mask + 1
    }

    /// Returns the sample of a place in the sequence, if it has been written and not been overwritten since.
    #[must_use]
    #[inline]
    pub fn at(&self, place: u64) -> &[u8] {
        let first = self.first_word_of(place);
        self.words[first..first + self.size].as_bytes()
    }

    /// Returns the memory for the sample of a place in the sequence.
    #[must_use]
    #[inline]
    pub fn at_mut(&mut self, place: u64) -> &mut [u8] {
        let first = self.first_word_of(place);
        self.words[first..first + self.size].as_mut_bytes()
    }

    #[inline]
    fn first_word_of(&self, place: u64) -> usize {
        usize::try_from(place & self.mask).expect("below the depth") * self.size
    }
}
