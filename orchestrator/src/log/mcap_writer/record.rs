//! A record as bytes: its kind, the length of the rest, and the rest, little-endian.

use std::collections::BTreeMap;

/// Length of a record's kind and length.
const FRAME_BYTES: usize = 1 + 8;

/// A record, put together member by member in the order of the specification.
#[derive(Clone)]
pub(super) struct Record {
    bytes: Vec<u8>,
}

macro_rules! put_numbers {
    ($($kind:ident),+) => {$(
        #[doc = concat!("Appends a `", stringify!($kind), "`.")]
        pub(super) fn $kind(self, value: $kind) -> Self {
            self.raw(&value.to_le_bytes())
        }
    )+};
}

impl Record {
    /// A record of a kind, without members yet.
    pub(super) fn new(opcode: u8) -> Self {
        let mut bytes = vec![0; FRAME_BYTES];
        bytes[0] = opcode;
        Self { bytes }
    }

    put_numbers!(u8, u16, u32, u64);

    /// Appends a text, or bytes, after their length.
    pub(super) fn text(self, text: &str) -> Self {
        self.u32(length_of(text.as_bytes())).raw(text.as_bytes())
    }

    /// Appends pairs of texts after their length in bytes.
    pub(super) fn text_map(self, map: &BTreeMap<String, String>) -> Self {
        let pairs = map
            .iter()
            .fold(Self::new(0), |pairs, (key, value)| pairs.text(key).text(value));
        self.nested(&pairs)
    }

    /// Appends pairs of a channel and a number after their length in bytes.
    pub(super) fn channel_map(self, pairs: impl IntoIterator<Item = (u16, u64)>) -> Self {
        let pairs = pairs
            .into_iter()
            .fold(Self::new(0), |all, (channel, value)| all.u16(channel).u64(value));
        self.nested(&pairs)
    }

    /// Appends bytes after their length.
    pub(super) fn sized(self, bytes: &[u8]) -> Self {
        self.u32(length_of(bytes)).raw(bytes)
    }

    /// The whole record.
    pub(super) fn bytes(&self) -> &[u8] {
        &self.bytes
    }

    /// Says that `more` bytes follow that belong to the record and are written by themselves.
    pub(super) fn followed_by(mut self, more: usize) -> Self {
        self.state_length(more);
        self
    }

    fn nested(self, members: &Self) -> Self {
        self.sized(&members.bytes[FRAME_BYTES..])
    }

    fn raw(mut self, bytes: &[u8]) -> Self {
        self.bytes.extend_from_slice(bytes);
        self.state_length(0);
        self
    }

    fn state_length(&mut self, more: usize) {
        let length = (self.bytes.len() - FRAME_BYTES + more) as u64;
        self.bytes[1..FRAME_BYTES].copy_from_slice(&length.to_le_bytes());
    }
}

fn length_of(bytes: &[u8]) -> u32 {
    u32::try_from(bytes.len()).expect("texts and indexes of a log are far below 4 GiB")
}
