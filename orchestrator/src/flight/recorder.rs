//! Puts what the services publish into the order of the log: (tick, topic), whole ticks only.

use std::ops::ControlFlow;

use runtime::in_process::TickSink;
use runtime::ports::{Delivery, Member, PortError, Receiver, TopicPorts};
use runtime::shared_page::Words;
use shared_types::schedule::Presence;
use shared_types::{Schedule, Topic};

use super::FlightFailure;
use super::archive::Archive;

/// Subscribes to every topic of a lock-step flight and hands its samples over tick by tick.
pub struct Recorder {
    feeds: Vec<Feed>,
    /// The tick that is being put together.
    tick: u64,
    last_tick: u64,
}

struct Feed {
    topic: Topic,
    rate: Presence,
    receiver: Box<dyn Receiver>,
    archive: Archive,
}

/// How far the recorder has come.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Progress {
    /// Samples are still missing.
    Waiting,
    /// The last tick is whole, or the sink wants no more.
    Done,
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
            let ports = member.create_topic(topic, schedule, Delivery::Lossless)?;
            feeds.push(Feed {
                topic,
                rate: schedule.publications(topic),
                receiver: ports.recorder()?,
                archive: Archive::new(schedule.publication(topic), schedule),
            });
            topics.push(ports);
        }
        Ok((
            Self {
                feeds,
                tick: 0,
                last_tick: schedule.last_tick(),
            },
            topics,
        ))
    }

    /// Lets publishers wait for the recorder.
    pub fn make_known(&self, words: &Words) {
        for (known, feed) in words.recorder.iter().zip(&self.feeds) {
            known.store(feed.receiver.id());
        }
    }

    /// What has been recorded of a topic that a service publishes.
    ///
    /// # Panics
    /// If no service publishes it.
    #[must_use]
    pub fn archive(&self, topic: Topic) -> &Archive {
        let feed = self.feeds.iter().find(|feed| feed.topic == topic);
        &feed.expect("all topics of services are recorded").archive
    }

    /// Ticks handed over so far.
    #[must_use]
    pub fn ticks(&self) -> u64 {
        self.tick
    }

    /// Connects to all publishers, once everybody is ready.
    ///
    /// # Errors
    /// [`PortError`].
    pub fn connect(&mut self) -> Result<(), PortError> {
        self.feeds.iter_mut().try_for_each(|feed| feed.receiver.connect())
    }

    /// Hands over every tick that is whole by now.
    ///
    /// # Errors
    /// [`FlightFailure`] if a sample is missing or differs from an earlier one, a port failed or the sink did.
    pub fn drain<S: TickSink>(&mut self, sink: &mut S) -> Result<Progress, FlightFailure>
    where
        FlightFailure: From<S::Error>,
    {
        while self.tick <= self.last_tick {
            if !self.collect()? {
                return Ok(Progress::Waiting);
            }
            let tick = self.tick;
            for feed in self.feeds.iter().filter(|feed| feed.rate.occurs_at(tick)) {
                sink.sample(feed.topic, feed.archive.sample(tick).expect("collected"))?;
            }
            self.tick += 1;
            if let ControlFlow::Break(()) = sink.end_tick(tick)? {
                return Ok(Progress::Done);
            }
        }
        Ok(Progress::Done)
    }

    /// Takes all that has been published, as far as there is room, whether its tick is whole or not.
    ///
    /// # Errors
    /// As [`Self::drain`].
    pub fn receive(&mut self) -> Result<(), FlightFailure> {
        let tick = self.tick;
        self.feeds
            .iter_mut()
            .try_for_each(|feed| feed.receive_while(|archive| archive.has_room(tick)))
    }

    /// Has the sample of every topic that is due at the tick; `false` if one is still missing.
    fn collect(&mut self) -> Result<bool, FlightFailure> {
        let tick = self.tick;
        for feed in self.feeds.iter_mut().filter(|feed| feed.rate.occurs_at(tick)) {
            feed.receive_while(|archive| archive.sample(tick).is_none())?;
            if feed.archive.sample(tick).is_none() {
                return Ok(false);
            }
        }
        Ok(true)
    }
}

impl Feed {
    fn receive_while(&mut self, wanted: impl Fn(&Archive) -> bool) -> Result<(), FlightFailure> {
        while wanted(&self.archive) {
            let received = self.receiver.receive();
            if !received.map_err(|error| FlightFailure::Setup(error.to_string()))? {
                break;
            }
            self.archive.keep(self.receiver.held().expect("just received"))?;
        }
        Ok(())
    }
}
