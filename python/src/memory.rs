//! Samples of a flight in memory: of each topic one after the other, in whole words.

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
    /// `true` for topics that are kept.
    wanted: [bool; Topic::ALL.len()],
}

impl Samples {
    /// Makes a place for samples of some topics, or of all.
    pub(crate) fn new(wanted: Option<&[Topic]>) -> Self {
        Self {
            topics: vec![Vec::new(); Topic::ALL.len()],
            wanted: Topic::ALL.map(|topic| wanted.is_none_or(|wanted| wanted.contains(&topic))),
        }
    }

    /// Keeps a sample.
    pub(crate) fn keep(&mut self, topic: Topic, bytes: &[u8]) {
        if self.wanted[topic.index()] {
            let words = bytes
                .as_chunks::<8>()
                .0
                .iter()
                .map(|word| u64::from_ne_bytes(*word));
            self.topics[topic.index()].extend(words);
        }
    }

    /// Returns whether all topics are kept.
    pub(crate) fn has_all(&self) -> bool {
        self.wanted.iter().all(|wanted| *wanted)
    }

    /// Returns the samples of a topic as an array of words that owns them: they are handed out once and not copied. They are
    /// read-only, because they are the flight that is saved and hashed.
    pub(crate) fn take<'py>(&mut self, py: Python<'py>, topic: Topic) -> Bound<'py, PyArray1<u64>> {
        let array = PyArray1::from_vec(py, std::mem::take(&mut self.topics[topic.index()]));
        array.readwrite().make_nonwriteable();
        array
    }

    /// Returns the names of the topics of which there are samples.
    pub(crate) fn names(&self) -> Vec<&'static str> {
        let kept = Topic::ALL
            .into_iter()
            .filter(|topic| !self.topics[topic.index()].is_empty());
        kept.map(Topic::name).collect()
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
    let mut places = vec![0; order.len()];
    loop {
        let next = order.iter().zip(&places).filter_map(|((topic, words), place)| {
            let sample = words.get(*place..*place + size(*topic))?;
            Some(header_of(sample.as_bytes()).tick)
        });
        let Some(tick) = next.min() else {
            return Ok(());
        };
        for ((topic, words), place) in order.iter().zip(&mut places) {
            while let Some(sample) = words.get(*place..*place + size(*topic))
                && header_of(sample.as_bytes()).tick == tick
            {
                sink(*topic, sample.as_bytes(), false)?;
                *place += size(*topic);
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

/// Returns the topic of a name.
pub(crate) fn topic_of(name: &str) -> PyResult<Topic> {
    Topic::from_name(name).ok_or_else(|| {
        let names = Topic::ALL.map(Topic::name).join(", ");
        PyKeyError::new_err(format!("there is no topic {name:?}; there are {names}"))
    })
}
