//! Reader of the data in `host.mcap` that a replay needs: the inputs of steps in real time, and checkpoints of the services.

use std::fs::File;
use std::io::{self, BufReader};
use std::path::{Path, PathBuf};

use mcap::McapError;
use mcap::records::{Channel, Record, op};
use shared_types::ServiceId;
use shared_types::sample::CDR_HEADER;
use zerocopy::FromBytes;

use super::host_samples::{HostSample, LoggedCheckpoint, PieceByPiece, ServiceCheckpoint, ServiceStep};
use super::records::{self, RawRecord, Records};

/// Reason why the record of the machine cannot be read further.
#[derive(Debug, thiserror::Error)]
pub enum HostReadError {
    /// The file cannot be opened.
    #[error("cannot read what the machine did from {}: {source}", .path.display())]
    Open {
        /// The file.
        path: PathBuf,
        /// The error of the system.
        source: io::Error,
    },
    /// The record is damaged.
    #[error("cannot read what the machine did from {}: {source}; try `gerono recover {}`", .path.display(), .path.display())]
    Damaged {
        /// The file.
        path: PathBuf,
        /// The violated requirement.
        source: McapError,
    },
    /// Its samples have another layout.
    #[error(
        "cannot read what the machine did from {}: its samples are laid out in another way; use the program that wrote it",
        .0.display()
    )]
    OtherLayout(PathBuf),
}

impl HostReadError {
    /// Returns whether the record is only damaged: a file that does not begin as an MCAP file is another one.
    #[must_use]
    pub fn is_incomplete(&self) -> bool {
        matches!(self, Self::Damaged { source, .. } if !matches!(source, McapError::BadMagic))
    }
}

/// An entry of the machine's record about a service.
#[derive(Clone, Debug, PartialEq)]
pub enum HostEntry {
    /// A step in real time.
    Step(ServiceId, ServiceStep),
    /// The state of a service before a step.
    Checkpoint(LoggedCheckpoint),
}

/// Reader of steps and checkpoints in the order of the file, in constant memory. A file that was not closed is read up to its break.
pub struct HostReader {
    path: PathBuf,
    records: Records<BufReader<File>>,
    record: RawRecord,
    channels: Channels,
    has_ended: bool,
}

/// Channels that are read.
#[derive(Default)]
struct Channels {
    steps: Option<u16>,
    checkpoints: Option<u16>,
    pieces: PieceByPiece,
}

/// Sample with another layout than this program's.
struct OtherLayout;

impl HostReader {
    /// Opens a record of the machine.
    ///
    /// # Errors
    /// [`HostReadError`] if it cannot be opened.
    pub fn open(path: &Path) -> Result<Self, HostReadError> {
        let failed = |source| HostReadError::Open {
            path: path.to_owned(),
            source,
        };
        let file = File::open(path).map_err(failed)?;
        let file_bytes = file.metadata().map_err(failed)?.len();
        Ok(Self {
            path: path.to_owned(),
            records: Records::new(BufReader::with_capacity(1 << 16, file), file_bytes),
            record: RawRecord::default(),
            channels: Channels::default(),
            has_ended: false,
        })
    }

    /// Returns only the steps.
    pub fn steps(self) -> impl Iterator<Item = Result<(ServiceId, ServiceStep), HostReadError>> {
        self.filter_map(|entry| match entry {
            Ok(HostEntry::Step(service, step)) => Some(Ok((service, step))),
            Ok(HostEntry::Checkpoint(_)) => None,
            Err(error) => Some(Err(error)),
        })
    }

    fn advance(&mut self) -> Result<Option<HostEntry>, HostReadError> {
        loop {
            match self.records.next(&mut self.record) {
                Ok(true) => {}
                Ok(false) | Err(McapError::UnexpectedEof) => return Ok(None),
                Err(error) => return Err(self.damaged(error)),
            }
            if !matches!(self.record.opcode, op::CHANNEL | op::MESSAGE) {
                continue;
            }
            match records::parse(self.record.opcode, &self.record.body) {
                Ok(Record::Channel(channel)) => self.channels.declare(&channel),
                Ok(Record::Message { header, data }) => match self.channels.take(header.channel_id, &data) {
                    Ok(None) => {}
                    Ok(found) => return Ok(found),
                    Err(OtherLayout) => return Err(HostReadError::OtherLayout(self.path.clone())),
                },
                Ok(_) => {}
                Err(error) => return Err(self.damaged(error)),
            }
        }
    }

    fn damaged(&self, source: McapError) -> HostReadError {
        HostReadError::Damaged {
            path: self.path.clone(),
            source,
        }
    }
}

impl Channels {
    fn declare(&mut self, channel: &Channel) {
        match channel.topic.as_str() {
            ServiceStep::CHANNEL => self.steps = Some(channel.id),
            ServiceCheckpoint::CHANNEL => self.checkpoints = Some(channel.id),
            _ => {}
        }
    }

    /// Returns the entry that a message of a channel completes, if any.
    fn take(&mut self, channel: u16, data: &[u8]) -> Result<Option<HostEntry>, OtherLayout> {
        if self.steps == Some(channel) {
            let step: ServiceStep = sample(data)?;
            let service = *ServiceId::ALL.get(step.service as usize).ok_or(OtherLayout)?;
            return Ok(Some(HostEntry::Step(service, step)));
        }
        if self.checkpoints == Some(channel) {
            return Ok(self.pieces.take(&sample(data)?).map(HostEntry::Checkpoint));
        }
        Ok(None)
    }
}

fn sample<T: FromBytes>(data: &[u8]) -> Result<T, OtherLayout> {
    let bytes = data.strip_prefix(&CDR_HEADER).ok_or(OtherLayout)?;
    T::read_from_bytes(bytes).map_err(|_| OtherLayout)
}

/// Nothing follows an error.
impl Iterator for HostReader {
    type Item = Result<HostEntry, HostReadError>;

    fn next(&mut self) -> Option<Self::Item> {
        if self.has_ended {
            return None;
        }
        let found = self.advance();
        self.has_ended = !matches!(found, Ok(Some(_)));
        found.transpose()
    }
}
