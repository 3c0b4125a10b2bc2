//! Recovery of made-up flights, byte by byte and chunk by chunk.

#![expect(clippy::disallowed_methods, reason = "tests make their own files")]

use std::fs;

use shared_types::service::header_of;
use tempfile::TempDir;

use super::*;
use crate::test_flight::{bomb, record, record_samples, samples, scenario};
use crate::{HostEvent, HostLogWriter, LogReader, RunLogWriter, ServiceHealth, digest, partial_path};
use zerocopy::FromZeros;

const TOPICS: u64 = Topic::ALL.len() as u64;
const COMPRESSIONS: [Compression; 3] = [Compression::None, Compression::Lz4, Compression::Zstd];

/// A log of chunks of five ticks.
struct Log {
    folder: TempDir,
    scenario: Scenario,
    bytes: Vec<u8>,
    /// Place where its chunks are.
    chunks: Vec<std::ops::Range<usize>>,
}

impl Log {
    fn new(compression: Compression) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("run.mcap");
        let scenario = scenario(0.05, 1.0);
        record(&path, &scenario, compression);
        let bytes = fs::read(&path).unwrap();
        let summary = mcap::Summary::read(&bytes).unwrap().unwrap();
        let chunks = summary.chunk_indexes.iter().map(|chunk| {
            let begin = usize::try_from(chunk.chunk_start_offset).unwrap();
            begin..begin + usize::try_from(chunk.chunk_length).unwrap()
        });
        Self {
            chunks: chunks.collect(),
            folder,
            scenario,
            bytes,
        }
    }

    /// Ticks of the samples that are recovered, and what is said of it.
    fn recover(&self, bytes: &[u8]) -> Result<(Vec<u64>, Recovery), RecoverError> {
        let [source, target] = ["damaged.mcap", "new.mcap"].map(|name| self.folder.path().join(name));
        fs::write(&source, bytes).unwrap();
        let _ = fs::remove_file(&target);
        let recovery = recover(&source, &target, None)?;
        assert!(is_whole(&target).unwrap());
        let mut reader = LogReader::open(&target).unwrap();
        assert_eq!(reader.recovery(), Some(&recovery));
        let mut expected: Vec<_> = samples(&self.scenario.schedule().unwrap()).collect();
        let mut ticks = Vec::new();
        while let Some(logged) = reader.next_sample().unwrap() {
            let place = expected
                .iter()
                .position(|(topic, bytes)| *topic == logged.topic && bytes == logged.bytes);
            expected.drain(..=place.expect("was recorded, and in this order"));
            ticks.push(logged.header.tick);
        }
        assert_eq!(ticks.len() as u64, recovery.kept());
        Ok((ticks, recovery))
    }
}

/// So many samples of each tick.
fn whole_ticks(ticks: impl Iterator<Item = u64>) -> Vec<u64> {
    ticks.flat_map(|tick| vec![tick; Topic::ALL.len()]).collect()
}

#[test]
fn an_unclosed_log_gives_all_that_reached_it() {
    for compression in COMPRESSIONS {
        let log = Log::new(compression);
        let (ticks, recovery) = log.recover(&log.bytes[..log.chunks[3].end]).unwrap();
        assert_eq!(ticks, whole_ticks(0..20));
        assert!(!recovery.was_closed && recovery.lost() == 0 && recovery.unverified == 0);
        assert_eq!(
            (recovery.last_tick(), recovery.planned_last_tick),
            (Some(19), Some(20))
        );
        assert!(!recovery.lacks_nothing());
    }
}

#[test]
fn a_damaged_chunk_costs_itself_and_is_counted_by_topic() {
    for compression in COMPRESSIONS {
        let mut log = Log::new(compression);
        let middle = log.chunks[1].start + log.chunks[1].len() / 2;
        log.bytes[middle] ^= 1;
        let (ticks, recovery) = log.recover(&log.bytes).unwrap();
        assert_eq!(ticks, whole_ticks((0..5).chain(10..21)));
        let [gap] = recovery.gaps.as_slice() else {
            panic!("{recovery}")
        };
        assert_eq!(gap.at, log.chunks[1].start as u64);
        let [after, before] = [gap.after, gap.before].map(|moment| moment.unwrap().tick.unwrap());
        assert_eq!((after, before), (4, 10));
        assert!(gap.lost.len() as u64 == TOPICS && gap.lost.values().all(|&lost| lost == 5));
        assert!(recovery.was_closed && recovery.lost() == 5 * TOPICS);
        let words = recovery.to_string();
        assert!(
            words.contains("between tick 4 (0.200 s) and tick 10") && words.contains("5 of rc/frame"),
            "{words}"
        );
    }
}

/// Zeros behind a byte that is the code of a chunk look like an empty chunk, of a length that reaches over others.
#[test]
fn a_damaged_chunk_that_looks_like_another_one_costs_itself() {
    let log = Log::new(Compression::None);
    let mut bytes = log.bytes.clone();
    let damaged = log.chunks[1].clone();
    let at = damaged.start + 100;
    let length = (log.chunks[3].start - at - 9) as u64;
    bytes[at..at + 200].fill(0);
    bytes[at] = 6;
    bytes[at + 1..at + 9].copy_from_slice(&length.to_le_bytes());
    let (ticks, recovery) = log.recover(&bytes).unwrap();
    assert_eq!(ticks, whole_ticks((0..5).chain(10..21)));
    assert_eq!(recovery.kept(), 16 * TOPICS);
}

/// The declarations of all channels stand in the first chunk.
#[test]
fn without_the_first_chunk_the_others_are_still_understood() {
    let mut log = Log::new(Compression::Zstd);
    let begin = log.chunks[0].start;
    log.bytes[begin] = 0xee;
    let (ticks, recovery) = log.recover(&log.bytes).unwrap();
    assert_eq!(ticks, whole_ticks(5..21));
    assert_eq!((recovery.lost(), recovery.strange), (5 * TOPICS, 0));
}

#[test]
fn of_a_chunk_that_breaks_off_the_whole_messages_are_kept_and_called_unverified() {
    let log = Log::new(Compression::None);
    let cut = log.chunks[2].start + log.chunks[2].len() / 2;
    let (ticks, recovery) = log.recover(&log.bytes[..cut]).unwrap();
    let verified = 10 * Topic::ALL.len();
    assert!(ticks.len() > verified && ticks.len() < verified + 5 * Topic::ALL.len());
    assert_eq!(recovery.unverified, (ticks.len() - verified) as u64);
    assert!(recovery.to_string().contains("no checksum"), "{recovery}");
    let log = Log::new(Compression::Lz4);
    let cut = log.chunks[2].start + log.chunks[2].len() / 2;
    let (ticks, recovery) = log.recover(&log.bytes[..cut]).unwrap();
    assert_eq!((ticks.len(), recovery.unverified), (verified, 0));
}

#[test]
fn damage_where_no_samples_are_loses_none() {
    let log = Log::new(Compression::None);
    let after_a_chunk = log.chunks[2].end + 3;
    let in_the_summary = log.bytes.len() - 60;
    for place in [9, after_a_chunk, in_the_summary, log.bytes.len() - 1] {
        let mut bytes = log.bytes.clone();
        bytes[place] ^= 0x55;
        let (ticks, recovery) = log.recover(&bytes).unwrap();
        assert_eq!(ticks, whole_ticks(0..21), "{place}");
        assert!(recovery.lacks_nothing(), "{place}: {recovery}");
    }
}

#[test]
fn what_is_recovered_of_the_beginning_has_the_digest_of_a_flight_of_that_length() {
    let log = Log::new(Compression::Lz4);
    log.recover(&log.bytes[..log.chunks[4].start]).unwrap();
    let shorter = log.folder.path().join("shorter.mcap");
    let schedule = log.scenario.schedule().unwrap();
    let beginning = samples(&schedule).filter(|(_, bytes)| header_of(bytes).tick < 20);
    record_samples(&shorter, &log.scenario, Compression::None, beginning);
    let recovered = log.folder.path().join("new.mcap");
    assert_eq!(digest(&recovered).unwrap(), digest(&shorter).unwrap());
}

#[test]
fn a_recovered_log_that_is_damaged_again_remembers_both() {
    let mut log = Log::new(Compression::None);
    let middle = log.chunks[3].start + 500;
    log.bytes[middle] ^= 1;
    log.recover(&log.bytes).unwrap();
    let once = log.folder.path().join("new.mcap");
    let mut bytes = fs::read(&once).unwrap();
    let second_chunk = mcap::Summary::read(&bytes).unwrap().unwrap().chunk_indexes[1].chunk_start_offset;
    bytes[usize::try_from(second_chunk).unwrap() + 500] ^= 1;
    let (ticks, recovery) = log.recover(&bytes).unwrap();
    assert_eq!(ticks, whole_ticks((0..5).chain(10..15).chain(20..21)));
    for (ticks, lacks) in [(0..=3, false), (3..=7, true), (11..=13, false), (16..=17, true)] {
        assert_eq!(recovery.lacks_samples_in(&ticks), lacks, "{ticks:?}");
    }
    let earlier = recovery.earlier.unwrap();
    assert!(!earlier.lacks_samples_in(&(3..=7)) && earlier.lacks_samples_in(&(16..=17)));
}

#[test]
fn a_damaged_manifest_asks_for_the_scenario_and_takes_no_other_for_it() {
    let mut log = Log::new(Compression::None);
    let seed = b"\"seed\":1";
    let place = log
        .bytes
        .windows(seed.len())
        .position(|bytes| bytes == seed)
        .unwrap();
    log.bytes[place + seed.len() - 1] = b'2';
    let error = log.recover(&log.bytes).unwrap_err();
    assert!(
        matches!(&error, RecoverError::Manifest { samples: 378, .. }),
        "{error}"
    );
    assert!(error.to_string().contains("--scenario"), "{error}");
    let [source, target] = ["damaged.mcap", "new.mcap"].map(|name| log.folder.path().join(name));
    let recovery = recover(&source, &target, Some(&log.scenario)).unwrap();
    assert!(recovery.is_scenario_restated);
    assert_eq!(
        LogReader::open(&target).unwrap().manifest().scenario,
        log.scenario.experiment()
    );
}

#[test]
fn nothing_is_overwritten_and_nothing_is_made_of_nothing() {
    let log = Log::new(Compression::None);
    let [source, target] = ["damaged.mcap", "there.mcap"].map(|name| log.folder.path().join(name));
    fs::write(&target, "mine").unwrap();
    fs::write(&source, &log.bytes[..log.chunks[0].start]).unwrap();
    assert!(matches!(
        recover(&source, &target, None),
        Err(RecoverError::Exists(_))
    ));
    assert_eq!(fs::read(&target).unwrap(), b"mine");
    let other = log.folder.path().join("other.mcap");
    assert!(matches!(
        recover(&source, &other, None),
        Err(RecoverError::Nothing(_))
    ));
    assert!(!other.exists() && !partial_path(&other).exists());
}

#[test]
fn what_is_empty_or_no_log_is_said_to_be_so() {
    let folder = tempfile::tempdir().unwrap();
    let recover_bytes = |bytes: &[u8]| {
        let source = folder.path().join("run.mcap.partial");
        fs::write(&source, bytes).unwrap();
        recover(&source, &folder.path().join("other.mcap"), None).unwrap_err()
    };
    assert!(matches!(recover_bytes(b""), RecoverError::Empty(_)));
    let text = b"a text, and a long one: longer than the magic of any log".repeat(100);
    assert!(matches!(recover_bytes(&text), RecoverError::NoFlight(_)));
    assert!(matches!(recover_bytes(mcap::MAGIC), RecoverError::Nothing(_)));
}

#[test]
fn a_log_that_is_being_written_is_not_recovered_before_its_writer_is_gone() {
    let folder = tempfile::tempdir().unwrap();
    let [log, target] = ["run.mcap", "new.mcap"].map(|name| folder.path().join(name));
    let scenario = scenario(0.05, 1.0);
    let mut writer = RunLogWriter::create(&log, &Manifest::new(&scenario), Compression::None).unwrap();
    for (topic, bytes) in samples(&scenario.schedule().unwrap()).take(200) {
        writer.write(topic, &bytes).unwrap();
    }
    let log = partial_path(&log);
    let refused = recover(&log, &target, None).unwrap_err();
    assert!(matches!(&refused, RecoverError::UnderWay(path) if *path == log) && !target.exists());
    drop(writer);
    assert!(!matches!(
        recover(&log, &target, None),
        Err(RecoverError::UnderWay(_))
    ));
}

/// The log in the making of `run.mcap` has the name of the source.
#[test]
fn a_log_that_was_never_closed_is_kept_when_it_is_recovered_under_its_final_name() {
    let log = Log::new(Compression::None);
    let folder = tempfile::tempdir().unwrap();
    let [source, target] = ["run.mcap.partial", "run.mcap"].map(|name| folder.path().join(name));
    let bytes = &log.bytes[..log.bytes.len() * 3 / 4];
    fs::write(&source, bytes).unwrap();
    let recovery = recover(&source, &target, None).unwrap();
    assert!(recovery.kept() > 0);
    assert_eq!(fs::read(&source).unwrap(), bytes);
    assert_eq!(LogReader::open(&target).unwrap().recoveries().len(), 1);
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 2);
}

/// A channel of the machine's log is declared with its first sample, facts stand anywhere.
#[test]
fn a_log_of_the_machine_is_recovered_with_its_facts_even_without_its_declarations() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("host.mcap");
    let facts = |name: &str| BTreeMap::from([(name.to_owned(), "so".to_owned())]);
    let mut writer = HostLogWriter::create(&path, Compression::None).unwrap();
    writer.write_facts("host", facts("machine")).unwrap();
    for second in 0..5 {
        let event = HostEvent::new(second * 1_000_000_000, None, HostEvent::KIND_NOTE, 0, "so");
        writer.write(&event).unwrap();
        let health = ServiceHealth {
            time_ns: event.time_ns,
            ..ServiceHealth::new_zeroed()
        };
        writer.write(&health).unwrap();
        writer.write_facts("timing", facts("late")).unwrap();
    }
    drop(writer);
    let partial = partial_path(&path);
    let mut bytes = fs::read(&partial).unwrap();
    // The kind of the first chunk, which follows the first facts.
    let chunk = bytes
        .windows(9)
        .position(|frame| frame[0] == 6 && frame[1] != 0 && frame[4..].iter().all(|&byte| byte == 0));
    bytes[chunk.unwrap() + 60] ^= 1;
    fs::write(&partial, &bytes).unwrap();
    let target = recovered_path(&partial);
    assert!(target.ends_with("host.recovered.mcap"));
    let recovery = recover(&partial, &target, None).unwrap();
    let expected = [("host/events", 4), ("host/health", 4)].map(|(name, count)| (name.to_owned(), count));
    assert_eq!(recovery.samples, BTreeMap::from(expected));
    assert!(recovery.to_string().contains("1 of host/events"), "{recovery}");
    let new = fs::read(&target).unwrap();
    let names: Vec<_> = mcap::Summary::read(&new)
        .unwrap()
        .unwrap()
        .metadata_indexes
        .into_iter()
        .map(|index| index.name)
        .collect();
    assert_eq!(
        names[..3],
        [Recovery::RECORD_NAME, "host", "timing"].map(str::to_owned)
    );
    assert_eq!(
        mcap::MessageStream::new(&new)
            .unwrap()
            .map(Result::unwrap)
            .count(),
        8
    );
}

#[test]
fn a_file_that_was_made_to_keep_its_reader_busy_is_given_up() {
    let folder = tempfile::tempdir().unwrap();
    let [source, target] = ["bomb.mcap", "new.mcap"].map(|name| folder.path().join(name));
    bomb(&source, 24, 12 << 20);
    for result in [
        inspect(&source).map(drop),
        recover(&source, &target, None).map(drop),
    ] {
        assert!(
            matches!(result, Err(RecoverError::Implausible { .. })),
            "{result:?}"
        );
    }
    assert!(!target.exists() && !partial_path(&target).exists());
}
