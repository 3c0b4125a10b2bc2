//! Latest samples of a topic.
//!
//! In a `STEADY` flight every service steps and publishes all its outputs at every tick: the compiler removes the queries of
//! the schedule.

use shared_types::schedule::Publication;
use shared_types::{Schedule, Topic};

use crate::owned_sample::OwnedSample;
use crate::sample_ring::SampleRing;

/// Latest samples of a topic, as many as its consumers need.
pub(super) struct History {
    pub(super) publication: Publication,
    pub(super) samples: SampleRing,
}

impl History {
    pub(super) fn new(topic: Topic, schedule: &Schedule, batch: u64) -> Self {
        let publication = schedule.publication(topic);
        let consumers = topic.consumers();
        let latest = consumers
            .map(|(service, input)| schedule.latency(service, input))
            .max();
        let period = publication.ticks.rate.period;
        let depth = (latest.unwrap_or(0) / period + 2).max(batch.div_ceil(period));
        Self {
            samples: SampleRing::new(topic, depth),
            publication,
        }
    }

    #[inline]
    pub(super) fn is_due<const STEADY: bool>(&self, tick: u64) -> bool {
        STEADY || self.publication.is_due(tick)
    }

    #[inline]
    pub(super) fn bytes(&self, tick: u64) -> &[u8] {
        self.bytes_of::<false>(tick)
    }

    #[inline]
    pub(super) fn bytes_of<const STEADY: bool>(&self, tick: u64) -> &[u8] {
        self.samples.at(self.number_of::<STEADY>(tick))
    }

    /// Publishes the sample of a tick from `draft`, which receives the overwritten sample in exchange.
    #[inline]
    pub(super) fn publish<const STEADY: bool>(&mut self, tick: u64, draft: &mut OwnedSample) {
        self.samples.swap(self.number_of::<STEADY>(tick), draft);
    }

    #[inline]
    fn number_of<const STEADY: bool>(&self, tick: u64) -> u64 {
        if STEADY {
            tick
        } else {
            self.publication.ticks.count_before(tick)
        }
    }
}
