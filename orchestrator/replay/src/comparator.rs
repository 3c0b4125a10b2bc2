//! The recorded samples of a topic at a tick, where several steps of that tick may have published it.
//!
//! A process that dies in the middle of publishing may have published a sample or not. Who takes its place may do the
//! tick again, and of two samples of one tick the first counts. So what was recorded is that of the first step which was
//! finished, or of one before it.

use host::owned_sample::OwnedSample;
use scenario::Recorded;
use shared_types::Topic;
use shared_types::service::header_of;

use super::compare::Comparison;
use super::history::History;

/// Compares what the steps of a service publish, and what it knows after some of them, with what was recorded.
pub(super) struct Comparator {
    judges: Vec<Judge>,
    /// Number of times that what it knows was compared.
    pub(super) checkpoints: u64,
    pub(super) checkpoints_different: u64,
    /// Tick of the first step after which the service knew something else than is recorded.
    pub(super) first_different_after: Option<u64>,
}

impl Comparator {
    /// One judge a topic that the service publishes, in the order of the wiring table, and how much of it was recorded.
    pub(super) fn new(topics: impl IntoIterator<Item = (Topic, Recorded)>) -> Self {
        let judges = topics
            .into_iter()
            .map(|(topic, recorded)| Judge::new(topic, recorded));
        Self {
            judges: judges.collect(),
            checkpoints: 0,
            checkpoints_different: 0,
            first_different_after: None,
        }
    }

    /// Hears what a step publishes on an output; if it was not finished, perhaps.
    pub(super) fn hear(&mut self, output: usize, replayed: &[u8], is_finished: bool, history: &History) {
        self.judges[output].hear(replayed, is_finished, history);
    }

    /// Hears what the service knows after its step at `tick`, and what it is recorded to have known.
    pub(super) fn hear_state(&mut self, tick: u64, replayed: &[u8], recorded: &[u8]) {
        self.checkpoints += 1;
        if replayed != recorded {
            self.checkpoints_different += 1;
            self.first_different_after.get_or_insert(tick);
        }
    }

    /// No more steps of the tick follow.
    pub(super) fn end_tick(&mut self, history: &History) {
        for judge in &mut self.judges {
            judge.end_tick(history);
        }
    }

    /// Returns the findings.
    pub(super) fn into_comparisons(self) -> impl Iterator<Item = Comparison> {
        self.judges.into_iter().map(Judge::into_comparison)
    }
}

/// Compares what the steps of a tick publish on one topic with what was recorded.
struct Judge {
    comparison: Comparison,
    recorded: Recorded,
    /// `true` if the recorded sample of the tick has been accounted for.
    is_settled: bool,
    /// A sample of the last step that may not have been published, and that is not what was recorded.
    doubtful: Option<OwnedSample>,
}

impl Judge {
    fn new(topic: Topic, recorded: Recorded) -> Self {
        Self {
            comparison: Comparison::new(topic),
            recorded,
            is_settled: false,
            doubtful: None,
        }
    }

    fn into_comparison(self) -> Comparison {
        self.comparison
    }

    /// Hears what a step publishes; if it was not finished, perhaps.
    fn hear(&mut self, replayed: &[u8], is_finished: bool, history: &History) {
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
            self.doubtful = None;
        } else {
            self.doubtful = Some(OwnedSample::copy_of(self.comparison.topic, replayed));
        }
    }

    /// No more steps of the tick follow: what was recorded can be nothing else.
    fn end_tick(&mut self, history: &History) {
        self.is_settled = false;
        if let Some(sample) = self.doubtful.take()
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
        let mut judge = Judge::new(PathReference::TOPIC, Recorded::All);
        for (gamma, is_finished) in steps {
            judge.hear(sample(*gamma).as_bytes(), *is_finished, &history);
        }
        judge.end_tick(&history);
        let found = judge.into_comparison();
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
