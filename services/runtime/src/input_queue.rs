//! Input queue of a service in real time: the latest samples, of which a step reads the newest due one.
//!
//! A step never waits for a lost sample: newer samples overwrite older ones. The queue holds a few samples, because the
//! newest one is not always due: samples of simulated cameras and radios have a latency of some ticks, and the controller
//! joins two inputs of one tick while the next sample of the first may have arrived. The delivered sample is retained until
//! a newer one is due, so an input that has delivered a sample never becomes empty again.

use shared_types::schedule::Edge;
use shared_types::service::{InputView, header_of};
use shared_types::{Schedule, ServiceId};

use crate::ports::{PortError, RECORDER_BUFFER, Receiver};
use host::edge_store::EdgeStore;
use host::owned_sample::OwnedSample;
use host::step::Timetable;

/// Capacity beyond the samples within the edge's latency.
const SPARE: usize = 4;

/// Capacity for a service that catches up with late steps, each of which reads the sample that was due at it: that of the
/// largest port.
pub const CATCHING_UP: usize = RECORDER_BUFFER;

/// Longest stall or restart after which a service that reads every sample loses none, ns, limited to [`CATCHING_UP`]
/// samples; also the largest lag of a service that is always late. Older samples are dropped, and the steps that would have
/// read them count as missed.
pub const TAKEN_IN_NS: u64 = 700_000_000;

/// Latest samples of an input.
pub struct InputQueue {
    /// The input's edge in the schedule.
    pub edge: Edge,
    /// Index of the input in the wiring table.
    pub index: usize,
    /// Publisher of the topic.
    pub publisher: ServiceId,
    receiver: Box<dyn Receiver>,
    kept: KeptSamples,
}

/// Samples that have arrived.
struct KeptSamples {
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

/// Returns the capacity of the queue of an input.
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

/// A sample and its tick.
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
        let topic = edge.topic;
        let depth = capacity(schedule, &Timetable::new(schedule, service), &edge);
        let slot = || Slot {
            tick: None,
            sample: OwnedSample::zeroed(topic),
        };
        Self {
            kept: KeptSamples {
                store: edge.has_faults().then(|| EdgeStore::new(edge.clone())),
                slots: (0..depth).map(|_| slot()).collect(),
                next: 0,
                delivered: slot(),
                newest: None,
                seen: None,
            },
            edge,
            index,
            publisher,
            receiver,
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

    /// Returns whether any sample has arrived.
    #[must_use]
    #[inline]
    pub fn has_any(&self) -> bool {
        self.kept.newest.is_some()
    }

    /// Receives new samples. Returns whether the sample of `tick` or a newer one has arrived.
    ///
    /// # Errors
    /// The error of the port.
    #[inline]
    pub fn has_arrived(&mut self, tick: u64) -> Result<bool, PortError> {
        self.collect()?;
        Ok(self.kept.newest >= Some(tick))
    }

    /// Receives new samples.
    ///
    /// # Errors
    /// The error of the port.
    #[inline]
    pub fn collect(&mut self) -> Result<(), PortError> {
        // Bounded: a publisher that is faster than this loop must not delay the step.
        for _ in 0..RECORDER_BUFFER {
            if !self.receiver.receive()? {
                break;
            }
            self.kept.keep(self.receiver.held().expect("just received"));
        }
        Ok(())
    }

    /// Returns the tick at which the oldest unread sample becomes due; `None` if there is none, and with planned faults,
    /// which define the lost samples themselves.
    #[must_use]
    pub fn oldest_unseen_is_due(&self) -> Option<u64> {
        let unseen = self.kept.slots.iter().filter_map(|slot| slot.tick);
        let oldest = unseen.filter(|&tick| Some(tick) > self.kept.seen).min()?;
        Some(oldest + self.edge.latency)
    }

    /// Stores concatenated samples that were published before the port of a restarted service existed.
    pub fn take_missed(&mut self, samples: &[u8]) {
        let size = self.kept.delivered.sample.bytes().len();
        for sample in samples.chunks_exact(size) {
            self.kept.keep(sample);
        }
    }

    /// Returns the newest sample that is due at the step at `tick`.
    #[inline]
    pub fn deliver(&mut self, tick: u64) -> Option<Delivery<'_>> {
        let due = self.edge.due_sample(tick)?;
        if self.kept.store.is_some() {
            return self.kept.deliver_among_faults(tick, due);
        }
        self.kept.deliver(due)
    }
}

impl KeptSamples {
    /// Stores a sample that is newer than all before: a restarted publisher may repeat its last samples.
    #[inline]
    fn keep(&mut self, bytes: &[u8]) {
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
        self.next = (self.next + 1) % self.slots.len();
    }

    /// Returns the newest sample of the tick `due` or before.
    #[inline]
    fn deliver(&mut self, due: u64) -> Option<Delivery<'_>> {
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

#[cfg(test)]
mod tests {
    use std::collections::VecDeque;

    use super::*;
    use crate::real_time::next_step;
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
            let at = (last + at).saturating_sub(50);
            let expected = ticks.iter().rev().copied().find(|&tick| tick < at);
            prop_assert_eq!(delivered(&mut queue, at).map(|(tick, _)| tick), expected);
        }
    }

    proptest! {
        /// An estimator that stands still for any times, of which none is longer than the samples that are kept.
        #[test]
        fn a_service_that_takes_in_all_sees_every_sample_in_order(
            stalls in prop::collection::vec(0u64..64, 1..10),
            period in 1u64..5,
        ) {
            let schedule = Schedule::ideal(1_000_000, 1_000_000);
            let timetable = Timetable::new(&schedule, ServiceId::Estimator);
            let frames = (0..2).find(|&input| ServiceId::Estimator.inputs()[input].topic == Topic::RcFrame).unwrap();
            let port = |ticks| Box::new(Port { coming: ticks, held: None });
            let mut queue =
                InputQueue::new(&schedule, ServiceId::Estimator, frames, ServiceId::RcOutput, port(VecDeque::new()));
            let (mut now, mut due, mut seen, mut sent) = (0, 1, Vec::new(), Vec::new());
            for stall in stalls {
                let came: Vec<u64> = (now + 1..=now + stall + 1).filter(|tick| tick % period == 0).collect();
                now += stall + 1;
                queue.receiver = port(came.iter().copied().map(frame).collect());
                sent.extend(came);
                while due <= now {
                    queue.collect().unwrap();
                    let tick = next_step(&timetable, due, now, queue.oldest_unseen_is_due());
                    prop_assert!((due..=now).contains(&tick));
                    if let Some((found, true)) = delivered(&mut queue, tick) {
                        seen.push(found);
                    }
                    due = tick + 1;
                }
            }
            let latency = queue.edge.latency;
            sent.retain(|tick| tick + latency <= now);
            prop_assert_eq!(seen, sent);
        }
    }

    /// As many frames as a plant can be late for come at once; then each of its late steps has its own.
    #[test]
    fn a_plant_that_catches_up_sees_the_frame_that_was_due_at_each_late_step() {
        let late = CATCHING_UP as u64;
        let mut queue = queue(1..=late);
        for tick in 2..=late {
            assert_eq!(delivered(&mut queue, tick), Some((tick - 1, true)));
        }
    }

    proptest! {
        /// Frames come in bursts, and the steps are late by any time: none is without a frame after the first.
        #[test]
        fn an_input_that_has_had_a_sample_never_again_has_none(
            bursts in prop::collection::vec((1u64..3 * CATCHING_UP as u64, 0u64..40), 1..8),
        ) {
            let mut queue = queue([1]);
            prop_assert_eq!(delivered(&mut queue, 2), Some((1, true)));
            let (mut sent, mut step, mut seen) = (1, 2, 1);
            for (frames, steps) in bursts {
                let port = Port { coming: (sent + 1..=sent + frames).map(frame).collect(), held: None };
                queue.receiver = Box::new(port);
                for _ in 0..3 {
                    queue.collect().unwrap();
                }
                sent += frames;
                for _ in 0..steps {
                    step += 1;
                    let (tick, _) = delivered(&mut queue, step).unwrap();
                    // What the ring has dropped is followed by the frame before, and never by one of the future.
                    prop_assert!(seen <= tick && tick < step);
                    seen = tick;
                }
            }
        }
    }

    /// A restarted plant flies its late steps with the frames that were published while it was dead, then with its port's.
    #[test]
    fn samples_that_were_published_before_the_port_was_made_come_before_those_of_the_port() {
        let mut queue = queue([]);
        let missed = [frame(1), frame(2), frame(3)];
        queue.take_missed(missed.as_bytes());
        queue.take_missed(&[0; 3]);
        queue.receiver = Box::new(Port {
            coming: [2, 3, 4].map(frame).into(),
            held: None,
        });
        queue.collect().unwrap();
        for tick in 2..=5 {
            assert_eq!(delivered(&mut queue, tick), Some((tick - 1, true)));
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
