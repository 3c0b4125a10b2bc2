//! Input queue of a service in real time: a port, and its latest samples ([`host::kept_samples`]).

use shared_types::schedule::Edge;
use shared_types::{Schedule, ServiceId};

use crate::ports::{PortError, RECORDER_BUFFER, Receiver};
use host::kept_samples::{self, Delivery, KeptSamples};
use host::step::Timetable;

const _: () = assert!(kept_samples::CATCHING_UP == RECORDER_BUFFER);

/// Latest samples of an input.
pub struct InputQueue {
    /// Index of the input in the wiring table.
    pub index: usize,
    /// Publisher of the topic.
    pub publisher: ServiceId,
    receiver: Box<dyn Receiver>,
    kept: KeptSamples,
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
        let capacity = kept_samples::capacity(schedule, &Timetable::new(schedule, service), &edge);
        Self {
            kept: KeptSamples::new(edge, capacity),
            index,
            publisher,
            receiver,
        }
    }

    /// Returns the input's edge in the schedule.
    #[must_use]
    pub fn edge(&self) -> &Edge {
        self.kept.edge()
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
        self.kept.is_awaited(tick)
    }

    /// Returns whether any sample has arrived.
    #[must_use]
    #[inline]
    pub fn has_any(&self) -> bool {
        self.kept.newest().is_some()
    }

    /// Receives new samples. Returns whether the sample of `tick` or a newer one has arrived.
    ///
    /// # Errors
    /// The error of the port.
    #[inline]
    pub fn has_arrived(&mut self, tick: u64) -> Result<bool, PortError> {
        self.collect()?;
        Ok(self.kept.newest() >= Some(tick))
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

    /// Returns the tick at which the oldest unread sample becomes due: see [`KeptSamples::oldest_unseen_is_due`].
    #[must_use]
    pub fn oldest_unseen_is_due(&self) -> Option<u64> {
        self.kept.oldest_unseen_is_due()
    }

    /// Stores concatenated samples that were published before the port of a restarted service existed.
    pub fn take_missed(&mut self, samples: &[u8]) {
        self.kept.keep_all(samples);
    }

    /// Returns the newest sample that is due at the step at `tick`.
    #[inline]
    pub fn deliver(&mut self, tick: u64) -> Option<Delivery<'_>> {
        self.kept.deliver(tick)
    }
}

#[cfg(test)]
mod tests {
    use std::collections::VecDeque;

    use super::*;
    use host::kept_samples::CATCHING_UP;
    use host::step::next_step;
    use proptest::prelude::*;
    use shared_types::samples::RcFrame;
    use shared_types::service::header_of;
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
            let latency = queue.edge().latency;
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
