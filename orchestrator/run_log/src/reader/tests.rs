//! Promises of a reader about whole, broken and foreign files.

#![expect(clippy::disallowed_methods, reason = "tests make their own files")]

use std::fs;

use proptest::prelude::*;
use scenario::Scenario;
use shared_types::samples::{ControlErrors, RunEvent};
use tempfile::TempDir;
use zerocopy::FromBytes;

use super::*;
use crate::framing::McapFile;
use crate::test_flight::{bomb, record, samples, scenario};
use crate::{Compression, partial_path};

const TOPICS: usize = Topic::ALL.len();
const COMPRESSIONS: [Compression; 3] = [Compression::None, Compression::Lz4, Compression::Zstd];

/// Topic and bytes of samples.
type Samples = Vec<(Topic, Vec<u8>)>;

/// A log of four chunks of five ticks and one of one, in bytes.
struct Recorded {
    folder: TempDir,
    scenario: Scenario,
    file: Vec<u8>,
}

fn recorded(compression: Compression) -> Recorded {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.mcap");
    let scenario = scenario(0.05, 1.0);
    record(&path, &scenario, compression);
    let file = fs::read(&path).unwrap();
    Recorded {
        folder,
        scenario,
        file,
    }
}

impl Recorded {
    /// The samples that are read of a file of these bytes, and how reading ended.
    fn read(&self, file: &[u8]) -> (Samples, Result<(), LogReadError>) {
        let path = self.folder.path().join("other.mcap");
        fs::write(&path, file).unwrap();
        let mut found = Vec::new();
        let mut reader = match LogReader::open(&path) {
            Ok(reader) => reader,
            Err(error) => return (found, Err(error)),
        };
        loop {
            match reader.next_sample() {
                Ok(Some(logged)) => found.push((logged.topic, logged.bytes.to_vec())),
                Ok(None) => return (found, Ok(())),
                Err(error) => {
                    assert!(
                        reader.next_sample().unwrap().is_none(),
                        "nothing follows an error"
                    );
                    return (found, Err(error));
                }
            }
        }
    }

    fn samples(&self) -> Samples {
        samples(&self.scenario.schedule().unwrap()).collect()
    }
}

#[test]
fn what_was_written_is_read_in_its_order() {
    for compression in COMPRESSIONS {
        let log = recorded(compression);
        let (found, end) = log.read(&log.file);
        end.unwrap();
        assert_eq!(found, log.samples());
        let reader = LogReader::open(&log.folder.path().join("run.mcap")).unwrap();
        assert_eq!(reader.manifest().scenario, log.scenario.experiment());
    }
}

#[test]
fn samples_are_aligned_for_their_type() {
    let log = recorded(Compression::Zstd);
    let mut reader = LogReader::open(&log.folder.path().join("run.mcap")).unwrap();
    while let Some(logged) = reader.next_sample().unwrap() {
        if logged.topic == Topic::ControlErrors {
            ControlErrors::ref_from_bytes(logged.bytes).unwrap();
        }
    }
}

#[test]
fn typed_samples_are_those_of_their_topic() {
    let log = recorded(Compression::None);
    let reader = LogReader::open(&log.folder.path().join("run.mcap")).unwrap();
    let events: Vec<RunEvent> = reader.samples().map(Result::unwrap).collect();
    let expected: Vec<_> = log
        .samples()
        .into_iter()
        .filter(|(topic, _)| *topic == Topic::RunEvent)
        .map(|(_, bytes)| bytes)
        .collect();
    assert_eq!(
        events
            .iter()
            .map(|event| event.as_bytes().to_vec())
            .collect::<Vec<_>>(),
        expected
    );
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn a_log_cut_anywhere_is_incomplete_and_ends_at_a_whole_tick(
        compression in prop::sample::select(&COMPRESSIONS[..]),
        cut in any::<prop::sample::Index>(),
    ) {
        let log = recorded(compression);
        let (found, end) = log.read(&log.file[..cut.index(log.file.len())]);
        prop_assert!(matches!(end, Err(LogReadError::Unclosed { .. })), "{end:?}");
        let all = log.samples();
        prop_assert!(found.len().is_multiple_of(5 * TOPICS) || found.len() == all.len());
        prop_assert!(all.starts_with(&found));
    }

    #[test]
    fn a_single_wrong_byte_is_found_and_nothing_wrong_is_handed_out(
        compression in prop::sample::select(&COMPRESSIONS[..]),
        place in any::<prop::sample::Index>(),
        flip in 1..=u8::MAX,
    ) {
        let mut log = recorded(compression);
        let place = place.index(log.file.len());
        log.file[place] ^= flip;
        let (found, end) = log.read(&log.file);
        prop_assert!(end.is_err(), "byte {place} of {}", log.file.len());
        prop_assert!(log.samples().starts_with(&found));
    }

    #[test]
    fn arbitrary_damage_is_no_reason_to_panic(
        compression in prop::sample::select(&COMPRESSIONS[..]),
        place in any::<prop::sample::Index>(),
        rubbish in proptest::collection::vec(any::<u8>(), 0..64),
        left_out in 0..64usize,
    ) {
        let mut log = recorded(compression);
        let begin = place.index(log.file.len());
        let end = (begin + left_out).min(log.file.len());
        log.file.splice(begin..end, rubbish);
        let (found, _) = log.read(&log.file);
        prop_assert!(log.samples().starts_with(&found));
    }

    #[test]
    fn a_file_of_anything_is_refused(bytes in proptest::collection::vec(any::<u8>(), 0..300), is_mcap in any::<bool>()) {
        let log = recorded(Compression::None);
        let bytes = if is_mcap { [mcap::MAGIC, bytes.as_slice()].concat() } else { bytes };
        let (found, end) = log.read(&bytes);
        prop_assert!(end.is_err() && found.is_empty());
    }
}

#[test]
fn a_chunk_of_damaged_kind_is_not_passed_over() {
    let mut log = recorded(Compression::None);
    for place in chunk_offsets(&log.file) {
        for flip in 1..=u8::MAX {
            log.file[place] ^= flip;
            let (found, end) = log.read(&log.file);
            assert!(
                end.is_err() && log.samples().starts_with(&found),
                "{place} {flip}"
            );
            log.file[place] ^= flip;
        }
    }
}

/// Returns where the chunks of a file begin.
fn chunk_offsets(file: &[u8]) -> Vec<usize> {
    let mut offsets = Vec::new();
    let mut offset = mcap::MAGIC.len();
    while let Some(frame) = file.get(offset..offset + 9) {
        if frame[0] == op::CHUNK {
            offsets.push(offset);
        }
        offset += 9 + u64::from_le_bytes(frame[1..].try_into().unwrap()) as usize;
    }
    assert_eq!(offsets.len(), 5);
    offsets
}

#[test]
fn a_log_whose_recorder_died_is_recognised() {
    let log = recorded(Compression::None);
    let path = log.folder.path().join("dead.mcap");
    let mut file = McapFile::create(&path, Compression::None, None).unwrap();
    file.write_metadata(Manifest::RECORD_NAME, Manifest::new(&log.scenario).to_metadata())
        .unwrap();
    file.flush().unwrap();
    drop(file);
    let mut reader = LogReader::open(&partial_path(&path)).unwrap();
    let error = reader.next_sample().unwrap_err();
    assert!(
        matches!(error, LogReadError::Unclosed { samples: 0, .. }),
        "{error}"
    );
}

/// The error of opening a log that has this manifest.
fn open_with_manifest(change: impl FnOnce(&mut BTreeMap<String, String>)) -> LogReadError {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.mcap");
    let mut metadata = Manifest::new(&scenario(0.01, 1.0)).to_metadata();
    change(&mut metadata);
    let mut file = McapFile::create(&path, Compression::None, None).unwrap();
    file.write_metadata(Manifest::RECORD_NAME, metadata).unwrap();
    file.finish().unwrap();
    LogReader::open(&path).map(|_| ()).unwrap_err()
}

#[test]
fn a_log_of_other_layouts_is_refused_by_the_names_of_its_types() {
    let error = open_with_manifest(|metadata| {
        metadata.insert("layout/rc/frame".to_owned(), "0".repeat(32));
        metadata.remove("layout/mocap/pose");
    });
    let LogReadError::Layouts { types, .. } = &error else {
        panic!("{error}")
    };
    assert_eq!(types, &["gerono_msgs/msg/MocapPose", "gerono_msgs/msg/RcFrame"]);
    assert!(error.to_string().contains("gerono_msgs/msg/RcFrame"), "{error}");
}

#[test]
fn a_log_of_another_version_is_refused_by_its_version() {
    let error = open_with_manifest(|metadata| {
        metadata.insert("format_version".to_owned(), "7".to_owned());
    });
    assert!(
        matches!(&error, LogReadError::Version { found, .. } if found == "7"),
        "{error}"
    );
}

#[test]
fn a_log_without_its_scenario_is_refused() {
    for scenario in [None, Some("{}")] {
        let error = open_with_manifest(|metadata| {
            metadata.remove("scenario");
            metadata.extend(scenario.map(|text| ("scenario".to_owned(), text.to_owned())));
        });
        assert!(
            matches!(&error, LogReadError::Manifest { source, .. } if source.to_string().contains("scenario")),
            "{error}"
        );
    }
}

/// The records of a log as a program writes them that puts the facts behind the samples.
fn with_facts_last(log: &[u8]) -> Vec<u8> {
    copied(log, 1)
}

/// A copy of a log with the facts behind the samples, each of which is written `times` times.
fn copied(log: &[u8], times: usize) -> Vec<u8> {
    let mut written = std::io::Cursor::new(Vec::new());
    let mut writer = mcap::Writer::new(&mut written).unwrap();
    for message in mcap::MessageStream::new(log).unwrap() {
        let message = message.unwrap();
        (0..times).for_each(|_| writer.write(&message).unwrap());
    }
    for record in mcap::read::LinearReader::new(log).unwrap() {
        if let Record::Metadata(metadata) = record.unwrap() {
            writer.write_metadata(&metadata).unwrap();
        }
    }
    writer.finish().unwrap();
    drop(writer);
    written.into_inner()
}

#[test]
fn a_log_with_samples_twice_is_refused_by_all_that_read_it() {
    let recorded = recorded(Compression::None);
    let (samples, end) = recorded.read(&copied(&recorded.file, 2));
    assert_eq!(samples.len(), 1);
    let says = |error: LogReadError| assert!(error.to_string().contains("samples twice"), "{error}");
    says(end.unwrap_err());
    says(crate::is_whole(&recorded.folder.path().join("other.mcap")).unwrap_err());
}

/// The same log with copies of its schemas and channels before the first chunk, and without a checksum of all data.
fn with_declarations_outside(log: &[u8]) -> Vec<u8> {
    const FRAME: usize = 9;
    let first = chunk_offsets(log)[0];
    // Times, size, checksum and the length of an empty name precede the length and the records of a chunk.
    let mut at = first + FRAME + 8 + 8 + 8 + 4 + 4 + 8;
    let mut declarations = Vec::new();
    while matches!(log[at], op::SCHEMA | op::CHANNEL) {
        let length: [u8; 8] = log[at + 1..at + FRAME].try_into().unwrap();
        let end = at + FRAME + u64::from_le_bytes(length) as usize;
        declarations.extend_from_slice(&log[at..end]);
        at = end;
    }
    assert!(!declarations.is_empty());
    let mut changed = [&log[..first], &declarations, &log[first..]].concat();
    let data_end = [op::DATA_END, 4, 0, 0, 0, 0, 0, 0, 0];
    let place = changed
        .windows(FRAME)
        .rposition(|frame| frame == data_end)
        .unwrap();
    changed[place + FRAME..place + FRAME + 4].fill(0);
    changed
}

#[test]
fn a_log_that_another_program_has_copied_is_read_as_the_one_that_was_written() {
    let log = recorded(Compression::None);
    for copy in [with_facts_last(&log.file), with_declarations_outside(&log.file)] {
        let (found, end) = log.read(&copy);
        end.unwrap();
        assert_eq!(found, log.samples());
        let path = log.folder.path().join("other.mcap");
        assert!(crate::is_whole(&path).unwrap());
        let reader = LogReader::open(&path).unwrap();
        assert_eq!(*reader.manifest(), Manifest::new(&log.scenario));
        // A copy that is cut is not whole for anybody.
        fs::write(&path, &copy[..copy.len() / 2]).unwrap();
        assert!(!crate::is_whole(&path).is_ok_and(|is_whole| is_whole));
    }
}

#[test]
fn a_log_of_another_program_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("other.mcap");
    let mut writer = mcap::Writer::new(fs::File::create(&path).unwrap()).unwrap();
    let channel = writer.add_channel(0, "chat", "json", &BTreeMap::new()).unwrap();
    let header = mcap::records::MessageHeader {
        channel_id: channel,
        sequence: 0,
        log_time: 0,
        publish_time: 0,
    };
    writer.write_to_known_channel(&header, b"{}").unwrap();
    writer.finish().unwrap();
    let error = LogReader::open(&path).map(|_| ()).unwrap_err();
    assert!(matches!(error, LogReadError::Foreign { .. }), "{error}");
    let error = crate::is_whole(&path).unwrap_err();
    assert!(matches!(error, LogReadError::Foreign { .. }), "{error}");
    let error = crate::recover(&path, &folder.path().join("saved.mcap"), None).unwrap_err();
    assert!(error.to_string().contains("is not a run log"), "{error}");
}

#[test]
fn a_log_that_does_not_exist_is_named() {
    let error = LogReader::open(Path::new("no/such/run.mcap"))
        .map(|_| ())
        .unwrap_err();
    assert!(error.to_string().contains("no/such/run.mcap"), "{error}");
}

/// Reads a log to its end; how many samples there were, and why it ended.
fn read_all(path: &Path) -> (u64, LogReadError) {
    let mut reader = LogReader::open(path).unwrap();
    for count in 0.. {
        match reader.next_sample() {
            Ok(Some(_)) => {}
            Ok(None) => unreachable!("it was never closed"),
            Err(error) => return (count, error),
        }
    }
    unreachable!("a file ends")
}

/// Recovery, which looks at each record alone, gives such a file up by its size.
#[test]
fn a_file_that_unpacks_to_far_more_of_one_sample_is_given_up_at_the_second() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("bomb.mcap");
    bomb(&path, 24, 12 << 20);
    let size = fs::metadata(&path).unwrap().len();
    assert!(size < 1 << 20, "{size}");
    let (samples, error) = read_all(&path);
    assert_eq!(samples, 1);
    assert!(error.to_string().contains("samples twice"), "{error}");
}

#[test]
fn a_chunk_that_unpacks_to_more_than_any_is_not_unpacked() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("bomb.mcap");
    bomb(&path, 1, 20 << 20);
    let (samples, error) = read_all(&path);
    assert!(
        samples == 0 && error.to_string().contains("exceeds limit"),
        "{error}"
    );
}
