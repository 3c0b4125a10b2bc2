//! An MCAP file that takes samples as they are and that is never called complete before it is.

use std::collections::BTreeMap;
use std::ffi::OsString;
use std::fs::{self, File};
use std::io::{self, BufWriter};
use std::path::{Path, PathBuf};

use shared_types::sample::{Record, layout_hash, msg_definition};

use super::mcap_writer::{Compressor, McapWriter, Message};

/// What precedes a sample's bytes in a message: CDR as of XCDR1, little-endian, no options.
pub(super) const CDR_HEADER: [u8; 4] = [0, 1, 0, 0];

/// Key of a channel's metadata under which the layout hash of its samples stands.
pub(super) const LAYOUT_KEY: &str = "layout";

/// What the logs name as their library: the bytes are to depend on no version of any.
pub(super) const LIBRARY: &str = "gerono";

/// Only small records go through this buffer: a chunk is larger and is handed to the system in one piece.
const BUFFER_BYTES: usize = 64 * 1024;

/// How the chunks of a log are compressed. The digest of a log does not depend on it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, clap::ValueEnum)]
pub enum Compression {
    /// Not at all: the least work.
    #[default]
    None,
    /// LZ4: several times the work of none, half the size.
    Lz4,
    /// Zstandard: the most work, the smallest files.
    Zstd,
}

/// Why a log cannot be written.
#[derive(Debug, thiserror::Error)]
pub enum LogError {
    /// The file cannot be made.
    #[error("cannot create the log {}: {source}; choose a folder that exists and that you may write to", .path.display())]
    Create {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
    /// The file cannot be written further.
    #[error("cannot write the log {}: {source}; make room on its file system or record elsewhere. What was written before is kept under this name", .path.display())]
    Write {
        /// The file, with the name of an incomplete log.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
    /// The finished file cannot be given its name.
    #[error("cannot rename the log {} to {}: {source}; it is complete, rename it by hand", .partial.display(), .path.display())]
    Rename {
        /// The name it has.
        partial: PathBuf,
        /// The name it should have.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
    /// An earlier write failed.
    #[error("the log {} takes no more samples after the failure reported before", .path.display())]
    Closed {
        /// The file, with the name of an incomplete log.
        path: PathBuf,
    },
}

/// What a finished log holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Written {
    /// Messages in the log.
    pub messages: u64,
    /// Size of the file.
    pub bytes: u64,
}

/// The name of a log while it is incomplete.
#[must_use]
pub fn partial_path(path: &Path) -> PathBuf {
    let mut name = OsString::from(path);
    name.push(".partial");
    name.into()
}

/// An MCAP file in the making.
///
/// A chunk is gathered in memory and handed to the system whole, so that the file at any time consists of whole
/// chunks but for a crash within that one write. Dropped before its end, it leaves the chunks that were written.
pub(super) struct McapFile {
    path: PathBuf,
    /// `None` after a failed write.
    writer: Option<McapWriter<BufWriter<File>>>,
    messages: u64,
}

impl McapFile {
    /// Creates the file under the name of an incomplete one.
    pub(super) fn create(path: &Path, compression: Compression) -> Result<Self, LogError> {
        let partial = partial_path(path);
        let create = || {
            let file = BufWriter::with_capacity(BUFFER_BYTES, File::create(&partial)?);
            McapWriter::new(file, "ros2", LIBRARY, Compressor::new(compression)?)
        };
        match create() {
            Ok(writer) => Ok(Self {
                path: path.to_owned(),
                writer: Some(writer),
                messages: 0,
            }),
            Err(source) => Err(LogError::Create {
                path: partial,
                source,
            }),
        }
    }

    /// Writes facts about the whole log.
    pub(super) fn write_metadata(
        &mut self,
        name: &str,
        metadata: &BTreeMap<String, String>,
    ) -> Result<(), LogError> {
        self.attempt(|writer| writer.write_metadata(name, metadata))
    }

    /// Adds a channel for samples of type `R` and says its number.
    pub(super) fn add_channel<R: Record>(&mut self, name: &str) -> Result<u16, LogError> {
        let metadata = BTreeMap::from([(LAYOUT_KEY.to_owned(), layout_hash::<R>())]);
        let writer = self.writer()?;
        let schema = writer.add_schema(R::MSG_NAME, "ros2msg", &msg_definition::<R>());
        Ok(writer.add_channel(schema, name, "cdr", &metadata))
    }

    /// Takes one sample; it reaches the file with its chunk.
    #[inline]
    pub(super) fn write(
        &mut self,
        channel: u16,
        sequence: u32,
        time_ns: u64,
        sample: &[u8],
    ) -> Result<(), LogError> {
        self.writer()?.push_message(&Message {
            channel,
            sequence,
            time_ns,
            prefix: CDR_HEADER,
            sample,
        });
        self.messages += 1;
        Ok(())
    }

    /// Bytes that wait for the end of their chunk.
    pub(super) fn waiting_bytes(&self) -> usize {
        self.writer.as_ref().map_or(0, McapWriter::chunk_bytes)
    }

    /// Ends the chunk and hands it to the system.
    pub(super) fn end_chunk(&mut self) -> Result<(), LogError> {
        self.attempt(McapWriter::end_chunk)
    }

    /// Writes the end of the file and gives it its name.
    ///
    /// It is not forced to the disk, which takes longer than many a flight. A reader recognises a file whose
    /// end was lost to a power failure.
    pub(super) fn finish(mut self) -> Result<Written, LogError> {
        let partial = partial_path(&self.path);
        let Some(writer) = self.writer.take() else {
            return Err(LogError::Closed { path: partial });
        };
        let bytes = writer.finish().map_err(|source| LogError::Write {
            path: partial.clone(),
            source,
        })?;
        fs::rename(&partial, &self.path).map_err(|source| LogError::Rename {
            partial,
            path: self.path.clone(),
            source,
        })?;
        Ok(Written {
            messages: self.messages,
            bytes,
        })
    }

    #[inline]
    fn writer(&mut self) -> Result<&mut McapWriter<BufWriter<File>>, LogError> {
        self.writer.as_mut().ok_or_else(|| LogError::Closed {
            path: partial_path(&self.path),
        })
    }

    /// Writes something to the file, for the last time if it fails.
    fn attempt(
        &mut self,
        action: impl FnOnce(&mut McapWriter<BufWriter<File>>) -> io::Result<()>,
    ) -> Result<(), LogError> {
        action(self.writer()?).map_err(|source| {
            self.writer = None;
            LogError::Write {
                path: partial_path(&self.path),
                source,
            }
        })
    }
}
