//! Comparison of two logs, sample by sample of equal topic and tick.

use std::collections::BTreeMap;
use std::path::Path;

use shared_types::Topic;

use crate::Comparison;
use run_log::{LogReadError, LogReader, topics_of};

/// Maximum number of samples that wait for their counterparts: in real time, those of a tick may be logged a little
/// later.
const MAX_UNMATCHED: usize = 16_384;

/// Comparison of one topic in two logs.
#[derive(Clone, Debug, PartialEq)]
pub struct TopicDiff {
    /// Samples that both logs have.
    pub comparison: Comparison,
    /// Number of samples that only the first or only the second log has.
    pub unmatched: [u64; 2],
}

impl TopicDiff {
    /// Returns whether both logs have the same samples.
    #[must_use]
    pub fn is_identical(&self) -> bool {
        self.comparison.different == 0 && self.unmatched == [0, 0]
    }
}

/// Compares the samples of two logs.
///
/// # Errors
/// Error of either log.
pub fn diff(first: &Path, second: &Path) -> Result<Vec<TopicDiff>, LogReadError> {
    let mut logs = [Log::open(first)?, Log::open(second)?];
    let mut topics = Topic::ALL.map(|topic| {
        let mut paddings = logs.iter().map(|log| log.reader.manifest().padding(topic));
        let padding = paddings.find(|padding| !padding.is_empty());
        TopicDiff {
            comparison: Comparison::new(topic, padding.unwrap_or_default()),
            unmatched: [0, 0],
        }
    });
    // The log with the lower tick is read next.
    while let Some(at) = (0..2)
        .filter(|&at| !logs[at].has_ended)
        .min_by_key(|&at| logs[at].tick)
    {
        let Some(place) = logs[at].read()? else {
            continue;
        };
        if logs[1 - at].waiting.contains_key(&place) {
            let [first, second] = &mut logs;
            let pair = first.waiting.remove(&place).zip(second.waiting.remove(&place));
            if let Some((first, second)) = pair {
                topics[place.1].comparison.compare_with(&first, &second);
            }
        }
        logs[at].drop_above(MAX_UNMATCHED, |topic| topics[topic].unmatched[at] += 1);
    }
    for (at, log) in logs.iter_mut().enumerate() {
        log.drop_above(0, |topic| topics[topic].unmatched[at] += 1);
    }
    let has_topic = |topic| {
        let mut scenarios = logs.iter().map(|log| &log.reader.manifest().scenario);
        scenarios.any(|scenario| topics_of(scenario).any(|other| other == topic))
    };
    let topics = topics.into_iter();
    Ok(topics.filter(|topic| has_topic(topic.comparison.topic)).collect())
}

/// Tick of a sample, and index of its topic.
type Place = (u64, usize);

struct Log {
    reader: LogReader,
    /// Tick of the last sample.
    tick: u64,
    has_ended: bool,
    /// Samples without a counterpart so far.
    waiting: BTreeMap<Place, Vec<u8>>,
}

impl Log {
    fn open(path: &Path) -> Result<Self, LogReadError> {
        Ok(Self {
            reader: LogReader::open(path)?,
            tick: 0,
            has_ended: false,
            waiting: BTreeMap::new(),
        })
    }

    /// Reads the next sample and returns its key; `None` at the end.
    fn read(&mut self) -> Result<Option<Place>, LogReadError> {
        let Some(sample) = self.reader.next_sample()? else {
            self.has_ended = true;
            return Ok(None);
        };
        let place = (sample.header.tick, sample.topic.index());
        self.tick = place.0;
        self.waiting.insert(place, sample.bytes.to_vec());
        Ok(Some(place))
    }

    /// Drops the oldest samples above `limit` as unmatched.
    fn drop_above(&mut self, limit: usize, mut unmatched: impl FnMut(usize)) {
        while self.waiting.len() > limit
            && let Some(((_, topic), _)) = self.waiting.pop_first()
        {
            unmatched(topic);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use run_log::Compression;
    use run_log::test_flight::{record, record_samples, samples, scenario};

    fn two_logs(change: impl Fn(Topic, u64, &mut Vec<u8>) -> bool) -> Vec<TopicDiff> {
        let folder = tempfile::tempdir().unwrap();
        let [first, second] = ["first.mcap", "second.mcap"].map(|name| folder.path().join(name));
        let scenario = scenario(0.01, 2.0);
        let schedule = scenario.schedule().unwrap();
        record(&first, &scenario, Compression::Zstd);
        let changed = samples(&schedule).filter_map(|(topic, mut bytes)| {
            let tick = shared_types::service::header_of(&bytes).tick;
            change(topic, tick, &mut bytes).then_some((topic, bytes))
        });
        record_samples(&second, &scenario, Compression::None, changed);
        diff(&first, &second).unwrap()
    }

    #[test]
    fn logs_of_the_same_samples_are_identical_however_they_are_compressed() {
        let topics = two_logs(|_, _, _| true);
        assert!(
            topics
                .iter()
                .all(|topic| topic.is_identical() && topic.comparison.compared == 201)
        );
    }

    #[test]
    fn a_changed_and_a_missing_sample_are_told_apart() {
        let topics = two_logs(|topic, tick, bytes| {
            if (topic, tick) == (Topic::RcFrame, 17) {
                *bytes.last_mut().unwrap() ^= 1;
            }
            (topic, tick) != (Topic::MocapPose, 5)
        });
        for diff in &topics {
            let topic = diff.comparison.topic;
            assert_eq!(diff.comparison.different, u64::from(topic == Topic::RcFrame));
            assert_eq!(diff.unmatched, [u64::from(topic == Topic::MocapPose), 0]);
        }
        let first = topics[Topic::RcFrame.index()].comparison.first.as_ref().unwrap();
        assert_eq!((first.tick, first.field.as_str()), (17, "pad0"));
    }

    #[test]
    fn what_a_shorter_log_has_not_is_counted() {
        let topics = two_logs(|_, tick, _| tick < 100);
        assert!(
            topics
                .iter()
                .all(|topic| topic.unmatched == [101, 0] && topic.comparison.compared == 100)
        );
    }
}
