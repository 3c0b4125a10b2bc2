//! Bytes of a frame, in place.

/// Bytes that the longest frame takes: two messages of MAVLink.
pub const CAPACITY: usize = 96;

/// The bytes of a frame.
#[derive(Clone, Copy, Debug)]
pub struct Frame {
    bytes: [u8; CAPACITY],
    length: usize,
}

impl Default for Frame {
    fn default() -> Self {
        Self {
            bytes: [0; CAPACITY],
            length: 0,
        }
    }
}

impl Frame {
    /// The bytes.
    #[must_use]
    #[inline]
    pub fn bytes(&self) -> &[u8] {
        &self.bytes[..self.length]
    }

    /// Removes all bytes.
    #[inline]
    pub fn clear(&mut self) {
        self.length = 0;
    }

    /// Appends bytes.
    ///
    /// # Panics
    /// If they are more than there is room for.
    #[inline]
    pub fn push(&mut self, bytes: &[u8]) {
        let end = self.length + bytes.len();
        self.bytes[self.length..end].copy_from_slice(bytes);
        self.length = end;
    }
}
