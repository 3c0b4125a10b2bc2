//! An input of a service in lock-step, also of one that is born again in flight.
//!
//! A reborn service may have missed samples: those that were published while nobody listened. It gets them from
//! the orchestrator, which has recorded them, and its port gives the rest; at first it takes whatever comes from
//! either. From the first sample at the port on all later ones come there: as soon as that is no later than what
//! is due, nothing can be missing any more and samples are read in shared memory again.

use std::collections::BTreeMap;

use shared_types::ServiceId;
use shared_types::schedule::Edge;
use shared_types::service::{InputView, header_of};
use zerocopy::IntoBytes;

use crate::lock_step::FlightError;
use crate::ports::{PortError, Receiver};

/// An input.
pub struct Inlet {
    /// Place of the input in the wiring table.
    pub index: usize,
    /// The input as the schedule sees it.
    pub edge: Edge,
    /// Who publishes the topic.
    pub publisher: ServiceId,
    receiver: Box<dyn Receiver>,
    missed: Option<Missed>,
}

/// What a reborn service has of an input beside the sample that its port holds.
#[derive(Default)]
struct Missed {
    /// Copies by tick; whole words, because samples are read in place.
    samples: BTreeMap<u64, Box<[u64]>>,
    /// Tick of the first sample that came by the port.
    first_at_port: Option<u64>,
}

impl Inlet {
    /// An input that reads from a port.
    #[must_use]
    pub fn new(index: usize, edge: Edge, publisher: ServiceId, receiver: Box<dyn Receiver>) -> Self {
        Self {
            index,
            edge,
            publisher,
            receiver,
            missed: None,
        }
    }

    /// The port.
    pub fn receiver(&mut self) -> &mut dyn Receiver {
        self.receiver.as_mut()
    }

    /// Says that the service is born again.
    ///
    /// What has come by the port until now is thrown away, because there may be gaps in it: a publisher does not
    /// wait for a receiver that is not connected or not known yet. From now on there are none.
    ///
    /// # Errors
    /// That of the port.
    pub fn expect_missed(&mut self) -> Result<(), PortError> {
        while self.receiver.receive()? {}
        self.missed = Some(Missed::default());
        Ok(())
    }

    /// Takes a sample that may have been missed.
    pub fn take_missed(&mut self, bytes: &[u8]) {
        if let Some(missed) = &mut self.missed {
            missed.insert(bytes);
        }
    }

    /// Whether all samples come by the port.
    #[must_use]
    #[inline]
    pub fn has_caught_up(&self) -> bool {
        self.missed.is_none()
    }

    /// Takes samples until the one of tick `due` is here, for the step at `tick`; `false` if it has not come yet.
    ///
    /// # Errors
    /// [`FlightError::Lost`] or that of the port.
    #[inline]
    pub fn advance(&mut self, tick: u64, due: u64) -> Result<bool, FlightError> {
        if self.missed.is_some() {
            return self.advance_reborn(tick, due);
        }
        loop {
            if let Some(got) = self.held_tick() {
                if got == due {
                    return Ok(true);
                }
                if got > due {
                    return Err(self.lost(tick, due, got));
                }
            }
            if !self.receiver.receive()? {
                return Ok(false);
            }
        }
    }

    /// The sample of tick `due` once it is here, for the step at `tick`.
    #[must_use]
    #[inline]
    pub fn view(&self, tick: u64, due: u64) -> InputView<'_> {
        let copy = self
            .missed
            .as_ref()
            .and_then(|missed| missed.samples.get(&due))
            .map(|words| words.as_bytes());
        InputView {
            bytes: copy.or_else(|| self.receiver.held()),
            fresh: self.edge.is_fresh(tick, due),
        }
    }

    #[cold]
    fn advance_reborn(&mut self, tick: u64, due: u64) -> Result<bool, FlightError> {
        loop {
            let Some(missed) = &mut self.missed else {
                return self.advance(tick, due);
            };
            missed.samples = missed.samples.split_off(&due);
            if missed.samples.contains_key(&due) {
                return Ok(true);
            }
            // What is due comes before the port's first sample: only the orchestrator can give it.
            if missed.first_at_port.is_some_and(|first| first > due) || !self.receiver.receive()? {
                return Ok(false);
            }
            let bytes = self.receiver.held().expect("just received");
            let got = header_of(bytes).tick;
            let first = *missed.first_at_port.get_or_insert(got);
            if first > due {
                missed.insert(bytes);
            } else if got == due {
                self.missed = None;
            } else if got > due {
                return Err(self.lost(tick, due, got));
            }
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

impl Missed {
    fn insert(&mut self, bytes: &[u8]) {
        let mut words = vec![0; bytes.len().div_ceil(size_of::<u64>())].into_boxed_slice();
        words.as_mut_bytes()[..bytes.len()].copy_from_slice(bytes);
        self.samples.insert(header_of(bytes).tick, words);
    }
}

#[cfg(test)]
mod tests {
    use std::collections::VecDeque;

    use proptest::prelude::*;
    use shared_types::samples::VehicleState;
    use shared_types::{Schedule, Topic};
    use zerocopy::FromZeros;

    use super::*;
    /// A port that has these ticks to give.
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

    fn inlet(coming: impl IntoIterator<Item = u64>) -> Inlet {
        let schedule = Schedule::ideal(1_000_000, 1000);
        let (service, index) = Topic::VehicleState.consumers().next().unwrap();
        let port = Port {
            coming: coming.into_iter().collect(),
            held: None,
        };
        Inlet::new(
            index,
            schedule.edge(service, index),
            ServiceId::Estimator,
            Box::new(port),
        )
    }

    fn tick_seen(inlet: &Inlet, due: u64) -> u64 {
        let view = inlet.view(due, due);
        // Ideal samples are as large as whole words.
        header_of(view.bytes.unwrap()).tick
    }

    proptest! {
        // The service died before its step at `next`; its port gives what was published after `first`, at first
        // perhaps again what a reborn publisher repeats; the orchestrator gives what it has, some of it late.
        #[test]
        fn a_reborn_service_sees_every_sample_once_wherever_it_comes_from(
            next in 10..20u64, joins_later in 0..10u64, repeats in 0..5u64, late in 0..12u64,
        ) {
            let (first, end) = (next + joins_later - repeats, 60);
            let mut inlet = inlet(first..end);
            inlet.missed = Some(Missed::default());
            let mut told = next;
            for due in next..end {
                while !inlet.advance(due, due).unwrap() {
                    // What the port did not give the orchestrator must.
                    prop_assert!(due < first, "{due} should have come by the port from {first} on");
                    inlet.take_missed(sample(told).as_bytes());
                    told += 1;
                }
                prop_assert_eq!(tick_seen(&inlet, due), due);
                if due < next + late {
                    inlet.take_missed(sample(told).as_bytes());
                    told += 1;
                }
            }
            prop_assert!(inlet.has_caught_up());
        }
    }

    #[test]
    fn what_came_before_a_rebirth_is_thrown_away() {
        let mut inlet = inlet([3, 4, 9]);
        inlet.expect_missed().unwrap();
        assert!(!inlet.advance(5, 5).unwrap());
        inlet.take_missed(sample(5).as_bytes());
        assert!(inlet.advance(5, 5).unwrap());
        assert_eq!(tick_seen(&inlet, 5), 5);
    }

    #[test]
    fn repeated_samples_are_passed_over_and_a_gap_is_an_error() {
        let mut inlet = inlet([3, 4, 3, 4, 5, 7]);
        for due in 3..6 {
            assert!(inlet.advance(due, due).unwrap());
            assert_eq!(tick_seen(&inlet, due), due);
        }
        assert!(matches!(
            inlet.advance(6, 6),
            Err(FlightError::Lost { due: 6, got: 7, .. })
        ));
    }
}
