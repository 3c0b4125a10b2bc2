//! A chunk: messages gathered in memory, compressed and written in one piece, with an index of each channel.

use std::io::{self, Write};

use mcap::records::op;

use super::record::Record;
use super::sink::Sink;
use crate::log::Compression;

/// Length of a message's frame and header.
const MESSAGE_HEADER_BYTES: usize = 1 + 8 + MESSAGE_MEMBERS_BYTES;
/// Channel, sequence, log time, publish time.
const MESSAGE_MEMBERS_BYTES: usize = 2 + 4 + 8 + 8;

/// Levels are stated because the libraries' defaults may move.
const LZ4_LEVEL: u32 = 1;
const ZSTD_LEVEL: i32 = 3;

/// A message to be written.
pub(in crate::log) struct Message<'a> {
    /// Number of its channel.
    pub(in crate::log) channel: u16,
    /// Its place in the channel.
    pub(in crate::log) sequence: u32,
    /// When it was logged and published, ns.
    pub(in crate::log) time_ns: u64,
    /// What precedes the sample in the message.
    pub(in crate::log) prefix: [u8; 4],
    /// The sample.
    pub(in crate::log) sample: &'a [u8],
}

/// Compresses chunks; its memory is reused.
pub(in crate::log) enum Compressor {
    /// Leaves them as they are.
    None,
    /// As an LZ4 frame.
    Lz4(Vec<u8>),
    /// As a Zstandard frame.
    Zstd(Box<zstd::bulk::Compressor<'static>>, Vec<u8>),
}

/// Records of the next chunk.
#[derive(Default)]
pub(super) struct Chunk {
    records: Vec<u8>,
    /// Log times of the first and the last message in time, ns.
    times: Option<(u64, u64)>,
    /// Of each channel, by number less one: log time and place of its messages, as the index wants them.
    indexes: Vec<Vec<u8>>,
}

/// What the summary says of a chunk.
pub(super) struct ChunkIndex {
    header: ChunkHeader,
    begin: u64,
    length: u64,
    /// Where the index of each channel begins.
    index_offsets: Vec<(u16, u64)>,
    index_length: u64,
}

/// What a chunk says of itself.
struct ChunkHeader {
    times: (u64, u64),
    uncompressed_bytes: u64,
    uncompressed_checksum: u32,
    compression: &'static str,
    compressed_bytes: u64,
}

impl Compressor {
    pub(in crate::log) fn new(compression: Compression) -> io::Result<Self> {
        Ok(match compression {
            Compression::None => Self::None,
            Compression::Lz4 => Self::Lz4(Vec::new()),
            Compression::Zstd => Self::Zstd(Box::new(zstd::bulk::Compressor::new(ZSTD_LEVEL)?), Vec::new()),
        })
    }

    /// Name of the compression in the file.
    fn name(&self) -> &'static str {
        match self {
            Self::None => "",
            Self::Lz4(_) => "lz4",
            Self::Zstd(..) => "zstd",
        }
    }

    fn compress<'a>(&'a mut self, records: &'a [u8]) -> io::Result<&'a [u8]> {
        match self {
            Self::None => Ok(records),
            Self::Lz4(place) => {
                place.clear();
                let mut encoder = lz4::EncoderBuilder::new()
                    .level(LZ4_LEVEL)
                    // The chunk has a checksum, and some readers mistake those of blocks.
                    .block_checksum(lz4::liblz4::BlockChecksum::NoBlockChecksum)
                    .build(place)?;
                encoder.write_all(records)?;
                let (place, result) = encoder.finish();
                result.map(|()| place.as_slice())
            }
            Self::Zstd(compressor, place) => {
                place.clear();
                place.reserve(zstd::zstd_safe::compress_bound(records.len()));
                compressor.compress_to_buffer(records, place)?;
                Ok(place)
            }
        }
    }
}

impl Chunk {
    /// Bytes gathered.
    #[inline]
    pub(super) fn len(&self) -> usize {
        self.records.len()
    }

    /// Forgets what was gathered, but keeps the memory.
    pub(super) fn clear(&mut self) {
        self.records.clear();
        self.times = None;
        self.indexes.iter_mut().for_each(Vec::clear);
    }

    /// Adds a record that is no message.
    pub(super) fn push_record(&mut self, record: &Record) {
        self.records.extend_from_slice(record.bytes());
    }

    /// Adds a message.
    #[inline]
    pub(super) fn push_message(&mut self, message: &Message<'_>) {
        let time = message.time_ns;
        self.push_index_entry(message.channel, time);
        let (first, last) = self.times.unwrap_or((time, time));
        self.times = Some((first.min(time), last.max(time)));

        let length = MESSAGE_MEMBERS_BYTES + message.prefix.len() + message.sample.len();
        let mut header = [0; MESSAGE_HEADER_BYTES + 4];
        header[0] = op::MESSAGE;
        header[1..9].copy_from_slice(&(length as u64).to_le_bytes());
        header[9..11].copy_from_slice(&message.channel.to_le_bytes());
        header[11..15].copy_from_slice(&message.sequence.to_le_bytes());
        header[15..23].copy_from_slice(&time.to_le_bytes());
        header[23..31].copy_from_slice(&time.to_le_bytes());
        header[31..].copy_from_slice(&message.prefix);
        self.records.reserve(header.len() + message.sample.len());
        self.records.extend_from_slice(&header);
        self.records.extend_from_slice(message.sample);
    }

    #[inline]
    fn push_index_entry(&mut self, channel: u16, time_ns: u64) {
        let place = usize::from(channel) - 1;
        if self.indexes.len() <= place {
            self.indexes.resize(place + 1, Vec::new());
        }
        let mut entry = [0; 16];
        entry[..8].copy_from_slice(&time_ns.to_le_bytes());
        entry[8..].copy_from_slice(&(self.records.len() as u64).to_le_bytes());
        self.indexes[place].extend_from_slice(&entry);
    }

    /// Writes the chunk and its indexes.
    pub(super) fn write_to<W: Write>(
        &self,
        sink: &mut Sink<W>,
        compressor: &mut Compressor,
    ) -> io::Result<ChunkIndex> {
        let begin = sink.position();
        let compression = compressor.name();
        let content = compressor.compress(&self.records)?;
        let header = ChunkHeader {
            times: self.times.unwrap_or_default(),
            uncompressed_bytes: self.records.len() as u64,
            uncompressed_checksum: crc32fast::hash(&self.records),
            compression,
            compressed_bytes: content.len() as u64,
        };
        sink.write_record(&header.record().followed_by(content.len()))?;
        sink.write(content)?;
        let end = sink.position();
        let index_offsets = self.write_indexes(sink)?;
        Ok(ChunkIndex {
            header,
            begin,
            length: end - begin,
            index_offsets,
            index_length: sink.position() - end,
        })
    }

    /// Writes the index of each channel that has messages and says where.
    fn write_indexes<W: Write>(&self, sink: &mut Sink<W>) -> io::Result<Vec<(u16, u64)>> {
        let mut offsets = Vec::with_capacity(self.indexes.len());
        for (channel, entries) in (1..)
            .zip(&self.indexes)
            .filter(|(_, entries)| !entries.is_empty())
        {
            offsets.push((channel, sink.position()));
            sink.write_record(&Record::new(op::MESSAGE_INDEX).u16(channel).sized(entries))?;
        }
        Ok(offsets)
    }
}

impl ChunkHeader {
    fn record(&self) -> Record {
        Record::new(op::CHUNK)
            .u64(self.times.0)
            .u64(self.times.1)
            .u64(self.uncompressed_bytes)
            .u32(self.uncompressed_checksum)
            .text(self.compression)
            .u64(self.compressed_bytes)
    }
}

impl ChunkIndex {
    pub(super) fn record(&self) -> Record {
        Record::new(op::CHUNK_INDEX)
            .u64(self.header.times.0)
            .u64(self.header.times.1)
            .u64(self.begin)
            .u64(self.length)
            .channel_map(self.index_offsets.iter().copied())
            .u64(self.index_length)
            .text(self.header.compression)
            .u64(self.header.compressed_bytes)
            .u64(self.header.uncompressed_bytes)
    }
}
