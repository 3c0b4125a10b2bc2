//! Scan for the valid parts of a damaged log.
//!
//! Records are read in sequence. After an invalid one the file is searched byte by byte for the next valid one: a chunk
//! with a valid checksum, or metadata whose lengths add up. So only damaged parts are lost.

use std::cell::RefCell;
use std::fs::File;
use std::io;
use std::ops::Range;
use std::os::unix::fs::FileExt;
use std::path::Path;

use mcap::records::{ChunkHeader, Metadata, Record, op};

use crate::records::{
    self, Budget, CHUNK_BYTES_MAX, ChunkRecords, FRAME_BYTES, RECORD_BYTES_MAX, RawRecord, is_message_index,
};

/// Length of the header of a chunk that is not compressed.
const PLAIN_HEADER_BYTES: u64 = 8 + 8 + 8 + 4 + 4 + 8;

/// Length of the body of the record that ends the data.
const DATA_END_BYTES: u64 = 4;

/// Length of the body of the last record.
const FOOTER_BYTES: u64 = 8 + 8 + 4;

/// Block size of the search, bytes.
const BLOCK_BYTES: usize = 1 << 16;

/// A part of a log.
pub(super) enum Piece {
    /// A chunk with a valid checksum.
    Chunk(Chunk),
    /// Complete records of a truncated chunk at the end of the file, not verified by a checksum.
    Cut {
        /// The records.
        chunk: Chunk,
        /// Place where it begins in the file.
        at: u64,
        /// Bytes to the end of the file.
        bytes: u64,
    },
    /// Facts about the log.
    Metadata(Metadata),
    /// Other bytes.
    Damage {
        /// Place where they begin in the file.
        at: u64,
        /// Number of bytes.
        bytes: u64,
    },
    /// The record that ends the data.
    End,
}

/// The records of a chunk.
pub(super) struct Chunk {
    /// Its compression, as MCAP calls it.
    pub(super) compression: String,
    content: Vec<u8>,
    records: Vec<(u8, Range<usize>)>,
}

impl Chunk {
    /// Returns kind and bytes of the records.
    pub(super) fn records(&self) -> impl Iterator<Item = (u8, &[u8])> {
        self.records
            .iter()
            .map(|(opcode, range)| (*opcode, &self.content[range.clone()]))
    }

    /// Opens a chunk; `None` if it is invalid.
    fn verified(body: &[u8]) -> Option<Self> {
        let mut records = ChunkRecords::new();
        records.open(body).ok()?;
        let mut chunk = Self::new(records.compression.clone());
        let mut record = RawRecord::default();
        while records.next(&mut record).ok()? {
            chunk.push(record.opcode, &record.body);
        }
        Some(chunk)
    }

    /// Returns the complete records at the beginning of `content`.
    fn beginning(mut content: &[u8]) -> Self {
        let mut chunk = Self::new(String::new());
        while let Some((frame, rest)) = content.split_first_chunk::<FRAME_BYTES>() {
            let (opcode, length) = frame_of(*frame);
            let is_expected = matches!(opcode, op::SCHEMA | op::CHANNEL | op::MESSAGE);
            let body = usize::try_from(length).ok().and_then(|length| rest.get(..length));
            let Some(body) = body.filter(|body| is_expected && records::parse(opcode, body).is_ok()) else {
                break;
            };
            chunk.push(opcode, body);
            content = &rest[body.len()..];
        }
        chunk
    }

    fn new(compression: String) -> Self {
        Self {
            compression,
            content: Vec::new(),
            records: Vec::new(),
        }
    }

    fn push(&mut self, opcode: u8, body: &[u8]) {
        let begin = self.content.len();
        self.content.extend_from_slice(body);
        self.records.push((opcode, begin..self.content.len()));
    }
}

/// Scan of a file.
///
/// Candidates for chunks are uncompressed for their verification, which a crafted file could make arbitrarily expensive.
/// Beyond the work for any log the scan fails with an error of the kind [`io::ErrorKind::InvalidData`].
pub(super) struct Scan {
    file: File,
    budget: RefCell<Budget>,
    /// Offset of the next piece.
    at: u64,
    /// End of the data: at the record that ends them, or at the end of the file.
    end: u64,
    /// `true` if there is such a record.
    is_closed: bool,
    has_ended: bool,
}

impl Scan {
    pub(super) fn open(path: &Path) -> io::Result<Self> {
        let file = File::open(path)?;
        let size = file.metadata()?.len();
        let mut scan = Self {
            file,
            budget: RefCell::new(Budget::new(size)),
            at: 0,
            end: size,
            is_closed: false,
            has_ended: false,
        };
        if let Some(end) = scan.stated_end()? {
            scan.end = end;
            scan.is_closed = true;
        }
        if scan.read(0, mcap::MAGIC.len())? == mcap::MAGIC {
            scan.at = mcap::MAGIC.len() as u64;
        }
        Ok(scan)
    }

    /// Returns the next piece; `None` at the end of the file.
    pub(super) fn next(&mut self) -> io::Result<Option<Piece>> {
        while self.at < self.end {
            let Some((found, bytes)) = self.record_at(self.at)? else {
                return self.damage().map(Some);
            };
            match found {
                WholeRecord::Chunk(chunk) => {
                    self.at += bytes;
                    return Ok(Some(Piece::Chunk(chunk)));
                }
                WholeRecord::Metadata(metadata) => {
                    self.at += bytes;
                    return Ok(Some(Piece::Metadata(metadata)));
                }
                WholeRecord::Index => self.at += bytes,
                // The summary is rebuilt.
                WholeRecord::DataEnd => match self.resynchronise(self.at + bytes)? {
                    Some(_) => return self.damage().map(Some),
                    None => {
                        self.end = self.at;
                        self.is_closed = true;
                    }
                },
            }
        }
        let ends_now = self.is_closed && !self.has_ended;
        self.has_ended = true;
        Ok(ends_now.then_some(Piece::End))
    }

    /// Returns the end of the data, by the last record of a complete file.
    fn stated_end(&self) -> io::Result<Option<u64>> {
        let footer_bytes = FRAME_BYTES as u64 + FOOTER_BYTES;
        let tail_bytes = footer_bytes + mcap::MAGIC.len() as u64;
        let Some(footer_at) = self.end.checked_sub(tail_bytes) else {
            return Ok(None);
        };
        let tail = self.read(footer_at, tail_bytes as usize)?;
        let Some((frame, body)) = tail.split_first_chunk::<FRAME_BYTES>() else {
            return Ok(None);
        };
        if frame_of(*frame) != (op::FOOTER, FOOTER_BYTES) || !tail.ends_with(mcap::MAGIC) {
            return Ok(None);
        }
        let Ok(Record::Footer(footer)) = records::parse(op::FOOTER, &body[..FOOTER_BYTES as usize]) else {
            return Ok(None);
        };
        let data_end_bytes = FRAME_BYTES as u64 + DATA_END_BYTES;
        let stated = footer.summary_start.checked_sub(data_end_bytes);
        let Some(at) = stated.filter(|&at| at < footer_at) else {
            return Ok(None);
        };
        Ok((self.frame_at(at)? == Some((op::DATA_END, DATA_END_BYTES))).then_some(at))
    }

    /// Skips to the next valid record.
    fn damage(&mut self) -> io::Result<Piece> {
        let at = self.at;
        let next = self.resynchronise(at + 1)?;
        let cut = match next {
            None if !self.is_closed => self.cut_at(at)?,
            _ => None,
        };
        self.at = next.unwrap_or(self.end);
        let bytes = self.at - at;
        Ok(match cut {
            Some(chunk) => Piece::Cut { chunk, at, bytes },
            None => Piece::Damage { at, bytes },
        })
    }

    /// Returns the offset of the next valid chunk or metadata, from `from` on.
    fn resynchronise(&self, from: u64) -> io::Result<Option<u64>> {
        let mut begin = from;
        while begin < self.end {
            let block = self.read(begin, BLOCK_BYTES + FRAME_BYTES)?;
            let searched = block.len().min(BLOCK_BYTES);
            for (offset, frame) in block.windows(FRAME_BYTES).enumerate().take(searched) {
                if !matches!(frame[0], op::CHUNK | op::METADATA) {
                    continue;
                }
                let at = begin + offset as u64;
                // An empty record has no verification, and its length may span whole chunks: zeros within a chunk look like
                // an empty record.
                let holds = match self.record_at(at)? {
                    Some((WholeRecord::Chunk(chunk), _)) => !chunk.records.is_empty(),
                    Some((WholeRecord::Metadata(metadata), _)) => !metadata.name.is_empty(),
                    _ => false,
                };
                if holds {
                    return Ok(Some(at));
                }
            }
            begin += searched as u64;
        }
        Ok(None)
    }

    /// Returns the record at an offset and its length, if it is valid.
    fn record_at(&self, at: u64) -> io::Result<Option<(WholeRecord, u64)>> {
        let Some((opcode, length)) = self.frame_at(at)? else {
            return Ok(None);
        };
        let bytes = (FRAME_BYTES as u64).saturating_add(length);
        if at.saturating_add(bytes) > self.end || length > RECORD_BYTES_MAX as u64 {
            return Ok(None);
        }
        let body = || self.read(at + FRAME_BYTES as u64, length as usize);
        let found = match opcode {
            op::CHUNK if self.may_be_chunk(at, length)? => Chunk::verified(&body()?).map(WholeRecord::Chunk),
            op::METADATA => metadata(&body()?).map(WholeRecord::Metadata),
            op::MESSAGE_INDEX => is_message_index(&body()?).then_some(WholeRecord::Index),
            op::HEADER if at == mcap::MAGIC.len() as u64 => skip_texts(&body()?, 2)
                .is_some_and(<[u8]>::is_empty)
                .then_some(WholeRecord::Index),
            op::DATA_END if length == DATA_END_BYTES => Some(WholeRecord::DataEnd),
            _ => None,
        };
        Ok(found.map(|found| (found, bytes)))
    }

    /// Returns whether the lengths in the header of a chunk fit into its record, which excludes most candidates without
    /// uncompressing them. Additional bytes are permitted for later versions of the format.
    fn may_be_chunk(&self, at: u64, length: u64) -> io::Result<bool> {
        let Some(header) = self.chunk_header_at(at)? else {
            return Ok(false);
        };
        let header_bytes = PLAIN_HEADER_BYTES + header.compression.len() as u64;
        let stated = header.compressed_size.checked_add(header_bytes);
        let may_be =
            stated.is_some_and(|stated| stated <= length) && header.uncompressed_size <= CHUNK_BYTES_MAX;
        if may_be {
            let spent = self.budget.borrow_mut().spend(length + header.uncompressed_size);
            spent.map_err(|error| io::Error::new(io::ErrorKind::InvalidData, error))?;
        }
        Ok(may_be)
    }

    fn chunk_header_at(&self, at: u64) -> io::Result<Option<ChunkHeader>> {
        const LONGEST_NAME: usize = 8;
        let begin = self.read(
            at + FRAME_BYTES as u64,
            PLAIN_HEADER_BYTES as usize + LONGEST_NAME,
        )?;
        // Times, size and checksum precede the name.
        let Some((name, _)) = begin.get(28..).and_then(split_text) else {
            return Ok(None);
        };
        let header_bytes = PLAIN_HEADER_BYTES as usize + name.len();
        // The library accepts no header without its stated content.
        let Some(header) = begin.get(..header_bytes) else {
            return Ok(None);
        };
        let number = |from: usize| u64::from_le_bytes(std::array::from_fn(|index| header[from + index]));
        Ok(Some(ChunkHeader {
            message_start_time: number(0),
            message_end_time: number(8),
            uncompressed_size: number(16),
            uncompressed_crc: u32::from_le_bytes(std::array::from_fn(|index| header[24 + index])),
            compression: name.to_owned(),
            compressed_size: number(header_bytes - 8),
        }))
    }

    /// Returns the records of an uncompressed chunk that extends beyond the end of the file.
    ///
    /// Only its own lengths identify such a chunk, so they must agree.
    fn cut_at(&self, at: u64) -> io::Result<Option<Chunk>> {
        let Some((op::CHUNK, length)) = self.frame_at(at)? else {
            return Ok(None);
        };
        let Some(header) = self.chunk_header_at(at)? else {
            return Ok(None);
        };
        let is_plain = header.compression.is_empty() && header.uncompressed_size == header.compressed_size;
        if !is_plain || header.compressed_size.checked_add(PLAIN_HEADER_BYTES) != Some(length) {
            return Ok(None);
        }
        let from = at + FRAME_BYTES as u64 + PLAIN_HEADER_BYTES;
        if from.saturating_add(header.compressed_size) <= self.end {
            return Ok(None);
        }
        let left = usize::try_from(self.end.saturating_sub(from)).unwrap_or(usize::MAX);
        let chunk = Chunk::beginning(&self.read(from, left.min(RECORD_BYTES_MAX))?);
        Ok((!chunk.records.is_empty()).then_some(chunk))
    }

    /// Returns kind and length of the record at an offset.
    fn frame_at(&self, at: u64) -> io::Result<Option<(u8, u64)>> {
        let bytes = self.read(at, FRAME_BYTES)?;
        Ok(bytes.first_chunk().map(|frame| frame_of(*frame)))
    }

    /// Reads up to `length` bytes at an offset.
    fn read(&self, at: u64, length: usize) -> io::Result<Vec<u8>> {
        let mut bytes = vec![0; length];
        let mut count = 0;
        while count < length {
            match self.file.read_at(&mut bytes[count..], at + count as u64) {
                Ok(0) => break,
                Ok(more) => count += more,
                Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
                Err(error) => return Err(error),
            }
        }
        bytes.truncate(count);
        Ok(bytes)
    }
}

/// Valid record.
enum WholeRecord {
    Chunk(Chunk),
    Metadata(Metadata),
    /// Index, which the writer rebuilds.
    Index,
    DataEnd,
}

fn frame_of(frame: [u8; FRAME_BYTES]) -> (u8, u64) {
    let length = std::array::from_fn(|index| frame[1 + index]);
    (frame[0], u64::from_le_bytes(length))
}

/// Parses metadata, if their lengths add up: a name, and pairs of texts that fill the rest.
fn metadata(body: &[u8]) -> Option<Metadata> {
    let (_, rest) = split_text(body)?;
    let (length, mut pairs) = rest.split_first_chunk()?;
    if u32::from_le_bytes(*length) as usize != pairs.len() {
        return None;
    }
    while !pairs.is_empty() {
        pairs = skip_texts(pairs, 2)?;
    }
    match records::parse(op::METADATA, body) {
        Ok(Record::Metadata(metadata)) => Some(metadata),
        _ => None,
    }
}

/// Returns the bytes after `count` texts.
fn skip_texts(bytes: &[u8], count: usize) -> Option<&[u8]> {
    (0..count).try_fold(bytes, |bytes, _| Some(split_text(bytes)?.1))
}

/// Splits off a text that is preceded by its length.
fn split_text(bytes: &[u8]) -> Option<(&str, &[u8])> {
    let (length, rest) = bytes.split_first_chunk()?;
    let (text, rest) = rest.split_at_checked(u32::from_le_bytes(*length) as usize)?;
    Some((std::str::from_utf8(text).ok()?, rest))
}
