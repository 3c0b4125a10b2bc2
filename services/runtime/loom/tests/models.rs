//! Every interleaving of the lock-free parts of `runtime`, as the memory model allows them.
//!
//! The models are bounded: records of two words, a writer that writes a few of them, one reader. The writer is always the
//! thread of the model itself, which loom runs first. With the reader there, loom (0.7) would leave orders out: it tries
//! another order of two accesses only if the thread of the later one has not read the word in between, as writers do.

use loom::sync::Arc;
use loom::sync::atomic::{AtomicU32, Ordering};
use loom::thread;
use runtime_loom::Gains;
use runtime_loom::announcement::{Published, announce, count_ring, rings};
use runtime_loom::seqlock::{LookUp, Pair, Ring};
use runtime_loom::status_cell::StatusCell;
use runtime_loom::tuning::{TuningReader, TuningRing};

const WORDS: usize = 2;
const DEPTH: usize = 2;

/// Record of a tick; no word of it is in the record of another tick.
fn record(tick: u64) -> [u8; 16] {
    let mut bytes = [0; 16];
    bytes[..8].copy_from_slice(&tick.to_ne_bytes());
    bytes[8..].copy_from_slice(&(!tick).to_ne_bytes());
    bytes
}

#[test]
fn a_snapshot_beside_a_writer_is_whole_and_of_the_tick_that_it_tells() {
    loom::model(|| {
        let pair = Arc::new(Pair::<WORDS>::default());
        pair.write(0, |keep| keep(&record(0)));
        let reader = {
            let pair = Arc::clone(&pair);
            thread::spawn(move || {
                if let Some((tick, bytes)) = pair.snapshot() {
                    assert_eq!(bytes, record(tick), "torn at {tick}");
                }
            })
        };
        (1..4).for_each(|tick| pair.write(tick, |keep| keep(&record(tick))));
        reader.join().unwrap();
        assert_eq!(pair.snapshot(), Some((3, record(3).to_vec())));
    });
}

#[test]
fn a_reader_beside_the_writer_of_a_ring_sees_whole_records_or_that_they_are_gone() {
    loom::model(|| {
        let ring = Arc::new(Ring::<WORDS, DEPTH>::default());
        let write = |ring: &Ring<WORDS, DEPTH>, number: u64| {
            ring.begin([number, 0]);
            ring.finish(1, !number);
        };
        write(&ring, 0);
        let reader = {
            let ring = Arc::clone(&ring);
            thread::spawn(move || {
                for number in 0..2 {
                    match ring.look_up(number) {
                        LookUp::Record(words) => assert_eq!(words, [number, !number]),
                        LookUp::Overwritten(oldest) => assert!(oldest > number),
                        LookUp::Pending => assert!(number > 0),
                    }
                }
            })
        };
        (1..4).for_each(|number| write(&ring, number));
        reader.join().unwrap();
        assert_eq!(ring.look_up(3), LookUp::Record([3, !3]));
    });
}

/// Step log: the writer dies after the begin of a record, which another process publishes. Nothing but the ring orders the
/// two here; the death of a process orders more.
#[test]
fn a_record_of_a_dead_writer_is_published_whole_or_not_at_all() {
    loom::model(|| {
        let ring = Arc::new(Ring::<WORDS, DEPTH>::default());
        let publisher = {
            let ring = Arc::clone(&ring);
            thread::spawn(move || {
                ring.finish_abandoned();
                match ring.look_up(0) {
                    LookUp::Record(words) => assert_eq!(words, [7, 8]),
                    other => assert_eq!(other, LookUp::Pending),
                }
            })
        };
        ring.begin([7, 8]);
        publisher.join().unwrap();
    });
}

/// Gains of a change; no word of them is in those of another change.
fn gains(change: u64) -> Gains {
    Gains {
        k1: change as f64,
        k2: -(change as f64),
    }
}

#[test]
fn a_service_beside_a_change_of_gains_has_whole_gains_that_are_due_and_their_number() {
    loom::model(|| {
        let ring = Arc::new(TuningRing::default());
        let service = {
            let ring = Arc::clone(&ring);
            thread::spawn(move || {
                let mut reader = TuningReader::default();
                for tick in 1..3 {
                    let before = reader.number();
                    match reader.due(&ring, tick) {
                        Some(found) => {
                            assert_eq!(found, gains(reader.number()));
                            assert!(before < reader.number() && reader.number() <= tick);
                        }
                        None => assert_eq!(reader.number(), before),
                    }
                }
                reader
            })
        };
        for change in 1..3 {
            assert_eq!(ring.change(change, &gains(change)), change);
        }
        let mut reader = service.join().unwrap();
        reader.due(&ring, 2);
        assert_eq!((reader.number(), ring.last()), (2, Some((2, gains(2)))));
    });
}

/// The numbers may be of two records, but each of them is one that was written, and none goes back.
#[test]
fn numbers_of_a_status_cell_are_whole_and_never_go_back() {
    loom::model(|| {
        let cell = Arc::new(StatusCell::default());
        let reader = {
            let cell = Arc::clone(&cell);
            thread::spawn(move || [(); 2].map(|()| cell.read::<[u64; 2]>()))
        };
        (1..3_u64).for_each(|number| cell.write(&[number, number]));
        let [first, second] = reader.join().unwrap();
        assert!(
            first
                .iter()
                .zip(second)
                .all(|(&before, after)| before <= after && after < 3)
        );
        assert_eq!(cell.read::<[u64; 2]>(), [2, 2]);
    });
}

const PUBLISHER: u32 = 3;

/// A sample is a word here, which is published in the weakest order that ports have.
#[test]
fn a_consumer_that_goes_to_sleep_has_seen_the_sample_or_is_woken() {
    loom::model(|| {
        let words = Arc::new([(); 3].map(|()| AtomicU32::new(0)));
        let publisher = {
            let words = Arc::clone(&words);
            thread::spawn(move || {
                let [sample, announced, bell] = &*words;
                sample.store(1, Ordering::Relaxed);
                if Published::now().is_awaited(announced, PUBLISHER) {
                    count_ring(bell);
                }
            })
        };
        let [sample, announced, bell] = &*words;
        announce(announced, PUBLISHER);
        let rung = rings(bell);
        let has_seen = sample.load(Ordering::Relaxed) == 1;
        publisher.join().unwrap();
        // The system lets nobody sleep on a count that has changed.
        assert!(has_seen || rings(bell) != rung);
    });
}
