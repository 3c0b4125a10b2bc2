//! Records of an MCAP file in order, each returned only after the verification of its checksum.

use std::io::{self, Read};

use mcap::records::{ChunkHeader, Record, op};
use mcap::sans_io::linear_reader::{LinearReadEvent, LinearReader, LinearReaderOptions};
use mcap::{McapError, McapResult};

/// Length of the frame of every record: its kind and the length of the body.
pub(super) const FRAME_BYTES: usize = 1 + 8;

/// Maximum size of a record, bytes.
pub(super) const RECORD_BYTES_MAX: usize = 256 << 20;

/// Maximum uncompressed size of a chunk, bytes. The writer's chunks have at most some megabytes.
pub(super) const CHUNK_BYTES_MAX: u64 = 16 << 20;

/// Maximum ratio of uncompressed to compressed size, above `UNPACKED_BYTES_FREE`. Logs of flights have a ratio of five, a
/// decompression bomb one of thousands.
const UNPACKED_RATIO_MAX: u64 = 100;
const UNPACKED_BYTES_FREE: u64 = 256 << 20;

/// Remaining number of bytes of a file that may be uncompressed.
pub(super) struct Budget(u64);

impl Budget {
    /// Makes the budget of a file of `file_bytes`.
    pub(super) fn new(file_bytes: u64) -> Self {
        Self(
            file_bytes
                .saturating_mul(UNPACKED_RATIO_MAX)
                .saturating_add(UNPACKED_BYTES_FREE),
        )
    }

    /// Subtracts the bytes that are about to be uncompressed.
    pub(super) fn spend(&mut self, bytes: u64) -> McapResult<()> {
        self.0 = self.0.checked_sub(bytes).ok_or_else(|| {
            McapError::DecompressionError(format!(
                "the file unpacks to more than {UNPACKED_RATIO_MAX} times its size, as no log of a flight does"
            ))
        })?;
        Ok(())
    }
}

/// Reader of the records of `source`, including those in chunks.
///
/// A chunk is passed to a second reader only after checks that the library omits: that it has a checksum, and that the
/// lengths of uncompressed records add up to the chunk.
pub(super) struct Records<R> {
    source: R,
    source_bytes: u64,
    file: LinearReader,
    budget: Budget,
    pub(super) chunk: ChunkRecords,
}

/// Reader of the records of a chunk, after the verification of its checksum.
pub(super) struct ChunkRecords {
    reader: LinearReader,
    /// The current chunk, framed as a record, and the number of bytes read.
    chunk: Vec<u8>,
    chunk_read: usize,
    /// The compression of the last chunk, as MCAP calls it.
    pub(super) compression: String,
    /// `true` before the first record of the chunk.
    is_new: bool,
    /// Number of chunks with a returned record, whose checksums are valid.
    pub(super) chunks: u64,
}

/// A record: its kind and its bytes.
#[derive(Default)]
pub(super) struct RawRecord {
    /// One of [`op`].
    pub(super) opcode: u8,
    /// `true` if it was in a chunk, under the chunk's checksum.
    pub(super) is_in_chunk: bool,
    /// The bytes after the length.
    pub(super) body: Vec<u8>,
}

impl<R: Read> Records<R> {
    pub(super) fn new(source: R, source_bytes: u64) -> Self {
        let limit =
            usize::try_from(source_bytes).map_or(RECORD_BYTES_MAX, |bytes| bytes.min(RECORD_BYTES_MAX));
        Self {
            source,
            source_bytes,
            file: LinearReader::new_with_options(
                LinearReaderOptions::default()
                    .with_emit_chunks(true)
                    .with_validate_data_section_crc(true)
                    .with_validate_summary_section_crc(true)
                    .with_check_finishes_after_end_magic(true)
                    .with_record_length_limit(limit),
            ),
            budget: Budget::new(source_bytes),
            chunk: ChunkRecords::new(),
        }
    }

    /// Reads the next record into `record`; `false` at the end of a complete file.
    pub(super) fn next(&mut self, record: &mut RawRecord) -> McapResult<bool> {
        loop {
            record.is_in_chunk = self.chunk.next(record)?;
            if record.is_in_chunk {
                return Ok(true);
            }
            if !self.next_in_file(record)? {
                return Ok(false);
            }
            if record.opcode != op::CHUNK {
                return Ok(true);
            }
            // Nothing of the chunk is uncompressed before this check.
            let unpacked = self.chunk.open(&record.body)?;
            self.budget.spend(unpacked)?;
        }
    }

    /// Reads the next record of the file, a chunk as one record; `false` at the end of a complete file.
    fn next_in_file(&mut self, record: &mut RawRecord) -> McapResult<bool> {
        loop {
            match self.file.next_event() {
                Some(Ok(LinearReadEvent::ReadRequest(wanted))) => {
                    let count = read_some(&mut self.source, self.file.insert(wanted))?;
                    self.file.notify_read(count);
                }
                Some(Ok(LinearReadEvent::Record { opcode, data })) => {
                    record.assign(opcode, data);
                    return Ok(true);
                }
                // A record beyond the end of the file was truncated, not forged.
                Some(Err(McapError::RecordTooLarge { len, .. })) if len > self.source_bytes => {
                    return Err(McapError::UnexpectedEof);
                }
                Some(Err(error)) => return Err(error),
                None => return Ok(false),
            }
        }
    }
}

impl ChunkRecords {
    pub(super) fn new() -> Self {
        let options = LinearReaderOptions::default()
            .with_skip_start_magic(true)
            .with_prevalidate_chunk_crcs(true)
            .with_record_length_limit(RECORD_BYTES_MAX);
        Self {
            reader: LinearReader::new_with_options(options),
            chunk: Vec::new(),
            chunk_read: 0,
            compression: String::new(),
            is_new: false,
            chunks: 0,
        }
    }

    /// Opens the chunk with this body. Returns its uncompressed size. After an error the reader must not be used.
    pub(super) fn open(&mut self, body: &[u8]) -> McapResult<u64> {
        let header = check_chunk(body)?;
        self.compression = header.compression;
        self.is_new = true;
        self.chunk.clear();
        self.chunk.push(op::CHUNK);
        self.chunk.extend_from_slice(&(body.len() as u64).to_le_bytes());
        self.chunk.extend_from_slice(body);
        self.chunk_read = 0;
        Ok(header.uncompressed_size)
    }

    /// Reads the next record of the chunk; `false` at its end.
    pub(super) fn next(&mut self, record: &mut RawRecord) -> McapResult<bool> {
        loop {
            match self.reader.next_event() {
                Some(Ok(LinearReadEvent::ReadRequest(wanted))) => {
                    let left = &self.chunk[self.chunk_read..];
                    let count = wanted.min(left.len());
                    if count == 0 {
                        // A request for a frame is the end of the records; within a record the chunk is too short.
                        return if wanted == FRAME_BYTES {
                            Ok(false)
                        } else {
                            Err(McapError::UnexpectedEoc)
                        };
                    }
                    self.reader.insert(count).copy_from_slice(&left[..count]);
                    self.reader.notify_read(count);
                    self.chunk_read += count;
                }
                Some(Ok(LinearReadEvent::Record { opcode, data })) => {
                    self.chunks += u64::from(std::mem::take(&mut self.is_new));
                    record.assign(opcode, data);
                    return Ok(true);
                }
                Some(Err(error)) => return Err(error),
                None => return Ok(false),
            }
        }
    }
}

impl RawRecord {
    fn assign(&mut self, opcode: u8, body: &[u8]) {
        self.opcode = opcode;
        self.body.clear();
        self.body.extend_from_slice(body);
    }
}

/// Reads at least one byte, except at the end of the source.
fn read_some(source: &mut impl Read, place: &mut [u8]) -> io::Result<usize> {
    loop {
        match source.read(place) {
            Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
            result => return result,
        }
    }
}

/// Parses a record of a kind, except the body of an attachment: logs have none, and the library (0.26) trusts their lengths
/// and panics.
pub(super) fn parse(opcode: u8, body: &[u8]) -> McapResult<Record<'_>> {
    match opcode {
        op::ATTACHMENT => Ok(Record::Unknown {
            opcode,
            data: body.into(),
        }),
        _ => mcap::parse_record(opcode, body),
    }
}

/// Refuses a chunk without a checksum or with an excessive size.
fn check_chunk(body: &[u8]) -> McapResult<ChunkHeader> {
    let Record::Chunk { header, data } = parse(op::CHUNK, body)? else {
        return Err(McapError::UnexpectedEoc);
    };
    if header.uncompressed_size > CHUNK_BYTES_MAX {
        return Err(McapError::ChunkTooLarge(header.uncompressed_size));
    }
    if header.uncompressed_crc == 0 && header.uncompressed_size > 0 {
        return Err(McapError::BadChunkCrc {
            saved: 0,
            calculated: 0,
        });
    }
    let is_plain = header.compression.is_empty();
    if is_plain && (header.uncompressed_size != header.compressed_size || !holds_whole_records(&data)) {
        return Err(McapError::UnexpectedEoc);
    }
    Ok(header)
}

/// Returns whether the lengths of the records add up to `data`.
fn holds_whole_records(mut data: &[u8]) -> bool {
    while let Some((frame, rest)) = data.split_first_chunk::<FRAME_BYTES>() {
        let length: [u8; 8] = std::array::from_fn(|index| frame[1 + index]);
        let Some(rest) = usize::try_from(u64::from_le_bytes(length))
            .ok()
            .and_then(|length| rest.get(length..))
        else {
            return false;
        };
        data = rest;
    }
    data.is_empty()
}

/// Returns whether these bytes can be an index of messages: a channel and a list of pairs that fills the rest.
pub(super) fn is_message_index(body: &[u8]) -> bool {
    const PAIR_BYTES: usize = 16;
    let Some((length, pairs)) = body.get(2..).and_then(<[u8]>::split_first_chunk) else {
        return false;
    };
    u32::from_le_bytes(*length) as usize == pairs.len() && pairs.len().is_multiple_of(PAIR_BYTES)
}

/// Returns whether these bytes can be a schema, a channel or metadata: numbers, and fields whose lengths fill the rest. Other
/// kinds are none of them.
pub(super) fn is_declaration(opcode: u8, body: &[u8]) -> bool {
    let (numbers_bytes, fields) = match opcode {
        op::SCHEMA => (2, 3),
        op::CHANNEL => (4, 3),
        op::METADATA => (0, 2),
        _ => return false,
    };
    let mut rest = body.get(numbers_bytes..);
    for _ in 0..fields {
        rest = rest
            .and_then(<[u8]>::split_first_chunk)
            .and_then(|(length, rest)| rest.get(u32::from_le_bytes(*length) as usize..));
    }
    rest.is_some_and(<[u8]>::is_empty)
}
