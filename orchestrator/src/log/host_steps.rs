//! Reads the records of the steps of a flight in real time from `host.mcap`, one after the other.

use std::fs::File;
use std::io::BufReader;
use std::path::{Path, PathBuf};

use mcap::McapError;
use mcap::records::{Record, op};
use shared_types::ServiceId;
use zerocopy::FromBytes;

use super::framing::CDR_HEADER;
use super::host_samples::{HostSample, ServiceStep};
use super::records::{RawRecord, Records};

/// Why the steps cannot be read on.
#[derive(Debug, thiserror::Error)]
#[error("cannot read the steps of the flight from {}: {reason}", .path.display())]
pub struct HostStepsError {
    /// The file.
    path: PathBuf,
    /// Why, and what to do.
    reason: String,
}

/// The steps in the order of the file; memory does not grow with it. A file that was not closed is read up to where it breaks off.
pub struct HostSteps {
    path: PathBuf,
    records: Records<BufReader<File>>,
    record: RawRecord,
    channel: Option<u16>,
    has_ended: bool,
}

impl HostSteps {
    /// Opens a record of the machine.
    ///
    /// # Errors
    /// [`HostStepsError`] if it cannot be opened.
    pub fn open(path: &Path) -> Result<Self, HostStepsError> {
        let failed = |error: std::io::Error| HostStepsError {
            path: path.to_owned(),
            reason: error.to_string(),
        };
        let file = File::open(path).map_err(failed)?;
        let file_bytes = file.metadata().map_err(failed)?.len();
        Ok(Self {
            path: path.to_owned(),
            records: Records::new(BufReader::with_capacity(1 << 16, file), file_bytes),
            record: RawRecord::default(),
            channel: None,
            has_ended: false,
        })
    }

    fn advance(&mut self) -> Result<Option<(ServiceId, ServiceStep)>, HostStepsError> {
        loop {
            match self.records.next(&mut self.record) {
                Ok(true) => {}
                Ok(false) | Err(McapError::UnexpectedEof) => return Ok(None),
                Err(error) => return Err(self.damaged(&error)),
            }
            if !matches!(self.record.opcode, op::CHANNEL | op::MESSAGE) {
                continue;
            }
            match mcap::parse_record(self.record.opcode, &self.record.body) {
                Ok(Record::Channel(channel)) if channel.topic == ServiceStep::CHANNEL => {
                    self.channel = Some(channel.id);
                }
                Ok(Record::Message { header, data }) if Some(header.channel_id) == self.channel => {
                    let step = data
                        .strip_prefix(&CDR_HEADER)
                        .and_then(|bytes| ServiceStep::read_from_bytes(bytes).ok());
                    let of_service = step.and_then(|step| {
                        let service = ServiceId::ALL.get(step.service as usize)?;
                        Some((*service, step))
                    });
                    return of_service.map(Some).ok_or_else(|| self.of_another_layout());
                }
                Ok(_) => {}
                Err(error) => return Err(self.damaged(&error)),
            }
        }
    }

    fn damaged(&self, error: &McapError) -> HostStepsError {
        HostStepsError {
            path: self.path.clone(),
            reason: format!("{error}; try `gerono recover {}`", self.path.display()),
        }
    }

    fn of_another_layout(&self) -> HostStepsError {
        HostStepsError {
            path: self.path.clone(),
            reason: "its steps are laid out in another way; use the program that wrote it".to_owned(),
        }
    }
}

/// Nothing follows an error.
impl Iterator for HostSteps {
    type Item = Result<(ServiceId, ServiceStep), HostStepsError>;

    fn next(&mut self) -> Option<Self::Item> {
        if self.has_ended {
            return None;
        }
        let found = self.advance();
        self.has_ended = !matches!(found, Ok(Some(_)));
        found.transpose()
    }
}
