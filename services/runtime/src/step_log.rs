//! Step log: inputs and times of every step in real time, passed to the recorder without waiting for it.
//!
//! It is a ring of records per service, in an anonymous file that the orchestrator creates and every service inherits. A
//! service writes regardless of its readers. A slow reader detects and counts overwritten records. The records survive the
//! death of their writer.

use std::os::fd::{BorrowedFd, OwnedFd};

use shared_types::ServiceId;
use shared_types::schedule::MAX_PORTS;
use shared_types::service::Operator;
use zerocopy::{FromBytes, Immutable, IntoBytes};

use crate::seqlock::{LookUp, Ring};
use crate::shared_file::SharedFile;

/// Maximum lag of a reader, in records of a service.
pub const DEPTH: u64 = 4096;

/// Lowest bit of the number of a change of gains in [`StepRecord::operator`].
pub const TUNING_SHIFT: u32 = Operator::BITS;

const WORDS: usize = size_of::<StepRecord>() / size_of::<u64>();

/// Word of a record that holds the time of publication.
const PUBLISHED: usize = std::mem::offset_of!(StepRecord, published_ns) / size_of::<u64>();

const _: () = assert!(
    WORDS * size_of::<u64>() == size_of::<StepRecord>() && WORDS == 8 + MAX_PORTS,
    "a record is whole words, as the ring stores it"
);

/// One step of a service in real time. Times are since the start of the flight.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, FromBytes, IntoBytes, Immutable)]
#[repr(C)]
pub struct StepRecord {
    /// Tick of the step.
    pub tick: u64,
    /// Begin of the step, ns, after the wait for its inputs.
    pub began_ns: u64,
    /// Time after the publication of all outputs and before consumers are woken, ns. 0 if the process died before: then some
    /// outputs may have been published.
    pub published_ns: u64,
    /// Number of steps skipped before this one, because their time had passed.
    pub missed: u64,
    /// Inputs of the step's own tick that had not arrived at the end of the wait: bit i for input i.
    pub late_inputs: u64,
    /// Inputs with another sample than at the previous step: bit i for input i.
    pub fresh_inputs: u64,
    /// Requests of the operator ([`Operator::to_bits`]); from bit [`TUNING_SHIFT`] on the number of the change of gains
    /// that holds for the step.
    pub operator: u64,
    /// 1 + the tick of the previous step that the service's state includes; 0 if there is none.
    pub previous: u64,
    /// 1 + the tick of the sample of each input; 0 without a sample.
    pub consumed: [u64; MAX_PORTS],
}

impl StepRecord {
    /// Returns whether all outputs of the step were published.
    #[must_use]
    pub fn is_finished(&self) -> bool {
        self.published_ns != 0
    }

    /// Returns the tick of the sample of an input, if it had one.
    #[must_use]
    pub fn consumed_tick(&self, input: usize) -> Option<u64> {
        self.consumed[input].checked_sub(1)
    }
}

type Records = Ring<WORDS, { DEPTH as usize }>;

type Rings = [Records; ServiceId::ALL.len()];

/// Mapping of all services' step records.
#[derive(Debug)]
pub struct StepLog(SharedFile);

impl StepLog {
    /// Creates the file of a run's step records.
    ///
    /// # Errors
    /// If the system has no memory or no file descriptor left.
    pub fn create() -> std::io::Result<Self> {
        SharedFile::create("gerono-steps", size_of::<Rings>()).map(Self)
    }

    /// Maps inherited step records.
    ///
    /// # Errors
    /// If the file does not hold them.
    pub fn open(file: OwnedFd) -> std::io::Result<Self> {
        SharedFile::open(file, size_of::<Rings>()).map(Self)
    }

    /// Returns the file that a service inherits.
    #[must_use]
    pub fn file(&self) -> BorrowedFd<'_> {
        self.0.file()
    }

    /// Writes the record of a step of `service`. Call it before the step publishes: a death after a publication must not
    /// leave a sample whose inputs no record names. Only the process of the service may call it.
    #[inline]
    pub fn begin(&self, service: ServiceId, record: StepRecord) {
        self.ring(service).begin(zerocopy::transmute!(record));
    }

    /// Writes the time of publication into the begun record and publishes the record to readers.
    #[inline]
    pub fn finish(&self, service: ServiceId, published_ns: u64) {
        self.ring(service).finish(PUBLISHED, published_ns);
    }

    /// Publishes the record of a step during whose publication the process died. Call it after that death.
    pub fn finish_abandoned(&self, service: ServiceId) {
        self.ring(service).finish_abandoned();
    }

    /// Returns the newest complete record of a step of `service` before a tick.
    #[must_use]
    pub fn last_before(&self, service: ServiceId, tick: u64) -> Option<StepRecord> {
        let ring = self.ring(service);
        let mut kept = (0..ring.written())
            .rev()
            .map_while(|number| match ring.look_up(number) {
                LookUp::Record(words) => Some::<StepRecord>(zerocopy::transmute!(words)),
                LookUp::Pending | LookUp::Overwritten(_) => None,
            });
        kept.find(|record| record.tick < tick)
    }

    fn ring(&self, service: ServiceId) -> &Records {
        #[expect(
            unsafe_code,
            reason = "memory shared by several processes can only be reached by mapping it"
        )]
        // SAFETY: the mapping lives as long as `self`, is page-aligned and holds whole `Rings` (checked by `SharedFile`),
        // which consist of atomics and padding: valid for every bit pattern, and others may write them meanwhile.
        let rings = unsafe { &*self.0.as_mut_ptr().cast::<Rings>() };
        &rings[service.index()]
    }
}

/// Reader of the records of a service, in their order.
#[derive(Clone, Debug)]
pub struct StepReader {
    service: ServiceId,
    next: u64,
    overwritten: u64,
}

impl StepReader {
    /// Makes a reader of all records of `service`.
    #[must_use]
    pub fn new(service: ServiceId) -> Self {
        Self {
            service,
            next: 0,
            overwritten: 0,
        }
    }

    /// Makes a reader of later records of `service`.
    #[must_use]
    pub fn from_now(service: ServiceId, log: &StepLog) -> Self {
        Self {
            service,
            next: log.ring(service).written(),
            overwritten: 0,
        }
    }

    /// Returns the next record, if it is complete.
    pub fn next(&mut self, log: &StepLog) -> Option<StepRecord> {
        let ring = log.ring(self.service);
        loop {
            match ring.look_up(self.next) {
                LookUp::Pending => return None,
                LookUp::Overwritten(oldest) => {
                    self.overwritten += oldest - self.next;
                    self.next = oldest;
                }
                LookUp::Record(words) => {
                    self.next += 1;
                    return Some(zerocopy::transmute!(words));
                }
            }
        }
    }

    /// Returns the number of records that were overwritten before they were read.
    #[must_use]
    pub fn overwritten(&self) -> u64 {
        self.overwritten
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

    fn write(log: &StepLog, service: ServiceId, record: StepRecord) {
        let begun = StepRecord {
            published_ns: 0,
            ..record
        };
        log.begin(service, begun);
        log.finish(service, record.published_ns);
    }

    #[test]
    fn a_record_of_a_dead_writer_is_read_once_without_time_of_publication() {
        let log = StepLog::create().unwrap();
        let mut reader = StepReader::new(SERVICE);
        write(&log, SERVICE, record(1));
        log.finish_abandoned(SERVICE);
        let mut late_reader = StepReader::from_now(SERVICE, &log);
        log.begin(
            SERVICE,
            StepRecord {
                published_ns: 0,
                ..record(2)
            },
        );
        assert_eq!(reader.next(&log), Some(record(1)));
        assert_eq!(reader.next(&log), None);
        log.finish_abandoned(SERVICE);
        log.finish_abandoned(SERVICE);
        write(&log, SERVICE, record(3));
        let unfinished = reader.next(&log).unwrap();
        assert_eq!((unfinished.tick, unfinished.published_ns), (2, 0));
        assert_eq!(late_reader.next(&log), Some(unfinished));
        assert_eq!(reader.next(&log), Some(record(3)));
        assert_eq!(reader.next(&log), None);
    }

    proptest! {
        #[test]
        fn every_record_is_read_or_counted_as_overwritten(bursts in prop::collection::vec(0u64..2 * DEPTH, 1..6)) {
            let log = StepLog::create().unwrap();
            let mut reader = StepReader::new(SERVICE);
            let (mut written, mut read) = (0, 0);
            for burst in bursts {
                for tick in written..written + burst {
                    write(&log, SERVICE, record(tick));
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
            scope.spawn(|| (0..total).for_each(|tick| write(&log, SERVICE, record(tick))));
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
        write(&log, ServiceId::Plant, record(1));
        assert_eq!(StepReader::new(SERVICE).next(&log), None);
        assert_eq!(StepReader::new(ServiceId::Plant).next(&log), Some(record(1)));
    }
}
