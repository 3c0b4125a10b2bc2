//! Status cell: a few numbers that one process writes and others read at any time, such as the state of connected
//! hardware.
//!
//! Neither side waits for the other. During a write a reader may get a mixture of old and new numbers. Each number is
//! consistent, because it is one atomic word. The numbers are displayed one by one, so the cell needs no sequence lock, and
//! relaxed order suffices.

use zerocopy::{FromBytes, FromZeros, Immutable, IntoBytes};

use crate::atomics::{AtomicU64, Ordering};

/// Capacity of a status cell, in numbers of 8 bytes.
pub const LENGTH: usize = 64;

/// Bytes of a number.
const WORD: usize = size_of::<u64>();

/// The numbers. All are 0 before the first write.
#[repr(C, align(64))]
#[derive(Debug)]
pub struct StatusCell([AtomicU64; LENGTH]);

impl Default for StatusCell {
    fn default() -> Self {
        Self(std::array::from_fn(|_| AtomicU64::new(0)))
    }
}

impl StatusCell {
    /// Replaces the record by another one of whole words.
    #[inline]
    pub fn write<T: IntoBytes + Immutable>(&self, record: &T) {
        const { assert!(size_of::<T>() <= LENGTH * WORD && size_of::<T>().is_multiple_of(WORD)) };
        let (words, _) = record.as_bytes().as_chunks::<WORD>();
        for (word, bytes) in self.0.iter().zip(words) {
            word.store(u64::from_ne_bytes(*bytes), Ordering::Relaxed);
        }
    }

    /// Returns the last record; all zeros before the first write.
    #[must_use]
    pub fn read<T: IntoBytes + FromBytes>(&self) -> T {
        let mut record = <T as FromZeros>::new_zeroed();
        let (words, _) = record.as_mut_bytes().as_chunks_mut::<WORD>();
        for (bytes, word) in words.iter_mut().zip(&self.0) {
            *bytes = word.load(Ordering::Relaxed).to_ne_bytes();
        }
        record
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_last_record_is_read_and_zeros_before_the_first() {
        let cell = StatusCell::default();
        assert_eq!(cell.read::<[f64; 3]>(), [0.0; 3]);
        cell.write(&[1.0, -2.0, 3.5]);
        cell.write(&[4.0, 5.0]);
        assert_eq!(cell.read::<[f64; 3]>(), [4.0, 5.0, 3.5]);
    }
}
