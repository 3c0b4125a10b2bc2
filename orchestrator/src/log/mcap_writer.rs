//! Writes MCAP (<https://mcap.dev/spec>), as much of it as the logs need.
//!
//! The `mcap` crate, which reads the logs, can write them too; but there a message goes through three layers in
//! seven pieces, which costs as much time as all services of a flight together. Here it is copied once. Besides,
//! the bytes of a log depend on no version of a library, but for the compressors'.
//!
//! Logs have chunks, indexes of messages and chunks, statistics and all checksums: what viewers need to seek, and
//! what it takes to find a single wrong byte.

mod chunk;
mod record;
mod sink;
mod summary;

use std::collections::BTreeMap;
use std::io::{self, Write};

use mcap::records::op;

use chunk::Chunk;
pub(super) use chunk::{Compressor, Message};
use record::Record;
use sink::Sink;
use summary::Summary;

/// Writes an MCAP file to `W`, front to back. After an error, nothing more may be written.
pub(super) struct McapWriter<W> {
    sink: Sink<W>,
    compressor: Compressor,
    /// What is gathered for the next chunk.
    chunk: Chunk,
    summary: Summary,
}

impl<W: Write> McapWriter<W> {
    /// Begins a file.
    pub(super) fn new(output: W, profile: &str, library: &str, compressor: Compressor) -> io::Result<Self> {
        let mut sink = Sink::new(output);
        sink.write(mcap::MAGIC)?;
        sink.write_record(&Record::new(op::HEADER).text(profile).text(library))?;
        Ok(Self {
            sink,
            compressor,
            chunk: Chunk::default(),
            summary: Summary::default(),
        })
    }

    /// Adds a schema and says its number.
    pub(super) fn add_schema(&mut self, name: &str, encoding: &str, definition: &str) -> u16 {
        let id = self.summary.next_schema();
        let schema = Record::new(op::SCHEMA)
            .u16(id)
            .text(name)
            .text(encoding)
            .text(definition);
        self.chunk.push_record(&schema);
        self.summary.add_schema(schema);
        id
    }

    /// Adds a channel and says its number.
    pub(super) fn add_channel(
        &mut self,
        schema: u16,
        topic: &str,
        encoding: &str,
        metadata: &BTreeMap<String, String>,
    ) -> u16 {
        let id = self.summary.next_channel();
        let channel = Record::new(op::CHANNEL)
            .u16(id)
            .u16(schema)
            .text(topic)
            .text(encoding)
            .text_map(metadata);
        self.chunk.push_record(&channel);
        self.summary.add_channel(channel);
        id
    }

    /// Adds a message of a known channel to the chunk that is being gathered.
    #[inline]
    pub(super) fn push_message(&mut self, message: &Message<'_>) {
        self.chunk.push_message(message);
        self.summary.count(message);
    }

    /// Bytes in the chunk that is being gathered.
    #[inline]
    pub(super) fn chunk_bytes(&self) -> usize {
        self.chunk.len()
    }

    /// Ends the chunk, if there is anything in it, and hands it to the system.
    pub(super) fn end_chunk(&mut self) -> io::Result<()> {
        if self.chunk.len() > 0 {
            let index = self.chunk.write_to(&mut self.sink, &mut self.compressor)?;
            self.summary.add_chunk(index);
            self.chunk.clear();
            self.sink.flush()?;
        }
        Ok(())
    }

    /// Writes facts about the whole file, behind what was written before.
    pub(super) fn write_metadata(
        &mut self,
        name: &str,
        metadata: &BTreeMap<String, String>,
    ) -> io::Result<()> {
        self.end_chunk()?;
        let begin = self.sink.position();
        self.sink
            .write_record(&Record::new(op::METADATA).text(name).text_map(metadata))?;
        let length = self.sink.position() - begin;
        self.summary
            .add_metadata(Record::new(op::METADATA_INDEX).u64(begin).u64(length).text(name));
        Ok(())
    }

    /// Ends the file with the last chunk, the summary and the footer. Says its size.
    pub(super) fn finish(mut self) -> io::Result<u64> {
        self.end_chunk()?;
        let checksum = self.sink.take_checksum();
        self.sink.write_record(&Record::new(op::DATA_END).u32(checksum))?;
        self.sink.take_checksum();
        self.summary.write_to(&mut self.sink)?;
        self.sink.write(mcap::MAGIC)?;
        self.sink.flush()?;
        Ok(self.sink.position())
    }
}

#[cfg(test)]
mod tests;
