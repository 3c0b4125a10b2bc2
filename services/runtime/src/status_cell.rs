//! A few numbers that one process tells and others look at, at any time: how what is connected to a service fares.
//!
//! Neither waits for the other. Who looks while they change sees some of before beside some of after: they are for
//! people, and each is whole.

use std::sync::atomic::{AtomicU64, Ordering};

use zerocopy::{FromBytes, FromZeros, Immutable, IntoBytes};

/// Numbers of a notice, of 8 bytes each.
pub const LENGTH: usize = 32;

/// Bytes of a number.
const WORD: usize = size_of::<u64>();

/// The numbers. All are 0 until somebody tells others.
#[repr(C, align(64))]
#[derive(Debug, Default)]
pub struct StatusCell([AtomicU64; LENGTH]);

impl StatusCell {
    /// Tells a record of whole words in place of the one before.
    #[inline]
    pub fn tell<T: IntoBytes + Immutable>(&self, record: &T) {
        const { assert!(size_of::<T>() <= LENGTH * WORD && size_of::<T>().is_multiple_of(WORD)) };
        let (words, _) = record.as_bytes().as_chunks::<WORD>();
        for (word, bytes) in self.0.iter().zip(words) {
            word.store(u64::from_ne_bytes(*bytes), Ordering::Relaxed);
        }
    }

    /// The record that was told last; all zero before the first.
    #[must_use]
    pub fn look<T: IntoBytes + FromBytes>(&self) -> T {
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
    fn what_was_told_last_is_seen_and_before_that_nothing() {
        let notice = StatusCell::default();
        assert_eq!(notice.look::<[f64; 3]>(), [0.0; 3]);
        notice.tell(&[1.0, -2.0, 3.5]);
        notice.tell(&[4.0, 5.0]);
        assert_eq!(notice.look::<[f64; 3]>(), [4.0, 5.0, 3.5]);
    }
}
