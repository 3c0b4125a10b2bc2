//! The latest samples of a topic.
//!
//! Of a `STEADY` flight every service steps at every tick and gets what the others then publish, which need not be asked.

use shared_types::schedule::Publication;
use shared_types::{Schedule, Topic};

use crate::owned_sample::OwnedSample;
use crate::sample_ring::SampleRing;

/// The latest samples of a topic, as many as any consumer may still need.
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
        self.samples.at(self.place_of::<STEADY>(tick))
    }

    /// Takes the sample of a tick; `draft` becomes one that is not needed any more.
    #[inline]
    pub(super) fn publish<const STEADY: bool>(&mut self, tick: u64, draft: &mut OwnedSample) {
        self.samples.swap(self.place_of::<STEADY>(tick), draft);
    }

    #[inline]
    fn place_of<const STEADY: bool>(&self, tick: u64) -> u64 {
        if STEADY {
            tick
        } else {
            self.publication.ticks.count_before(tick)
        }
    }
}
