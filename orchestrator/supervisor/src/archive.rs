//! The latest samples of a topic: those that the log is still waiting for, and before them those that a restarted
//! service may have missed.

use std::collections::BTreeMap;

use host::sample_ring::SampleRing;
use shared_types::schedule::{Edge, Publication, Rate};
use shared_types::service::header_of;
use shared_types::{Header, Schedule, ServiceId};

use super::RunFailure;

/// Least number of samples that are kept before those that the log is waiting for.
const LEAST_HISTORY: u64 = 64;

/// A ring of the latest samples of a topic, by their place in the sequence of the topic.
pub struct Archive {
    publication: Publication,
    samples: SampleRing,
    /// Number of samples that have come.
    count: u64,
    /// Samples that are kept for good, by place: consumers need them long after later ones, as planned.
    remembered: BTreeMap<u64, Option<Box<[u8]>>>,
    /// `true` if an external program publishes: no process takes its place that might repeat samples, and nobody else sees
    /// to its headers.
    is_external: bool,
}

impl Archive {
    /// An empty archive of a topic.
    #[must_use]
    pub fn new(publication: Publication, schedule: &Schedule) -> Self {
        // A consumer lags behind its publisher by less than its buffer holds; as much again may wait for the log.
        let history = schedule.buffer_size(publication.topic).max(LEAST_HISTORY);
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

    /// Demands of every sample that it is the one which is due: an external program publishes them.
    pub fn demand_what_is_due(&mut self) {
        self.is_external = true;
    }

    /// Returns whether there is room for another sample while those from the one of `tick` on are waited for.
    #[must_use]
    #[inline]
    pub fn has_room(&self, tick: u64) -> bool {
        let waiting = self.count.saturating_sub(self.place_of(tick));
        2 * waiting < self.samples.depth()
    }

    /// Keeps a sample. A restarted service may repeat one, which must be the same.
    ///
    /// # Errors
    /// [`RunFailure::Lost`] if samples are missing before it, [`RunFailure::Diverged`] if it is not the same.
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

    /// Returns whether a sample is the one that is due.
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

    /// Tick of the next sample, if there is no outage.
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

    /// The sample of a tick, if it has come and is still kept.
    #[must_use]
    #[inline]
    pub fn sample(&self, tick: u64) -> Option<&[u8]> {
        self.at(self.place_of(tick))
    }

    /// The sample of a place in the sequence, if it has come and is still kept.
    #[must_use]
    #[inline]
    pub fn at(&self, place: u64) -> Option<&[u8]> {
        if place < self.count && self.count - place <= self.samples.depth() {
            return Some(self.samples.at(place));
        }
        self.remembered.get(&place)?.as_deref()
    }

    /// Tick of the newest sample, and how many have come.
    #[must_use]
    pub fn newest(&self) -> Option<(u64, u64)> {
        Some((header_of(self.newest_sample()?).tick, self.count))
    }

    /// Returns the newest sample.
    #[must_use]
    pub fn newest_sample(&self) -> Option<&[u8]> {
        self.at(self.count.checked_sub(1)?)
    }

    /// Returns how many samples have come.
    #[must_use]
    #[inline]
    pub fn count(&self) -> u64 {
        self.count
    }

    /// Place in the sequence of the sample that is due at `tick`, or else of the first after it.
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
        archive.demand_what_is_due();
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
