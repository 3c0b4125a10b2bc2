//! Reader of the recorded samples, as far as the replay needs them.
//!
//! In real time a late step publishes late, so its samples follow newer ones of other services in the log. A step must
//! find all recorded samples of its tick, however late: its inputs must not depend on how far the log happens to have
//! been read. So the largest lateness is determined first, and the log is read ahead by it.

use std::path::Path;

use run_log::LogReader;
use shared_types::Topic;

use super::ReplayError;
use super::history::History;
use super::tuning::RecordedTuning;

/// Returns the maximum number of ticks by which a sample of the log is older than one before it.
pub(super) fn largest_lateness(log: &Path) -> Result<u64, ReplayError> {
    let mut reader = LogReader::open(log)?;
    let (mut newest, mut largest) = (0_u64, 0);
    loop {
        match reader.next_sample() {
            Ok(Some(sample)) => {
                newest = newest.max(sample.header.tick);
                largest = largest.max(newest - sample.header.tick);
            }
            Ok(None) => return Ok(largest),
            Err(error) if error.is_incomplete() => return Ok(largest),
            Err(error) => return Err(error.into()),
        }
    }
}

/// Recorded samples, read on demand.
pub(super) struct LogSource {
    pub(super) reader: LogReader,
    pub(super) history: History,
    pub(super) tuning: RecordedTuning,
    /// Number of ticks that are read ahead of the replayed one.
    read_ahead: u64,
    /// Newest tick that has been read; `u64::MAX` at the end of the log.
    read_until: u64,
    /// Reason why the log ends early.
    pub(super) ends: Option<String>,
    /// `true` if the log may end within a tick.
    breaks_off: bool,
}

impl LogSource {
    /// Creates the source of an unread log whose samples are at most `lateness` ticks behind newer ones.
    pub(super) fn new(reader: LogReader, lateness: u64, history: History, tuning: RecordedTuning) -> Self {
        Self {
            reader,
            history: history.behind_by(lateness),
            tuning,
            read_ahead: lateness,
            read_until: 0,
            ends: None,
            breaks_off: false,
        }
    }

    /// Reads until all samples up to a tick have been read.
    pub(super) fn read_to(&mut self, tick: u64) -> Result<(), ReplayError> {
        let tick = tick.saturating_add(self.read_ahead);
        while self.read_until <= tick {
            match self.reader.next_sample() {
                Ok(Some(sample)) => {
                    self.read_until = self.read_until.max(sample.header.tick);
                    self.history.keep(sample.topic, sample.bytes);
                    if sample.topic == Topic::RunEvent {
                        self.tuning.take(sample.bytes)?;
                    }
                }
                Ok(None) => {
                    self.breaks_off |= self.reader.recovery().is_some();
                    self.read_until = u64::MAX;
                }
                // Everything before the incomplete record is valid.
                Err(error) if error.is_incomplete() => {
                    self.ends = Some(error.to_string());
                    self.breaks_off = true;
                    self.read_until = u64::MAX;
                }
                Err(error) => return Err(error.into()),
            }
        }
        Ok(())
    }

    /// Returns whether the log ends before a tick is complete. If the log is cut off, so may be its last tick.
    pub(super) fn is_exhausted_before(&self, tick: u64) -> bool {
        let whole_until = self
            .history
            .last_tick()
            .map(|last| last + u64::from(!self.breaks_off));
        self.read_until == u64::MAX && whole_until <= Some(tick)
    }
}
