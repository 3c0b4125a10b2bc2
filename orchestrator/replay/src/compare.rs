//! The samples of a service in a replay against those that were recorded.

use serde_json::Value;
use shared_types::Topic;
use shared_types::service::{header_of, seconds};

use super::history::History;
use run_log::decode_sample;

/// The samples of one topic, compared.
#[derive(Clone, Debug, PartialEq)]
pub struct Comparison {
    /// The topic.
    pub topic: Topic,
    /// Samples that were compared.
    pub compared: u64,
    /// Samples of which none was recorded.
    pub unrecorded: u64,
    /// Samples that do not belong into the log, which has a part of the topic only.
    pub left_out: u64,
    /// Samples that differ.
    pub different: u64,
    /// The first of them.
    pub first: Option<Difference>,
    /// The largest difference of any number, and the time of its sample, s.
    pub largest: Option<(f64, f64)>,
}

/// The first sample that differs.
#[derive(Clone, Debug, PartialEq)]
pub struct Difference {
    /// Its topic.
    pub topic: Topic,
    /// Its tick.
    pub tick: u64,
    /// Time of the tick, s.
    pub time: f64,
    /// The first member that differs.
    pub field: String,
    /// Its recorded value.
    pub recorded: Value,
    /// Its replayed value.
    pub replayed: Value,
}

impl Comparison {
    /// Nothing compared yet.
    #[must_use]
    pub fn new(topic: Topic) -> Self {
        Self {
            topic,
            compared: 0,
            unrecorded: 0,
            left_out: 0,
            different: 0,
            first: None,
            largest: None,
        }
    }

    pub(super) fn compare(&mut self, replayed: &[u8], history: &History) {
        let Some(recorded) = history.sample(self.topic, header_of(replayed).seq) else {
            self.unrecorded += 1;
            return;
        };
        self.compare_with(recorded, replayed);
    }

    /// Returns whether a sample of the tick of `replayed` was recorded.
    pub(super) fn has_recorded(&self, replayed: &[u8], history: &History) -> bool {
        history.sample(self.topic, header_of(replayed).seq).is_some()
    }

    /// Returns whether this very sample was recorded.
    pub(super) fn is_recorded(&self, replayed: &[u8], history: &History) -> bool {
        history.sample(self.topic, header_of(replayed).seq) == Some(replayed)
    }

    /// Compares two samples of the topic, the recorded one or that of the first log first.
    pub fn compare_with(&mut self, recorded: &[u8], replayed: &[u8]) {
        self.compared += 1;
        if recorded != replayed {
            self.note(recorded, replayed);
        }
    }

    #[cold]
    fn note(&mut self, recorded: &[u8], replayed: &[u8]) {
        self.different += 1;
        let header = header_of(recorded);
        let time = seconds(header.stamp_ns);
        let distance = self.distance(recorded, replayed);
        if self.largest.is_none_or(|(largest, _)| distance > largest) {
            self.largest = Some((distance, time));
        }
        if self.first.is_none() {
            let (field, recorded, replayed) = first_difference(self.topic, recorded, replayed);
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

    /// The largest difference of any number of two samples.
    fn distance(&self, a: &[u8], b: &[u8]) -> f64 {
        let members = self.topic.members().into_iter();
        let numbers = members
            .filter_map(|member| member.numbers(None))
            .flat_map(|range| {
                let read = |bytes: &[u8]| {
                    let numbers = bytes[range.clone()].chunks_exact(size_of::<f64>());
                    let numbers =
                        numbers.map(|bytes| f64::from_le_bytes(bytes.try_into().expect("eight bytes")));
                    numbers.collect::<Vec<_>>()
                };
                let (a, b) = (read(a), read(b));
                a.into_iter().zip(b).map(|(a, b)| (a - b).abs())
            });
        numbers.fold(0.0, f64::max)
    }
}

/// The first member of which a byte differs: values may be equal all the same, as 0 and −0 are.
fn first_difference(topic: Topic, recorded: &[u8], replayed: &[u8]) -> (String, Value, Value) {
    let place = recorded
        .iter()
        .zip(replayed)
        .position(|(one, other)| one != other);
    let members = topic.members().into_iter();
    let before = members.take_while(|member| place.is_some_and(|place| member.offset <= place));
    let field = before.last().map_or("", |member| member.name);
    let [recorded, replayed] = [recorded, replayed].map(|bytes| decode_sample(topic, bytes));
    let value = |sample: &Value| sample.get(field).cloned().unwrap_or_default();
    (field.to_owned(), value(&recorded), value(&replayed))
}
