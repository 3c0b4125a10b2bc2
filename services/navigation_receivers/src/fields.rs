//! Little-endian numbers at offsets of a payload.

/// Payload of a message with a known length.
pub(crate) struct Fields<'a>(pub &'a [u8]);

impl Fields<'_> {
    /// Returns the bytes at an offset.
    fn bytes<const N: usize>(&self, offset: usize) -> [u8; N] {
        std::array::from_fn(|index| self.0[offset + index])
    }

    pub fn u8(&self, offset: usize) -> u8 {
        self.0[offset]
    }

    pub fn i8(&self, offset: usize) -> i8 {
        i8::from_le_bytes(self.bytes(offset))
    }

    pub fn u16(&self, offset: usize) -> u16 {
        u16::from_le_bytes(self.bytes(offset))
    }

    pub fn u32(&self, offset: usize) -> u32 {
        u32::from_le_bytes(self.bytes(offset))
    }

    pub fn u64(&self, offset: usize) -> u64 {
        u64::from_le_bytes(self.bytes(offset))
    }

    pub fn i32(&self, offset: usize) -> i32 {
        i32::from_le_bytes(self.bytes(offset))
    }

    pub fn f32(&self, offset: usize) -> f32 {
        f32::from_le_bytes(self.bytes(offset))
    }

    /// Returns consecutive numbers of 32 bits.
    pub fn floats<const N: usize>(&self, offset: usize) -> [f64; N] {
        std::array::from_fn(|index| f64::from(self.f32(offset + 4 * index)))
    }
}
