//! Records that one process writes and others copy at the same time, without blocking the writer and without torn copies.
//!
//! They are sequence locks of words, as in Boehm, "Can Seqlocks Get Along With Programming Language Memory Models?"
//! (2012). Every word is atomic, so a copy during a write is no data race. Fences order the words between the accesses
//! to the words that identify the record. `services/runtime/loom` checks every interleaving of these functions: it
//! includes this file, with loom's atomics in `crate::atomics`.

use crate::atomics::{AtomicU64, Ordering, fence};

/// Bytes of a word.
pub const WORD: usize = 8;

const SLOTS: usize = 2;

/// Record of some bytes with a tick. The previous record remains until the next one is complete, so that the death of a
/// writer leaves one.
#[repr(C)]
#[derive(Debug)]
pub struct Pair<const WORDS: usize>([Slot<WORDS>; SLOTS]);

/// One of the two slots.
#[repr(C, align(64))]
#[derive(Debug)]
struct Slot<const WORDS: usize> {
    /// 1 + the tick of the record; 0 while there is none.
    tick: AtomicU64,
    /// Bytes of the record.
    length: AtomicU64,
    words: [AtomicU64; WORDS],
}

impl<const WORDS: usize> Pair<WORDS> {
    /// Overwrites the older record by that of a tick. `save` passes its bytes, in one call. Ticks must not repeat.
    ///
    /// Only one process at a time may call this.
    ///
    /// # Panics
    /// If there are more bytes than words for them.
    #[inline]
    pub fn write(&self, tick: u64, save: impl FnOnce(&mut dyn FnMut(&[u8]))) {
        // Relaxed: only this process writes the ticks.
        let [first, second] = self.0.each_ref().map(|slot| slot.tick.load(Ordering::Relaxed));
        let slot = &self.0[usize::from(first > second)];
        slot.tick.store(0, Ordering::Relaxed);
        // The tick is invalidated before any word of the record is written. Pairs with the fence in `snapshot`: a
        // reader that has read a word of the new record finds the tick changed. Without the fence, new words
        // could become visible under the old tick, and a reader would take a torn record.
        fence(Ordering::Release);
        save(&mut |bytes| slot.store(bytes));
        // Release: the words become visible before the tick. A reader of this tick reads this record or a later one,
        // and never words of the record before.
        slot.tick.store(tick + 1, Ordering::Release);
    }

    /// Copies the newer record and returns it with its tick. Returns `None` if there is none, or if two more were
    /// written meanwhile.
    pub fn snapshot(&self) -> Option<(u64, Vec<u8>)> {
        // Acquire: the words are read after the tick. Pairs with the last store of `write`.
        let ticks = self.0.each_ref().map(|slot| slot.tick.load(Ordering::Acquire));
        let newer = usize::from(ticks[1] > ticks[0]);
        let (slot, tick) = (&self.0[newer], ticks[newer]);
        let record = (tick.checked_sub(1)?, slot.load()?);
        // The words are read before the second load of the tick, so an overwritten copy is discarded. Pairs with the
        // fence in `write`. An acquire load alone would not do: it orders later reads, not earlier ones.
        fence(Ordering::Acquire);
        (slot.tick.load(Ordering::Relaxed) == tick).then_some(record)
    }
}

/// Empty records, for tests: shared memory is mapped and all zeros.
impl<const WORDS: usize> Default for Pair<WORDS> {
    fn default() -> Self {
        Self(std::array::from_fn(|_| Slot {
            tick: AtomicU64::new(0),
            length: AtomicU64::new(0),
            words: std::array::from_fn(|_| AtomicU64::new(0)),
        }))
    }
}

impl<const WORDS: usize> Slot<WORDS> {
    #[inline]
    fn store(&self, bytes: &[u8]) {
        assert!(
            bytes.len() <= WORDS * WORD,
            "a record of {} bytes has no room",
            bytes.len()
        );
        // Compilers do not unroll loops of atomic stores: eight at a time take half as long.
        let (blocks, rest) = bytes.as_chunks::<{ 8 * WORD }>();
        let (places, _) = self.words.as_chunks::<8>();
        for (place, block) in places.iter().zip(blocks) {
            let (words, _) = block.as_chunks::<WORD>();
            for (word, bytes) in place.iter().zip(words) {
                word.store(u64::from_ne_bytes(*bytes), Ordering::Relaxed);
            }
        }
        for (word, bytes) in self.words[8 * blocks.len()..].iter().zip(rest.chunks(WORD)) {
            let mut whole = [0; WORD];
            whole[..bytes.len()].copy_from_slice(bytes);
            word.store(u64::from_ne_bytes(whole), Ordering::Relaxed);
        }
        self.length.store(bytes.len() as u64, Ordering::Relaxed);
    }

    /// Copies the record. The copy is valid only if the tick is the same before and after. Returns `None` for an
    /// impossible length, which a torn read can produce.
    fn load(&self) -> Option<Vec<u8>> {
        let length = usize::try_from(self.length.load(Ordering::Relaxed)).ok();
        let length = length.filter(|&length| length <= WORDS * WORD)?;
        let mut record = vec![0; length];
        for (bytes, word) in record.chunks_mut(WORD).zip(&self.words) {
            let read = word.load(Ordering::Relaxed).to_ne_bytes();
            bytes.copy_from_slice(&read[..bytes.len()]);
        }
        Some(record)
    }
}

/// Ring of the latest records. A reader that is too slow misses some.
#[repr(C, align(64))]
#[derive(Debug)]
pub struct Ring<const WORDS: usize, const DEPTH: usize> {
    /// Number of complete records; record n is at n modulo the depth.
    written: AtomicU64,
    /// 1 + the number of the last record that was begun.
    begun: AtomicU64,
    slots: [[AtomicU64; WORDS]; DEPTH],
}

impl<const WORDS: usize, const DEPTH: usize> Default for Ring<WORDS, DEPTH> {
    fn default() -> Self {
        Self {
            written: AtomicU64::new(0),
            begun: AtomicU64::new(0),
            slots: std::array::from_fn(|_| std::array::from_fn(|_| AtomicU64::new(0))),
        }
    }
}

/// Result of a look-up in a [`Ring`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LookUp<const WORDS: usize> {
    /// The requested record.
    Record([u64; WORDS]),
    /// The record is not complete yet.
    Pending,
    /// The record was overwritten; this is the number of the oldest one that may be left.
    Overwritten(u64),
}

impl<const WORDS: usize, const DEPTH: usize> Ring<WORDS, DEPTH> {
    /// Writes the next record. Readers receive it only after it is [finished](Self::finish).
    ///
    /// Only one process at a time may call this and [`Self::finish`].
    #[inline]
    pub fn begin(&self, record: [u64; WORDS]) {
        let number = self.written.load(Ordering::Relaxed);
        // Pairs with the fence in `look_up`: a reader that has read a word of the new record sees there that all records
        // before it are complete, so that the oldest one is being overwritten. Without the fence it could return a torn
        // record as the oldest.
        fence(Ordering::Release);
        for (place, word) in self.slot(number).iter().zip(record) {
            place.store(word, Ordering::Relaxed);
        }
        // Release: pairs with the acquire load in `finish_abandoned`, which must not publish a record whose words
        // are missing.
        self.begun.store(number + 1, Ordering::Release);
    }

    /// Changes one word of the begun record and publishes the record to readers.
    #[inline]
    pub fn finish(&self, word: usize, value: u64) {
        let number = self.written.load(Ordering::Relaxed);
        self.slot(number)[word].store(value, Ordering::Relaxed);
        // Release: the words become visible before the count. A reader of the count reads a complete record.
        self.written.store(number + 1, Ordering::Release);
    }

    /// Publishes a record that a dead process has begun.
    pub fn finish_abandoned(&self) {
        let number = self.written.load(Ordering::Relaxed);
        if self.begun.load(Ordering::Acquire) == number + 1 {
            self.written.store(number + 1, Ordering::Release);
        }
    }

    /// Returns the number of complete records.
    pub fn written(&self) -> u64 {
        self.written.load(Ordering::Acquire)
    }

    /// Returns a record by its number.
    pub fn look_up(&self, number: u64) -> LookUp<WORDS> {
        let written = self.written.load(Ordering::Acquire);
        if number >= written {
            return LookUp::Pending;
        }
        // In a full ring the oldest record may be half overwritten.
        let oldest = (written + 1).saturating_sub(DEPTH as u64);
        if number < oldest {
            return LookUp::Overwritten(oldest);
        }
        let slot = self.slot(number);
        let words = std::array::from_fn(|word| slot[word].load(Ordering::Relaxed));
        // Orders the loads of the words before the second load of the count, so that a record overwritten meanwhile is
        // detected. Pairs with the fence in `begin`. Without it a torn record could be returned.
        fence(Ordering::Acquire);
        let oldest = (self.written.load(Ordering::Relaxed) + 1).saturating_sub(DEPTH as u64);
        if number < oldest {
            LookUp::Overwritten(oldest)
        } else {
            LookUp::Record(words)
        }
    }

    fn slot(&self, number: u64) -> &[AtomicU64; WORDS] {
        &self.slots[usize::try_from(number % DEPTH as u64).expect("below the depth")]
    }
}
