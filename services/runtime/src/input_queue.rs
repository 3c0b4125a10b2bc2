//! Input queue of a service in real time: the latest samples, of which a step sees the newest due one.
//!
//! A step never waits for a lost sample: newer samples overwrite older ones. A few are kept, because the newest one is
//! not always due. Samples of simulated cameras and radios take some ticks on their way, and the controller joins two
//! inputs of one tick while the next sample of the first has already come.

use shared_types::schedule::Edge;
use shared_types::service::{InputView, header_of};
use shared_types::{Schedule, ServiceId};

use crate::ports::{PortError, RECORDER_BUFFER, Receiver};
use host::edge_store::EdgeStore;
use host::owned_sample::OwnedSample;

/// Samples that are kept beside those that are on their way.
const SPARE: u64 = 4;

/// Latest samples of an input.
pub struct InputQueue {
    /// The input as the schedule sees it.
    pub edge: Edge,
    /// Place of the input in the wiring table.
    pub index: usize,
    /// Publisher of the topic.
    pub publisher: ServiceId,
    receiver: Box<dyn Receiver>,
    slots: Vec<Slot>,
    /// Place of the next sample.
    next: usize,
    newest: Option<u64>,
    /// Tick of the sample that the step before saw.
    seen: Option<u64>,
    /// With planned faults: all samples that may be due.
    store: Option<EdgeStore>,
}

/// A sample and its tick.
struct Slot {
    tick: Option<u64>,
    sample: OwnedSample,
}

/// Input as a step sees it.
#[derive(Clone, Copy, Debug)]
pub struct Delivery<'a> {
    /// The sample.
    pub view: InputView<'a>,
    /// Tick of the sample.
    pub tick: u64,
}

impl InputQueue {
    /// Makes an empty queue of an input, filled from a port.
    #[must_use]
    pub fn new(
        schedule: &Schedule,
        service: ServiceId,
        index: usize,
        publisher: ServiceId,
        receiver: Box<dyn Receiver>,
    ) -> Self {
        let edge = schedule.edge(service, index);
        let depth = edge.latency / schedule.topic_rate(edge.topic).period + SPARE;
        let topic = edge.topic;
        let slot = || Slot {
            tick: None,
            sample: OwnedSample::of(topic),
        };
        Self {
            store: edge.has_faults().then(|| EdgeStore::new(edge.clone())),
            edge,
            index,
            publisher,
            receiver,
            slots: (0..depth).map(|_| slot()).collect(),
            next: 0,
            newest: None,
            seen: None,
        }
    }

    /// Connects to all publishers that exist by now.
    ///
    /// # Errors
    /// The error of the port.
    pub fn connect(&mut self) -> Result<(), PortError> {
        self.receiver.connect()
    }

    /// Returns whether the step at `tick` waits for a sample of its own tick.
    #[must_use]
    #[inline]
    pub fn is_awaited(&self, tick: u64) -> bool {
        self.edge.due_sample(tick) == Some(tick)
    }

    /// Returns whether any sample has come.
    #[must_use]
    #[inline]
    pub fn has_any(&self) -> bool {
        self.newest.is_some()
    }

    /// Takes new samples. Returns whether the sample of `tick` or a newer one has come.
    ///
    /// # Errors
    /// The error of the port.
    #[inline]
    pub fn has_come(&mut self, tick: u64) -> Result<bool, PortError> {
        self.collect()?;
        Ok(self.newest >= Some(tick))
    }

    /// Takes new samples.
    ///
    /// # Errors
    /// The error of the port.
    #[inline]
    pub fn collect(&mut self) -> Result<(), PortError> {
        // Bounded: a publisher that is faster than this must not keep the step from beginning.
        for _ in 0..RECORDER_BUFFER {
            if !self.receiver.receive()? {
                break;
            }
            let bytes = self.receiver.held().expect("just received");
            let tick = header_of(bytes).tick;
            // A restarted publisher may repeat its last samples.
            if self.newest.is_some_and(|newest| tick <= newest) {
                continue;
            }
            self.newest = Some(tick);
            if let Some(store) = &mut self.store {
                store.keep(bytes);
                continue;
            }
            let slot = &mut self.slots[self.next];
            slot.tick = Some(tick);
            slot.sample.bytes_mut().copy_from_slice(bytes);
            self.next = (self.next + 1) % self.slots.len();
        }
        Ok(())
    }

    /// Returns the newest sample that is due at the step at `tick`.
    #[inline]
    pub fn deliver(&mut self, tick: u64) -> Option<Delivery<'_>> {
        let due = self.edge.due_sample(tick)?;
        if self.store.is_some() {
            return self.deliver_among_faults(tick, due);
        }
        let arrived = self.slots.iter().filter(|slot| slot.tick <= Some(due));
        let slot = arrived.max_by_key(|slot| slot.tick)?;
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

#[cfg(test)]
mod tests {
    use std::collections::VecDeque;

    use super::*;
    use proptest::prelude::*;
    use shared_types::samples::RcFrame;
    use shared_types::{Header, Topic};
    use zerocopy::{FromZeros, IntoBytes};

    /// Port with samples of given ticks.
    #[derive(Default)]
    struct Port {
        coming: VecDeque<RcFrame>,
        held: Option<RcFrame>,
    }

    impl Receiver for Port {
        fn receive(&mut self) -> Result<bool, PortError> {
            let sample = self.coming.pop_front();
            let is_new = sample.is_some();
            self.held = sample.or(self.held.take());
            Ok(is_new)
        }

        fn held(&self) -> Option<&[u8]> {
            self.held.as_ref().map(IntoBytes::as_bytes)
        }

        fn id(&self) -> u128 {
            0
        }

        fn connect(&mut self) -> Result<(), PortError> {
            Ok(())
        }
    }

    fn frame(tick: u64) -> RcFrame {
        let header = Header {
            tick,
            stamp_ns: tick,
            seq: tick,
        };
        RcFrame {
            header,
            ..RcFrame::new_zeroed()
        }
    }

    fn queue(ticks: impl IntoIterator<Item = u64>) -> InputQueue {
        let schedule = Schedule::ideal(1_000_000, 1_000_000);
        assert_eq!(ServiceId::Plant.inputs()[0].topic, Topic::RcFrame);
        let port = Port {
            coming: ticks.into_iter().map(frame).collect(),
            held: None,
        };
        let mut queue = InputQueue::new(
            &schedule,
            ServiceId::Plant,
            0,
            ServiceId::RcOutput,
            Box::new(port),
        );
        queue.collect().unwrap();
        queue
    }

    fn delivered(queue: &mut InputQueue, tick: u64) -> Option<(u64, bool)> {
        let delivery = queue.deliver(tick)?;
        let header = header_of(delivery.view.bytes.unwrap());
        assert_eq!(header.tick, delivery.tick);
        Some((delivery.tick, delivery.view.fresh))
    }

    proptest! {
        /// The plant sees a frame one tick after it was sent.
        #[test]
        fn a_step_sees_the_newest_sample_that_is_due(gaps in prop::collection::vec(1u64..5, 1..20), at in 0u64..100) {
            let ticks: Vec<u64> = gaps.iter().scan(0, |tick, gap| { *tick += gap; Some(*tick) }).collect();
            let last = *ticks.last().unwrap();
            let mut queue = queue(ticks.iter().copied());
            // No more than the spare places are kept: a step long past is not asked for.
            let at = last + at;
            let expected = ticks.iter().rev().take(4).copied().find(|&tick| tick < at);
            prop_assert_eq!(delivered(&mut queue, at).map(|(tick, _)| tick), expected);
        }
    }

    #[test]
    fn a_sample_is_fresh_once() {
        let mut queue = queue([3, 4]);
        assert_eq!(delivered(&mut queue, 3), None);
        assert_eq!(delivered(&mut queue, 4), Some((3, true)));
        assert_eq!(delivered(&mut queue, 5), Some((4, true)));
        assert_eq!(delivered(&mut queue, 6), Some((4, false)));
    }

    #[test]
    fn repeated_samples_of_a_restarted_publisher_are_skipped() {
        let mut queue = queue([3, 4, 3, 4, 5]);
        assert_eq!(delivered(&mut queue, 5), Some((4, true)));
        assert_eq!(delivered(&mut queue, 6), Some((5, true)));
    }
}
