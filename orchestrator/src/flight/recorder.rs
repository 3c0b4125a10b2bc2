//! Puts what the services publish into the order of the log: (tick, topic), whole ticks only.

use std::ops::ControlFlow;

use runtime::in_process::TickSink;
use runtime::ports::{Member, PortError, Receiver, TopicPorts};
use shared_types::schedule::Rate;
use shared_types::service::header_of;
use shared_types::{Schedule, Topic};

use super::FlightFailure;

/// Subscribes to every topic of a lock-step flight and hands its samples over tick by tick.
pub struct Recorder {
    feeds: Vec<Feed>,
    /// The tick that is being put together.
    tick: u64,
    last_tick: u64,
}

struct Feed {
    topic: Topic,
    rate: Rate,
    receiver: Box<dyn Receiver>,
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
            let ports = member.create_topic(topic, schedule)?;
            feeds.push(Feed {
                topic,
                rate: schedule.topic_rate(topic),
                receiver: ports.recorder()?,
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

    /// Ids of the recorder's receivers.
    pub fn receiver_ids(&self) -> impl Iterator<Item = u128> {
        self.feeds.iter().map(|feed| feed.receiver.id())
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
    /// [`FlightFailure`] if a sample is missing, a port failed or the sink did.
    pub fn drain<S: TickSink>(&mut self, sink: &mut S) -> Result<Progress, FlightFailure>
    where
        FlightFailure: From<S::Error>,
    {
        while self.tick <= self.last_tick {
            if !self.collect()? {
                return Ok(Progress::Waiting);
            }
            for feed in self.feeds.iter().filter(|feed| feed.rate.occurs_at(self.tick)) {
                sink.sample(feed.topic, feed.receiver.held().expect("collected"))?;
            }
            let tick = self.tick;
            self.tick += 1;
            if let ControlFlow::Break(()) = sink.end_tick(tick)? {
                return Ok(Progress::Done);
            }
        }
        Ok(Progress::Done)
    }

    /// Holds the sample of every topic that is due at the tick; `false` if one is still missing.
    fn collect(&mut self) -> Result<bool, FlightFailure> {
        for feed in &mut self.feeds {
            if feed.rate.occurs_at(self.tick) && !feed.collect(self.tick)? {
                return Ok(false);
            }
        }
        Ok(true)
    }
}

impl Feed {
    fn collect(&mut self, tick: u64) -> Result<bool, FlightFailure> {
        if self.held_tick() == Some(tick) {
            return Ok(true);
        }
        if !self
            .receiver
            .receive()
            .map_err(|error| FlightFailure::Setup(error.to_string()))?
        {
            return Ok(false);
        }
        match self.held_tick() {
            Some(got) if got != tick => Err(FlightFailure::Lost {
                topic: self.topic.to_string(),
                due: tick,
                got,
            }),
            held => Ok(held.is_some()),
        }
    }

    fn held_tick(&self) -> Option<u64> {
        self.receiver.held().map(|bytes| header_of(bytes).tick)
    }
}
