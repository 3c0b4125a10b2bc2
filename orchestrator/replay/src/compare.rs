//! Comparison of replayed with recorded samples.

use std::ops::Range;

use serde_json::Value;
use shared_types::Topic;
use shared_types::service::{header_of, seconds};

use super::history::History;
use run_log::decode_sample;

/// Comparison of the samples of one topic.
#[derive(Clone, Debug, PartialEq)]
pub struct Comparison {
    pub topic: Topic,
    pub compared: u64,
    /// Samples without a recorded counterpart.
    pub unrecorded: u64,
    /// Samples outside of the recorded part of the topic.
    pub left_out: u64,
    pub different: u64,
    pub first: Option<Difference>,
    /// Largest difference of any number, and the time of its sample, s.
    pub largest: Option<(f64, f64)>,
    /// Bytes that are not compared: a recorded sample of an earlier layout has padding there.
    padding: Range<usize>,
}

#[derive(Clone, Debug, PartialEq)]
pub struct Difference {
    pub topic: Topic,
    pub tick: u64,
    pub time: f64,
    /// First field that differs.
    pub field: String,
    pub recorded: Value,
    pub replayed: Value,
}

impl Comparison {
    /// Creates a comparison without samples, of all bytes but those of `padding`.
    #[must_use]
    pub fn new(topic: Topic, padding: Range<usize>) -> Self {
        Self {
            topic,
            compared: 0,
            unrecorded: 0,
            left_out: 0,
            different: 0,
            first: None,
            largest: None,
            padding,
        }
    }

    pub(super) fn compare(&mut self, replayed: &[u8], history: &History) {
        let Some(recorded) = history.sample(self.topic, header_of(replayed).seq) else {
            self.unrecorded += 1;
            return;
        };
        self.compare_with(recorded, replayed);
    }

    /// Returns whether a sample with the sequence number of `replayed` was recorded.
    pub(super) fn has_recorded(&self, replayed: &[u8], history: &History) -> bool {
        history.sample(self.topic, header_of(replayed).seq).is_some()
    }

    /// Returns whether this sample was recorded with equal bytes.
    pub(super) fn is_recorded(&self, replayed: &[u8], history: &History) -> bool {
        let recorded = history.sample(self.topic, header_of(replayed).seq);
        recorded.is_some_and(|recorded| self.first_different_byte(recorded, replayed).is_none())
    }

    /// Compares two samples of the topic; the recorded one, or that of the first log, comes first.
    pub fn compare_with(&mut self, recorded: &[u8], replayed: &[u8]) {
        self.compared += 1;
        if let Some(place) = self.first_different_byte(recorded, replayed) {
            self.note(place, recorded, replayed);
        }
    }

    fn first_different_byte(&self, recorded: &[u8], replayed: &[u8]) -> Option<usize> {
        if recorded == replayed {
            return None;
        }
        let mut pairs = recorded.iter().zip(replayed).enumerate();
        let differs = |place, one: &u8, other: &u8| one != other && !self.padding.contains(&place);
        pairs.find_map(|(place, (one, other))| differs(place, one, other).then_some(place))
    }

    #[cold]
    fn note(&mut self, place: usize, recorded: &[u8], replayed: &[u8]) {
        self.different += 1;
        let header = header_of(recorded);
        let time = seconds(header.stamp_ns);
        let distance = self.distance(recorded, replayed);
        if self.largest.is_none_or(|(largest, _)| distance > largest) {
            self.largest = Some((distance, time));
        }
        if self.first.is_none() {
            let (field, recorded, replayed) = values_at(self.topic, place, recorded, replayed);
            self.first = Some(Difference {
                topic: self.topic,
                tick: header.tick,
                time,
                field,
                recorded,
                replayed,
            });
        }
    }

    /// Returns the largest difference of the numbers in two samples.
    fn distance(&self, a: &[u8], b: &[u8]) -> f64 {
        let members = self.topic.members().into_iter();
        let numbers = members.filter_map(|node| node.numbers(None)).flat_map(|range| {
            let read = |bytes: &[u8]| {
                let numbers = bytes[range.clone()].chunks_exact(size_of::<f64>());
                let numbers = numbers.map(|bytes| f64::from_le_bytes(bytes.try_into().expect("eight bytes")));
                numbers.collect::<Vec<_>>()
            };
            let (a, b) = (read(a), read(b));
            a.into_iter().zip(b).map(|(a, b)| (a - b).abs())
        });
        numbers.fold(0.0, f64::max)
    }
}

/// Returns the member at a differing byte, and both values, which may compare as equal, like 0 and −0.
fn values_at(topic: Topic, place: usize, recorded: &[u8], replayed: &[u8]) -> (String, Value, Value) {
    let members = topic.members().into_iter();
    let before = members.take_while(|node| node.offset <= place);
    let field = before.last().map_or("", |node| node.name);
    let [recorded, replayed] = [recorded, replayed].map(|bytes| decode_sample(topic, bytes));
    let value = |sample: &Value| sample.get(field).cloned().unwrap_or_default();
    (field.to_owned(), value(&recorded), value(&replayed))
}
