//! Promises of a log in several files: nothing is lost at a split, at a crash or by a missing file without a word.

#![expect(clippy::disallowed_methods, reason = "tests make their own files")]

use std::fs;

use proptest::prelude::*;
use scenario::{Record, Scenario, Split};
use shared_types::service::header_of;
use tempfile::TempDir;

use super::*;
use crate::test_flight::{record, samples, scenario};
use crate::{
    Ending, LogError, LogReadError, LogReader, RunLogWriter, digest, ending, files_of_log, partial_path,
    recover, recovered_path, written_files,
};

/// The flight of [`scenario`] whose log is split.
fn split_flight(split: Split) -> Scenario {
    let mut flown = scenario(0.01, 10.0);
    flown.record = Some(Record {
        split: Some(split),
        ..Record::default()
    });
    flown
}

fn after_seconds(seconds: f64) -> Scenario {
    split_flight(Split {
        after_seconds: Some(seconds),
        ..Split::default()
    })
}

struct Recorded {
    folder: TempDir,
    first: PathBuf,
}

impl Recorded {
    fn of(scenario: &Scenario) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let first = folder.path().join("run.mcap");
        record(&first, scenario, Compression::Lz4);
        Self { folder, first }
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }
}

/// Reads on as far as possible: ticks of the samples, and the end.
fn read(log: &Path) -> (Vec<u64>, Result<(), LogReadError>) {
    let mut ticks = Vec::new();
    let mut reader = match LogReader::open(log) {
        Ok(reader) => reader,
        Err(error) => return (ticks, Err(error)),
    };
    loop {
        match reader.next_sample() {
            Ok(Some(sample)) => ticks.push(sample.header.tick),
            Ok(None) => return (ticks, Ok(())),
            Err(error) => return (ticks, Err(error)),
        }
    }
}

/// Writes the samples before a tick and leaves the log as it then is.
fn break_off_before(first: &Path, scenario: &Scenario, tick: u64) {
    let mut writer = RunLogWriter::create(first, &Manifest::new(scenario), Compression::None).unwrap();
    for (topic, bytes) in samples(&scenario.schedule().unwrap()) {
        if header_of(&bytes).tick == tick {
            break;
        }
        writer.write(topic, &bytes).unwrap();
        if topic.index() + 1 == Topic::ALL.len() {
            writer.end_tick(header_of(&bytes).tick).unwrap();
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(12))]
    /// Wherever the log is split: nothing is lost, and it is the log of a flight that is not.
    #[test]
    fn a_split_log_has_the_digest_of_one_file(bytes in 65_536u64..2_000_000, seconds in 1.0..12.0f64) {
        let whole = Recorded::of(&scenario(0.01, 10.0));
        let split = Split { after_bytes: Some(bytes), after_seconds: Some(seconds) };
        let parts = Recorded::of(&split_flight(split));
        prop_assert_eq!(digest(&parts.first).unwrap(), digest(&whole.first).unwrap());
        let files = files_of_log(&parts.first);
        prop_assert_eq!(&files, &written_files(&parts.first));
        for (number, file) in (0..).zip(&files) {
            let is_last = number + 1 == files.len() as u64;
            let expected = if is_last { Ending::Last } else { Ending::GoesOn(number + 1) };
            prop_assert_eq!(ending(file).unwrap(), expected);
            // A chunk of 25 ticks is all that may come on top of the time.
            let own = mcap::MessageStream::new(&fs::read(file).unwrap()).unwrap()
                .map(|message| message.unwrap().log_time).collect::<Vec<_>>();
            let span = (own[own.len() - 1] - own[0]) as f64 * 1e-9;
            prop_assert!(span < seconds + 0.25, "{} s", span);
        }
    }
}

#[test]
fn the_files_begin_at_their_times_and_open_alone() {
    let parts = Recorded::of(&after_seconds(4.0));
    let names = ["run.mcap", "run.1.mcap", "run.2.mcap"].map(|name| parts.path(name));
    assert_eq!(files_of_log(&parts.first), names);
    for (name, begins) in names.iter().zip([0, 400, 800]) {
        let (ticks, end) = read(name);
        end.unwrap();
        assert_eq!((ticks[0], *ticks.last().unwrap()), (begins, 1000), "{name:?}");
    }
}

#[test]
fn a_log_that_breaks_off_keeps_its_complete_files_and_the_newest_is_recovered() {
    let parts = Recorded::of(&after_seconds(4.0));
    let folder = tempfile::tempdir().unwrap();
    let first = folder.path().join("run.mcap");
    break_off_before(&first, &after_seconds(4.0), 560);
    assert!(first.exists(), "the file before the newest is complete");
    let partial = partial_path(&folder.path().join("run.1.mcap"));
    let (ticks, end) = read(&first);
    // The last whole chunk ends with tick 549.
    assert_eq!(ticks.last(), Some(&549));
    let Err(LogReadError::Unclosed {
        path,
        samples,
        last_tick,
    }) = end
    else {
        panic!("{end:?}");
    };
    assert_eq!(
        (&path, samples, last_tick),
        (&partial, ticks.len() as u64, Some(549))
    );
    recover(&partial, &recovered_path(&partial), None).unwrap();
    let (recovered, end) = read(&first);
    end.unwrap();
    assert_eq!(recovered, ticks);
    assert_eq!(LogReader::open(&first).unwrap().recoveries().len(), 1);
    let (whole, _) = read(&parts.first);
    assert!(whole.starts_with(&recovered));
}

#[test]
fn a_newest_file_without_a_sample_ends_the_log_once_the_one_before_is_recovered() {
    let folder = tempfile::tempdir().unwrap();
    let first = folder.path().join("run.mcap");
    break_off_before(&first, &after_seconds(4.0), 410);
    let partial = partial_path(&folder.path().join("run.1.mcap"));
    let (ticks, end) = read(&first);
    assert!(
        matches!(end, Err(LogReadError::Unclosed { ref path, .. }) if *path == partial),
        "{end:?}"
    );
    assert_eq!(ticks.last(), Some(&399));
    recover(&partial, &recovered_path(&partial), None).unwrap_err();
    recover(&first, &recovered_path(&first), None).unwrap();
    for content in [fs::read(&partial).unwrap(), Vec::new()] {
        fs::write(&partial, content).unwrap();
        let (recovered, end) = read(&recovered_path(&first));
        end.unwrap();
        assert_eq!(recovered, ticks);
    }
}

#[test]
fn a_file_that_is_missing_is_named_and_behind_a_recovered_one_passed_over() {
    let parts = Recorded::of(&after_seconds(2.0));
    let missing = parts.path("run.2.mcap");
    fs::remove_file(&missing).unwrap();
    let (ticks, end) = read(&parts.first);
    assert_eq!(ticks.last(), Some(&399));
    let error = end.unwrap_err();
    assert!(
        matches!(&error, LogReadError::MissingPart { missing: found, last_tick: Some(399), .. } if *found == missing),
        "{error}"
    );
    assert!(error.to_string().contains("run.2.mcap"), "{error}");
    let before = parts.path("run.1.mcap");
    recover(&before, &recovered_path(&before), None).unwrap();
    let (ticks, end) = read(&parts.first);
    end.unwrap();
    assert!(
        !ticks.contains(&400) && !ticks.contains(&599) && ticks.contains(&600) && ticks.ends_with(&[1000])
    );
}

#[test]
fn a_file_that_is_lost_behind_a_recovered_one_is_named() {
    let parts = Recorded::of(&after_seconds(2.0));
    let damaged = parts.path("run.1.mcap");
    let mut content = fs::read(&damaged).unwrap();
    let middle = content.len() / 2;
    content[middle] ^= 1;
    fs::write(&damaged, content).unwrap();
    recover(&damaged, &recovered_path(&damaged), None).unwrap();
    read(&parts.first).1.unwrap();
    let kept = fs::read(parts.path("run.2.mcap")).unwrap();
    for later_is_lost in [false, true] {
        if later_is_lost {
            for name in ["run.3.mcap", "run.4.mcap", "run.5.mcap"] {
                let _ = fs::remove_file(parts.path(name));
            }
        }
        let missing = parts.path("run.2.mcap");
        fs::remove_file(&missing).unwrap();
        let error = read(&parts.first).1.unwrap_err();
        assert!(
            matches!(&error, LogReadError::MissingPart { missing: found, .. } if *found == missing),
            "{error}"
        );
        fs::write(&missing, &kept).unwrap();
    }
}

#[test]
fn a_file_of_another_flight_is_refused() {
    let parts = Recorded::of(&after_seconds(4.0));
    let mut other = after_seconds(4.0);
    other.seed = 7;
    let other = Recorded::of(&other);
    fs::copy(other.path("run.1.mcap"), parts.path("run.1.mcap")).unwrap();
    let (ticks, end) = read(&parts.first);
    assert_eq!(ticks.last(), Some(&399));
    let error = end.unwrap_err().to_string();
    assert!(
        error.contains("run.1.mcap") && error.contains("same flight"),
        "{error}"
    );
    // Nor may a file take the place of another one.
    fs::copy(other.path("run.mcap"), other.path("run.1.mcap")).unwrap();
    assert!(matches!(read(&other.first).1, Err(LogReadError::Damaged { .. })));
}

#[test]
fn a_file_that_cannot_be_begun_ends_the_log_and_the_one_before_is_never_called_complete() {
    let folder = tempfile::tempdir().unwrap();
    let first = folder.path().join("run.mcap");
    // A folder in its place.
    fs::create_dir(partial_path(&folder.path().join("run.1.mcap"))).unwrap();
    let scenario = after_seconds(4.0);
    let mut writer = RunLogWriter::create(&first, &Manifest::new(&scenario), Compression::None).unwrap();
    let failure = samples(&scenario.schedule().unwrap()).find_map(|(topic, bytes)| {
        let written = writer.write(topic, &bytes);
        let tick = header_of(&bytes).tick;
        let ended = (topic.index() + 1 == Topic::ALL.len()).then(|| writer.end_tick(tick));
        written.and(ended.unwrap_or(Ok(()))).err()
    });
    assert!(
        matches!(failure, Some(LogError::Exists { ref path }) if path.ends_with("run.1.mcap.partial")),
        "{failure:?}"
    );
    drop(writer);
    assert!(!first.exists());
    let (ticks, _) = read(&partial_path(&first));
    assert_eq!(ticks.last(), Some(&399));
}

#[test]
fn files_that_are_forced_to_the_disk_are_the_same() {
    let plain = Recorded::of(&after_seconds(2.0));
    let folder = tempfile::tempdir().unwrap();
    let first = folder.path().join("run.mcap");
    let scenario = after_seconds(2.0);
    let mut writer = RunLogWriter::create(&first, &Manifest::new(&scenario), Compression::Lz4)
        .unwrap()
        .durable(Some(Duration::from_millis(1)))
        .unwrap();
    for (topic, bytes) in samples(&scenario.schedule().unwrap()) {
        writer.write(topic, &bytes).unwrap();
        if topic.index() + 1 == Topic::ALL.len() {
            writer.end_tick(header_of(&bytes).tick).unwrap();
        }
    }
    let written = writer.finish().unwrap();
    let files = written_files(&first);
    assert_eq!(files.len(), 6);
    let sizes = files.iter().map(|file| fs::metadata(file).unwrap().len());
    assert_eq!(written.bytes, sizes.sum::<u64>());
    for (file, other) in files.iter().zip(written_files(&plain.first)) {
        assert!(fs::read(file).unwrap() == fs::read(other).unwrap(), "{file:?}");
    }
}
