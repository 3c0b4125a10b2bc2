//! The latest samples of a topic: those that the log still waits for, and before them those that a restarted service
//! may have missed.

use std::collections::BTreeMap;

use host::sample_ring::SampleRing;
use shared_types::schedule::{Edge, Publication, Rate};
use shared_types::service::header_of;
use shared_types::{Header, Schedule, ServiceId};

use super::RunFailure;

/// Minimum number of samples that are kept before those that the log waits for.
const MIN_HISTORY: u64 = 64;

/// Ring of the latest samples of a topic, by sequence number.
pub struct Archive {
    publication: Publication,
    samples: SampleRing,
    /// Number of received samples.
    count: u64,
    /// Samples that are kept permanently, by sequence number: planned faults repeat them much later.
    remembered: BTreeMap<u64, Option<Box<[u8]>>>,
    /// `true` if an external program publishes: it has no successor that might repeat samples, and its headers are not
    /// trusted.
    is_external: bool,
}

impl Archive {
    /// Creates an empty archive.
    #[must_use]
    pub fn new(publication: Publication, schedule: &Schedule) -> Self {
        // A consumer lags behind its publisher by less than its buffer; as many samples may wait for the log.
        let history = schedule.buffer_size(publication.topic).max(MIN_HISTORY);
        let edges: Vec<_> = publication
            .topic
            .consumers()
            .map(|(service, input)| schedule.edge(service, input))
            .collect();
        let longest_loss = edges
            .iter()
            .map(|edge| edge.longest_loss(schedule.last_tick()))
            .max();
        let remembered = edges.iter().flat_map(Edge::remembered);
        Self {
            samples: SampleRing::new(
                publication.topic,
                2 * (history + longest_loss.unwrap_or_default()),
            ),
            remembered: remembered
                .map(|tick| (publication.ticks.count_before(tick), None))
                .collect(),
            publication,
            count: 0,
            is_external: false,
        }
    }

    /// Requires every sample to be the one that is due: an external program publishes the topic.
    pub fn require_due_samples(&mut self) {
        self.is_external = true;
    }

    /// Returns whether there is room for another sample while those from `tick` on are still needed.
    #[must_use]
    #[inline]
    pub fn has_room(&self, tick: u64) -> bool {
        let waiting = self.count.saturating_sub(self.place_of(tick));
        2 * waiting < self.samples.depth()
    }

    /// Stores a sample. A restarted service may repeat samples, which must be equal.
    ///
    /// # Errors
    /// [`RunFailure::Lost`] if samples before it are missing, [`RunFailure::Diverged`] if a repeated sample differs.
    #[inline]
    pub fn keep(&mut self, bytes: &[u8]) -> Result<(), RunFailure> {
        let header = header_of(bytes);
        let Header { tick, seq: place, .. } = header;
        if self.is_external {
            self.check(header)?;
        }
        if place == self.count {
            self.samples.at_mut(place).copy_from_slice(bytes);
            self.count += 1;
            if let Some(remembered) = self.remembered.get_mut(&place) {
                *remembered = Some(bytes.into());
            }
            return Ok(());
        }
        self.compare(tick, place, bytes)
    }

    /// Checks that a sample is the one that is due.
    fn check(&self, header: Header) -> Result<(), RunFailure> {
        let due = self.next_due();
        if self.publication.header(due) == header {
            return Ok(());
        }
        Err(RunFailure::NotDue {
            service: self
                .publication
                .topic
                .publisher()
                .map_or("nobody", ServiceId::name),
            topic: self.publication.topic.name(),
            due,
            got: header,
        })
    }

    /// Returns the tick of the next sample; valid without outages.
    fn next_due(&self) -> u64 {
        let Rate { period, phase } = self.publication.ticks.rate;
        phase + self.count * period
    }

    #[cold]
    fn compare(&self, tick: u64, place: u64, bytes: &[u8]) -> Result<(), RunFailure> {
        let topic = self.publication.topic.to_string();
        if place > self.count {
            let due = self.next_due();
            return Err(RunFailure::Lost {
                topic,
                due,
                got: tick,
            });
        }
        if self.at(place).is_none_or(|first| first == bytes) {
            Ok(())
        } else {
            Err(RunFailure::Diverged { topic, tick })
        }
    }

    /// Returns the sample of a tick, if it was received and is still stored.
    #[must_use]
    #[inline]
    pub fn sample(&self, tick: u64) -> Option<&[u8]> {
        self.at(self.place_of(tick))
    }

    /// Returns the sample of a sequence number, if it was received and is still stored.
    #[must_use]
    #[inline]
    pub fn at(&self, place: u64) -> Option<&[u8]> {
        if place < self.count && self.count - place <= self.samples.depth() {
            return Some(self.samples.at(place));
        }
        self.remembered.get(&place)?.as_deref()
    }

    /// Returns the tick of the newest sample and the number of received samples.
    #[must_use]
    pub fn newest(&self) -> Option<(u64, u64)> {
        Some((header_of(self.newest_sample()?).tick, self.count))
    }

    #[must_use]
    pub fn newest_sample(&self) -> Option<&[u8]> {
        self.at(self.count.checked_sub(1)?)
    }

    /// Returns the number of received samples.
    #[must_use]
    #[inline]
    pub fn count(&self) -> u64 {
        self.count
    }

    /// Returns the sequence number of the sample at `tick`, or of the first after it.
    #[must_use]
    #[inline]
    pub fn place_of(&self, tick: u64) -> u64 {
        self.publication.ticks.count_before(tick)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use shared_types::Topic;
    use shared_types::samples::VehicleState;
    use zerocopy::{FromZeros, IntoBytes};

    fn archive() -> Archive {
        let schedule = Schedule::ideal(1_000_000, 10_000);
        Archive::new(schedule.publication(Topic::VehicleState), &schedule)
    }

    fn sample(tick: u64, x: f64) -> VehicleState {
        let mut sample = VehicleState::new_zeroed();
        (sample.header.tick, sample.header.seq) = (tick, tick);
        sample.position_world[0] = x;
        sample
    }

    #[test]
    fn samples_are_kept_until_many_later_ones_have_come() {
        let mut archive = archive();
        let depth = archive.samples.depth();
        for tick in 0..3 * depth {
            archive.keep(sample(tick, tick as f64).as_bytes()).unwrap();
        }
        assert!(archive.sample(2 * depth - 1).is_none() && archive.sample(3 * depth).is_none());
        for tick in 2 * depth..3 * depth {
            assert_eq!(
                archive.sample(tick).unwrap(),
                sample(tick, tick as f64).as_bytes()
            );
        }
        assert!(archive.has_room(3 * depth) && archive.has_room(3 * depth - 1));
        assert!(!archive.has_room(3 * depth - depth / 2));
    }

    #[test]
    fn of_an_external_program_nothing_is_kept_but_what_is_due() {
        let sound = |tick: u64| {
            let mut sound = sample(tick, 1.0);
            sound.header.stamp_ns = tick * 1_000_000;
            sound
        };
        let mut archive = archive();
        archive.require_due_samples();
        for tick in 0..5 {
            archive.keep(sound(tick).as_bytes()).unwrap();
        }
        let past_tick = Header {
            tick: 3,
            ..sound(5).header
        };
        let future_tick = Header {
            tick: u64::MAX,
            ..sound(5).header
        };
        let stamp = Header {
            stamp_ns: 7,
            ..sound(5).header
        };
        for header in [sound(4).header, sound(6).header, past_tick, future_tick, stamp] {
            let mut wrong = sound(5);
            wrong.header = header;
            let failure = archive.keep(wrong.as_bytes()).unwrap_err();
            assert!(
                matches!(failure, RunFailure::NotDue { due: 5, got, .. } if got == header),
                "{failure}"
            );
        }
        archive.keep(sound(5).as_bytes()).unwrap();
    }

    #[test]
    fn a_repeated_sample_must_be_the_same_and_none_may_be_missing() {
        let mut archive = archive();
        for tick in 0..5 {
            archive.keep(sample(tick, 1.0).as_bytes()).unwrap();
        }
        assert!(archive.keep(sample(3, 1.0).as_bytes()).is_ok());
        assert!(matches!(
            archive.keep(sample(3, 2.0).as_bytes()),
            Err(RunFailure::Diverged { tick: 3, .. })
        ));
        assert!(matches!(
            archive.keep(sample(6, 1.0).as_bytes()),
            Err(RunFailure::Lost { due: 5, got: 6, .. })
        ));
        assert!(archive.keep(sample(5, 1.0).as_bytes()).is_ok());
    }
}
