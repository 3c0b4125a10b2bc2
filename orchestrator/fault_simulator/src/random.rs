//! Random numbers of a history.
//!
//! The plan of the faults is drawn from ChaCha8. The latencies of a process are functions of (seed, process, purpose), so
//! that a history with fewer faults keeps the latencies of the processes that it has in common with the longer one.

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};

/// Generator of the plan of a history.
#[derive(Debug)]
pub(crate) struct Draws(ChaCha8Rng);

impl Draws {
    pub(crate) fn new(seed: u64) -> Self {
        let mut key = [0; 32];
        key[..8].copy_from_slice(&seed.to_le_bytes());
        Self(ChaCha8Rng::from_seed(key))
    }

    /// Returns a number in `0..bound`.
    pub(crate) fn below(&mut self, bound: u64) -> u64 {
        scaled(self.0.next_u64(), bound)
    }

    /// Returns a number in `from..=until`, small ones as likely as large ones: the logarithm is uniform.
    pub(crate) fn of_any_size(&mut self, from: u64, until: u64) -> u64 {
        let doublings = (until / from.max(1)).max(1).ilog2() + 1;
        let size = from << self.below(u64::from(doublings));
        (size + self.below(size.max(1))).clamp(from, until)
    }

    /// Returns `true` once in `times` times.
    pub(crate) fn once_in(&mut self, times: u64) -> bool {
        self.below(times) == 0
    }
}

/// Returns a number in `range` as a function of a seed, a process and a purpose.
pub(crate) fn drawn(seed: u64, process: u64, purpose: u64, range: std::ops::RangeInclusive<u64>) -> u64 {
    let mixed = mix(mix(seed ^ process.wrapping_mul(0x9E37_79B9_7F4A_7C15)).wrapping_add(purpose));
    let (from, until) = range.into_inner();
    from + scaled(mixed, until - from + 1)
}

fn scaled(bits: u64, bound: u64) -> u64 {
    ((u128::from(bits) * u128::from(bound)) >> 64) as u64
}

/// The finaliser of SplitMix64.
fn mix(bits: u64) -> u64 {
    let bits = (bits ^ (bits >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    let bits = (bits ^ (bits >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    bits ^ (bits >> 31)
}
