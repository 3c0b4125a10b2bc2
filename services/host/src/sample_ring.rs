//! Ring of the latest samples of a topic, by their number in the sequence, in memory that is allocated once.

use shared_types::Topic;

use crate::owned_sample::OwnedSample;

/// A ring of samples of one topic.
#[derive(Clone, Debug)]
pub struct SampleRing {
    /// The length is a power of two.
    samples: Box<[OwnedSample]>,
}

impl SampleRing {
    /// Makes a ring that holds the latest `depth` samples of `topic`, or more.
    ///
    /// # Panics
    /// If the samples exceed the address space.
    #[must_use]
    pub fn new(topic: Topic, depth: u64) -> Self {
        let samples =
            usize::try_from(depth.next_power_of_two()).expect("the samples fit into the address space");
        Self {
            samples: vec![OwnedSample::zeroed(topic); samples].into_boxed_slice(),
        }
    }

    /// Returns the capacity.
    #[must_use]
    #[inline]
    pub fn depth(&self) -> u64 {
        self.samples.len() as u64
    }

    /// Returns the sample with a number in the sequence, if it was written and not overwritten since.
    #[must_use]
    #[inline]
    pub fn at(&self, number: u64) -> &[u8] {
        self.samples[self.index_of(number)].bytes()
    }

    /// Returns the memory for the sample with a number in the sequence.
    #[must_use]
    #[inline]
    pub fn at_mut(&mut self, number: u64) -> &mut [u8] {
        let index = self.index_of(number);
        self.samples[index].bytes_mut()
    }

    /// Stores the sample with a number in the sequence, in exchange for the one that it overwrites.
    #[inline]
    pub fn swap(&mut self, number: u64, sample: &mut OwnedSample) {
        let index = self.index_of(number);
        std::mem::swap(&mut self.samples[index], sample);
    }

    #[inline]
    #[expect(clippy::cast_possible_truncation, reason = "the mask keeps only low bits")]
    fn index_of(&self, number: u64) -> usize {
        number as usize & (self.samples.len() - 1)
    }
}
