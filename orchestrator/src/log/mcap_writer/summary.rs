//! The end of a file: what it holds and where, so that a reader need not go through all of it.

use std::io::{self, Write};

use mcap::records::op;

use super::chunk::{ChunkIndex, Message};
use super::record::Record;
use super::sink::Sink;

/// What the end of the file repeats, counts and points to.
#[derive(Default)]
pub(super) struct Summary {
    schemas: Vec<Record>,
    channels: Vec<Record>,
    chunks: Vec<ChunkIndex>,
    metadata: Vec<Record>,
    /// Messages of each channel, by number less one.
    messages: Vec<u64>,
    /// Log times of the first and the last message in time, ns.
    times: Option<(u64, u64)>,
}

impl Summary {
    /// Number of the next schema; they begin with 1.
    pub(super) fn next_schema(&self) -> u16 {
        next_number(&self.schemas)
    }

    /// Number of the next channel; they begin with 1.
    pub(super) fn next_channel(&self) -> u16 {
        next_number(&self.channels)
    }

    pub(super) fn add_schema(&mut self, schema: Record) {
        self.schemas.push(schema);
    }

    pub(super) fn add_channel(&mut self, channel: Record) {
        self.channels.push(channel);
        self.messages.push(0);
    }

    pub(super) fn add_chunk(&mut self, index: ChunkIndex) {
        self.chunks.push(index);
    }

    pub(super) fn add_metadata(&mut self, index: Record) {
        self.metadata.push(index);
    }

    #[inline]
    pub(super) fn count(&mut self, message: &Message<'_>) {
        let time = message.time_ns;
        self.messages[usize::from(message.channel) - 1] += 1;
        let (first, last) = self.times.unwrap_or((time, time));
        self.times = Some((first.min(time), last.max(time)));
    }

    /// Writes the summary and the footer, whose checksum covers both up to itself.
    pub(super) fn write_to<W: Write>(&self, sink: &mut Sink<W>) -> io::Result<()> {
        let begin = sink.position();
        let chunks: Vec<Record> = self.chunks.iter().map(ChunkIndex::record).collect();
        let groups: [(u8, &[Record]); 5] = [
            (op::SCHEMA, &self.schemas),
            (op::CHANNEL, &self.channels),
            (op::STATISTICS, &[self.statistics()]),
            (op::CHUNK_INDEX, &chunks),
            (op::METADATA_INDEX, &self.metadata),
        ];
        let mut offsets = Vec::new();
        for (opcode, records) in groups.into_iter().filter(|(_, records)| !records.is_empty()) {
            let group_begin = sink.position();
            records.iter().try_for_each(|record| sink.write_record(record))?;
            let length = sink.position() - group_begin;
            offsets.push(
                Record::new(op::SUMMARY_OFFSET)
                    .u8(opcode)
                    .u64(group_begin)
                    .u64(length),
            );
        }
        let offsets_begin = sink.position();
        offsets.iter().try_for_each(|offset| sink.write_record(offset))?;
        let footer = Record::new(op::FOOTER).u64(begin).u64(offsets_begin);
        sink.write_record(&footer.followed_by(size_of::<u32>()))?;
        let checksum = sink.take_checksum();
        sink.write(&checksum.to_le_bytes())
    }

    fn statistics(&self) -> Record {
        let (first, last) = self.times.unwrap_or_default();
        let counted = (1..).zip(self.messages.iter().copied());
        Record::new(op::STATISTICS)
            .u64(self.messages.iter().sum())
            .u16(self.schemas.len() as u16)
            .u32(self.channels.len() as u32)
            // Attachments.
            .u32(0)
            .u32(self.metadata.len() as u32)
            .u32(self.chunks.len() as u32)
            .u64(first)
            .u64(last)
            .channel_map(counted.filter(|(_, messages)| *messages > 0))
    }
}

fn next_number(records: &[Record]) -> u16 {
    u16::try_from(records.len() + 1).expect("a log has a few types and topics")
}
