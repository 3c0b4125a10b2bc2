//! Memory for writes of a plug-in, between guard words that detect writes out of bounds.

/// Words before and after the memory.
const GUARDS: usize = 4;

/// Content of a guard word: a number that programs are unlikely to write.
const GUARD: u64 = 0x6765_726f_6e6f_a55a;

/// Memory of whole words, aligned to 8 bytes.
#[derive(Debug)]
pub(crate) struct Guarded {
    words: Box<[u64]>,
    size: usize,
}

impl Guarded {
    /// Makes zeroed memory of `size` bytes. Padding to a whole word is part of the guard.
    pub(crate) fn new(size: usize) -> Self {
        let mut words = vec![GUARD; size.div_ceil(size_of::<u64>()) + 2 * GUARDS];
        let end = words.len() - GUARDS;
        words[GUARDS..end].fill(0);
        Self {
            words: words.into(),
            size,
        }
    }

    /// Returns the memory.
    #[inline]
    pub(crate) fn bytes(&self) -> &[u8] {
        &zerocopy::IntoBytes::as_bytes(&self.words[GUARDS..])[..self.size]
    }

    /// Returns the memory.
    #[inline]
    pub(crate) fn bytes_mut(&mut self) -> &mut [u8] {
        &mut zerocopy::IntoBytes::as_mut_bytes(&mut self.words[GUARDS..])[..self.size]
    }

    /// Returns whether no write was out of bounds.
    #[inline]
    pub(crate) fn is_intact(&self) -> bool {
        let guards = [GUARD; GUARDS];
        let is_guarded =
            self.words.first_chunk() == Some(&guards) && self.words.last_chunk() == Some(&guards);
        is_guarded && self.padding().iter().all(|&byte| byte == 0)
    }

    /// Returns the padding to a whole word.
    #[inline]
    fn padding(&self) -> &[u8] {
        &zerocopy::IntoBytes::as_bytes(&self.words[GUARDS..self.words.len() - GUARDS])[self.size..]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn memory_of_any_size_is_aligned_zeroed_and_guarded_on_both_sides() {
        for size in [0, 1, 7, 8, 9, 224] {
            let mut memory = Guarded::new(size);
            assert!(memory.bytes().iter().all(|&byte| byte == 0));
            assert_eq!(
                (memory.bytes().len(), memory.bytes().as_ptr().align_offset(8)),
                (size, 0)
            );
            memory.bytes_mut().fill(7);
            assert!(memory.is_intact(), "{size}");
            for word in [GUARDS - 1, GUARDS + size.div_ceil(8)] {
                let before = std::mem::replace(&mut memory.words[word], 0);
                assert!(!memory.is_intact(), "{size}: word {word}");
                memory.words[word] = before;
            }
        }
    }

    #[test]
    fn a_byte_beyond_a_part_of_a_word_is_seen() {
        let mut memory = Guarded::new(9);
        zerocopy::IntoBytes::as_mut_bytes(&mut memory.words[..])[GUARDS * 8 + 9] = 1;
        assert!(!memory.is_intact());
    }
}
