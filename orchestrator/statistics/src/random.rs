//! Random numbers as functions of (seed, purpose, stream).

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};

/// Use of random numbers. Numbers of different purposes are independent.
#[derive(Clone, Copy, Debug)]
#[repr(u64)]
pub enum Purpose {
    /// Coordinates of a random point; the stream is the sample.
    Point = 1,
    /// Seed of a sample's flight; the stream is the sample.
    SampleSeed = 2,
    /// Scrambling of the Sobol sequence.
    Scramble = 3,
    /// Order of the strata of a Latin hypercube; the stream is the dimension.
    Permutation = 4,
    /// Offsets within the strata of a Latin hypercube; the stream is the sample.
    Offset = 5,
    /// Resamples of a bootstrap.
    Bootstrap = 6,
}

/// Generator of the random numbers of a stream.
#[derive(Debug)]
pub struct Generator(ChaCha8Rng);

impl Generator {
    /// Makes the generator of a stream: the key of ChaCha8 is (seed, purpose, 0, 0).
    pub fn new(seed: u64, purpose: Purpose, stream: u64) -> Self {
        let mut key = [0; 32];
        key[..8].copy_from_slice(&seed.to_le_bytes());
        key[8..16].copy_from_slice(&(purpose as u64).to_le_bytes());
        let mut generator = ChaCha8Rng::from_seed(key);
        generator.set_stream(stream);
        Self(generator)
    }

    /// Returns the next 32 bits.
    pub fn bits32(&mut self) -> u32 {
        self.0.next_u32()
    }

    /// Returns the next 53 bits, which a double represents exactly.
    pub fn bits53(&mut self) -> u64 {
        self.0.next_u64() >> 11
    }

    /// Returns a uniformly distributed number in [0, 1).
    pub fn uniform(&mut self) -> f64 {
        self.bits53() as f64 * (1.0 / (1_u64 << 53) as f64)
    }

    /// Returns a number below a bound > 0, uniformly distributed up to bound/2⁶⁴: the high word of bits · bound.
    pub fn below(&mut self, bound: usize) -> usize {
        ((u128::from(self.0.next_u64()) * bound as u128) >> 64) as usize
    }
}
