//! Finiteness check of samples by sums of their numbers: a few instructions, where a check of each number takes
//! hundreds.

use zerocopy::FromBytes;

/// Number of parallel sums: an addition need not wait for the one before.
const LANES: usize = 8;

/// Finiteness check of samples.
#[derive(Clone, Copy, Debug, Default)]
pub struct FinitenessCheck {
    sums: [f64; LANES],
}

impl FinitenessCheck {
    /// Adds a sample.
    ///
    /// # Panics
    /// If the sample is not aligned whole words.
    // Always, so that the sums stay in registers.
    #[inline(always)]
    pub fn take_in(&mut self, sample: &[u8]) {
        let words = <[f64]>::ref_from_bytes(sample).expect("a sample is aligned and of whole words");
        let (rows, rest) = words.as_chunks::<LANES>();
        rows.iter().for_each(|row| self.add(row));
        match words.last_chunk::<LANES>() {
            // Some words are added twice, which does not change the result.
            Some(last) => self.add(last),
            None => self
                .sums
                .iter_mut()
                .zip(rest)
                .for_each(|(sum, word)| *sum += word),
        }
    }

    #[inline]
    fn add(&mut self, row: &[f64; LANES]) {
        for (sum, word) in self.sums.iter_mut().zip(row) {
            *sum += word;
        }
    }

    /// Returns `true` only if all numbers are finite: a sum that has become infinite or NaN stays so. After `false`,
    /// each number must be checked: finite numbers may have too large a sum, and words that are not numbers count as if
    /// they were.
    #[must_use]
    #[inline]
    pub fn is_surely_finite(&self) -> bool {
        self.sums.iter().sum::<f64>().is_finite()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use zerocopy::IntoBytes;

    fn check_at(samples: &[Vec<f64>]) -> FinitenessCheck {
        let mut check = FinitenessCheck::default();
        for sample in samples {
            check.take_in(sample.as_bytes());
        }
        check
    }

    proptest! {
        #[test]
        fn no_number_that_is_not_finite_is_overlooked(
            mut samples in prop::collection::vec(prop::collection::vec(-1e9..1e9f64, 1..40), 1..8),
            (sample, place) in (0..8usize, 0..40usize),
            number in prop::sample::select(vec![f64::NAN, -f64::NAN, f64::INFINITY, f64::NEG_INFINITY]),
            other in (0..8usize, 0..40usize),
            opposite in any::<bool>(),
        ) {
            prop_assert!(check_at(&samples).is_surely_finite());
            let count = samples.len();
            let mut put = |(sample, place): (usize, usize), number: f64| {
                let sample = &mut samples[sample % count];
                let place = place % sample.len();
                sample[place] = number;
            };
            if opposite {
                put(other, -number);
            }
            put((sample, place), number);
            prop_assert!(!check_at(&samples).is_surely_finite());
        }
    }
}
