//! Compares two logs, sample by sample: those of equal topic and tick.

use std::collections::BTreeMap;
use std::path::Path;

use shared_types::Topic;

use crate::Comparison;
use run_log::{LogReadError, LogReader, topics_of};

/// Samples of a log that wait for their counterparts at most: in real time those of a tick may be logged a little later.
const WAITING: usize = 16_384;

/// One topic in two logs.
#[derive(Clone, Debug, PartialEq)]
pub struct TopicDiff {
    /// The samples that both have.
    pub comparison: Comparison,
    /// Samples that only one of them has: the first, the second.
    pub lonely: [u64; 2],
}

impl TopicDiff {
    /// Returns whether both logs have the same samples.
    #[must_use]
    pub fn is_identical(&self) -> bool {
        self.comparison.different == 0 && self.lonely == [0, 0]
    }
}

/// Compares two logs.
///
/// # Errors
/// [`LogReadError`] of either log.
pub fn diff(first: &Path, second: &Path) -> Result<Vec<TopicDiff>, LogReadError> {
    let mut sides = [Side::open(first)?, Side::open(second)?];
    let mut topics = Topic::ALL.map(|topic| TopicDiff {
        comparison: Comparison::new(topic),
        lonely: [0, 0],
    });
    // The log that is behind goes on.
    while let Some(at) = (0..2)
        .filter(|&at| !sides[at].has_ended)
        .min_by_key(|&at| sides[at].tick)
    {
        let Some(place) = sides[at].read()? else {
            continue;
        };
        if sides[1 - at].waiting.contains_key(&place) {
            let [first, second] = &mut sides;
            let pair = first.waiting.remove(&place).zip(second.waiting.remove(&place));
            if let Some((first, second)) = pair {
                topics[place.1].comparison.compare_with(&first, &second);
            }
        }
        sides[at].give_up_above(WAITING, |topic| topics[topic].lonely[at] += 1);
    }
    for (at, side) in sides.iter_mut().enumerate() {
        side.give_up_above(0, |topic| topics[topic].lonely[at] += 1);
    }
    let has_topic = |topic| {
        let mut scenarios = sides.iter().map(|side| &side.reader.manifest().scenario);
        scenarios.any(|scenario| topics_of(scenario).any(|other| other == topic))
    };
    let topics = topics.into_iter();
    Ok(topics.filter(|topic| has_topic(topic.comparison.topic)).collect())
}

/// Tick and position of the topic of a sample.
type Place = (u64, usize);

/// One of the logs.
struct Side {
    reader: LogReader,
    /// Tick of the last sample that was read.
    tick: u64,
    has_ended: bool,
    /// Samples to which the other log has had no counterpart yet.
    waiting: BTreeMap<Place, Vec<u8>>,
}

impl Side {
    fn open(path: &Path) -> Result<Self, LogReadError> {
        Ok(Self {
            reader: LogReader::open(path)?,
            tick: 0,
            has_ended: false,
            waiting: BTreeMap::new(),
        })
    }

    /// Takes the next sample; none at the end.
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

    /// Gives up waiting for the counterparts of the oldest samples beyond so many.
    fn give_up_above(&mut self, limit: usize, mut lonely: impl FnMut(usize)) {
        while self.waiting.len() > limit
            && let Some(((_, topic), _)) = self.waiting.pop_first()
        {
            lonely(topic);
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
            assert_eq!(diff.lonely, [u64::from(topic == Topic::MocapPose), 0]);
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
                .all(|topic| topic.lonely == [101, 0] && topic.comparison.compared == 100)
        );
    }
}
