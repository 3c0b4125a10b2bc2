//! Puts what the services publish into the order of the log: (tick, topic), whole ticks only.

use std::ops::ControlFlow;

use host::in_process::TickSink;
use host::watchdog::{self, Work};
use runtime::ports::PortError;
use runtime::shared_page::ControlBlock;
use shared_types::ExternalServices;
use shared_types::schedule::OutageSchedule;
use shared_types::{Schedule, ServiceId, Topic};

use super::RunFailure;
use super::archive::Archive;
use super::subscription::Subscription;
use run_client::newest::Newest;

/// Ticks that are handed over in a row: one that is always behind on a busy machine must not keep the orchestrator from
/// everything else. The fastest flight has a third of them ready at a look.
const TICKS_IN_A_ROW: u64 = 256;

/// Subscribes to every topic of a lock-step flight and hands its samples over tick by tick.
pub struct Recorder {
    feeds: Vec<Feed>,
    /// The tick that is being put together.
    tick: u64,
    last_tick: u64,
}

struct Feed {
    topic: Topic,
    rate: OutageSchedule,
    archive: Archive,
    subscription: Subscription,
}

/// The progress of the recorder.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Progress {
    /// Samples are still missing.
    Waiting,
    /// There may be more.
    Behind,
    /// The last tick is whole, or the sink wants no more.
    Done,
}

impl Recorder {
    /// A recorder that has received nothing yet.
    ///
    /// # Panics
    /// If the subscriptions are not in the order of the log, one a topic.
    #[must_use]
    pub fn new(subscriptions: Vec<Subscription>, schedule: &Schedule) -> Self {
        assert!(
            subscriptions.is_sorted_by(|one, next| one.topic < next.topic),
            "a log has the samples of a tick in the order of the topics, each once"
        );
        let feed = |subscription: Subscription| Feed {
            topic: subscription.topic,
            rate: schedule.publications(subscription.topic),
            archive: Archive::new(schedule.publication(subscription.topic), schedule),
            subscription,
        };
        Self {
            feeds: subscriptions.into_iter().map(feed).collect(),
            tick: 0,
            last_tick: schedule.last_tick(),
        }
    }

    /// Copies what external programs publish before it is looked at, and demands that it is what is due.
    #[must_use]
    pub fn distrust(mut self, external_services: ExternalServices, schedule: &Schedule) -> Self {
        let distrust = |mut feed: Feed| {
            if feed.subscription.is_of(external_services) {
                feed.archive.demand_what_is_due();
                feed.subscription = feed.subscription.distrust(schedule);
            }
            feed
        };
        self.feeds = self.feeds.into_iter().map(distrust).collect();
        self
    }

    /// Lets publishers wait for the recorder.
    pub fn make_known(&self, block: &ControlBlock) {
        for (known, feed) in block.recorder.iter().zip(&self.feeds) {
            known.store(feed.subscription.receiver.id());
        }
    }

    /// Returns the recorded samples of a topic that a service publishes.
    ///
    /// # Panics
    /// If no service publishes it.
    #[must_use]
    pub fn archive(&self, topic: Topic) -> &Archive {
        let feed = self.feeds.iter().find(|feed| feed.topic == topic);
        &feed.expect("all topics of services are recorded").archive
    }

    /// Tick of the newest sample that a service has published, and how many of that topic have come.
    #[must_use]
    pub fn newest_of(&self, service: ServiceId) -> Option<(u64, u64)> {
        let feeds = self.feeds.iter();
        let own = feeds.filter(|feed| feed.topic.publisher() == Some(service));
        own.filter_map(|feed| feed.archive.newest()).max()
    }

    /// Samples of all topics that have come.
    #[must_use]
    pub fn received_in_all(&self) -> u64 {
        let newest = self.feeds.iter().filter_map(|feed| feed.archive.newest());
        newest.map(|(_, count)| count).sum()
    }

    /// Returns whether a sample of a service is missing to the tick that is being put together.
    #[must_use]
    pub fn waits_for(&self, service: ServiceId) -> bool {
        let mut feeds = self.feeds.iter();
        feeds.any(|feed| {
            feed.topic.publisher() == Some(service)
                && feed.rate.occurs_at(self.tick)
                && feed.archive.sample(self.tick).is_none()
        })
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
        self.feeds
            .iter_mut()
            .try_for_each(|feed| watchdog::during(Work::Ports, || feed.subscription.receiver.connect()))
    }

    /// Hands over every tick that is whole by now, however many.
    ///
    /// # Errors
    /// As [`Self::drain`].
    pub fn drain_all<S: TickSink>(&mut self, sink: &mut S) -> Result<(), RunFailure>
    where
        RunFailure: From<S::Error>,
    {
        while self.drain(sink)? == Progress::Behind {}
        Ok(())
    }

    /// Hands over the ticks that are whole by now, up to some hundred.
    ///
    /// # Errors
    /// [`RunFailure`] if a sample is missing or differs from an earlier one, a port failed or the sink did.
    pub fn drain<S: TickSink>(&mut self, sink: &mut S) -> Result<Progress, RunFailure>
    where
        RunFailure: From<S::Error>,
    {
        let pause = self.tick + TICKS_IN_A_ROW;
        while self.tick <= self.last_tick {
            if self.tick == pause {
                return Ok(Progress::Behind);
            }
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
    pub fn receive(&mut self) -> Result<(), RunFailure> {
        let tick = self.tick;
        self.feeds
            .iter_mut()
            .try_for_each(|feed| feed.receive_while(|archive| archive.has_room(tick)))
    }

    /// Has the sample of every topic that is due at the tick; `false` if one is still missing.
    fn collect(&mut self) -> Result<bool, RunFailure> {
        let tick = self.tick;
        let mut is_whole = true;
        // Also those behind one that is missing: what is wrong with them may be why it is.
        for feed in self.feeds.iter_mut().filter(|feed| feed.rate.occurs_at(tick)) {
            feed.receive_while(|archive| archive.sample(tick).is_none())?;
            is_whole &= feed.archive.sample(tick).is_some();
        }
        Ok(is_whole)
    }
}

impl Newest for Recorder {
    fn newest_bytes(&self, topic: Topic) -> Option<&[u8]> {
        let feed = self.feeds.iter().find(|feed| feed.topic == topic)?;
        feed.archive.newest_sample()
    }
}

impl Feed {
    fn receive_while(&mut self, wanted: impl Fn(&Archive) -> bool) -> Result<(), RunFailure> {
        while wanted(&self.archive) {
            let received = watchdog::during(Work::Receive, || self.subscription.receiver.receive());
            if !received.map_err(RunFailure::setup)? {
                break;
            }
            self.archive
                .keep(self.subscription.receiver.held().expect("just received"))?;
        }
        Ok(())
    }
}
