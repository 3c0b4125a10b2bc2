//! Splitting of a log into files.
//!
//! A file ends with a chunk, so that the samples of a tick are in one file and the chunks equal those of an unsplit log. The
//! next file begins with its first sample, so that none is empty.

use std::path::{Path, PathBuf};
use std::thread::{self, JoinHandle};
use std::time::Duration;

use result_file::ResultFile;
use shared_types::Topic;

use super::compression::Compression;
use super::framing::{Content, LogError, McapFile, Written};
use super::manifest::Manifest;
use super::parts::{CONTINUES, Part, goes_on_in, part_path};
use super::topic_channels::declare_topics;

/// Creation of the files of a log.
#[derive(Clone, Copy)]
pub(super) enum Making {
    /// With the name of an incomplete log, which keeps every chunk of a flight that cannot be repeated.
    Flight,
    /// As a result: complete or absent.
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

/// Files of a log up to the current one.
pub(super) struct Splitter {
    first: PathBuf,
    manifest: Manifest,
    compression: Compression,
    making: Making,
    bytes: u64,
    ticks: u64,
    /// Period of the synchronisation to the disk, if any.
    forcing: Option<Duration>,
    /// The current file.
    pub(super) part: Part,
    /// First tick of the file; `None` before its first sample.
    begins_at: Option<u64>,
    is_full: bool,
    /// Contents of the complete files.
    ended: Written,
    /// Thread that completes the previous file.
    ending: Option<JoinHandle<Result<Written, LogError>>>,
}

impl Splitter {
    /// Makes the splitter of a log with this manifest; `None` if the scenario does not split it.
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

    /// Records that the file has `bytes` and all samples before a tick.
    pub(super) fn end_chunk_before(&mut self, tick: u64, bytes: u64) {
        let ticks = self.begins_at.map_or(0, |first| tick.saturating_sub(first));
        self.is_full = self.begins_at.is_some() && (bytes >= self.bytes || ticks >= self.ticks);
    }

    /// Returns whether a sample of this tick belongs to the next file.
    #[inline]
    pub(super) fn is_due(&mut self, tick: u64) -> bool {
        self.begins_at.get_or_insert(tick);
        self.is_full
    }

    /// Begins the next file. Returns the numbers of its channels.
    ///
    /// The previous file is renamed after the creation of the next one: after a crash at any point, no complete file names a
    /// successor that was never created.
    #[cold]
    pub(super) fn split(&mut self, file: &mut McapFile) -> Result<[u16; Topic::ALL.len()], LogError> {
        self.collect()?;
        let next = Part {
            number: self.part.number + 1,
            samples_before: self.part.samples_before + file.messages(),
        };
        file.write_metadata(CONTINUES, goes_on_in(next.number))?;
        let (begun, channels) = self.begin(next)?;
        self.end(std::mem::replace(file, begun))?;
        self.part = next;
        self.begins_at = None;
        self.is_full = false;
        Ok(channels)
    }

    /// Begins the file of a part, and writes its manifest at once.
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

    /// Completes a file. A thread waits for the disk, if requested, so that the flight continues.
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

    /// Waits for the completion of the previous file.
    fn collect(&mut self) -> Result<(), LogError> {
        if let Some(ending) = self.ending.take() {
            self.ended = sum(self.ended, ending.join().expect("it does not panic")?);
        }
        Ok(())
    }

    /// Returns the content of all files; `last` is that of the last one.
    pub(super) fn finish(mut self, last: Written) -> Result<Written, LogError> {
        self.collect()?;
        Ok(sum(self.ended, last))
    }
}

/// Returns the number of ticks, rounded up.
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
