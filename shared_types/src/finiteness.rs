//! Whether all numbers of samples are finite, at a check: by their sum, in a few instructions, where to ask each number
//! takes hundreds.

use zerocopy::FromBytes;

/// How many sums run side by side: an addition does not have to wait for the one before.
const LANES: usize = 4;

/// A check at samples.
#[derive(Clone, Copy, Debug, Default)]
pub struct FinitenessCheck {
    sums: [f64; LANES],
}

impl FinitenessCheck {
    /// Takes a sample in.
    ///
    /// # Panics
    /// If these are not whole words, aligned.
    #[inline]
    pub fn take_in(&mut self, sample: &[u8]) {
        let words = <[f64]>::ref_from_bytes(sample).expect("a sample is aligned and of whole words");
        let (rows, rest) = words.as_chunks::<LANES>();
        for row in rows {
            for (sum, word) in self.sums.iter_mut().zip(row) {
                *sum += word;
            }
        }
        for (sum, word) in self.sums.iter_mut().zip(rest) {
            *sum += word;
        }
    }

    /// Whether all numbers are surely finite: a sum stays what it has once become, infinite or not a number. If not,
    /// each has to be asked: the sum of finite ones may be too large, and what is no number counts as if it were one.
    #[must_use]
    #[inline]
    pub fn is_surely_finite(&self) -> bool {
        let [a, b, c, d] = self.sums;
        ((a + c) + (b + d)).is_finite()
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
