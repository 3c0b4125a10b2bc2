//! MCAP file for unchanged samples, which has its final name only when it is complete.

use std::collections::BTreeMap;
use std::ffi::OsString;
use std::fs::{self, File};
use std::io::{self, BufWriter, Seek};
use std::path::{Path, PathBuf};
use std::time::Duration;

use mcap::records::{MessageHeader, Metadata};
use mcap::write::NoSeek;
use mcap::{McapError, McapResult, WriteOptions, Writer};
use result_file::ResultFile;
use shared_types::sample::{CDR_HEADER, Record, layout_hash, msg_definition};

use super::compression::Compression;
use super::durability::Durability;

/// Key of the layout hash in a channel's metadata.
pub(super) const LAYOUT_KEY: &str = "layout";

/// Name of the library in the logs, constant so that the bytes do not depend on a version.
pub(super) const LIBRARY: &str = "gerono";

/// The profile of a log whose messages are all CDR.
pub(super) const ROS2_PROFILE: &str = "ros2";

/// Buffer for small records: a chunk is larger and is written in one call.
const BUFFER_BYTES: usize = 64 * 1024;

/// Reason why a log cannot be written.
#[derive(Debug, thiserror::Error)]
pub enum LogError {
    /// The file cannot be created.
    #[error("cannot create the log {}: {source}; choose a folder that exists and that you may write to", .path.display())]
    Create {
        /// The file.
        path: PathBuf,
        /// The error of the system.
        source: io::Error,
    },
    /// A file with the name of the incomplete log exists.
    #[error("{} exists already: it may be all that is left of a flight and is not overwritten; move it away, or record into another folder", .path.display())]
    Exists {
        /// The file, with the name of an incomplete log.
        path: PathBuf,
    },
    /// A log derived from other data cannot be written.
    #[error("cannot write {}: {source}; nothing of it is kept, and what had this name before still has it", .path.display())]
    NotMade {
        /// The file.
        path: PathBuf,
        /// The error of the system.
        source: io::Error,
    },
    /// The file cannot be written further.
    #[error("cannot write the log {}: {source}; make room on its file system or record elsewhere. What was written before is kept under this name", .path.display())]
    Write {
        /// The file, with the name of an incomplete log.
        path: PathBuf,
        /// The error of the system.
        source: io::Error,
    },
    /// The file was removed, or renamed, while it was written.
    #[error("the log {} was removed while it was written: what it held is lost; record into a folder that nobody cleans up", .path.display())]
    Removed {
        /// The file, with the name of an incomplete log.
        path: PathBuf,
    },
    /// The file has another size than the written bytes.
    #[error("the log {} has {length} bytes and not the {written} that were written: another program, or a plug-in, has changed it; `gerono recover` keeps what is whole of it", .path.display())]
    Altered {
        /// The file, with the name of an incomplete log.
        path: PathBuf,
        /// Size of the file.
        length: u64,
        /// Written bytes.
        written: u64,
    },
    /// The finished file cannot be renamed.
    #[error("cannot rename the log {} to {}: {source}; it is complete, rename it by hand", .partial.display(), .path.display())]
    Rename {
        /// Present name.
        partial: PathBuf,
        /// Final name.
        path: PathBuf,
        /// The error of the system.
        source: io::Error,
    },
    /// An earlier write failed.
    #[error("the log {} takes no more samples after the failure reported before", .path.display())]
    Closed {
        /// The file, with the name of an incomplete log.
        path: PathBuf,
    },
}

/// The content of a finished log.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Written {
    /// Messages in the log.
    pub messages: u64,
    /// Size of the file.
    pub bytes: u64,
}

/// Returns the name of a log while it is incomplete.
#[must_use]
pub fn partial_path(path: &Path) -> PathBuf {
    let mut name = OsString::from(path);
    name.push(".partial");
    name.into()
}

/// MCAP file that is being written.
///
/// A chunk is assembled in memory and written in one call, so that the file always consists of complete chunks, except for a
/// crash during that call.
pub(super) struct McapFile {
    path: PathBuf,
    /// `None` after a failed write.
    writer: Option<Writer<NoSeek<BufWriter<File>>>>,
    /// The same file, with a shared position, to compare its size with the written bytes.
    own: File,
    /// Buffer for a message, reused to avoid allocations.
    payload: Vec<u8>,
    messages: u64,
    /// Written bytes.
    bytes: u64,
    /// `None` without periodic synchronisation.
    durability: Option<Durability>,
    /// The file as a result, complete or absent; `None` for the log of a flight, of which every complete chunk is valuable.
    result: Option<ResultFile>,
}

/// Content of a file that is written as a result.
#[derive(Clone, Copy)]
pub(super) enum Content {
    /// Samples alone.
    Samples,
    /// Samples and messages of other encodings, without a profile.
    Mixed,
}

impl McapFile {
    /// Creates the file with the name of an incomplete one, which must not exist.
    ///
    /// `chunk_bytes` closes a chunk by size; without it only [`flush`](Self::flush) does.
    pub(super) fn create(
        path: &Path,
        compression: Compression,
        chunk_bytes: Option<u64>,
    ) -> Result<Self, LogError> {
        Self::begin(ROS2_PROFILE, new_file(path)?, path, compression, chunk_bytes)
    }

    /// Begins a file that is complete or absent, because it can be written again from other data.
    pub(super) fn create_result(
        result: io::Result<ResultFile>,
        content: Content,
        path: &Path,
        compression: Compression,
        chunk_bytes: Option<u64>,
    ) -> Result<Self, LogError> {
        let opened = result.and_then(|result| Ok((result.try_clone()?, result)));
        let (file, result) = opened.map_err(|source| LogError::NotMade {
            path: path.to_owned(),
            source,
        })?;
        let profile = match content {
            Content::Samples => ROS2_PROFILE,
            Content::Mixed => "",
        };
        let mut begun = Self::begin(profile, file, path, compression, chunk_bytes)?;
        begun.result = Some(result);
        Ok(begun)
    }

    /// As [`Self::create`], over a file that is open: a device in place of a disk.
    pub(super) fn over(
        file: File,
        path: &Path,
        compression: Compression,
        chunk_bytes: Option<u64>,
    ) -> Result<Self, LogError> {
        Self::begin(ROS2_PROFILE, file, path, compression, chunk_bytes)
    }

    fn begin(
        profile: &str,
        file: File,
        path: &Path,
        compression: Compression,
        chunk_bytes: Option<u64>,
    ) -> Result<Self, LogError> {
        let options = WriteOptions::new()
            .profile(profile)
            .library(LIBRARY)
            .disable_seeking(true)
            .chunk_size(chunk_bytes)
            .compression_threads(0);
        let failed = |source| LogError::Create {
            path: partial_path(path),
            source,
        };
        let own = file.try_clone().map_err(failed)?;
        let writer = compression
            .apply(options)
            .create(NoSeek::new(BufWriter::with_capacity(BUFFER_BYTES, file)))
            .map_err(|error| failed(io_error(error)))?;
        Ok(Self {
            path: path.to_owned(),
            writer: Some(writer),
            own,
            payload: CDR_HEADER.to_vec(),
            messages: 0,
            bytes: 0,
            durability: None,
            result: None,
        })
    }

    /// Returns the error of a write that has failed.
    fn failed(&self, source: io::Error) -> LogError {
        match self.result {
            Some(_) => LogError::NotMade {
                path: self.path.clone(),
                source,
            },
            None => LogError::Write {
                path: partial_path(&self.path),
                source,
            },
        }
    }

    /// Synchronises the written bytes to the disk in every `period`.
    pub(super) fn force_every(&mut self, period: Duration) -> Result<(), LogError> {
        let partial = partial_path(&self.path);
        // Through another descriptor of the same file: the library keeps its own.
        let begun = File::open(&partial).and_then(|file| Durability::begin(period, move || file.sync_data()));
        let durability = begun.map_err(|source| LogError::Create {
            path: partial,
            source,
        })?;
        self.durability = Some(durability);
        Ok(())
    }

    /// Writes facts about the whole log.
    pub(super) fn write_metadata(
        &mut self,
        name: &str,
        metadata: BTreeMap<String, String>,
    ) -> Result<(), LogError> {
        let name = name.to_owned();
        self.attempt(|writer| writer.write_metadata(&Metadata { name, metadata }))
    }

    /// Adds a channel for samples of type `R`. Returns its number.
    pub(super) fn add_channel<R: Record>(&mut self, name: &str) -> Result<u16, LogError> {
        self.declare_channel(name, R::MSG_NAME, &msg_definition::<R>(), &layout_hash::<R>())
    }

    /// Adds a channel for samples of a type with this name, definition and layout. Returns its number.
    pub(super) fn declare_channel(
        &mut self,
        name: &str,
        schema: &str,
        definition: &str,
        layout: &str,
    ) -> Result<u16, LogError> {
        self.attempt(|writer| {
            let schema = writer.add_schema(schema, "ros2msg", definition.as_bytes())?;
            let metadata = BTreeMap::from([(LAYOUT_KEY.to_owned(), layout.to_owned())]);
            writer.add_channel(schema, name, "cdr", &metadata)
        })
    }

    /// Adds a channel for Protocol Buffers, whose schema is a `FileDescriptorSet`. Returns its number.
    pub(super) fn declare_protobuf_channel(
        &mut self,
        name: &str,
        schema: &str,
        description: &[u8],
    ) -> Result<u16, LogError> {
        self.attempt(|writer| {
            let schema = writer.add_schema(schema, "protobuf", description)?;
            writer.add_channel(schema, name, "protobuf", &BTreeMap::new())
        })
    }

    /// Writes one sample.
    #[inline]
    pub(super) fn write(
        &mut self,
        channel_id: u16,
        sequence: u32,
        time_ns: u64,
        sample: &[u8],
    ) -> Result<(), LogError> {
        let mut payload = std::mem::take(&mut self.payload);
        payload.truncate(CDR_HEADER.len());
        payload.extend_from_slice(sample);
        let result = self.write_payload(channel_id, sequence, time_ns, &payload);
        self.payload = payload;
        result
    }

    /// Writes one message of any encoding.
    #[inline]
    pub(super) fn write_payload(
        &mut self,
        channel_id: u16,
        sequence: u32,
        time_ns: u64,
        payload: &[u8],
    ) -> Result<(), LogError> {
        let header = MessageHeader {
            channel_id,
            sequence,
            log_time: time_ns,
            publish_time: time_ns,
        };
        let result = self.attempt(|writer| writer.write_to_known_channel(&header, payload));
        self.messages += u64::from(result.is_ok());
        result
    }

    /// Refuses a file that another program has truncated or written to: the next chunk would fill the gap with zeros, so that
    /// at the end the size alone would be correct.
    fn check_length(&mut self) -> Result<(), LogError> {
        if self.writer.is_none() {
            return Ok(());
        }
        let sizes = self.own.metadata().and_then(|found| {
            // Devices and pipes have no size.
            let is_file = found.is_file();
            let written = if is_file { self.own.stream_position()? } else { 0 };
            Ok(is_file.then_some((found.len(), written)))
        });
        let problem = match sizes {
            Ok(Some((length, written))) if length != written => LogError::Altered {
                path: self
                    .result
                    .as_ref()
                    .map_or_else(|| partial_path(&self.path), |_| self.path.clone()),
                length,
                written,
            },
            Ok(_) => return Ok(()),
            Err(source) => self.failed(source),
        };
        self.abandon();
        Err(problem)
    }

    /// Closes the chunk and writes it.
    pub(super) fn flush(&mut self) -> Result<(), LogError> {
        self.check_length()?;
        if self.durability.as_ref().is_some_and(Durability::has_failed) {
            self.end_durability()?;
        }
        self.attempt(Writer::flush)?;
        if let Some(result) = &self.result {
            self.bytes = result.bytes().map_err(|source| self.failed(source))?;
            return Ok(());
        }
        let path = partial_path(&self.path);
        match fs::symlink_metadata(&path) {
            Ok(file) => {
                self.bytes = file.len();
                Ok(())
            }
            Err(error) if error.kind() == io::ErrorKind::NotFound => {
                self.abandon();
                Err(LogError::Removed { path })
            }
            // Other errors do not show that the file was removed.
            _ => Ok(()),
        }
    }

    /// Returns the number of written messages.
    pub(super) fn messages(&self) -> u64 {
        self.messages
    }

    /// Returns the written bytes.
    pub(super) fn bytes(&self) -> u64 {
        self.bytes
    }

    /// Synchronises the rest to the disk; after a failure the file is closed.
    fn end_durability(&mut self) -> Result<(), LogError> {
        let result = self
            .durability
            .take()
            .map_or(Ok(()), |mut durability| durability.end());
        result.map_err(|source| {
            self.abandon();
            self.failed(source)
        })
    }

    /// Writes index and end of the file and renames it.
    ///
    /// Synchronised to the disk only on request, because that may take longer than a flight. A reader detects a file whose
    /// end was lost by a power failure.
    pub(super) fn finish(mut self) -> Result<Written, LogError> {
        self.check_length()?;
        self.attempt(Writer::finish)?;
        self.check_length()?;
        let is_durable = self.durability.is_some();
        self.end_durability()?;
        if let Some(result) = self.result.take() {
            return self.finish_result(result);
        }
        let partial = partial_path(&self.path);
        let written = |source| LogError::Write {
            path: partial.clone(),
            source,
        };
        let bytes = fs::metadata(&partial).map_err(written)?.len();
        // Rename last: a log with its final name is complete, and a process that dies before leaves the partial name for `recover`.
        fs::rename(&partial, &self.path).map_err(|source| LogError::Rename {
            partial,
            path: self.path.clone(),
            source,
        })?;
        if is_durable {
            // The bytes are on the disk; without this call the new name might be lost by a power failure.
            force_names(&self.path).map_err(|source| LogError::Write {
                path: self.path.clone(),
                source,
            })?;
        }
        Ok(Written {
            messages: self.messages,
            bytes,
        })
    }

    fn finish_result(&self, result: ResultFile) -> Result<Written, LogError> {
        let bytes = result.bytes();
        let finished = bytes.and_then(|bytes| result.finish().map(|()| bytes));
        let bytes = finished.map_err(|source| LogError::NotMade {
            path: self.path.clone(),
            source,
        })?;
        Ok(Written {
            messages: self.messages,
            bytes,
        })
    }

    /// Calls a function of the writer; after a failure the file is abandoned.
    #[inline]
    fn attempt<T>(
        &mut self,
        action: impl FnOnce(&mut Writer<NoSeek<BufWriter<File>>>) -> McapResult<T>,
    ) -> Result<T, LogError> {
        let Some(writer) = &mut self.writer else {
            return Err(LogError::Closed {
                path: partial_path(&self.path),
            });
        };
        action(writer).map_err(|error| {
            self.abandon();
            self.failed(io_error(error))
        })
    }

    /// Leaves the file unchanged. Dropping the writer would write an end, and the file would appear complete.
    fn abandon(&mut self) {
        if let Some(writer) = self.writer.take() {
            drop(writer.into_inner());
        }
    }
}

impl Drop for McapFile {
    fn drop(&mut self) {
        self.abandon();
    }
}

/// Creates the file of an incomplete log.
///
/// An existing file is not removed: it may be the only copy of a flight. A symbolic link is removed and not followed: in a
/// folder that others may write to, its target is not trusted.
fn new_file(path: &Path) -> Result<File, LogError> {
    let path = partial_path(path);
    let is_link = fs::symlink_metadata(&path).is_ok_and(|found| found.is_symlink());
    let removed = if is_link { fs::remove_file(&path) } else { Ok(()) };
    let made = removed.and_then(|()| result_file::new_file(&path));
    // For `is_being_written`; on a file system without locks nobody is told.
    let made = made.inspect(|file| drop(file.try_lock()));
    made.map_err(|source| match source.kind() {
        io::ErrorKind::AlreadyExists => LogError::Exists { path },
        _ => LogError::Create { path, source },
    })
}

/// Returns whether a process that lives has a log open for writing.
pub(super) fn is_being_written(path: &Path) -> bool {
    let tried = File::open(path).map(|file| file.try_lock_shared());
    matches!(tried, Ok(Err(fs::TryLockError::WouldBlock)))
}

/// Synchronises the folder of a file to the disk.
fn force_names(path: &Path) -> io::Result<()> {
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty());
    File::open(folder.unwrap_or(Path::new(".")))?.sync_all()
}

/// Returns the system's error inside of the library's, if there is one.
fn io_error(error: McapError) -> io::Error {
    match error {
        McapError::Io(source) => source,
        other => io::Error::other(other),
    }
}
