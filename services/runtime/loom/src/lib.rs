//! Checks every interleaving of the lock-free parts of `runtime`, with the code itself and loom's atomics.
//!
//! The models are bounded: records of two words, a writer that writes a few of them, one reader.
#![cfg(test)]
#![allow(dead_code, reason = "the models use a part of the code")]

/// Atomics as `runtime` imports them.
mod atomics {
    pub use loom::sync::atomic::{AtomicU64, Ordering, fence};
}

#[path = "../../src/seqlock.rs"]
mod seqlock;

use loom::sync::Arc;
use loom::sync::atomic::{AtomicU32, Ordering, fence};
use loom::thread;

use crate::seqlock::{LookUp, Pair, Ring};

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
        let writer = {
            let pair = Arc::clone(&pair);
            thread::spawn(move || (1..4).for_each(|tick| pair.write(tick, |keep| keep(&record(tick)))))
        };
        if let Some((tick, bytes)) = pair.snapshot() {
            assert_eq!(bytes, record(tick), "torn at {tick}");
        }
        writer.join().unwrap();
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
        let writer = {
            let ring = Arc::clone(&ring);
            thread::spawn(move || (1..4).for_each(|number| write(&ring, number)))
        };
        for number in 0..2 {
            match ring.look_up(number) {
                LookUp::Record(words) => assert_eq!(words, [number, !number]),
                LookUp::Overwritten(oldest) => assert!(oldest > number),
                LookUp::Pending => assert!(number > 0),
            }
        }
        writer.join().unwrap();
        assert_eq!(ring.look_up(3), LookUp::Record([3, !3]));
    });
}

/// Announcement of `runtime::wait` and `runtime::real_time`. A consumer announces its sleep, then looks again. A
/// publisher publishes, then looks for the announcement. A sample is a word here.
#[test]
fn a_consumer_that_goes_to_sleep_has_seen_the_sample_or_is_woken() {
    loom::model(|| {
        let words = Arc::new([const { () }; 2].map(|()| AtomicU32::new(0)));
        let publisher = {
            let words = Arc::clone(&words);
            thread::spawn(move || {
                words[0].store(1, Ordering::Release);
                fence(Ordering::SeqCst);
                words[1].load(Ordering::Relaxed) == 1
            })
        };
        words[1].store(1, Ordering::Relaxed);
        fence(Ordering::SeqCst);
        let has_seen = words[0].load(Ordering::Acquire) == 1;
        let is_woken = publisher.join().unwrap();
        assert!(has_seen || is_woken);
    });
}
