//! Writes `run.mcap`: the log of the experiment, a function of scenario and seed alone.

use std::fs::File;
use std::path::Path;
use std::time::Duration;

use scenario::Recorded;
use shared_types::Topic;
use shared_types::service::header_of;

use super::framing::{Compression, LogError, McapFile, Written};
use super::manifest::Manifest;
use super::parts::Part;
use super::splitter::{Making, Splitter};
use super::topic_channels::declare_topics;

/// Simulated time that a chunk spans, s: what a crash of the recorder may cost.
const CHUNK_SECONDS: f64 = 0.25;

/// The same in real time, s. There samples wait before they are written until those of their tick have settled, and a crash costs
/// both: together less than [`CHUNK_SECONDS`].
const REAL_TIME_CHUNK_SECONDS: f64 = 0.125;

/// Ticks that a chunk spans at most, whatever the tick: a reader holds a whole chunk in memory.
const CHUNK_TICKS_MAX: f64 = 1000.0;

/// Writes a flight's samples to `run.mcap`.
///
/// Two logs of equal scenario, seed and compression are equal in every byte: order and chunk boundaries are a
/// function of the ticks, and nothing of the machine is in the file. Where the scenario says so (`[record]`) the log goes on in
/// further files, always between two ticks.
pub struct RunLogWriter {
    file: McapFile,
    channels: [u16; Topic::ALL.len()],
    recorded: [Recorded; Topic::ALL.len()],
    chunk_ticks: u64,
    /// Tick at which the next chunk begins, whether there are samples just before it or not.
    next_chunk: u64,
    /// The tick that has ended last.
    last_tick: u64,
    /// How the log is split, if it is.
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

    /// Creates a log that is whole or not there, for a flight that can be flown or written again: what has its name is
    /// replaced in the end.
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

    /// Ends chunks as often as a flight in real time needs it.
    #[must_use]
    pub fn in_real_time(mut self, manifest: &Manifest) -> Self {
        self.chunk_ticks = chunk_ticks(manifest.scenario.schedule.tick, REAL_TIME_CHUNK_SECONDS);
        self.next_chunk = self.chunk_ticks;
        self
    }

    /// Forces what is recorded to the disk in every `period`, if there is one: a power failure costs that and a chunk.
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

    /// Writes a sample of a topic, if the scenario does not leave it out (`[record]`). The caller keeps the order (tick, topic).
    ///
    /// The message's sequence number is the header's `seq` modulo 2³²: MCAP has no room for more. The sample
    /// itself keeps all of it.
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

    /// Says that all samples of a tick are written, which ends a chunk now and then.
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

    /// Ends the chunk before a tick, so that none spans a time of which nothing was recorded.
    #[cold]
    fn end_chunk_before(&mut self, tick: u64) -> Result<(), LogError> {
        // A sample states its tick, and may be damaged.
        let chunk = (tick / self.chunk_ticks).saturating_add(1);
        self.next_chunk = chunk.saturating_mul(self.chunk_ticks);
        self.file.flush()?;
        if let Some(splitter) = &mut self.splitter {
            splitter.end_chunk_before(tick, self.file.bytes());
        }
        Ok(())
    }

    /// Completes the log and gives it its name. To be called at the end of a whole tick.
    ///
    /// Without it, the log keeps the name `<path>.partial` and the chunks that were written.
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

/// Returns the number of ticks of `tick` seconds that a chunk of so many seconds spans.
#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "clamped to 1..=CHUNK_TICKS_MAX"
)]
fn chunk_ticks(tick: f64, seconds: f64) -> u64 {
    (seconds / tick).round().clamp(1.0, CHUNK_TICKS_MAX) as u64
}

#[cfg(test)]
#[expect(clippy::disallowed_methods, reason = "tests make their own files")]
mod tests {
    use std::fs;
    use std::os::unix::fs::symlink;

    use super::*;
    use crate::partial_path;
    use crate::schema::definition;
    use crate::test_flight::{record, sample, samples, scenario};
    use shared_types::Header;

    const COMPRESSIONS: [Compression; 3] = [Compression::None, Compression::Lz4, Compression::Zstd];

    #[test]
    fn no_chunk_spans_a_time_of_which_nothing_was_recorded() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("run.mcap");
        let scenario = scenario(0.01, 10.0);
        let manifest = Manifest::new(&scenario);
        let mut log = RunLogWriter::create(&path, &manifest, Compression::None)
            .unwrap()
            .in_real_time(&manifest);
        // Chunks of 13 ticks, and nobody recorded from tick 6 to 99.
        for tick in (0..=5).chain(100..=120) {
            let header = Header {
                tick,
                stamp_ns: tick * 10_000_000,
                seq: tick,
            };
            log.write(Topic::VehicleState, &sample(Topic::VehicleState, header))
                .unwrap();
            log.end_tick(tick).unwrap();
        }
        log.finish().unwrap();
        let file = fs::read(&path).unwrap();
        let summary = mcap::Summary::read(&file).unwrap().unwrap();
        let chunks = summary.chunk_indexes.iter();
        let ticks = |ns: u64| ns / 10_000_000;
        let spans: Vec<_> = chunks
            .map(|chunk| (ticks(chunk.message_start_time), ticks(chunk.message_end_time)))
            .collect();
        assert_eq!(spans, [(0, 5), (100, 103), (104, 116), (117, 120)]);
    }

    #[test]
    fn two_logs_of_the_same_flight_are_equal_in_every_byte() {
        let folder = tempfile::tempdir().unwrap();
        for compression in COMPRESSIONS {
            let [first, second] = ["a", "b"].map(|name| folder.path().join(name));
            for path in [&first, &second] {
                record(path, &scenario(0.01, 1.0), compression);
            }
            assert!(
                fs::read(first).unwrap() == fs::read(second).unwrap(),
                "{compression:?}"
            );
        }
    }

    #[test]
    fn an_independent_reader_finds_every_sample_in_its_order() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("run.mcap");
        let scenario = scenario(0.01, 1.0);
        for compression in COMPRESSIONS {
            let written = record(&path, &scenario, compression);
            let file = fs::read(&path).unwrap();
            assert_eq!(written.bytes, file.len() as u64);
            let mut messages = mcap::MessageStream::new(&file).unwrap();
            let mut count = 0;
            for (topic, sample) in samples(&scenario.schedule().unwrap()) {
                let message = messages.next().unwrap().unwrap();
                let header = header_of(&sample);
                let schema = message.channel.schema.as_ref().unwrap();
                assert_eq!(message.channel.topic, topic.name());
                assert_eq!(message.channel.message_encoding, "cdr");
                assert_eq!(message.channel.metadata["layout"], topic.layout_hash());
                assert_eq!((&*schema.name, &*schema.encoding), (topic.msg_name(), "ros2msg"));
                assert_eq!(schema.data, definition(topic, &scenario).as_bytes());
                assert_eq!(
                    (message.log_time, message.publish_time),
                    (header.stamp_ns, header.stamp_ns)
                );
                assert_eq!(u64::from(message.sequence), header.seq);
                assert_eq!(message.data[..4], [0, 1, 0, 0]);
                assert_eq!(message.data[4..], sample);
                count += 1;
            }
            assert!(messages.next().is_none());
            assert_eq!(written.messages, count);
        }
    }

    #[test]
    fn chunks_span_a_quarter_of_a_simulated_second_each() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("run.mcap");
        record(&path, &scenario(0.01, 1.1), Compression::None);
        let summary = mcap::Summary::read(&fs::read(&path).unwrap()).unwrap().unwrap();
        let spans: Vec<_> = summary
            .chunk_indexes
            .iter()
            .map(|chunk| {
                (
                    chunk.message_start_time / 10_000_000,
                    chunk.message_end_time / 10_000_000,
                )
            })
            .collect();
        assert_eq!(spans, [(0, 24), (25, 49), (50, 74), (75, 99), (100, 110)]);
    }

    #[test]
    fn a_chunk_has_a_bounded_number_of_ticks_at_any_tick() {
        let spans = [1e-6, 1e-4, 0.001, 0.003, 0.25, 1.0].map(|tick| chunk_ticks(tick, CHUNK_SECONDS));
        assert_eq!(spans, [1000, 1000, 250, 83, 1, 1]);
    }

    #[test]
    fn a_flight_cut_short_is_the_beginning_of_the_whole_flight() {
        let folder = tempfile::tempdir().unwrap();
        let scenario = scenario(0.01, 1.0);
        let [whole, cut] = ["whole", "cut"].map(|name| folder.path().join(name));
        record(&whole, &scenario, Compression::None);
        let mut writer = RunLogWriter::create(&cut, &Manifest::new(&scenario), Compression::None).unwrap();
        for (topic, bytes) in samples(&scenario.schedule().unwrap()).take(70 * Topic::ALL.len()) {
            writer.write(topic, &bytes).unwrap();
            if topic.index() + 1 == Topic::ALL.len() {
                writer.end_tick(header_of(&bytes).tick).unwrap();
            }
        }
        drop(writer);
        assert!(!cut.exists(), "a log that was not finished never has its name");
        let whole = fs::read(whole).unwrap();
        let partial = fs::read(partial_path(&cut)).unwrap();
        assert!(whole.starts_with(&partial));
        let messages = mcap::io::MessageReader::new(partial.as_slice()).flatten().count();
        assert_eq!(messages, 50 * Topic::ALL.len(), "two whole chunks");
    }

    #[test]
    fn a_sequence_number_beyond_32_bits_wraps_in_the_message_and_not_in_the_sample() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("run.mcap");
        let manifest = Manifest::new(&scenario(0.01, 1.0));
        let mut writer = RunLogWriter::create(&path, &manifest, Compression::None).unwrap();
        let header = Header {
            tick: 5,
            stamp_ns: 50,
            seq: (1 << 32) + 3,
        };
        writer
            .write(Topic::RcFrame, &sample(Topic::RcFrame, header))
            .unwrap();
        writer.finish().unwrap();
        let file = fs::read(&path).unwrap();
        let message = mcap::MessageStream::new(&file).unwrap().next().unwrap().unwrap();
        assert_eq!(message.sequence, 3);
        assert_eq!(header_of(&message.data[4..]), header);
    }

    /// A log on a device, which has the name of the incomplete log.
    fn on_device(device: &str, path: &Path, manifest: &Manifest) -> RunLogWriter {
        let _earlier = fs::remove_file(partial_path(path));
        symlink(device, partial_path(path)).unwrap();
        let file = File::options().write(true).open(device).unwrap();
        RunLogWriter::over(file, path, manifest, Compression::None).unwrap()
    }

    #[test]
    fn a_link_in_the_place_of_the_log_is_not_followed() {
        let folder = tempfile::tempdir().unwrap();
        let [path, precious] = ["run.mcap", "precious"].map(|name| folder.path().join(name));
        fs::write(&precious, "content").unwrap();
        symlink(&precious, partial_path(&path)).unwrap();
        let manifest = Manifest::new(&scenario(0.01, 1.0));
        let writer = RunLogWriter::create(&path, &manifest, Compression::None).unwrap();
        writer.finish().unwrap();
        assert_eq!(fs::read_to_string(precious).unwrap(), "content");
        assert!(path.symlink_metadata().unwrap().is_file());
    }

    #[test]
    fn a_file_with_the_name_of_the_incomplete_log_is_not_removed() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("run.mcap");
        fs::write(partial_path(&path), "the only copy").unwrap();
        let manifest = Manifest::new(&scenario(0.01, 1.0));
        let refused = RunLogWriter::create(&path, &manifest, Compression::None)
            .err()
            .unwrap();
        assert!(matches!(refused, LogError::Exists { .. }), "{refused}");
        RunLogWriter::create_result(&path, &manifest, Compression::None)
            .unwrap()
            .finish()
            .unwrap();
        assert!(path.exists());
        assert_eq!(fs::read_to_string(partial_path(&path)).unwrap(), "the only copy");
    }

    #[test]
    fn a_log_that_can_be_made_again_is_whole_or_leaves_what_was_there() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("run.mcap");
        let split = "split = { after_seconds = 1.0 }";
        let mut scenario = scenario(0.01, 3.0);
        scenario.record = Some(toml::from_str(split).unwrap());
        fs::write(&path, "before").unwrap();
        let begun = RunLogWriter::create_result(&path, &Manifest::new(&scenario), Compression::None);
        drop(begun.unwrap());
        assert_eq!(fs::read_to_string(&path).unwrap(), "before");
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);
        record(&path, &scenario, Compression::None);
        let flown = crate::digest(&path).unwrap();
        let mut again =
            RunLogWriter::create_result(&path, &Manifest::new(&scenario), Compression::None).unwrap();
        for (topic, bytes) in samples(&scenario.schedule().unwrap()) {
            again.write(topic, &bytes).unwrap();
            if topic.index() + 1 == Topic::ALL.len() {
                again.end_tick(header_of(&bytes).tick).unwrap();
            }
        }
        again.finish().unwrap();
        assert_eq!(crate::digest(&path).unwrap(), flown);
        assert!(!partial_path(&path).exists());
    }

    #[test]
    fn a_full_disk_is_reported_once_and_keeps_the_incomplete_name() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("run.mcap");
        let scenario = scenario(0.01, 1.0);
        let mut writer = on_device("/dev/full", &path, &Manifest::new(&scenario));
        let mut failures = Vec::new();
        for (topic, bytes) in samples(&scenario.schedule().unwrap()) {
            failures.extend(writer.write(topic, &bytes).err());
            failures.extend(writer.end_tick(header_of(&bytes).tick).err());
        }
        let reported = failures.remove(0).to_string();
        assert!(
            reported.contains("run.mcap.partial") && reported.contains("make room"),
            "{reported}"
        );
        assert!(!failures.is_empty());
        assert!(
            failures
                .iter()
                .all(|failure| matches!(failure, LogError::Closed { .. }))
        );
        assert!(matches!(writer.finish(), Err(LogError::Closed { .. })));
        assert!(!path.exists());
    }

    #[test]
    fn what_cannot_be_forced_to_the_disk_is_reported_and_is_not_called_complete() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("run.mcap");
        let manifest = Manifest::new(&scenario(0.01, 1.0));
        for period in [Duration::from_millis(1), Duration::from_secs(3600)] {
            // It takes everything, but there is no disk behind it.
            let writer = on_device("/dev/null", &path, &manifest);
            let finished = writer.durable(Some(period)).unwrap().finish();
            assert!(matches!(finished, Err(LogError::Write { .. })), "{finished:?}");
            assert!(!path.exists());
        }
    }

    #[test]
    fn a_disk_that_fails_in_flight_is_reported_with_the_next_chunk() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("run.mcap");
        let manifest = Manifest::new(&scenario(0.01, 1.0));
        let writer = on_device("/dev/null", &path, &manifest);
        let mut writer = writer.durable(Some(Duration::from_millis(1))).unwrap();
        let deadline = std::time::Instant::now() + Duration::from_secs(60);
        let failure = (0..).find_map(|tick| {
            assert!(std::time::Instant::now() < deadline, "it was never reported");
            writer.end_tick(tick).err()
        });
        assert!(matches!(failure, Some(LogError::Write { .. })), "{failure:?}");
        assert!(matches!(writer.finish(), Err(LogError::Closed { .. })));
    }

    #[test]
    fn a_disk_that_is_full_at_the_end_leaves_no_complete_log() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("run.mcap");
        let manifest = Manifest::new(&scenario(0.01, 1.0));
        let writer = on_device("/dev/full", &path, &manifest);
        assert!(matches!(writer.finish(), Err(LogError::Write { .. })));
        assert!(!path.exists());
    }

    #[test]
    fn a_place_that_cannot_be_written_is_named() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("no/such/folder/run.mcap");
        let manifest = Manifest::new(&scenario(0.01, 1.0));
        let Err(error) = RunLogWriter::create(&path, &manifest, Compression::None) else {
            panic!("created a log in a folder that does not exist")
        };
        assert!(error.to_string().contains("no/such/folder/run.mcap"), "{error}");
    }
}
