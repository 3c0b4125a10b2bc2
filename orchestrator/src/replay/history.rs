//! The recorded samples around the tick that is replayed.

use std::collections::BTreeMap;

use shared_types::Topic;
use shared_types::service::header_of;
use zerocopy::IntoBytes;

/// Samples of a topic that are kept: any that a step may have seen is among the latest before it.
const KEPT: usize = 4096;

/// Samples by topic and sequence number.
#[derive(Default)]
pub(super) struct History {
    topics: [BTreeMap<u64, Recorded>; Topic::ALL.len()],
    last_tick: Option<u64>,
}

/// A sample, in whole words: it is read in place.
struct Recorded {
    words: Box<[u64]>,
    size: usize,
}

impl History {
    pub(super) fn keep(&mut self, topic: Topic, bytes: &[u8]) {
        let header = header_of(bytes);
        let mut words = vec![0; bytes.len().div_ceil(size_of::<u64>())].into_boxed_slice();
        words.as_mut_bytes()[..bytes.len()].copy_from_slice(bytes);
        let recorded = Recorded {
            words,
            size: bytes.len(),
        };
        self.topics[topic.index()].insert(header.seq, recorded);
        self.last_tick = self.last_tick.max(Some(header.tick));
    }

    /// The sample of a sequence number.
    pub(super) fn sample(&self, topic: Topic, seq: u64) -> Option<&[u8]> {
        let recorded = self.topics[topic.index()].get(&seq)?;
        Some(&recorded.words.as_bytes()[..recorded.size])
    }

    /// Tick of the latest sample.
    pub(super) fn last_tick(&self) -> Option<u64> {
        self.last_tick
    }

    pub(super) fn forget_old(&mut self) {
        for samples in &mut self.topics {
            while samples.len() > KEPT {
                samples.pop_first();
            }
        }
    }
}
