#![expect(clippy::disallowed_methods, reason = "tests make their own files")]

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
    // Chunks of 13 ticks, and nothing recorded from tick 6 to 99.
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
    let mut again = RunLogWriter::create_result(&path, &Manifest::new(&scenario), Compression::None).unwrap();
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

/// What cuts the file in flight leaves zeros behind the next chunk, and the right length.
#[test]
fn a_log_that_something_else_cuts_or_lengthens_is_not_called_complete() {
    let scenario = scenario(0.01, 1.0);
    for (length, at_the_end) in [(0, false), (0, true), (1 << 20, true)] {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("run.mcap");
        let mut writer = RunLogWriter::create(&path, &Manifest::new(&scenario), Compression::None).unwrap();
        let mut failures = Vec::new();
        for (topic, bytes) in samples(&scenario.schedule().unwrap()) {
            let tick = header_of(&bytes).tick;
            failures.extend(writer.write(topic, &bytes).err());
            failures.extend(writer.end_tick(tick).err());
            if tick == 60 && !at_the_end {
                cut(&partial_path(&path), length);
            }
        }
        cut(&partial_path(&path), length);
        let finished = writer.finish().err();
        let first = failures.into_iter().chain(finished).next().unwrap();
        assert!(matches!(first, LogError::Altered { .. }), "{first}");
        assert!(first.to_string().contains("gerono recover"), "{first}");
        assert!(!path.exists());
    }
}

fn cut(path: &Path, length: u64) {
    let file = std::fs::OpenOptions::new().write(true).open(path).unwrap();
    file.set_len(length).unwrap();
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
