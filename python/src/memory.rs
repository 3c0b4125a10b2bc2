//! Samples of a flight in memory: those of each topic one after the other, as 64-bit words.

use numpy::{PyArray1, PyArrayMethods};
use pyo3::exceptions::PyKeyError;
use pyo3::prelude::*;
use shared_types::Topic;
use shared_types::digest::ExperimentDigest;
use shared_types::service::header_of;
use zerocopy::IntoBytes;

/// Samples by topic.
#[derive(Debug)]
pub(crate) struct Samples {
    topics: Vec<Vec<u64>>,
    is_recorded: [bool; Topic::ALL.len()],
}

impl Samples {
    /// Makes an empty record of the given topics, or of all.
    pub(crate) fn new(recorded: Option<&[Topic]>) -> Self {
        Self {
            topics: vec![Vec::new(); Topic::ALL.len()],
            is_recorded: Topic::ALL.map(|topic| recorded.is_none_or(|recorded| recorded.contains(&topic))),
        }
    }

    /// Adds a sample, if its topic is recorded.
    pub(crate) fn add(&mut self, topic: Topic, bytes: &[u8]) {
        if self.is_recorded[topic.index()] {
            let words = bytes
                .as_chunks::<8>()
                .0
                .iter()
                .map(|word| u64::from_ne_bytes(*word));
            self.topics[topic.index()].extend(words);
        }
    }

    /// Returns whether all topics are recorded.
    pub(crate) fn has_all(&self) -> bool {
        self.is_recorded.iter().all(|is_recorded| *is_recorded)
    }

    /// Moves the samples of a topic into an array of words, without a copy. It is read-only, because the flight is saved and
    /// hashed from it.
    pub(crate) fn take<'py>(&mut self, py: Python<'py>, topic: Topic) -> Bound<'py, PyArray1<u64>> {
        let array = PyArray1::from_vec(py, std::mem::take(&mut self.topics[topic.index()]));
        array.readwrite().make_nonwriteable();
        array
    }

    /// Returns the names of the topics that have samples.
    pub(crate) fn names(&self) -> Vec<&'static str> {
        let topics = Topic::ALL
            .into_iter()
            .filter(|topic| !self.topics[topic.index()].is_empty());
        topics.map(Topic::name).collect()
    }
}

/// Returns the samples of several arrays in the order of the log: by tick, then by topic, events last.
pub(crate) fn in_order<E>(
    arrays: &[(Topic, &[u64])],
    mut sink: impl FnMut(Topic, &[u8], bool) -> Result<(), E>,
) -> Result<(), E> {
    let size = |topic: Topic| topic.kind().size / size_of::<u64>();
    let mut order: Vec<(Topic, &[u64])> = arrays.to_vec();
    order.sort_by_key(|(topic, _)| (*topic == Topic::RunEvent, topic.index()));
    let mut offsets = vec![0; order.len()];
    loop {
        let next = order.iter().zip(&offsets).filter_map(|((topic, words), offset)| {
            let sample = words.get(*offset..*offset + size(*topic))?;
            Some(header_of(sample.as_bytes()).tick)
        });
        let Some(tick) = next.min() else {
            return Ok(());
        };
        for ((topic, words), offset) in order.iter().zip(&mut offsets) {
            while let Some(sample) = words.get(*offset..*offset + size(*topic))
                && header_of(sample.as_bytes()).tick == tick
            {
                sink(*topic, sample.as_bytes(), false)?;
                *offset += size(*topic);
            }
        }
        // The end of the tick.
        sink(Topic::RunEvent, tick.as_bytes(), true)?;
    }
}

/// Returns the digest of samples, as `gerono digest` prints it.
pub(crate) fn digest(arrays: &[(Topic, &[u64])]) -> String {
    let mut digest = ExperimentDigest::default();
    let fed = in_order::<std::convert::Infallible>(arrays, |topic, bytes, ends_tick| {
        if !ends_tick {
            digest.update(topic, bytes);
        }
        Ok(())
    });
    match fed {
        Ok(()) => digest.finish(),
        Err(never) => match never {},
    }
}

/// Returns the topic with a name.
pub(crate) fn topic_of(name: &str) -> PyResult<Topic> {
    Topic::from_name(name).ok_or_else(|| {
        let names = Topic::ALL.map(Topic::name).join(", ");
        PyKeyError::new_err(format!("there is no topic {name:?}; there are {names}"))
    })
}
