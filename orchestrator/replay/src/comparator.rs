//! Comparison with the recorded samples, where several steps of one tick may have published the recorded sample.
//!
//! A process that dies while it publishes may have published a sample or not. Its successor may repeat the tick, and of
//! two samples of one tick the first counts. So the recorded sample is that of the first finished step, or of an
//! unfinished one before it.

use std::ops::Range;

use host::owned_sample::OwnedSample;
use scenario::Recorded;
use shared_types::Topic;
use shared_types::service::header_of;

use super::compare::Comparison;
use super::history::History;

/// Compares the samples and the states of a service's steps with the recorded ones.
pub(super) struct Comparator {
    topics: Vec<TopicComparator>,
    /// Number of compared checkpoints.
    pub(super) checkpoints: u64,
    pub(super) checkpoints_different: u64,
    /// Tick of the first step whose state differs from its checkpoint.
    pub(super) first_different_after: Option<u64>,
}

impl Comparator {
    /// Creates the comparator for the topics that the service publishes, in the order of the wiring table, with their
    /// recorded parts and the bytes of a sample that are not compared.
    pub(super) fn new(topics: impl IntoIterator<Item = (Topic, Recorded, Range<usize>)>) -> Self {
        let topics = topics
            .into_iter()
            .map(|(topic, recorded, padding)| TopicComparator::new(topic, recorded, padding));
        Self {
            topics: topics.collect(),
            checkpoints: 0,
            checkpoints_different: 0,
            first_different_after: None,
        }
    }

    /// Compares a sample that a step publishes. An unfinished step may not have published it.
    pub(super) fn compare(&mut self, output: usize, replayed: &[u8], is_finished: bool, history: &History) {
        self.topics[output].compare(replayed, is_finished, history);
    }

    /// Compares the state after the step at `tick` with its checkpoint.
    pub(super) fn compare_checkpoint(&mut self, tick: u64, replayed: &[u8], recorded: &[u8]) {
        self.checkpoints += 1;
        if replayed != recorded {
            self.checkpoints_different += 1;
            self.first_different_after.get_or_insert(tick);
        }
    }

    /// Ends a tick: none of its steps follow.
    pub(super) fn end_tick(&mut self, history: &History) {
        for topic in &mut self.topics {
            topic.end_tick(history);
        }
    }

    pub(super) fn into_comparisons(self) -> impl Iterator<Item = Comparison> {
        self.topics.into_iter().map(TopicComparator::into_comparison)
    }
}

/// Compares the samples of a tick on one topic with the recorded one.
struct TopicComparator {
    comparison: Comparison,
    recorded: Recorded,
    /// `true` if the comparison for the recorded sample of the tick is decided.
    is_settled: bool,
    /// Sample of the last unfinished step, which may not have been published and differs from the recorded one.
    unconfirmed: Option<OwnedSample>,
}

impl TopicComparator {
    fn new(topic: Topic, recorded: Recorded, padding: Range<usize>) -> Self {
        Self {
            comparison: Comparison::new(topic, padding),
            recorded,
            is_settled: false,
            unconfirmed: None,
        }
    }

    fn into_comparison(self) -> Comparison {
        self.comparison
    }

    /// Compares a sample that a step publishes. An unfinished step may not have published it.
    fn compare(&mut self, replayed: &[u8], is_finished: bool, history: &History) {
        if self.is_settled {
            return;
        }
        if !self.recorded.has(header_of(replayed).seq) {
            self.comparison.left_out += 1;
            self.is_settled = true;
            return;
        }
        if is_finished || self.comparison.is_recorded(replayed, history) {
            self.comparison.compare(replayed, history);
            self.is_settled = true;
            self.unconfirmed = None;
        } else {
            self.unconfirmed = Some(OwnedSample::copy_of(self.comparison.topic, replayed));
        }
    }

    /// Ends a tick: if no other step has published the recorded sample, the unfinished one has.
    fn end_tick(&mut self, history: &History) {
        self.is_settled = false;
        if let Some(sample) = self.unconfirmed.take()
            && self.comparison.has_recorded(sample.bytes(), history)
        {
            self.comparison.compare(sample.bytes(), history);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use shared_types::samples::PathReference;
    use shared_types::{Header, Published};
    use zerocopy::{FromZeros, IntoBytes};

    fn sample(gamma: f64) -> PathReference {
        let header = Header {
            seq: 1,
            ..Header::new_zeroed()
        };
        PathReference {
            header,
            gamma,
            ..PathReference::new_zeroed()
        }
    }

    /// Compared, unrecorded and different samples of a tick with such steps, of which `recorded` was.
    fn judged(recorded: Option<f64>, steps: &[(f64, bool)]) -> (u64, u64, u64) {
        let mut history = History::of(|_| true);
        if let Some(gamma) = recorded {
            history.keep(PathReference::TOPIC, sample(gamma).as_bytes());
        }
        let mut topic = TopicComparator::new(PathReference::TOPIC, Recorded::All, 0..0);
        for (gamma, is_finished) in steps {
            topic.compare(sample(*gamma).as_bytes(), *is_finished, &history);
        }
        topic.end_tick(&history);
        let found = topic.into_comparison();
        (found.compared, found.unrecorded, found.different)
    }

    #[test]
    fn the_first_finished_step_or_one_before_it_made_what_was_recorded() {
        assert_eq!(judged(Some(1.0), &[(1.0, true)]), (1, 0, 0));
        assert_eq!(judged(Some(1.0), &[(1.0, true), (2.0, true)]), (1, 0, 0));
        assert_eq!(judged(Some(1.0), &[(1.0, false), (2.0, true)]), (1, 0, 0));
        assert_eq!(judged(Some(2.0), &[(1.0, false), (2.0, true)]), (1, 0, 0));
        assert_eq!(judged(Some(3.0), &[(1.0, false), (2.0, true)]), (1, 0, 1));
        assert_eq!(judged(Some(2.0), &[(1.0, true), (2.0, true)]), (1, 0, 1));
    }

    #[test]
    fn what_nobody_finished_may_have_been_published_or_not() {
        assert_eq!(judged(Some(1.0), &[(1.0, false)]), (1, 0, 0));
        assert_eq!(judged(None, &[(1.0, false)]), (0, 0, 0));
        assert_eq!(judged(Some(2.0), &[(1.0, false)]), (1, 0, 1));
        assert_eq!(judged(None, &[(1.0, true)]), (0, 1, 0));
    }
}
