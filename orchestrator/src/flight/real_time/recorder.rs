//! Records a flight in real time: takes what comes, puts it into the order of the log, and holds nobody up.
//!
//! Samples of one tick come within about a millisecond of each other, but nothing promises it. They are put in order
//! among those of the last [`SETTLING_NS`]; one that comes even later is still recorded, after younger ones. What was
//! overwritten before it could be taken shows as a gap between what was published and what was recorded.

use std::collections::BTreeMap;

use runtime::in_process::TickSink;
use runtime::ports::{Delivery, Member, PortError, Receiver, TopicPorts};
use shared_types::service::header_of;
use shared_types::{Sample, Schedule, Topic};

use crate::flight::FlightFailure;

/// How long samples of a tick are waited for before the tick is written, ns.
pub const SETTLING_NS: u64 = 50_000_000;

/// Subscribes to every topic of a flight in real time.
pub struct Recorder {
    feeds: Vec<Feed>,
    /// Samples that wait for their tick to be written, by tick and topic.
    waiting: BTreeMap<(u64, usize), Waiting>,
    /// Memory of samples that have been written.
    spare: Vec<Box<[u64]>>,
    /// Ticks before this one have been written.
    written_until: u64,
}

struct Feed {
    topic: Topic,
    receiver: Box<dyn Receiver>,
    received: u64,
    /// Tick of the newest sample.
    newest: Option<u64>,
}

/// A sample in whole words.
struct Waiting {
    topic: Topic,
    words: Box<[u64]>,
}

impl Recorder {
    /// Makes every topic of the run and subscribes to it. The topics must be held until the run has ended.
    ///
    /// # Errors
    /// [`PortError`].
    pub fn create(
        member: &Member,
        schedule: &Schedule,
    ) -> Result<(Self, Vec<Box<dyn TopicPorts>>), PortError> {
        let mut feeds = Vec::new();
        let mut topics = Vec::new();
        for topic in Topic::ALL.into_iter().filter(|topic| topic.publisher().is_some()) {
            let ports = member.create_topic(topic, schedule, Delivery::NewestWins)?;
            feeds.push(Feed {
                topic,
                receiver: ports.recorder()?,
                received: 0,
                newest: None,
            });
            topics.push(ports);
        }
        let recorder = Self {
            feeds,
            waiting: BTreeMap::new(),
            spare: Vec::new(),
            written_until: 0,
        };
        Ok((recorder, topics))
    }

    /// Connects to all publishers that exist by now.
    ///
    /// # Errors
    /// [`PortError`].
    pub fn connect(&mut self) -> Result<(), PortError> {
        self.feeds.iter_mut().try_for_each(|feed| feed.receiver.connect())
    }

    /// The newest sample of a topic that has been received.
    #[must_use]
    pub fn newest<T: Sample>(&self) -> Option<T> {
        let feed = self.feeds.iter().find(|feed| feed.topic == T::TOPIC)?;
        T::read_from_bytes(feed.receiver.held()?).ok()
    }

    /// Samples of all topics that have been received.
    #[must_use]
    pub fn received_in_all(&self) -> u64 {
        self.feeds.iter().map(|feed| feed.received).sum()
    }

    /// Samples of a topic that have been received.
    #[must_use]
    pub fn received(&self, topic: Topic) -> u64 {
        let feed = self.feeds.iter().find(|feed| feed.topic == topic);
        feed.map_or(0, |feed| feed.received)
    }

    /// Ticks written so far.
    #[must_use]
    pub fn ticks(&self) -> u64 {
        self.written_until
    }

    /// Takes all that has come.
    ///
    /// # Errors
    /// [`FlightFailure::Setup`] if a port failed.
    pub fn receive(&mut self) -> Result<(), FlightFailure> {
        for feed in &mut self.feeds {
            while feed
                .receiver
                .receive()
                .map_err(|error| FlightFailure::Setup(error.to_string()))?
            {
                let bytes = feed.receiver.held().expect("just received");
                // One that was born again may repeat its last words, as the world does: the first count, for its
                // consumers too.
                let tick = header_of(bytes).tick;
                if feed.newest.replace(tick.max(feed.newest.unwrap_or(0))) >= Some(tick) {
                    continue;
                }
                feed.received += 1;
                let words = self.spare.pop();
                let sample = Waiting::new(feed.topic, bytes, words);
                let key = (header_of(bytes).tick, feed.topic.index());
                self.waiting.insert(key, sample);
            }
        }
        Ok(())
    }

    /// Writes all ticks before `tick`, and with them what came too late for its own.
    ///
    /// # Errors
    /// That of the sink.
    pub fn write_before<S: TickSink>(&mut self, tick: u64, sink: &mut S) -> Result<(), S::Error> {
        for ending in self.written_until..tick {
            while let Some(entry) = self.waiting.first_entry().filter(|entry| entry.key().0 <= ending) {
                let sample = entry.remove();
                sink.sample(sample.topic, sample.bytes())?;
                self.spare.push(sample.words);
            }
            // The clock ends a flight in real time, not the sink.
            let _ = sink.end_tick(ending)?;
            self.written_until = ending + 1;
        }
        Ok(())
    }
}

impl Waiting {
    fn new(topic: Topic, bytes: &[u8], words: Option<Box<[u64]>>) -> Self {
        use zerocopy::IntoBytes;
        let length = bytes.len().div_ceil(size_of::<u64>());
        let mut words = words
            .filter(|words| words.len() == length)
            .unwrap_or_else(|| vec![0; length].into_boxed_slice());
        words.as_mut_bytes()[..bytes.len()].copy_from_slice(bytes);
        Self { topic, words }
    }

    fn bytes(&self) -> &[u8] {
        use zerocopy::IntoBytes;
        &self.words.as_bytes()[..self.topic.kind().size]
    }
}
