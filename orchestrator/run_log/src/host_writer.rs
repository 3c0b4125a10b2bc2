//! Writer of `host.mcap`, the record of the machine.

use std::collections::BTreeMap;
use std::path::Path;
use std::time::Duration;

use super::compression::Compression;
use super::framing::{LogError, McapFile, Written};
use super::host_samples::HostSample;

/// Size at which a chunk is closed, bytes.
const CHUNK_BYTES: u64 = 64 * 1024;

/// Maximum wall time that a crash of the orchestrator may lose, ns. In real time a replay needs the steps of all samples in
/// `run.mcap`.
const FLUSH_PERIOD_NS: u64 = 125_000_000;

/// A channel and the number of its next message.
struct Channel {
    id: u16,
    next_sequence: u32,
}

/// Writer of samples of any [`HostSample`] type; a type's channel is declared with its first sample.
pub struct HostLogWriter {
    file: McapFile,
    channels: BTreeMap<&'static str, Channel>,
    flushed_ns: u64,
}

impl HostLogWriter {
    /// Creates the log under the name `<path>.partial`.
    ///
    /// # Errors
    /// [`LogError::Create`].
    pub fn create(path: &Path, compression: Compression) -> Result<Self, LogError> {
        Ok(Self {
            file: McapFile::create(path, compression, Some(CHUNK_BYTES))?,
            channels: BTreeMap::new(),
            flushed_ns: 0,
        })
    }

    /// Synchronises to the disk in every `period`, if stated: a power failure loses at most that and an eighth of a second.
    ///
    /// # Errors
    /// [`LogError::Create`].
    pub fn durable(mut self, period: Option<Duration>) -> Result<Self, LogError> {
        if let Some(period) = period {
            self.file.force_every(period)?;
        }
        Ok(self)
    }

    /// Writes facts about the whole run, such as the kind of the machine.
    ///
    /// # Errors
    /// [`LogError::Write`] once, [`LogError::Closed`] from then on.
    pub fn write_facts(&mut self, name: &str, facts: BTreeMap<String, String>) -> Result<(), LogError> {
        self.file.write_metadata(name, facts)
    }

    /// Writes a sample. It reaches the file with the first later sample that begins a new period of an eighth of a second.
    ///
    /// # Errors
    /// [`LogError::Write`] once, [`LogError::Closed`] from then on.
    pub fn write<T: HostSample>(&mut self, sample: &T) -> Result<(), LogError> {
        if !self.channels.contains_key(T::CHANNEL) {
            let id = self.file.add_channel::<T>(T::CHANNEL)?;
            let channel = Channel { id, next_sequence: 0 };
            self.channels.insert(T::CHANNEL, channel);
        }
        let channel = self.channels.get_mut(T::CHANNEL).expect("added above");
        let time_ns = sample.time_ns();
        self.file
            .write(channel.id, channel.next_sequence, time_ns, sample.as_bytes())?;
        channel.next_sequence = channel.next_sequence.wrapping_add(1);
        if time_ns.saturating_sub(self.flushed_ns) >= FLUSH_PERIOD_NS {
            self.flushed_ns = time_ns;
            self.file.flush()?;
        }
        Ok(())
    }

    /// Completes the log and renames it.
    ///
    /// # Errors
    /// [`LogError`].
    pub fn finish(self) -> Result<Written, LogError> {
        self.file.finish()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{HostEvent, ServiceHealth, partial_path};
    use shared_types::ServiceId;
    use zerocopy::{FromZeros, IntoBytes};

    #[test]
    fn samples_of_any_type_are_found_on_their_channels() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("host.mcap");
        let mut writer = HostLogWriter::create(&path, Compression::Zstd).unwrap();
        writer
            .write_facts("machine", BTreeMap::from([("cores".to_owned(), "2".to_owned())]))
            .unwrap();
        let event = HostEvent::new(7, Some(ServiceId::Plant), HostEvent::KIND_SPAWNED, 42, "at last");
        let health = ServiceHealth {
            time_ns: 9,
            steps: 3,
            ..ServiceHealth::new_zeroed()
        };
        writer.write(&event).unwrap();
        writer.write(&health).unwrap();
        writer.write(&event).unwrap();
        assert_eq!(writer.finish().unwrap().messages, 3);
        let file = std::fs::read(&path).unwrap();
        let found: Vec<_> = mcap::MessageStream::new(&file)
            .unwrap()
            .map(|message| message.unwrap())
            .map(|message| {
                (
                    message.channel.topic.clone(),
                    message.sequence,
                    message.log_time,
                    message.data[4..].to_vec(),
                )
            })
            .collect();
        let expected = [
            ("host/events".to_owned(), 0, 7, event.as_bytes().to_vec()),
            ("host/health".to_owned(), 0, 9, health.as_bytes().to_vec()),
            ("host/events".to_owned(), 1, 7, event.as_bytes().to_vec()),
        ];
        assert_eq!(found, expected);
        let summary = mcap::Summary::read(&file).unwrap().unwrap();
        assert_eq!(summary.metadata_indexes[0].name, "machine");
    }

    #[test]
    fn what_is_older_than_an_eighth_of_a_second_survives_a_crash() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("host.mcap");
        let mut writer = HostLogWriter::create(&path, Compression::None).unwrap();
        for hundredths in 0..350 {
            let event = HostEvent::new(hundredths * 10_000_000, None, HostEvent::KIND_NOTE, 0, "");
            writer.write(&event).unwrap();
        }
        let partial = std::fs::read(partial_path(&path)).unwrap();
        let kept = mcap::io::MessageReader::new(partial.as_slice()).flatten().count();
        assert!(kept >= 350 - 13, "only {kept} of 350 reached the file");
    }
}
