//! Records copied beside their writer, in memory of this process: for interpreters and sanitizers, which see no other
//! memory.

use std::sync::atomic::{AtomicBool, Ordering};

use runtime::seqlock::{LookUp, Pair, Ring};

/// Few under an interpreter of every access.
const RECORDS: u64 = if cfg!(miri) { 200 } else { 200_000 };

const WORDS: usize = 4;

#[test]
fn snapshots_beside_a_writer_are_whole() {
    let pair = Pair::<WORDS>::default();
    let is_over = AtomicBool::new(false);
    std::thread::scope(|scope| {
        scope.spawn(|| {
            // Not a multiple of a word.
            (0..RECORDS).for_each(|tick| pair.write(tick, |keep| keep(&[tick as u8; 8 * WORDS - 3])));
            is_over.store(true, Ordering::Release);
        });
        let mut newest = 0;
        while !is_over.load(Ordering::Acquire) {
            if let Some((tick, record)) = pair.snapshot() {
                assert_eq!(record, [tick as u8; 8 * WORDS - 3]);
                assert!(tick >= newest);
                newest = tick;
            }
        }
    });
    assert_eq!(pair.snapshot().unwrap().0, RECORDS - 1);
}

#[test]
fn records_of_a_ring_beside_its_writer_are_whole_or_gone() {
    let ring = Ring::<WORDS, 8>::default();
    std::thread::scope(|scope| {
        scope.spawn(|| {
            for number in 0..RECORDS {
                ring.begin([number; WORDS]);
                ring.finish(1, !number);
            }
        });
        let mut next = 0;
        while next < RECORDS {
            match ring.look_up(next) {
                LookUp::Pending => std::hint::spin_loop(),
                LookUp::Overwritten(oldest) => {
                    assert!(oldest > next);
                    next = oldest;
                }
                LookUp::Record(words) => {
                    assert_eq!(words, [next, !next, next, next]);
                    next += 1;
                }
            }
        }
    });
}
