//! Where the bytes of a file go: counted and under a checksum.

use std::io::{self, Write};

use crc32fast::Hasher;

use super::record::Record;

/// Passes bytes on to `output`.
pub(super) struct Sink<W> {
    output: W,
    position: u64,
    checksum: Hasher,
}

impl<W: Write> Sink<W> {
    pub(super) fn new(output: W) -> Self {
        Self {
            output,
            position: 0,
            checksum: Hasher::new(),
        }
    }

    /// Bytes written.
    pub(super) fn position(&self) -> u64 {
        self.position
    }

    /// CRC-32 of the bytes written since the last call.
    pub(super) fn take_checksum(&mut self) -> u32 {
        std::mem::take(&mut self.checksum).finalize()
    }

    pub(super) fn write(&mut self, bytes: &[u8]) -> io::Result<()> {
        self.checksum.update(bytes);
        self.position += bytes.len() as u64;
        self.output.write_all(bytes)
    }

    pub(super) fn write_record(&mut self, record: &Record) -> io::Result<()> {
        self.write(record.bytes())
    }

    pub(super) fn flush(&mut self) -> io::Result<()> {
        self.output.flush()
    }
}
