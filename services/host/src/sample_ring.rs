//! Ring of the latest samples of a topic, by their place in its sequence, in memory that is allocated once.

use shared_types::Topic;

use crate::owned_sample::OwnedSample;

/// A ring of samples of one topic.
#[derive(Clone, Debug)]
pub struct SampleRing {
    /// As many as a power of two.
    samples: Box<[OwnedSample]>,
}

impl SampleRing {
    /// Makes a ring that holds the latest `depth` samples of `topic`, or more.
    ///
    /// # Panics
    /// If that is more memory than can be addressed.
    #[must_use]
    pub fn new(topic: Topic, depth: u64) -> Self {
        let samples = usize::try_from(depth.next_power_of_two()).expect("that many samples can be addressed");
        Self {
            samples: vec![OwnedSample::of(topic); samples].into_boxed_slice(),
        }
    }

    /// Returns the number of samples that it holds.
    #[must_use]
    #[inline]
    pub fn depth(&self) -> u64 {
        self.samples.len() as u64
    }

    /// Returns the sample of a place in the sequence, if it has been written and not been overwritten since.
    #[must_use]
    #[inline]
    pub fn at(&self, place: u64) -> &[u8] {
        self.samples[self.index_of(place)].bytes()
    }

    /// Returns the memory for the sample of a place in the sequence.
    #[must_use]
    #[inline]
    pub fn at_mut(&mut self, place: u64) -> &mut [u8] {
        let index = self.index_of(place);
        self.samples[index].bytes_mut()
    }

    /// Takes the sample of a place in the sequence, in exchange for the one that it overwrites.
    #[inline]
    pub fn swap(&mut self, place: u64, sample: &mut OwnedSample) {
        let index = self.index_of(place);
        std::mem::swap(&mut self.samples[index], sample);
    }

    #[inline]
    #[expect(
        clippy::cast_possible_truncation,
        reason = "what is masked away does not matter"
    )]
    fn index_of(&self, place: u64) -> usize {
        place as usize & (self.samples.len() - 1)
    }
}
