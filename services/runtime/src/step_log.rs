//! What every step in real time was made of and how long it took, handed to the recorder without ever waiting for it.
//!
//! A ring of records a service, in an anonymous file that the orchestrator makes and every service inherits. A service
//! writes at its own pace and never looks whether anybody has read; a reader that was too slow finds that records
//! have been overwritten and counts them. The count of records survives the death of their writer.

use std::os::fd::{BorrowedFd, OwnedFd};
use std::sync::atomic::{AtomicU64, Ordering, fence};

use shared_types::ServiceId;
use shared_types::schedule::MAX_PORTS;

use crate::shared_file::SharedFile;

/// Records of a service that a reader may lag behind.
pub const DEPTH: u64 = 4096;

const WORDS: usize = 8 + MAX_PORTS;

/// One step of a service in real time. Times are since the start of the flight.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct StepRecord {
    /// Tick of the step.
    pub tick: u64,
    /// When it began, ns: its time had come, and what it waited for was here or given up.
    pub began_ns: u64,
    /// When all that it had to publish was published and nobody had been woken yet, ns.
    pub published_ns: u64,
    /// Steps before it that were left out because their time had passed.
    pub missed: u64,
    /// Inputs of its own tick that had not come when it was given up waiting for them: bit i for input i.
    pub late_inputs: u64,
    /// Inputs of which it saw another sample than the step before: bit i for input i.
    pub fresh_inputs: u64,
    /// What the operator asked for: bit 0 armed, bit 1 land, bit 2 killed.
    pub operator: u64,
    /// 1 + the tick of the step before it that the service remembers; 0 if there is none.
    pub previous: u64,
    /// Of each input, 1 + the tick of the sample that it saw; 0 if it saw none.
    pub consumed: [u64; MAX_PORTS],
}

impl StepRecord {
    fn to_words(self) -> [u64; WORDS] {
        let mut words = [0; WORDS];
        words[..8].copy_from_slice(&[
            self.tick,
            self.began_ns,
            self.published_ns,
            self.missed,
            self.late_inputs,
            self.fresh_inputs,
            self.operator,
            self.previous,
        ]);
        words[8..].copy_from_slice(&self.consumed);
        words
    }

    fn from_words(words: [u64; WORDS]) -> Self {
        let [
            tick,
            began_ns,
            published_ns,
            missed,
            late_inputs,
            fresh_inputs,
            operator,
            previous,
            consumed @ ..,
        ] = words;
        Self {
            tick,
            began_ns,
            published_ns,
            missed,
            late_inputs,
            fresh_inputs,
            operator,
            previous,
            consumed,
        }
    }

    /// Tick of the sample that it saw of an input.
    #[must_use]
    pub fn consumed_tick(&self, input: usize) -> Option<u64> {
        self.consumed[input].checked_sub(1)
    }
}

#[repr(C, align(64))]
struct Ring {
    /// Records written so far, each at its number modulo [`DEPTH`].
    written: AtomicU64,
    slots: [[AtomicU64; WORDS]; DEPTH as usize],
}

type Rings = [Ring; ServiceId::ALL.len()];

/// A mapping of all services' step records.
#[derive(Debug)]
pub struct StepLog(SharedFile);

impl StepLog {
    /// Makes room for a run's step records.
    ///
    /// # Errors
    /// If the system has no memory or no file descriptor left.
    pub fn create() -> std::io::Result<Self> {
        SharedFile::create("gerono-steps", size_of::<Rings>()).map(Self)
    }

    /// Maps step records that were inherited.
    ///
    /// # Errors
    /// If the file does not hold them.
    pub fn open(file: OwnedFd) -> std::io::Result<Self> {
        SharedFile::open(file, size_of::<Rings>()).map(Self)
    }

    /// The file, to be inherited by a service.
    #[must_use]
    pub fn file(&self) -> BorrowedFd<'_> {
        self.0.file()
    }

    /// Adds a record of `service`. To be called by one process at a time for a service: by its own.
    #[inline]
    pub fn write(&self, service: ServiceId, record: StepRecord) {
        let ring = self.ring(service);
        let number = ring.written.load(Ordering::Relaxed);
        for (place, word) in ring.slots[slot_of(number)].iter().zip(record.to_words()) {
            place.store(word, Ordering::Relaxed);
        }
        ring.written.store(number + 1, Ordering::Release);
    }

    fn ring(&self, service: ServiceId) -> &Ring {
        #[expect(
            unsafe_code,
            reason = "memory shared by several processes can only be reached by mapping it"
        )]
        // SAFETY: the mapping lives as long as `self`, is page-aligned and holds whole `Rings` (`SharedFile` sees to it),
        // which consist of atomics and padding: valid for every bit pattern, and others may write them meanwhile.
        let rings = unsafe { &*self.0.as_mut_ptr().cast::<Rings>() };
        &rings[service.index()]
    }
}

fn slot_of(number: u64) -> usize {
    usize::try_from(number % DEPTH).expect("below the depth")
}

/// Reads the records of a service in their order.
#[derive(Clone, Debug)]
pub struct StepReader {
    service: ServiceId,
    next: u64,
    overwritten: u64,
}

impl StepReader {
    /// Reads the records of `service` from the first on.
    #[must_use]
    pub fn new(service: ServiceId) -> Self {
        Self {
            service,
            next: 0,
            overwritten: 0,
        }
    }

    /// The next record, if there is one by now.
    pub fn next(&mut self, log: &StepLog) -> Option<StepRecord> {
        let ring = log.ring(self.service);
        loop {
            let written = ring.written.load(Ordering::Acquire);
            if self.next >= written {
                return None;
            }
            // The oldest is just being overwritten when the ring is full.
            let oldest = (written + 1).saturating_sub(DEPTH);
            self.skip_to(oldest);
            let slot = &ring.slots[slot_of(self.next)];
            let words = std::array::from_fn(|word| slot[word].load(Ordering::Relaxed));
            // The words before, the count after: what was overwritten meanwhile is not taken.
            fence(Ordering::Acquire);
            if ring.written.load(Ordering::Relaxed) < self.next + DEPTH {
                self.next += 1;
                return Some(StepRecord::from_words(words));
            }
        }
    }

    /// Records that were overwritten before they were read.
    #[must_use]
    pub fn overwritten(&self) -> u64 {
        self.overwritten
    }

    fn skip_to(&mut self, oldest: u64) {
        self.overwritten += oldest.saturating_sub(self.next);
        self.next = self.next.max(oldest);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const SERVICE: ServiceId = ServiceId::Controller;

    fn record(tick: u64) -> StepRecord {
        StepRecord {
            tick,
            began_ns: 10 * tick,
            published_ns: 10 * tick + 3,
            missed: tick % 3,
            late_inputs: tick % 2,
            fresh_inputs: tick % 4,
            operator: tick % 8,
            previous: tick,
            consumed: std::array::from_fn(|input| tick + input as u64),
        }
    }

    proptest! {
        #[test]
        fn every_record_is_read_or_counted_as_overwritten(bursts in prop::collection::vec(0u64..2 * DEPTH, 1..6)) {
            let log = StepLog::create().unwrap();
            let mut reader = StepReader::new(SERVICE);
            let (mut written, mut read) = (0, 0);
            for burst in bursts {
                for tick in written..written + burst {
                    log.write(SERVICE, record(tick));
                }
                written += burst;
                while let Some(found) = reader.next(&log) {
                    prop_assert_eq!(found, record(read + reader.overwritten()));
                    read += 1;
                }
                prop_assert_eq!(read + reader.overwritten(), written);
            }
        }
    }

    #[test]
    fn a_reader_beside_a_writer_sees_only_whole_records_in_their_order() {
        let log = StepLog::create().unwrap();
        let total = 50 * DEPTH;
        std::thread::scope(|scope| {
            scope.spawn(|| (0..total).for_each(|tick| log.write(SERVICE, record(tick))));
            let mut reader = StepReader::new(SERVICE);
            let (mut last, mut read) = (None, 0);
            while read + reader.overwritten() < total {
                if let Some(found) = reader.next(&log) {
                    assert_eq!(found, record(found.tick));
                    assert!(last < Some(found.tick));
                    last = Some(found.tick);
                    read += 1;
                }
            }
            assert_eq!(last, Some(total - 1));
        });
    }

    #[test]
    fn services_do_not_see_each_others_records() {
        let log = StepLog::create().unwrap();
        log.write(ServiceId::Plant, record(1));
        assert_eq!(StepReader::new(SERVICE).next(&log), None);
        assert_eq!(StepReader::new(ServiceId::Plant).next(&log), Some(record(1)));
    }
}
