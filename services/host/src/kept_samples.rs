//! Samples of an input in real time: the latest ones, of which a step reads the newest due one.
//!
//! A step never waits for a lost sample: newer samples overwrite older ones. A few samples are kept, because the newest one
//! is not always due: samples of simulated cameras and radios have a latency of some ticks, and the controller joins two
//! inputs of one tick while the next sample of the first may have arrived. The delivered sample is retained until a newer
//! one is due, so an input that has delivered a sample never becomes empty again.

use shared_types::Schedule;
use shared_types::schedule::Edge;
use shared_types::service::{InputView, header_of};

use crate::edge_store::EdgeStore;
use crate::owned_sample::OwnedSample;
use crate::step::Timetable;

/// Capacity beyond the samples within the edge's latency.
const SPARE: usize = 4;

/// Capacity for a service that catches up with late steps, each of which reads the sample that was due at it: that of the
/// largest port.
pub const CATCHING_UP: usize = 1024;

/// Longest stall or restart after which a service that reads every sample loses none, ns, limited to [`CATCHING_UP`]
/// samples; also the largest lag of a service that is always late. Older samples are dropped, and the steps that would have
/// read them count as missed.
pub const TAKEN_IN_NS: u64 = 700_000_000;

/// Returns the capacity of an input.
#[must_use]
pub fn capacity(schedule: &Schedule, consumer: &Timetable, edge: &Edge) -> usize {
    let period = schedule.topic_rate(edge.topic).period;
    let limited = |samples: u64| usize::try_from(samples).unwrap_or(CATCHING_UP).min(CATCHING_UP);
    let in_transit = limited(edge.latency / period);
    match (consumer.catches_up, consumer.reads_every_sample) {
        (true, _) => CATCHING_UP,
        (false, true) => in_transit + limited(TAKEN_IN_NS.div_ceil(schedule.time_ns(period))),
        (false, false) => in_transit + SPARE,
    }
}

/// Samples of an input that have arrived.
#[derive(Clone)]
pub struct KeptSamples {
    edge: Edge,
    /// Ring in ascending order of ticks.
    slots: Vec<Slot>,
    /// Slot of the next sample.
    next: usize,
    /// The sample that was delivered last, after newer ones have overwritten its slot.
    delivered: Slot,
    newest: Option<u64>,
    /// Tick of the sample that the previous step read.
    seen: Option<u64>,
    /// All samples that may be due, if faults of the edge are planned.
    store: Option<EdgeStore>,
}

/// A sample and its tick.
#[derive(Clone)]
struct Slot {
    tick: Option<u64>,
    sample: OwnedSample,
}

/// Input of a step.
#[derive(Clone, Copy, Debug)]
pub struct Delivery<'a> {
    /// The sample.
    pub view: InputView<'a>,
    /// Tick of the sample.
    pub tick: u64,
}

impl KeptSamples {
    /// Makes the empty input at an edge, with room for this number of samples.
    #[must_use]
    pub fn new(edge: Edge, capacity: usize) -> Self {
        let slot = Slot {
            tick: None,
            sample: OwnedSample::zeroed(edge.topic),
        };
        Self {
            store: edge.has_faults().then(|| EdgeStore::new(edge.clone())),
            slots: vec![slot.clone(); capacity],
            next: 0,
            delivered: slot,
            newest: None,
            seen: None,
            edge,
        }
    }

    /// Returns the edge in the schedule.
    #[must_use]
    #[inline]
    pub fn edge(&self) -> &Edge {
        &self.edge
    }

    /// Returns the tick of the newest sample.
    #[must_use]
    #[inline]
    pub fn newest(&self) -> Option<u64> {
        self.newest
    }

    /// Returns the tick of the sample that the previous step read.
    #[must_use]
    #[inline]
    pub fn seen(&self) -> Option<u64> {
        self.seen
    }

    /// Returns whether the step at `tick` waits for a sample of its own tick.
    #[must_use]
    #[inline]
    pub fn is_awaited(&self, tick: u64) -> bool {
        self.edge.due_sample(tick) == Some(tick)
    }

    /// Returns the tick at which the oldest unread sample becomes due; `None` if there is none, and with planned faults,
    /// which define the lost samples themselves.
    #[must_use]
    pub fn oldest_unseen_is_due(&self) -> Option<u64> {
        let unseen = self.slots.iter().filter_map(|slot| slot.tick);
        let oldest = unseen.filter(|&tick| Some(tick) > self.seen).min()?;
        Some(oldest + self.edge.latency)
    }

    /// Stores a sample that is newer than all before: a restarted publisher may repeat its last samples.
    #[inline]
    pub fn keep(&mut self, bytes: &[u8]) {
        let tick = header_of(bytes).tick;
        if self.newest.is_some_and(|newest| tick <= newest) {
            return;
        }
        self.newest = Some(tick);
        if let Some(store) = &mut self.store {
            store.keep(bytes);
            return;
        }
        let slot = &mut self.slots[self.next];
        if slot.tick.is_some() && slot.tick == self.seen {
            std::mem::swap(slot, &mut self.delivered);
        }
        slot.tick = Some(tick);
        slot.sample.bytes_mut().copy_from_slice(bytes);
        self.next += 1;
        if self.next == self.slots.len() {
            self.next = 0;
        }
    }

    /// Stores concatenated samples, as [`keep`](Self::keep).
    pub fn keep_all(&mut self, samples: &[u8]) {
        let size = self.delivered.sample.bytes().len();
        for sample in samples.chunks_exact(size) {
            self.keep(sample);
        }
    }

    /// Replaces the input of a dead process by that of its successor: its port is new, and it is sent the samples from the
    /// tick `first` on, or none.
    pub fn restart(&mut self, first: Option<u64>) {
        let is_sent = |tick: u64| first.is_some_and(|first| tick >= first);
        (self.seen, self.newest) = (None, self.newest.filter(|&newest| is_sent(newest)));
        for slot in self.slots.iter_mut().chain([&mut self.delivered]) {
            slot.tick = slot.tick.filter(|&tick| is_sent(tick));
        }
        if let Some(store) = &mut self.store {
            match first {
                Some(first) => store.forget_before(first),
                None => *store = EdgeStore::new(self.edge.clone()),
            }
        }
    }

    /// Returns the newest sample that is due at the step at `tick`.
    #[inline]
    pub fn deliver(&mut self, tick: u64) -> Option<Delivery<'_>> {
        let due = self.edge.due_sample(tick)?;
        if self.store.is_some() {
            return self.deliver_among_faults(tick, due);
        }
        let (newer, older) = self.slots.split_at(self.next);
        let mut from_newest = newer.iter().rev().chain(older.iter().rev());
        let is_due = |slot: &&Slot| slot.tick.is_some_and(|tick| tick <= due);
        let slot = from_newest
            .find(is_due)
            .or(Some(&self.delivered).filter(is_due))?;
        let found = slot.tick?;
        let fresh = self.seen.replace(found) != Some(found);
        Some(Delivery {
            view: InputView {
                bytes: Some(slot.sample.bytes()),
                fresh,
            },
            tick: found,
        })
    }

    #[cold]
    fn deliver_among_faults(&mut self, tick: u64, due: u64) -> Option<Delivery<'_>> {
        let store = self.store.as_mut()?;
        let found = store.newest_at_or_before(due)?;
        store.forget_before(found);
        let fresh = self.seen.replace(found) != Some(found);
        let view = store.view(tick, found);
        Some(Delivery {
            view: InputView { fresh, ..view },
            tick: found,
        })
    }
}
