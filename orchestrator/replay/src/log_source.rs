//! The recorded samples of the flight that is replayed, read as far as they are needed.
//!
//! In real time a service that steps late publishes late, and its samples stand in the log after younger ones of other
//! services. A step must find whatever was recorded of its tick, however late: what it finds must not depend on how far the
//! replay happens to have read. So the largest lateness is found first, and read ahead.

use std::path::Path;

use run_log::LogReader;
use shared_types::Topic;

use super::ReplayError;
use super::history::History;
use super::tuning::RecordedTuning;

/// Returns the most ticks by which a sample of a log is older than one before it.
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

/// The recorded samples, read as far as they are needed.
pub(super) struct LogSource {
    pub(super) reader: LogReader,
    pub(super) history: History,
    pub(super) tuning: RecordedTuning,
    /// Ticks beyond a tick that are read before it is replayed.
    read_ahead: u64,
    /// The newest tick that has been read; `u64::MAX` at the end.
    read_until: u64,
    /// Reason why the log ends early.
    pub(super) ends: Option<String>,
    /// `true` if it ends anywhere, and not with a whole tick.
    breaks_off: bool,
}

impl LogSource {
    /// A log of which nothing has been read, and in which samples stand at most `lateness` ticks behind younger ones.
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

    /// Reads until every sample of a tick, and of those before it, has been read.
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
                // What was read before it is whole.
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

    /// Returns whether the log ends before a tick is whole. Of one that breaks off, the last tick may be broken, too.
    pub(super) fn is_exhausted_before(&self, tick: u64) -> bool {
        let whole_until = self
            .history
            .last_tick()
            .map(|last| last + u64::from(!self.breaks_off));
        self.read_until == u64::MAX && whole_until <= Some(tick)
    }
}
