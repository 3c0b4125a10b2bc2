//! Recorded samples around the replayed tick.

use std::collections::VecDeque;

use host::owned_sample::OwnedSample;
use shared_types::Topic;
use shared_types::service::header_of;

/// Number of samples kept for each topic; every sample that a step may have consumed is among them.
pub(super) const HISTORY: usize = 4096;

/// Recorded samples by topic and sequence number.
pub(super) struct History {
    /// `None` for topics that no replayed service uses.
    topics: [Option<Recorded>; Topic::ALL.len()],
    last_tick: Option<u64>,
    /// Number of samples kept for each topic.
    kept: usize,
}

/// Latest samples of a topic.
#[derive(Default)]
struct Recorded {
    /// In the order of their sequence numbers.
    samples: VecDeque<(u64, OwnedSample)>,
    /// Buffers of removed samples, for reuse.
    free: Vec<OwnedSample>,
}

impl History {
    /// Creates the history of the topics for which `is_used` is true.
    pub(super) fn of(is_used: impl Fn(Topic) -> bool) -> Self {
        Self {
            topics: Topic::ALL.map(|topic| is_used(topic).then(Recorded::default)),
            last_tick: None,
            kept: HISTORY,
        }
    }

    /// Extends the history for steps that are up to `ticks` behind the newest sample.
    pub(super) fn behind_by(mut self, ticks: u64) -> Self {
        // A topic has at most one sample a tick.
        self.kept = HISTORY.saturating_add(usize::try_from(ticks).unwrap_or(usize::MAX));
        self
    }

    pub(super) fn keep(&mut self, topic: Topic, bytes: &[u8]) {
        let header = header_of(bytes);
        self.last_tick = self.last_tick.max(Some(header.tick));
        if let Some(recorded) = &mut self.topics[topic.index()] {
            recorded.keep(topic, header.seq, bytes);
        }
    }

    /// Returns the sample of a sequence number.
    pub(super) fn sample(&self, topic: Topic, seq: u64) -> Option<&[u8]> {
        self.topics[topic.index()].as_ref()?.sample(seq)
    }

    /// Returns the tick of the latest sample of any topic.
    pub(super) fn last_tick(&self) -> Option<u64> {
        self.last_tick
    }

    pub(super) fn remove_old(&mut self) {
        for recorded in self.topics.iter_mut().flatten() {
            recorded.remove_old(self.kept);
        }
    }
}

impl Recorded {
    fn keep(&mut self, topic: Topic, seq: u64, bytes: &[u8]) {
        let mut sample = self.free.pop().unwrap_or_else(|| OwnedSample::zeroed(topic));
        sample.bytes_mut().copy_from_slice(bytes);
        let is_newest = self.samples.back().is_none_or(|(newest, _)| *newest < seq);
        if is_newest {
            self.samples.push_back((seq, sample));
            return;
        }
        match self.position(seq) {
            Ok(position) => self.samples[position].1 = sample,
            Err(position) => self.samples.insert(position, (seq, sample)),
        }
    }

    fn sample(&self, seq: u64) -> Option<&[u8]> {
        let (first, _) = self.samples.front()?;
        let distance = usize::try_from(seq.checked_sub(*first)?).ok()?;
        // The fast path holds unless sequence numbers are missing.
        let position = match self.samples.get(distance) {
            Some((found, _)) if *found == seq => distance,
            _ => self.position(seq).ok()?,
        };
        Some(self.samples[position].1.bytes())
    }

    /// Returns the index of a sequence number, or the index at which to insert it.
    fn position(&self, seq: u64) -> Result<usize, usize> {
        self.samples.binary_search_by_key(&seq, |(kept, _)| *kept)
    }

    fn remove_old(&mut self, kept: usize) {
        while self.samples.len() > kept
            && let Some((_, sample)) = self.samples.pop_front()
        {
            self.free.push(sample);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use shared_types::samples::PathReference;
    use shared_types::{Header, Published};
    use std::collections::BTreeMap;
    use zerocopy::{FromZeros, IntoBytes};

    fn sample(seq: u64, gamma: f64) -> PathReference {
        PathReference {
            header: Header {
                seq,
                tick: seq,
                ..Header::new_zeroed()
            },
            gamma,
            ..PathReference::new_zeroed()
        }
    }

    proptest! {
        /// In whatever order they come, whichever are missing and however often one comes: the newest of a number is found.
        #[test]
        fn samples_are_found_by_their_numbers(
            numbers in proptest::collection::vec(0..60u64, 0..120),
            start in 0..10_000u64,
        ) {
            let topic = PathReference::TOPIC;
            let mut history = History::of(|asked| asked == topic);
            let mut model = BTreeMap::new();
            for (at, number) in numbers.iter().enumerate() {
                let sample = sample(start + number, at as f64);
                history.keep(topic, sample.as_bytes());
                model.insert(start + number, sample);
            }
            for seq in start.saturating_sub(2)..start + 62 {
                let expected = model.get(&seq).map(IntoBytes::as_bytes);
                prop_assert_eq!(history.sample(topic, seq), expected);
            }
            prop_assert_eq!(history.last_tick(), model.keys().next_back().copied());
        }
    }

    #[test]
    fn the_latest_are_kept_and_none_of_what_nobody_asks_for() {
        let topic = PathReference::TOPIC;
        let mut history = History::of(|asked| asked == topic);
        let mut blind = History::of(|asked| asked != topic);
        let count = HISTORY as u64 + 10;
        for seq in 0..count {
            let sample = sample(seq, seq as f64);
            history.keep(topic, sample.as_bytes());
            history.remove_old();
            blind.keep(topic, sample.as_bytes());
        }
        assert_eq!(history.sample(topic, 9), None);
        for seq in [10, 11, count - 1] {
            assert_eq!(
                history.sample(topic, seq),
                Some(sample(seq, seq as f64).as_bytes())
            );
        }
        assert_eq!(blind.sample(topic, count - 1), None);
        assert_eq!(blind.last_tick(), Some(count - 1));
    }
}
