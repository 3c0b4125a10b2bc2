//! Samples that hold garbage, for tests of what services make of it.

use zerocopy::{FromBytes, Immutable, IntoBytes};

/// Bytes of a header, which stays.
const HEADER: usize = 24;

/// Any bits, or if they are tame a number of any magnitude up to that of a flight's largest.
fn number(bits: [u8; 8], tame: bool) -> [u8; 8] {
    let word = u64::from_le_bytes(bits);
    if !tame {
        return bits;
    }
    let magnitude = libm::pow(10.0, (word % 13) as f64 - 3.0);
    (magnitude * (word as f64 / 9.2e18 - 1.0)).to_le_bytes()
}

/// Bits of which some are what they should be, and always the header.
pub(crate) fn sample<T: FromBytes + IntoBytes + Immutable>(bits: &[u8], good: &T, keep: &[bool]) -> T {
    let mut bytes = good.as_bytes().to_vec();
    for (index, chunk) in bytes.chunks_mut(8).enumerate().skip(HEADER / 8) {
        if !keep[index % keep.len()] {
            let garbage = bits[index * 8..index * 8 + 8].try_into().unwrap();
            chunk.copy_from_slice(&number(garbage, bits[0].is_multiple_of(2))[..chunk.len()]);
        }
    }
    T::read_from_bytes(&bytes).unwrap()
}
