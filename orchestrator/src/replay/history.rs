//! The recorded samples around the tick that is replayed.

use std::collections::BTreeMap;

use runtime::owned_sample::OwnedSample;
use shared_types::Topic;
use shared_types::service::header_of;

/// Samples of a topic that are kept: any that a step may have seen is among the latest before it.
pub(super) const KEPT: usize = 4096;

/// Samples by topic and sequence number.
#[derive(Default)]
pub(super) struct History {
    topics: [BTreeMap<u64, OwnedSample>; Topic::ALL.len()],
    last_tick: Option<u64>,
}

impl History {
    pub(super) fn keep(&mut self, topic: Topic, bytes: &[u8]) {
        let header = header_of(bytes);
        let sample = OwnedSample::copy_of(topic, bytes);
        self.topics[topic.index()].insert(header.seq, sample);
        self.last_tick = self.last_tick.max(Some(header.tick));
    }

    /// The sample of a sequence number.
    pub(super) fn sample(&self, topic: Topic, seq: u64) -> Option<&[u8]> {
        self.topics[topic.index()].get(&seq).map(OwnedSample::bytes)
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
