//! Frame: bytes in a fixed-size buffer.

/// Length of the longest frame, bytes: two MAVLink messages.
pub const CAPACITY: usize = 96;

/// Frame to be sent.
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
    /// Returns the bytes.
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
    /// If the frame would exceed [`CAPACITY`].
    #[inline]
    pub fn push(&mut self, bytes: &[u8]) {
        let end = self.length + bytes.len();
        self.bytes[self.length..end].copy_from_slice(bytes);
        self.length = end;
    }
}
