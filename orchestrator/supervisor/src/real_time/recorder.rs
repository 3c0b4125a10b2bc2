//! Recorder of a flight in real time: receives samples, orders them for the log, and delays no service.
//!
//! Samples of one tick usually arrive within a millisecond, but this is not guaranteed. They are ordered within the
//! last [`SETTLING_NS`]; one that arrives even later is still recorded, after newer ones. Samples overwritten before
//! they were received show as a gap between the published and the recorded numbers.

use std::collections::{BTreeMap, VecDeque};

use host::in_process::TickSink;
use host::kept_samples::CATCHING_UP;
use host::owned_sample::OwnedSample;
use host::step::Timetable;
use host::watchdog::{self, Work};
use runtime::flight_clock::FlightClock;
use runtime::ports::{PortError, RECORDER_BUFFER};
use shared_types::ExternalServices;
use shared_types::service::header_of;
use shared_types::{Schedule, ServiceId, Topic};

use crate::RunFailure;
use crate::subscription::Subscription;
use run_client::newest::Newest;

/// Time that a tick's samples are waited for before it is written, ns.
pub const SETTLING_NS: u64 = 50_000_000;

/// Subscriber of every topic of a flight in real time.
pub struct Recorder {
    feeds: Vec<Feed>,
    /// Samples of ticks that are not written yet.
    waiting: BTreeMap<(u64, Topic), OwnedSample>,
    /// Buffers of written samples of each topic, for reuse.
    spare: [Vec<OwnedSample>; Topic::ALL.len()],
    /// First tick that is not written yet.
    written_until: u64,
}

impl Newest for Recorder {
    fn newest_bytes(&self, topic: Topic) -> Option<&[u8]> {
        let feed = self.feeds.iter().find(|feed| feed.subscription.topic == topic)?;
        feed.subscription.receiver.held()
    }
}

struct Feed {
    subscription: Subscription,
    received: u64,
    newest: Option<u64>,
    /// `true` if its port failed at the last receive.
    has_failed: bool,
    /// Last samples, if a consumer makes up for late steps or takes in every sample: it gets them after a restart.
    last: Option<VecDeque<OwnedSample>>,
}

impl Feed {
    fn remember(&mut self, topic: Topic, bytes: &[u8]) {
        let Some(last) = &mut self.last else {
            return;
        };
        let oldest = (last.len() == CATCHING_UP).then(|| last.pop_front()).flatten();
        let mut sample = oldest.unwrap_or_else(|| OwnedSample::zeroed(topic));
        sample.bytes_mut().copy_from_slice(bytes);
        last.push_back(sample);
    }
}

impl Recorder {
    /// Creates a recorder without samples, whose first tick is `first_tick`.
    #[must_use]
    pub fn new(subscriptions: Vec<Subscription>, first_tick: u64) -> Self {
        let feed = |subscription| Feed {
            subscription,
            received: 0,
            newest: None,
            has_failed: false,
            last: None,
        };
        Self {
            feeds: subscriptions.into_iter().map(feed).collect(),
            waiting: BTreeMap::new(),
            spare: Default::default(),
            written_until: first_tick,
        }
    }

    /// Stores the last samples of the topics whose consumers make up for late steps or take in every sample.
    #[must_use]
    pub fn remember_for_restarts(mut self, schedule: &Schedule) -> Self {
        let needs_more_than_the_newest = |&service: &ServiceId| {
            let timetable = Timetable::new(schedule, service);
            timetable.catches_up || timetable.reads_every_sample
        };
        for service in ServiceId::ALL.into_iter().filter(needs_more_than_the_newest) {
            for (_, input) in schedule.inputs_read(service) {
                let mut feeds = self.feeds.iter_mut();
                if let Some(feed) = feeds.find(|feed| feed.subscription.topic == input.topic) {
                    feed.last = Some(VecDeque::new());
                }
            }
        }
        self
    }

    /// Returns the stored samples of a topic from a tick on, in order.
    pub fn remembered(&self, topic: Topic, from: u64) -> impl Iterator<Item = &[u8]> {
        let of_topic = move |feed: &&Feed| feed.subscription.topic == topic;
        let last = self
            .feeds
            .iter()
            .filter(of_topic)
            .filter_map(|feed| feed.last.as_ref());
        let samples = last.flatten().map(OwnedSample::bytes);
        samples.filter(move |bytes| header_of(bytes).tick >= from)
    }

    /// Copies samples of external programs before they are checked, and refuses those that are impossible by the clock.
    #[must_use]
    pub fn distrust(
        mut self,
        external_services: ExternalServices,
        schedule: &Schedule,
        clock: FlightClock,
    ) -> Self {
        let distrust = |mut feed: Feed| {
            if feed.subscription.is_of(external_services) {
                feed.subscription = feed.subscription.distrust_by_the_clock(schedule, clock);
            }
            feed
        };
        self.feeds = self.feeds.into_iter().map(distrust).collect();
        self
    }

    /// Returns the refused samples of external programs, as sentences.
    pub fn refusals(&self) -> impl Iterator<Item = String> {
        self.feeds.iter().filter_map(|feed| {
            let (refusals, topic) = (&feed.subscription.refusals, feed.subscription.topic);
            let last = refusals.last()?;
            Some(format!(
                "{} samples of `{topic}` were refused: the program in place of `{}` published them with a tick beyond the \
                 clock or another header than that of their tick, at last tick {}, number {}, {} ns \
                 (docs/process_contract.md)",
                refusals.count(),
                topic.publisher().map_or("nobody", ServiceId::name),
                last.tick,
                last.seq,
                last.stamp_ns
            ))
        })
    }

    /// Connects to all publishers that exist now.
    ///
    /// # Errors
    /// The first [`PortError`].
    pub fn connect(&mut self) -> Result<(), PortError> {
        self.feeds
            .iter_mut()
            .try_for_each(|feed| watchdog::during(Work::Ports, || feed.subscription.receiver.connect()))
    }

    /// Returns the number of received samples of all topics.
    #[must_use]
    pub fn received_in_all(&self) -> u64 {
        self.feeds.iter().map(|feed| feed.received).sum()
    }

    /// Returns the number of received samples of a topic.
    #[must_use]
    pub fn received(&self, topic: Topic) -> u64 {
        let feed = self.feeds.iter().find(|feed| feed.subscription.topic == topic);
        feed.map_or(0, |feed| feed.received)
    }

    /// Returns the tick of the newest sample of a service, and the number of received samples of that topic.
    #[must_use]
    pub fn newest_of(&self, service: ServiceId) -> Option<(u64, u64)> {
        let of_service = |feed: &&Feed| feed.subscription.topic.publisher() == Some(service);
        let feeds = self.feeds.iter().filter(of_service);
        feeds.filter_map(|feed| Some((feed.newest?, feed.received))).max()
    }

    /// Returns the number of ticks written so far.
    #[must_use]
    pub fn ticks(&self) -> u64 {
        self.written_until
    }

    /// Receives all pending samples; a failed port does not affect the others.
    ///
    /// # Errors
    /// [`RunFailure::setup`] if a port failed.
    pub fn receive(&mut self) -> Result<(), RunFailure> {
        let mut received = Ok(());
        for at in 0..self.feeds.len() {
            let of_feed = self.receive_of(at);
            self.feeds[at].has_failed = of_feed.is_err();
            received = received.and(of_feed);
        }
        received
    }

    /// Returns whether the port of a topic works, so that a missing sample means an unpublished one.
    #[must_use]
    pub fn is_receiving(&self, topic: Topic) -> bool {
        let mut feeds = self.feeds.iter();
        feeds.any(|feed| feed.subscription.topic == topic && !feed.has_failed)
    }

    fn receive_of(&mut self, at: usize) -> Result<(), RunFailure> {
        let feed = &mut self.feeds[at];
        // Bounded: a publisher without pauses must not block this process.
        for _ in 0..RECORDER_BUFFER {
            let received = watchdog::during(Work::Receive, || feed.subscription.receiver.receive());
            if !received.map_err(RunFailure::setup)? {
                break;
            }
            let bytes = feed.subscription.receiver.held().expect("just received");
            // A restarted service may repeat its last samples, as the HIL simulator does: the first one counts, as for
            // its consumers.
            let tick = header_of(bytes).tick;
            if feed.newest.replace(tick.max(feed.newest.unwrap_or(0))) >= Some(tick) {
                continue;
            }
            feed.received += 1;
            let topic = feed.subscription.topic;
            let spare = self.spare[topic.index()].pop();
            let mut sample = spare.unwrap_or_else(|| OwnedSample::zeroed(topic));
            sample.bytes_mut().copy_from_slice(bytes);
            feed.remember(topic, sample.bytes());
            let earlier = self.waiting.insert((tick, topic), sample);
            debug_assert!(earlier.is_none(), "one sample a topic and tick");
        }
        Ok(())
    }

    /// Writes all ticks before `tick`, and with them samples of earlier ticks that arrived too late.
    ///
    /// # Errors
    /// That of the sink.
    pub fn write_before<S: TickSink>(&mut self, tick: u64, sink: &mut S) -> Result<(), S::Error> {
        for ending in self.written_until..tick {
            while let Some(entry) = self.waiting.first_entry().filter(|entry| entry.key().0 <= ending) {
                let ((_, topic), sample) = entry.remove_entry();
                sink.sample(topic, sample.bytes())?;
                self.spare[topic.index()].push(sample);
            }
            // The clock ends a flight in real time, not the sink.
            let _ = sink.end_tick(ending)?;
            self.written_until = ending + 1;
        }
        Ok(())
    }
}
