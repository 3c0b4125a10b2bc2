//! The latest samples of a topic, by their place in its sequence, in memory that is laid out once.

use shared_types::Topic;

use crate::owned_sample::OwnedSample;

/// A ring of samples of one topic.
#[derive(Debug)]
pub struct SampleRing {
    /// A power of two of them.
    slots: Vec<OwnedSample>,
}

impl SampleRing {
    /// A ring that holds the latest `depth` samples of `topic`, or more.
    #[must_use]
    pub fn new(topic: Topic, depth: u64) -> Self {
        let slots = (0..depth.next_power_of_two()).map(|_| OwnedSample::of(topic));
        Self {
            slots: slots.collect(),
        }
    }

    /// How many samples it holds.
    #[must_use]
    #[inline]
    pub fn depth(&self) -> u64 {
        self.slots.len() as u64
    }

    /// The sample of a place in the sequence, if it has been written and not been overwritten since.
    #[must_use]
    #[inline]
    pub fn at(&self, place: u64) -> &[u8] {
        self.slots[self.slot_of(place)].bytes()
    }

    /// Where the sample of a place in the sequence is written.
    #[must_use]
    #[inline]
    pub fn at_mut(&mut self, place: u64) -> &mut [u8] {
        let slot = self.slot_of(place);
        self.slots[slot].bytes_mut()
    }

    #[inline]
    fn slot_of(&self, place: u64) -> usize {
        // The depth is a power of two.
        usize::try_from(place & (self.depth() - 1)).expect("below the depth")
    }
}
