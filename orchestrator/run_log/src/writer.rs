//! Writer of `run.mcap`, the log of the experiment: a function of scenario and seed alone.

use std::fs::File;
use std::path::Path;
use std::time::Duration;

use scenario::Recorded;
use shared_types::Topic;
use shared_types::service::header_of;

use super::compression::Compression;
use super::framing::{LogError, McapFile, Written};
use super::manifest::Manifest;
use super::parts::Part;
use super::splitter::{Making, Splitter};
use super::topic_channels::declare_topics;

/// Simulated time of a chunk, s: the loss by a crash of the recorder.
const CHUNK_SECONDS: f64 = 0.25;

/// Time of a chunk in real time, s. There a crash also loses the samples that wait for late ones of their tick; together less
/// than [`CHUNK_SECONDS`].
const REAL_TIME_CHUNK_SECONDS: f64 = 0.125;

/// Maximum number of ticks in a chunk, for any tick: a reader holds a whole chunk in memory.
const CHUNK_TICKS_MAX: f64 = 1000.0;

/// Writer of a flight's samples to `run.mcap`.
///
/// Two logs of equal scenario, seed and compression are equal in every byte: order and chunk boundaries are a function of
/// the ticks, and nothing of the machine is in the file. If the scenario states it (`[record]`), the log continues in
/// further files, split between two ticks.
pub struct RunLogWriter {
    file: McapFile,
    channels: [u16; Topic::ALL.len()],
    recorded: [Recorded; Topic::ALL.len()],
    chunk_ticks: u64,
    /// Tick at which the next chunk begins, with or without samples just before it.
    next_chunk: u64,
    /// The last completed tick.
    last_tick: u64,
    /// Splitter, if the log is split.
    splitter: Option<Splitter>,
}

impl RunLogWriter {
    /// Creates the log under the name `<path>.partial`, with its manifest and a channel for every topic.
    ///
    /// # Errors
    /// [`LogError::Create`], [`LogError::Exists`] or [`LogError::Write`].
    pub fn create(path: &Path, manifest: &Manifest, compression: Compression) -> Result<Self, LogError> {
        Self::begin_as(Making::Flight, path, manifest, compression)
    }

    /// Creates a log that is complete or absent, for a flight that can be repeated: replaces an existing file at the end.
    ///
    /// # Errors
    /// [`LogError::NotMade`].
    pub fn create_result(
        path: &Path,
        manifest: &Manifest,
        compression: Compression,
    ) -> Result<Self, LogError> {
        Self::begin_as(Making::Result, path, manifest, compression)
    }

    fn begin_as(
        making: Making,
        path: &Path,
        manifest: &Manifest,
        compression: Compression,
    ) -> Result<Self, LogError> {
        let file = making.file(path, compression)?;
        Self::begin(file, making, path, manifest, compression)
    }

    /// As [`Self::create`], over a file that is open: a device in place of a disk.
    ///
    /// # Errors
    /// [`LogError::Create`] or [`LogError::Write`].
    pub fn over(
        file: File,
        path: &Path,
        manifest: &Manifest,
        compression: Compression,
    ) -> Result<Self, LogError> {
        Self::begin(
            McapFile::over(file, path, compression, None)?,
            Making::Flight,
            path,
            manifest,
            compression,
        )
    }

    fn begin(
        mut file: McapFile,
        making: Making,
        path: &Path,
        manifest: &Manifest,
        compression: Compression,
    ) -> Result<Self, LogError> {
        let splitter = Splitter::new(path, manifest, compression, making);
        if let Some(splitter) = &splitter {
            file.write_metadata(Part::RECORD_NAME, splitter.part.to_metadata())?;
        }
        file.write_metadata(Manifest::RECORD_NAME, manifest.to_metadata())?;
        let chunk_ticks = chunk_ticks(manifest.scenario.schedule.tick, CHUNK_SECONDS);
        Ok(Self {
            channels: declare_topics(&mut file, &manifest.scenario)?,
            recorded: Recorded::of_topics(&manifest.scenario),
            file,
            chunk_ticks,
            next_chunk: chunk_ticks,
            last_tick: 0,
            splitter,
        })
    }

    /// Sets the length of chunks for a flight in real time.
    #[must_use]
    pub fn in_real_time(mut self, manifest: &Manifest) -> Self {
        self.chunk_ticks = chunk_ticks(manifest.scenario.schedule.tick, REAL_TIME_CHUNK_SECONDS);
        self.next_chunk = self.chunk_ticks;
        self
    }

    /// Synchronises to the disk in every `period`, if stated: a power failure loses at most that and a chunk.
    ///
    /// # Errors
    /// [`LogError::Create`].
    pub fn durable(mut self, period: Option<Duration>) -> Result<Self, LogError> {
        if let Some(period) = period {
            self.file.force_every(period)?;
            if let Some(splitter) = &mut self.splitter {
                splitter.force_every(period);
            }
        }
        Ok(self)
    }

    /// Writes a sample of a topic, unless the scenario omits the topic (`[record]`). Call in the order (tick, topic).
    ///
    /// The message's sequence number is the header's `seq` modulo 2³², the limit of MCAP; the sample has the full number.
    ///
    /// # Errors
    /// [`LogError::Write`] once, [`LogError::Closed`] from then on.
    #[inline]
    pub fn write(&mut self, topic: Topic, bytes: &[u8]) -> Result<(), LogError> {
        let header = header_of(bytes);
        if !self.recorded[topic.index()].has(header.seq) {
            return Ok(());
        }
        if header.tick >= self.next_chunk {
            self.end_chunk_before(header.tick)?;
        }
        if let Some(splitter) = &mut self.splitter
            && splitter.is_due(header.tick)
        {
            self.channels = splitter.split(&mut self.file)?;
        }
        let sequence = header.seq as u32;
        self.file
            .write(self.channels[topic.index()], sequence, header.stamp_ns, bytes)
    }

    /// Completes a tick, and the chunk if it ends there.
    ///
    /// # Errors
    /// [`LogError::Write`] once, [`LogError::Closed`] from then on.
    ///
    /// # Panics
    /// If a later tick has ended before.
    #[inline]
    pub fn end_tick(&mut self, tick: u64) -> Result<(), LogError> {
        assert!(tick >= self.last_tick, "a log does not go back in time");
        self.last_tick = tick;
        if (tick + 1).is_multiple_of(self.chunk_ticks) {
            self.end_chunk_before(tick + 1)?;
        }
        Ok(())
    }

    /// Ends the chunk before a tick, so that no chunk spans a time without recorded samples.
    #[cold]
    fn end_chunk_before(&mut self, tick: u64) -> Result<(), LogError> {
        // Saturating: the tick of a damaged sample can have any value.
        let chunk = (tick / self.chunk_ticks).saturating_add(1);
        self.next_chunk = chunk.saturating_mul(self.chunk_ticks);
        self.file.flush()?;
        if let Some(splitter) = &mut self.splitter {
            splitter.end_chunk_before(tick, self.file.bytes());
        }
        Ok(())
    }

    /// Completes the log and renames it. Call it after a complete tick.
    ///
    /// Without this call the log keeps the name `<path>.partial` and the written chunks.
    ///
    /// # Errors
    /// [`LogError`].
    pub fn finish(self) -> Result<Written, LogError> {
        let last = self.file.finish()?;
        match self.splitter {
            Some(splitter) => splitter.finish(last),
            None => Ok(last),
        }
    }
}

/// Returns the number of ticks of `tick` seconds in a chunk of `seconds`.
#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "clamped to 1..=CHUNK_TICKS_MAX"
)]
fn chunk_ticks(tick: f64, seconds: f64) -> u64 {
    (seconds / tick).round().clamp(1.0, CHUNK_TICKS_MAX) as u64
}

#[cfg(test)]
mod tests;
