//! Samples of external services: copied before any use, and in real time refused if they are ahead of the clock.
//!
//! A program may write into a sample after it has sent it. The validated bytes must be the used bytes, so every sample is
//! copied once and only the copy is read. Built-in services do not write into sent samples; these are read in place.
//!
//! In real time all samples after one whose tick is ahead of the clock would be dropped as old. Such a sample, and one whose
//! header is not that of its tick, is refused and counted; later valid samples are accepted.

use std::cell::Cell;
use std::rc::Rc;

use shared_types::Header;
use shared_types::schedule::Publication;
use shared_types::service::header_of;

use crate::ports::{PortError, RECORDER_BUFFER, Receiver};
use host::owned_sample::OwnedSample;

/// Tolerance in ticks: the program reads the clock at another time than this process.
const EARLY_TICKS: u64 = 1;

/// Refused samples.
#[derive(Debug, Default)]
pub struct Refusals {
    count: Cell<u64>,
    last: Cell<Option<Header>>,
}

impl Refusals {
    /// Returns the number of refused samples.
    #[must_use]
    pub fn count(&self) -> u64 {
        self.count.get()
    }

    /// Returns the header of the last refused sample.
    #[must_use]
    pub fn last(&self) -> Option<Header> {
        self.last.get()
    }
}

/// Rule for accepting a sample.
struct Admission {
    publication: Publication,
    last_tick: u64,
    /// Current tick of the flight's clock.
    clock_tick: Box<dyn Fn() -> u64>,
    refusals: Rc<Refusals>,
}

impl Admission {
    fn admits(&self, header: Header) -> bool {
        // Check the limit first: the header of a much larger tick cannot be computed.
        let latest = (self.clock_tick)()
            .saturating_add(EARLY_TICKS)
            .min(self.last_tick);
        let is_possible = header.tick <= latest
            && self.publication.is_due(header.tick)
            && self.publication.header(header.tick) == header;
        if !is_possible {
            self.refusals.count.set(self.refusals.count() + 1);
            self.refusals.last.set(Some(header));
        }
        is_possible
    }
}

/// Receiver of a topic that an external service publishes.
pub struct UntrustedReceiver {
    inner: Box<dyn Receiver>,
    /// Copy of the held sample, if `is_held`.
    held: OwnedSample,
    is_held: bool,
    /// Copy of the next sample, before its validation.
    next: OwnedSample,
    admission: Option<Admission>,
}

impl UntrustedReceiver {
    /// Makes a receiver that copies the samples of `inner`, a receiver of the topic of `publication`.
    #[must_use]
    pub fn new(inner: Box<dyn Receiver>, publication: &Publication) -> Self {
        Self {
            inner,
            held: OwnedSample::zeroed(publication.topic),
            is_held: false,
            next: OwnedSample::zeroed(publication.topic),
            admission: None,
        }
    }

    /// Adds the refusal of samples that are ahead of the clock: `clock_tick` returns the current tick.
    #[must_use]
    pub fn within_clock(
        mut self,
        publication: Publication,
        last_tick: u64,
        clock_tick: impl Fn() -> u64 + 'static,
    ) -> Self {
        self.admission = Some(Admission {
            publication,
            last_tick,
            clock_tick: Box::new(clock_tick),
            refusals: Rc::default(),
        });
        self
    }

    /// Returns the record of refused samples.
    #[must_use]
    pub fn refusals(&self) -> Rc<Refusals> {
        let admission = self.admission.as_ref();
        admission.map_or_else(Rc::default, |admission| Rc::clone(&admission.refusals))
    }
}

impl Receiver for UntrustedReceiver {
    fn receive(&mut self) -> Result<bool, PortError> {
        // Bounded: a program that publishes invalid samples without a pause must not block its consumer.
        for _ in 0..RECORDER_BUFFER {
            if !self.inner.receive()? {
                return Ok(false);
            }
            // Copy before the validation: the program may write at any time.
            let received = self.inner.held().expect("just received");
            self.next.bytes_mut().copy_from_slice(received);
            let header = header_of(self.next.bytes());
            if self
                .admission
                .as_ref()
                .is_none_or(|admission| admission.admits(header))
            {
                std::mem::swap(&mut self.held, &mut self.next);
                self.is_held = true;
                return Ok(true);
            }
        }
        Ok(false)
    }

    fn held(&self) -> Option<&[u8]> {
        self.is_held.then(|| self.held.bytes())
    }

    fn id(&self) -> u128 {
        self.inner.id()
    }

    fn connect(&mut self) -> Result<(), PortError> {
        self.inner.connect()
    }
}

#[cfg(test)]
mod tests {
    use std::collections::VecDeque;

    use shared_types::samples::ControlCommand;
    use shared_types::{Schedule, Topic};
    use zerocopy::{FromZeros, IntoBytes};

    use super::*;

    const LAST_TICK: u64 = 1000;

    /// Port with these headers, whose program writes into sent samples.
    struct Port {
        coming: VecDeque<Header>,
        held: Option<ControlCommand>,
    }

    impl Receiver for Port {
        fn receive(&mut self) -> Result<bool, PortError> {
            let next = self.coming.pop_front();
            let sample = |header| ControlCommand {
                header,
                ..ControlCommand::new_zeroed()
            };
            self.held = next.map(sample).or(self.held);
            Ok(next.is_some())
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

    fn receiver(headers: impl IntoIterator<Item = Header>, now: u64) -> UntrustedReceiver {
        let publication = Schedule::ideal(1_000_000, LAST_TICK).publication(Topic::ControlCommand);
        let port = Port {
            coming: headers.into_iter().collect(),
            held: None,
        };
        UntrustedReceiver::new(Box::new(port), &publication).within_clock(publication, LAST_TICK, move || now)
    }

    fn good(tick: u64) -> Header {
        Schedule::ideal(1_000_000, LAST_TICK).header(Topic::ControlCommand, tick)
    }

    fn ticks(receiver: &mut UntrustedReceiver) -> Vec<u64> {
        let mut ticks = Vec::new();
        while receiver.receive().unwrap() {
            ticks.push(header_of(receiver.held().unwrap()).tick);
        }
        ticks
    }

    #[test]
    fn impossible_samples_are_refused_and_good_ones_after_them_pass() {
        let wrong = [
            Header {
                tick: u64::MAX,
                ..good(5)
            },
            Header {
                tick: 1 << 40,
                ..good(5)
            },
            Header {
                stamp_ns: 1,
                ..good(5)
            },
            Header { seq: 6, ..good(5) },
            good(12),
        ];
        for refused in wrong {
            let mut receiver = receiver([good(5), refused, good(6), good(11)], 10);
            assert_eq!(ticks(&mut receiver), [5, 6, 11], "{refused:?}");
            let refusals = receiver.refusals();
            assert_eq!((refusals.count(), refusals.last()), (1, Some(refused)));
        }
        let beyond_the_flight = Header {
            tick: LAST_TICK + 1,
            ..good(5)
        };
        assert!(ticks(&mut receiver([beyond_the_flight], u64::MAX)).is_empty());
    }

    #[test]
    fn a_flood_of_invalid_samples_does_not_block_the_consumer() {
        let nonsense = Header {
            tick: u64::MAX,
            ..good(5)
        };
        let mut receiver = receiver(vec![nonsense; 3 * RECORDER_BUFFER], 10);
        assert!(!receiver.receive().unwrap());
        assert_eq!(receiver.refusals().count(), RECORDER_BUFFER as u64);
        assert!(receiver.held().is_none());
    }

    #[test]
    fn a_held_sample_does_not_change_when_the_program_writes_into_it() {
        let mut receiver = receiver([good(5), good(6)], 10);
        assert!(receiver.receive().unwrap());
        // The port goes on to the next sample in the same memory, though no step has asked for it.
        assert!(receiver.inner.receive().unwrap());
        assert_eq!(header_of(receiver.held().unwrap()), good(5));
    }
}
