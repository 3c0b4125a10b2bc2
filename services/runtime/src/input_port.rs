//! Input of a service in lock step, also of a restarted one.
//!
//! A restarted service may have missed samples that were published before its ports existed. The orchestrator has recorded
//! these samples and sends them; later ones arrive at the port. At first the service accepts samples from both sources.
//! No sample after the first one at the port can be missing: as soon as the due sample is not earlier than that one, the
//! service reads from shared memory only.
//!
//! An edge with planned faults receives every sample at once and stores those that may still be due ([`EdgeStore`]).

use shared_types::ServiceId;
use shared_types::schedule::Edge;
use shared_types::service::{InputView, header_of};

use crate::flight_error::FlightError;
use crate::ports::{PortError, RECORDER_BUFFER, Receiver};
use host::edge_store::EdgeStore;

/// Input of a service.
pub struct InputPort {
    /// Index of the input in the wiring table.
    pub index: usize,
    /// The input's edge in the schedule.
    pub edge: Edge,
    /// Publisher of the topic.
    pub publisher: ServiceId,
    receiver: Box<dyn Receiver>,
    kept: Option<Kept>,
}

/// Copies of samples besides the one that the port holds, for a restarted service and for an edge with planned faults.
struct Kept {
    samples: EdgeStore,
    /// `true` while the due sample may have to come from the orchestrator.
    is_restarted: bool,
    /// Tick of the first sample that arrived at the port.
    first_at_port: Option<u64>,
}

impl Kept {
    fn new(edge: &Edge, is_restarted: bool) -> Self {
        Self {
            samples: EdgeStore::new(edge.clone()),
            is_restarted,
            first_at_port: None,
        }
    }
}

impl InputPort {
    /// Makes an input that reads from a port.
    #[must_use]
    pub fn new(index: usize, edge: Edge, publisher: ServiceId, receiver: Box<dyn Receiver>) -> Self {
        Self {
            index,
            kept: edge.has_faults().then(|| Kept::new(&edge, false)),
            edge,
            publisher,
            receiver,
        }
    }

    /// Returns the port.
    pub fn receiver(&mut self) -> &mut dyn Receiver {
        self.receiver.as_mut()
    }

    /// Marks the service as restarted.
    ///
    /// Discards the samples that are at the port. They may have gaps, because a publisher does not wait for a receiver
    /// that is not connected or not published in the control block. Later samples have none.
    ///
    /// # Errors
    /// The error of the port.
    pub fn expect_missed(&mut self) -> Result<(), PortError> {
        while self.receiver.receive()? {}
        self.kept = Some(Kept::new(&self.edge, true));
        Ok(())
    }

    /// Stores a sample that the service may have missed.
    pub fn take_missed(&mut self, bytes: &[u8]) {
        if let Some(kept) = self.kept.as_mut().filter(|kept| kept.is_restarted) {
            kept.samples.keep(bytes);
        }
    }

    /// Returns whether all further samples come from the port.
    #[must_use]
    #[inline]
    pub fn has_caught_up(&self) -> bool {
        self.kept.as_ref().is_none_or(|kept| !kept.is_restarted)
    }

    /// Receives samples up to that of tick `due`, the due one without faults. Returns `false` if one has not arrived yet.
    ///
    /// # Errors
    /// [`FlightError::Lost`] or the error of the port.
    #[inline]
    pub fn advance(&mut self, tick: u64, due: u64) -> Result<bool, FlightError> {
        if self.kept.is_some() {
            return if self.edge.has_faults() {
                self.advance_among_faults(tick, due)
            } else {
                self.advance_restarted(tick, due)
            };
        }
        // Bounded: a publisher that repeats old samples without a pause must not prevent the service from checking for
        // the end of the run.
        for _ in 0..=RECORDER_BUFFER {
            if let Some(got) = self.held_tick() {
                if got == due {
                    return Ok(true);
                }
                if got > due {
                    return Err(self.lost(tick, due, got));
                }
            }
            if !self.receiver.receive()? {
                break;
            }
        }
        Ok(false)
    }

    /// Returns the sample of tick `due` for the step at `tick`, after it has arrived.
    #[must_use]
    #[inline]
    pub fn view(&mut self, tick: u64, due: u64) -> InputView<'_> {
        if let Some(kept) = self.kept.as_mut().filter(|kept| kept.samples.has(due)) {
            return kept.samples.view(tick, due);
        }
        InputView {
            bytes: self.receiver.held(),
            fresh: self.edge.is_fresh(tick, due),
        }
    }

    /// Receives all samples at the port until no sample can be missing, even if the orchestrator has sent the due one: a
    /// full port would block its publisher.
    #[cold]
    fn advance_restarted(&mut self, tick: u64, due: u64) -> Result<bool, FlightError> {
        let Some(kept) = &mut self.kept else {
            return self.advance(tick, due);
        };
        while kept.is_restarted && self.receiver.receive()? {
            let bytes = self.receiver.held().expect("just received");
            kept.first_at_port.get_or_insert(header_of(bytes).tick);
            kept.samples.keep(bytes);
        }
        kept.samples.forget_before(due);
        if kept.first_at_port.is_some_and(|first| first <= due) {
            kept.is_restarted = false;
        }
        if kept.samples.has(due) {
            return Ok(true);
        }
        if kept.is_restarted {
            // The due sample is earlier than the first one at the port: it comes from the orchestrator.
            return Ok(false);
        }
        // No stored sample is left: the next one is at the port.
        self.kept = None;
        self.advance(tick, due)
    }

    /// Stores all samples that have arrived: with late or lost samples, later ones may arrive before the due one. The service also
    /// waits for what would be due without faults, `published`: or it would run ahead of its publishers.
    #[cold]
    fn advance_among_faults(&mut self, tick: u64, published: u64) -> Result<bool, FlightError> {
        let Some(kept) = &mut self.kept else {
            return Ok(false);
        };
        while self.receiver.receive()? {
            let bytes = self.receiver.held().expect("just received");
            kept.first_at_port.get_or_insert(header_of(bytes).tick);
            kept.samples.keep(bytes);
        }
        let due = self.edge.due_sample(tick);
        due.inspect(|&due| kept.samples.forget_before(due));
        let oldest = due.map_or(published, |due| kept.samples.oldest_needed(due));
        if kept.first_at_port.is_some_and(|first| first <= oldest) {
            kept.is_restarted = false;
        }
        // A restarted service gets only what it needs of what was published before.
        if !kept.is_restarted && !kept.samples.has_come_to(published) {
            return Ok(false);
        }
        let Some(due) = due.filter(|&due| !kept.samples.has(due)) else {
            return Ok(true);
        };
        match kept
            .samples
            .newest()
            .filter(|&newest| newest > due && !kept.is_restarted)
        {
            Some(newest) => Err(self.lost(tick, due, newest)),
            None => Ok(false),
        }
    }

    #[inline]
    fn held_tick(&self) -> Option<u64> {
        self.receiver.held().map(|bytes| header_of(bytes).tick)
    }

    #[cold]
    fn lost(&self, tick: u64, due: u64, got: u64) -> FlightError {
        FlightError::Lost {
            tick,
            topic: self.edge.topic,
            due,
            got,
        }
    }
}

#[cfg(test)]
mod tests {
    use std::collections::VecDeque;

    use proptest::prelude::*;
    use shared_types::samples::VehicleState;
    use shared_types::{Schedule, Topic};
    use zerocopy::{FromZeros, IntoBytes};

    use super::*;

    /// Port that has samples of these ticks.
    struct Port {
        coming: VecDeque<u64>,
        held: Option<VehicleState>,
    }

    fn sample(tick: u64) -> VehicleState {
        let mut sample = VehicleState::new_zeroed();
        sample.header.tick = tick;
        sample
    }

    impl Receiver for Port {
        fn receive(&mut self) -> Result<bool, PortError> {
            let next = self.coming.pop_front();
            self.held = next.map(sample).or(self.held);
            Ok(next.is_some())
        }

        fn held(&self) -> Option<&[u8]> {
            self.held.as_ref().map(IntoBytes::as_bytes)
        }

        fn id(&self) -> u128 {
            1
        }

        fn connect(&mut self) -> Result<(), PortError> {
            Ok(())
        }
    }

    fn input(coming: impl IntoIterator<Item = u64>) -> InputPort {
        let schedule = Schedule::ideal(1_000_000, 1000);
        let (service, index) = Topic::VehicleState.consumers().next().unwrap();
        let port = Port {
            coming: coming.into_iter().collect(),
            held: None,
        };
        InputPort::new(
            index,
            schedule.edge(service, index),
            ServiceId::Estimator,
            Box::new(port),
        )
    }

    fn tick_seen(input: &mut InputPort, due: u64) -> u64 {
        let view = input.view(due, due);
        // Ideal samples are as large as whole words.
        header_of(view.bytes.unwrap()).tick
    }

    proptest! {
        // The service died before its step at `next`. Its port gives the samples after `first`, perhaps preceded by
        // those that a restarted publisher repeats. The orchestrator gives the recorded ones, some of them late.
        #[test]
        fn a_restarted_service_sees_every_sample_once_wherever_it_comes_from(
            next in 10..20u64, joins_later in 0..10u64, repeats in 0..5u64, late in 0..12u64,
        ) {
            let (first, end) = (next + joins_later - repeats, 60);
            let mut input = input(first..end);
            input.kept = Some(Kept::new(&input.edge, true));
            let mut told = next;
            for due in next..end {
                while !input.advance(due, due).unwrap() {
                    // A sample that the port did not give must come from the orchestrator.
                    prop_assert!(due < first, "{due} should have come through the port from {first} on");
                    input.take_missed(sample(told).as_bytes());
                    told += 1;
                }
                prop_assert_eq!(tick_seen(&mut input, due), due);
                if due < next + late {
                    input.take_missed(sample(told).as_bytes());
                    told += 1;
                }
            }
            prop_assert!(input.has_caught_up());
        }
    }

    #[test]
    fn samples_from_before_a_restart_are_discarded() {
        let mut input = input([3, 4, 9]);
        input.expect_missed().unwrap();
        assert!(!input.advance(5, 5).unwrap());
        input.take_missed(sample(5).as_bytes());
        assert!(input.advance(5, 5).unwrap());
        assert_eq!(tick_seen(&mut input, 5), 5);
    }

    #[test]
    fn repeated_samples_are_skipped_and_a_gap_is_an_error() {
        let mut input = input([3, 4, 3, 4, 5, 7]);
        for due in 3..6 {
            assert!(input.advance(due, due).unwrap());
            assert_eq!(tick_seen(&mut input, due), due);
        }
        assert!(matches!(
            input.advance(6, 6),
            Err(FlightError::Lost { due: 6, got: 7, .. })
        ));
    }
}
