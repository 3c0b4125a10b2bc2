//! Splits a log into files.
//!
//! A file ends with a chunk, so that the samples of a tick are in one file and the chunks are those of a log in one file. The
//! next file begins with its first sample, so that none is empty.

use std::path::{Path, PathBuf};
use std::thread::{self, JoinHandle};
use std::time::Duration;

use result_file::ResultFile;
use shared_types::Topic;

use super::compression::Compression;
use super::framing::{Content, LogError, McapFile, Written};
use super::manifest::Manifest;
use super::parts::{GOES_ON, Part, goes_on_in, part_path};
use super::topic_channels::declare_topics;

/// How the files of a log are made.
#[derive(Clone, Copy)]
pub(super) enum Making {
    /// Under the name of an incomplete log, which keeps every chunk of a flight that cannot be repeated.
    Flight,
    /// As a result: whole or not there.
    Result,
}

impl Making {
    /// Begins a file of the log.
    pub(super) fn file(self, path: &Path, compression: Compression) -> Result<McapFile, LogError> {
        match self {
            Self::Flight => McapFile::create(path, compression, None),
            Self::Result => {
                let result = ResultFile::create(path, &[]);
                McapFile::create_result(result, Content::Samples, path, compression, None)
            }
        }
    }
}

/// The files of a log up to the one that is written.
pub(super) struct Splitter {
    first: PathBuf,
    manifest: Manifest,
    compression: Compression,
    making: Making,
    bytes: u64,
    ticks: u64,
    /// How often the files are forced to the disk, if they are.
    forcing: Option<Duration>,
    /// The file that is written.
    pub(super) part: Part,
    /// Its first tick, once it has a sample.
    begins_at: Option<u64>,
    is_full: bool,
    /// The files that are complete.
    ended: Written,
    /// Waits until the disk has the file before.
    ending: Option<JoinHandle<Result<Written, LogError>>>,
}

impl Splitter {
    /// The splitter of a log with this manifest; none if the scenario does not ask for one.
    pub(super) fn new(
        first: &Path,
        manifest: &Manifest,
        compression: Compression,
        making: Making,
    ) -> Option<Self> {
        let split = manifest.scenario.record.as_ref()?.split?;
        let tick = manifest.scenario.schedule.tick;
        let ticks = split.after_seconds.map(|seconds| whole_ticks(seconds / tick));
        Some(Self {
            first: first.to_owned(),
            manifest: manifest.clone(),
            compression,
            making,
            bytes: split.after_bytes.unwrap_or(u64::MAX),
            ticks: ticks.unwrap_or(u64::MAX),
            forcing: None,
            part: Part {
                number: 0,
                samples_before: 0,
            },
            begins_at: None,
            is_full: false,
            ended: Written {
                messages: 0,
                bytes: 0,
            },
            ending: None,
        })
    }

    pub(super) fn force_every(&mut self, period: Duration) {
        self.forcing = Some(period);
    }

    /// Takes note that the file has so many bytes and all samples before a tick.
    pub(super) fn end_chunk_before(&mut self, tick: u64, bytes: u64) {
        let ticks = self.begins_at.map_or(0, |first| tick.saturating_sub(first));
        self.is_full = self.begins_at.is_some() && (bytes >= self.bytes || ticks >= self.ticks);
    }

    /// Returns whether a sample of this tick belongs into the next file.
    #[inline]
    pub(super) fn is_due(&mut self, tick: u64) -> bool {
        self.begins_at.get_or_insert(tick);
        self.is_full
    }

    /// Goes on in the next file, and says the numbers of its channels.
    ///
    /// The file before gets its name once the next one is there: whatever happens, no complete file claims a next one that was
    /// never made.
    #[cold]
    pub(super) fn split(&mut self, file: &mut McapFile) -> Result<[u16; Topic::ALL.len()], LogError> {
        self.collect()?;
        let next = Part {
            number: self.part.number + 1,
            samples_before: self.part.samples_before + file.messages(),
        };
        file.write_metadata(GOES_ON, goes_on_in(next.number))?;
        let (begun, channels) = self.begin(next)?;
        self.end(std::mem::replace(file, begun))?;
        self.part = next;
        self.begins_at = None;
        self.is_full = false;
        Ok(channels)
    }

    /// Begins the file of a part, whose manifest is handed to the system at once.
    fn begin(&self, part: Part) -> Result<(McapFile, [u16; Topic::ALL.len()]), LogError> {
        let path = part_path(&self.first, part.number);
        let mut file = self.making.file(&path, self.compression)?;
        file.write_metadata(Part::RECORD_NAME, part.to_metadata())?;
        file.write_metadata(Manifest::RECORD_NAME, self.manifest.to_metadata())?;
        file.flush()?;
        if let Some(period) = self.forcing {
            file.force_every(period)?;
        }
        let channels = declare_topics(&mut file, &self.manifest.scenario)?;
        Ok((file, channels))
    }

    /// Completes a file. A thread waits for the disk, if it is to have the file: the flight goes on meanwhile.
    fn end(&mut self, file: McapFile) -> Result<(), LogError> {
        if self.forcing.is_none() {
            self.ended = sum(self.ended, file.finish()?);
            return Ok(());
        }
        let thread = thread::Builder::new().name("log_part".to_owned());
        let begun = thread.spawn(|| file.finish());
        let ending = begun.map_err(|source| LogError::Create {
            path: part_path(&self.first, self.part.number),
            source,
        })?;
        self.ending = Some(ending);
        Ok(())
    }

    /// Waits for the file before, if it is not complete yet.
    fn collect(&mut self) -> Result<(), LogError> {
        if let Some(ending) = self.ending.take() {
            self.ended = sum(self.ended, ending.join().expect("it does not panic")?);
        }
        Ok(())
    }

    /// Returns what is in all files, of which the last one is complete.
    pub(super) fn finish(mut self, last: Written) -> Result<Written, LogError> {
        self.collect()?;
        Ok(sum(self.ended, last))
    }
}

/// Returns the number of whole ticks that are at least so many.
#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "a cast of a float saturates, and the time is positive"
)]
fn whole_ticks(ticks: f64) -> u64 {
    ticks.ceil() as u64
}

fn sum(before: Written, last: Written) -> Written {
    Written {
        messages: before.messages + last.messages,
        bytes: before.bytes + last.bytes,
    }
}

#[cfg(test)]
mod tests;
