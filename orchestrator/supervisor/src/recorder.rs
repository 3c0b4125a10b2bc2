//! Recorder of a flight in lock step: passes on complete ticks in the order of the log (tick, topic).

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

/// Maximum number of ticks passed on at once: a recorder that is always behind on a busy machine must not block the
/// orchestrator's other work. The fastest flight has a third of them ready in a period.
const MAX_TICKS: u64 = 256;

/// Subscriber of every topic of a flight in lock step.
pub struct Recorder {
    feeds: Vec<Feed>,
    /// The tick that is being collected.
    tick: u64,
    last_tick: u64,
}

struct Feed {
    topic: Topic,
    rate: OutageSchedule,
    archive: Archive,
    subscription: Subscription,
}

/// Progress of the recorder.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Progress {
    /// Samples of the tick are missing.
    Waiting,
    /// More ticks may be complete.
    Behind,
    /// The last tick is complete, or the sink has ended the flight.
    Done,
}

impl Recorder {
    /// Creates a recorder without samples.
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

    /// Copies samples of external programs before they are checked, and requires them to be the ones that are due.
    #[must_use]
    pub fn distrust(mut self, external_services: ExternalServices, schedule: &Schedule) -> Self {
        let distrust = |mut feed: Feed| {
            if feed.subscription.is_of(external_services) {
                feed.archive.require_due_samples();
                feed.subscription = feed.subscription.distrust(schedule);
            }
            feed
        };
        self.feeds = self.feeds.into_iter().map(distrust).collect();
        self
    }

    /// Publishes the recorder's IDs, so that publishers wait for it when its buffers are full.
    pub fn publish_ids(&self, block: &ControlBlock) {
        for (known, feed) in block.recorder.iter().zip(&self.feeds) {
            known.store(feed.subscription.receiver.id());
        }
    }

    /// Returns the recorded samples of a topic.
    ///
    /// # Panics
    /// If no service publishes it.
    #[must_use]
    pub fn archive(&self, topic: Topic) -> &Archive {
        let feed = self.feeds.iter().find(|feed| feed.topic == topic);
        &feed.expect("all topics of services are recorded").archive
    }

    /// Returns the tick of the newest sample of a service, and the number of received samples of that topic.
    #[must_use]
    pub fn newest_of(&self, service: ServiceId) -> Option<(u64, u64)> {
        let feeds = self.feeds.iter();
        let own = feeds.filter(|feed| feed.topic.publisher() == Some(service));
        own.filter_map(|feed| feed.archive.newest()).max()
    }

    /// Returns the number of received samples of all topics.
    #[must_use]
    pub fn received_in_all(&self) -> u64 {
        let newest = self.feeds.iter().filter_map(|feed| feed.archive.newest());
        newest.map(|(_, count)| count).sum()
    }

    /// Returns whether the tick that is being collected lacks a sample of a service.
    #[must_use]
    pub fn waits_for(&self, service: ServiceId) -> bool {
        let mut feeds = self.feeds.iter();
        feeds.any(|feed| {
            feed.topic.publisher() == Some(service)
                && feed.rate.occurs_at(self.tick)
                && feed.archive.sample(self.tick).is_none()
        })
    }

    /// Returns the number of ticks passed on so far.
    #[must_use]
    pub fn ticks(&self) -> u64 {
        self.tick
    }

    /// Connects to all publishers, once all services are ready.
    ///
    /// # Errors
    /// The first [`PortError`].
    pub fn connect(&mut self) -> Result<(), PortError> {
        self.feeds
            .iter_mut()
            .try_for_each(|feed| watchdog::during(Work::Ports, || feed.subscription.receiver.connect()))
    }

    /// Passes on all complete ticks.
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

    /// Passes on complete ticks, up to some hundred.
    ///
    /// # Errors
    /// [`RunFailure`] if a sample is missing or differs from an earlier one, or a port or the sink failed.
    pub fn drain<S: TickSink>(&mut self, sink: &mut S) -> Result<Progress, RunFailure>
    where
        RunFailure: From<S::Error>,
    {
        let pause = self.tick + MAX_TICKS;
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

    /// Receives all pending samples that fit, whether or not their ticks are complete.
    ///
    /// # Errors
    /// As [`Self::drain`].
    pub fn receive(&mut self) -> Result<(), RunFailure> {
        let tick = self.tick;
        self.feeds
            .iter_mut()
            .try_for_each(|feed| feed.receive_while(|archive| archive.has_room(tick)))
    }

    /// Receives the samples of the tick; `false` if one is missing.
    fn collect(&mut self) -> Result<bool, RunFailure> {
        let tick = self.tick;
        let mut is_whole = true;
        // Continues after a missing sample: an error of a later topic may be the cause.
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
