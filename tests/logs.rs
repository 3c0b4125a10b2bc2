//! Logs that were cut, damaged or never closed: nothing panics or hangs, all that is whole is recovered, and every command says
//! what it has before it.

#![expect(clippy::disallowed_methods, reason = "tests make their own files")]

use crate::common;

use std::collections::BTreeMap;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::process::Output;

use common::processes::signal;
use common::{Begun, Place, begin, complaint, finish, output, succeed};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};
use replay::{Options, replay};
use run_log::{
    Compression, HostEvent, HostLogWriter, LogReadError, LogReader, RecoverError, Recovery, is_whole, recover,
};
use rustix::process::Signal;
use scenario::Scenario;

const COMPRESSIONS: [&str; 3] = ["none", "lz4", "zstd"];

/// Topic and bytes of samples.
type Samples = Vec<(String, Vec<u8>)>;

/// Returns the findings of a reader, and its end.
fn read(log: &Path) -> (Samples, Result<(), LogReadError>) {
    let mut samples = Vec::new();
    let mut reader = LogReader::open(log).unwrap();
    loop {
        match reader.next_sample() {
            Ok(Some(sample)) => samples.push((sample.topic.name().to_owned(), sample.bytes.to_vec())),
            Ok(None) => return (samples, Ok(())),
            Err(error) => return (samples, Err(error)),
        }
    }
}

/// Texts of programs below a folder, with their paths.
fn programs(folder: &Path) -> Vec<(PathBuf, String)> {
    let mut found = Vec::new();
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            found.append(&mut programs(&path));
        } else if path.extension().is_some_and(|extension| extension == "rs") {
            let text = std::fs::read_to_string(&path).unwrap();
            found.push((path, text));
        }
    }
    found
}

#[test]
fn no_reader_takes_an_error_for_the_end() {
    // Each ends silently at the first error, and what was read until then counts as the whole.
    let patterns = [
        concat!("while let Ok", "(Some("),
        concat!("while let Some", "(Ok("),
        concat!("map_while", "(Result::ok)"),
        concat!("map_while", "(|found| found.ok())"),
    ];
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    let folders = ["orchestrator", "services", "shared_types", "python/src", "tests"];
    let mut texts: Vec<_> = folders
        .iter()
        .flat_map(|folder| programs(&root.join(folder)))
        .collect();
    texts.retain(|(path, _)| !path.components().any(|part| part.as_os_str() == "target"));
    assert!(texts.len() > 300, "only {} files", texts.len());
    let found: Vec<_> = texts
        .iter()
        .filter(|(_, text)| patterns.iter().any(|pattern| text.contains(pattern)))
        .map(|(path, _)| path)
        .collect();
    assert_eq!(found, Vec::<&PathBuf>::new());
}

#[test]
fn what_is_identified_from_a_damaged_log_is_an_error() {
    let place = Place::new();
    succeed(&mut place.rig_flight("out", 30.0, &["--host", "inprocess", "--quiet"]));
    let whole = output(&mut place.gerono(&["identify", "out"]));
    assert_eq!(whole.status.code(), Some(0), "{}", complaint(&whole));
    let mut bytes = std::fs::read(place.log("out")).unwrap();
    let middle = bytes.len() * 9 / 10;
    bytes[middle] ^= 1;
    std::fs::write(place.log("out"), bytes).unwrap();
    let damaged = output(&mut place.gerono(&["identify", "out"]));
    assert_eq!(damaged.status.code(), Some(10), "{}", complaint(&damaged));
    assert!(
        damaged.stdout.is_empty() && complaint(&damaged).contains("damaged after"),
        "{}",
        complaint(&damaged)
    );
}

/// A short flight's log, and what an independent reader finds in each of its chunks.
struct Whole {
    place: Place,
    file: Vec<u8>,
    scenario: Scenario,
    chunks: Vec<(Range<usize>, Samples)>,
}

impl Whole {
    fn fly(compression: &str) -> Self {
        let place = Place::new();
        let coarse = ["--set", "schedule.tick=0.005", "--host", "inprocess"];
        succeed(
            place
                .short_flight("out", 2.0, &coarse)
                .args(["--compression", compression]),
        );
        let log = place.path("out").join("run.mcap");
        let file = std::fs::read(&log).unwrap();
        let summary = mcap::Summary::read(&file).unwrap().unwrap();
        let chunks = summary.chunk_indexes.iter().map(|index| {
            let begin = usize::try_from(index.chunk_start_offset).unwrap();
            let messages = summary.stream_chunk(&file, index).unwrap();
            let samples = messages.map(|message| {
                let message = message.unwrap();
                (message.channel.topic.clone(), message.data[4..].to_vec())
            });
            (
                begin..begin + usize::try_from(index.chunk_length).unwrap(),
                samples.collect(),
            )
        });
        let chunks: Vec<_> = chunks.collect();
        assert!(chunks.len() >= 8);
        Self {
            scenario: LogReader::open(&log).unwrap().manifest().scenario.clone(),
            chunks,
            file,
            place,
        }
    }

    /// Recovers a log of these bytes; the scenario is at hand if its manifest is damaged.
    fn recover(&self, bytes: &[u8]) -> Result<(Samples, Recovery), RecoverError> {
        let [damaged, new] = ["damaged.mcap", "new.mcap"].map(|name| self.place.path(name));
        std::fs::write(&damaged, bytes).unwrap();
        let _ = std::fs::remove_file(&new);
        // Whatever it is, reading it ends.
        if let Ok(mut reader) = LogReader::open(&damaged) {
            while reader.next_sample().is_ok_and(|sample| sample.is_some()) {}
        }
        let recovery = recover(&damaged, &new, Some(&self.scenario))?;
        assert!(is_whole(&new).unwrap());
        let (samples, end) = read(&new);
        end.unwrap();
        Ok((samples, recovery))
    }

    fn samples_of<'a>(&'a self, is_kept: impl Fn(&Range<usize>) -> bool + 'a) -> Samples {
        let kept = self.chunks.iter().filter(move |(range, _)| is_kept(range));
        kept.flat_map(|(_, samples)| samples.clone()).collect()
    }
}

/// Nothing is made up, nothing changes its place, and of each chunk there is all or, at the end, the beginning.
fn assert_prefix(samples: &Samples, of: &Samples, at: usize) {
    assert!(of.starts_with(samples), "cut at {at}: {} samples", samples.len());
}

#[test]
fn of_a_log_that_is_cut_anywhere_every_whole_chunk_is_recovered() {
    let mut random = ChaCha8Rng::seed_from_u64(6);
    let mut nothing = 0;
    for compression in COMPRESSIONS {
        let whole = Whole::fly(compression);
        let all = whole.samples_of(|_| true);
        for _ in 0..200_usize.div_ceil(COMPRESSIONS.len()) {
            let cut = usize::try_from(random.next_u64() % whole.file.len() as u64).unwrap();
            let certain = whole.samples_of(|chunk| chunk.end <= cut);
            match whole.recover(&whole.file[..cut]) {
                Ok((samples, recovery)) => {
                    let unverified = usize::try_from(recovery.unverified).unwrap();
                    assert_eq!(samples.len(), certain.len() + unverified, "cut at {cut}");
                    assert_prefix(&samples, &all, cut);
                    assert!(!recovery.was_closed || samples == all);
                    assert!(unverified == 0 || compression == "none");
                }
                Err(error) => {
                    assert!(matches!(error, RecoverError::Nothing(_)), "{error}");
                    assert!(certain.is_empty(), "cut at {cut}");
                    nothing += 1;
                }
            }
        }
    }
    assert!(nothing < 50, "most cuts leave something");
}

#[test]
fn of_a_log_with_wrong_bytes_every_chunk_without_one_is_recovered_and_no_other_sample() {
    let mut random = ChaCha8Rng::seed_from_u64(66);
    for compression in COMPRESSIONS {
        let whole = Whole::fly(compression);
        let all = whole.samples_of(|_| true);
        for round in 0..200_usize.div_ceil(COMPRESSIONS.len()) {
            let mut file = whole.file.clone();
            // One wrong byte, or a few of them in different places.
            let places: Vec<_> = (0..=round % 3)
                .map(|_| usize::try_from(random.next_u64() % file.len() as u64).unwrap())
                .collect();
            for &place in &places {
                file[place] ^= u8::try_from(1 + random.next_u32() % 255).unwrap();
            }
            let is_hit = |chunk: &Range<usize>| places.iter().any(|place| chunk.contains(place));
            let certain = whole.samples_of(|chunk| !is_hit(chunk));
            let (samples, recovery) = whole
                .recover(&file)
                .unwrap_or_else(|error| panic!("{places:?}: {error}"));
            // The times in a chunk's header are under no checksum, and not needed.
            let possible = whole.samples_of(|chunk| {
                let in_times = |place: &usize| (chunk.start + 9..chunk.start + 25).contains(place);
                places
                    .iter()
                    .all(|place| !chunk.contains(place) || in_times(place))
            });
            assert!(
                samples == certain || samples == possible,
                "{places:?}: {recovery}"
            );
            if samples.len() < all.len() {
                assert!(!recovery.lacks_nothing(), "{places:?}: {recovery}");
            }
        }
    }
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

fn fails(place: &Place, arguments: &[&str], code: i32) -> Output {
    let ended = output(&mut place.gerono(arguments));
    assert_eq!(
        ended.status.code(),
        Some(code),
        "{arguments:?} {}",
        text(&ended.stderr)
    );
    ended
}

/// A log of another program, with a chunk of messages.
fn foreign_log() -> Vec<u8> {
    let mut written = std::io::Cursor::new(Vec::new());
    let mut writer = mcap::Writer::new(&mut written).unwrap();
    let channel = writer
        .add_channel(0, "vehicle/state", "json", &BTreeMap::new())
        .unwrap();
    for sequence in 0..100 {
        let header = mcap::records::MessageHeader {
            channel_id: channel,
            sequence,
            log_time: 0,
            publish_time: 0,
        };
        writer
            .write_to_known_channel(&header, br#"{"text": "hello"}"#)
            .unwrap();
    }
    writer.finish().unwrap();
    drop(writer);
    written.into_inner()
}

fn with_flipped(bytes: &[u8], at: usize) -> Vec<u8> {
    let mut flipped = bytes.to_vec();
    flipped[at] ^= 1;
    flipped
}

/// Whether a file is no log of a flight, or an incomplete or damaged one, is the same for all commands.
#[test]
fn every_command_tells_foreign_files_from_incomplete_and_damaged_logs_by_the_same_exit_code() {
    let place = Place::new();
    succeed(&mut place.short_flight("out", 0.5, &["--host", "inprocess", "--quiet"]));
    let ours = std::fs::read(place.log("out")).unwrap();
    // The library in the header has the name, and then the metadata.
    let mut names = (0..ours.len()).filter(|at| ours[*at..].starts_with(b"\x06\0\0\0gerono"));
    let manifest_at = names.nth(1).unwrap();
    let other = foreign_log();
    let machine = place.path("machine.mcap");
    let mut host = HostLogWriter::create(&machine, Compression::None).unwrap();
    host.write(&HostEvent::new(0, None, HostEvent::KIND_NOTE, 0, "so"))
        .unwrap();
    host.finish().unwrap();
    let machine = std::fs::read(machine).unwrap();
    let (foreign, broken) = ((1, "is not a run log"), (10, "gerono recover"));
    let nothing = (1, "nothing to recover");
    let cases = [
        ("short", b"hi\n".to_vec(), foreign, foreign),
        ("text", b"not a log\n".repeat(9), foreign, foreign),
        (
            "picture",
            b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR".to_vec(),
            foreign,
            foreign,
        ),
        ("other", other.clone(), foreign, foreign),
        ("other-cut", other[..other.len() / 2].to_vec(), foreign, foreign),
        ("other-begun", other[..20].to_vec(), foreign, foreign),
        (
            "other-spoilt",
            with_flipped(&other, other.len() / 3),
            foreign,
            foreign,
        ),
        ("machine", machine.clone(), foreign, (0, "nothing to recover")),
        (
            "machine-cut",
            machine[..machine.len() - 40].to_vec(),
            foreign,
            (0, "kept 1 samples"),
        ),
        ("empty", Vec::new(), broken, nothing),
        ("begun", ours[..20].to_vec(), broken, nothing),
        (
            "other-begin",
            with_flipped(&ours, 0),
            broken,
            (0, "nothing is missing"),
        ),
        (
            "no-manifest",
            with_flipped(&ours, manifest_at + 5),
            broken,
            (1, "--scenario"),
        ),
    ];
    for (name, bytes, (code, piece), (recovers, tells)) in cases {
        let file = format!("{name}.mcap");
        std::fs::write(place.path(&file), bytes).unwrap();
        let readers: [&[&str]; 8] = [
            &["info", &file],
            &["digest", &file],
            &["export", &file],
            &["replay", &file, "--quiet"],
            &["diff", &file, &file],
            &["plot", &file, "--output", "plot.svg"],
            &["report", &file, "--output", "report"],
            &["view", &file, "--port", "0"],
        ];
        for arguments in readers {
            let said = complaint(&fails(&place, arguments, code));
            assert!(said.contains(piece), "{arguments:?}: {said}");
        }
        let saved = format!("{name}.saved.mcap");
        let ended = fails(&place, &["recover", &file, "--out", &saved], recovers);
        let said = format!("{} {}", text(&ended.stdout), complaint(&ended));
        assert!(said.contains(tells), "{name}: {said}");
    }
    assert!(complaint(&fails(&place, &["info", "missing.mcap"], 1)).contains("cannot read the log"));
}

/// Kills the orchestrator of a run once its log has so many bytes, and leaves the folder as it then is.
fn kill_at(place: &Place, child: Begun, out: &str, bytes: u64) {
    place.await_log(out, bytes);
    signal(child.id(), Signal::KILL);
    finish(child);
    let exists = |name| place.path(out).join(name).exists();
    assert!(exists("run.mcap.partial") && !exists("run.mcap"));
}

fn recovered(place: &Place, out: &str) -> PathBuf {
    place.path(out).join("run.recovered.mcap")
}

#[test]
fn a_killed_recorder_loses_less_than_a_chunk_and_the_rest_is_a_prefix_of_the_whole_flight() {
    let place = Place::new();
    succeed(&mut place.short_flight("whole", 20.0, &["--host", "inprocess"]));
    kill_at(
        &place,
        begin(&mut place.short_flight("out", 20.0, &[])),
        "out",
        1_000_000,
    );
    // Everyone who opens it says what it is and what to do.
    for command in ["digest", "diff"] {
        let mut arguments = vec![command, "out"];
        arguments.extend((command == "diff").then_some("out"));
        let ended = fails(&place, &arguments, 10);
        assert!(complaint(&ended).contains("gerono recover"), "{command}");
    }
    let shown = text(&fails(&place, &["info", "out"], 10).stdout);
    assert!(
        shown.contains("never closed") && shown.contains("gerono recover"),
        "{shown}"
    );

    let said = text(&succeed(&mut place.gerono(&["recover", "out"])).stdout);
    assert!(
        said.contains("run.recovered.mcap") && said.contains("never closed"),
        "{said}"
    );
    let (samples, end) = read(&recovered(&place, "out"));
    end.unwrap();
    let (all, _) = read(&place.path("whole").join("run.mcap"));
    assert!(samples.len() > 1000 && samples.len() < all.len() && all.starts_with(&samples));
    // 250 ticks a chunk: what had been flown beyond the last is less than a chunk. If the kill came in the middle of
    // writing one, its whole messages are kept besides, without their checksum.
    let recovery = LogReader::open(&recovered(&place, "out"))
        .unwrap()
        .recovery()
        .cloned()
        .unwrap();
    let ends_with_a_chunk = (recovery.last_tick().unwrap() + 1) % 250 == 0;
    assert_eq!(ends_with_a_chunk, recovery.unverified == 0);

    let replayed = replay(&recovered(&place, "out"), &Options::default(), None).unwrap();
    assert!(replayed.is_identical(), "{:?}", replayed.first_difference());
    assert!(replayed.compared() > 1000 && replayed.log_ends.is_some());
    let cut = text(&fails(&place, &["replay", "out", "--quiet"], 10).stdout);
    let agree = format!(
        "in the intact part of the log: all {} samples",
        replayed.compared()
    );
    assert!(
        cut.contains("The log was recovered: it ends") && cut.contains(&agree) && !cut.contains("identical"),
        "{cut}"
    );
    // A part that the log has is whole.
    let part = succeed(&mut place.gerono(&["replay", "out", "--to", "0.2", "--quiet"]));
    assert!(
        text(&part.stdout).contains("identical: "),
        "{}",
        text(&part.stdout)
    );
    let digest = succeed(&mut place.gerono(&["digest", "out"]));
    assert!(
        text(&digest.stderr).contains("was recovered"),
        "{}",
        text(&digest.stderr)
    );
    fails(&place, &["recover", "out"], 4);
    let whole = succeed(&mut place.gerono(&["recover", "whole"]));
    assert!(text(&whole.stdout).contains("nothing to recover"));
    assert!(!recovered(&place, "whole").exists());
}

/// The bound holds for chunks and for what waits to be put in order (`SETTLING_NS`); what the machine adds is not the log's.
#[test]
fn a_killed_recorder_in_real_time_has_kept_chunks_of_an_eighth_of_a_second_and_both_logs_are_recovered() {
    let place = Place::new();
    kill_at(&place, begin(&mut place.live_hover("out", &[])), "out", 1_500_000);
    succeed(&mut place.gerono(&["recover", "out"]));
    let log = recovered(&place, "out");
    let file = std::fs::read(&log).unwrap();
    let summary = mcap::Summary::read(&file).unwrap().unwrap();
    assert!(summary.chunk_indexes.len() > 3);
    for chunk in &summary.chunk_indexes {
        let span_ns = chunk.message_end_time - chunk.message_start_time;
        assert!(span_ns <= 200_000_000, "a chunk of {span_ns} ns");
    }
    let host = place.path("out").join("host.recovered.mcap");
    assert!(is_whole(&host).unwrap());
    let replayed = replay(&log, &Options::default(), None).unwrap();
    assert!(
        replayed.in_real_time && replayed.is_identical(),
        "{:?}",
        replayed.first_difference()
    );
}

#[test]
fn a_replay_of_a_recovered_log_does_not_go_beyond_where_samples_are_missing() {
    let place = Place::new();
    succeed(&mut place.short_flight("out", 2.0, &["--host", "inprocess"]));
    let log = place.path("out").join("run.mcap");
    let mut file = std::fs::read(&log).unwrap();
    let chunks = mcap::Summary::read(&file).unwrap().unwrap().chunk_indexes;
    file[usize::try_from(chunks[4].chunk_start_offset).unwrap() + 1000] ^= 1;
    std::fs::write(&log, &file).unwrap();
    let ended = fails(&place, &["digest", "out"], 10);
    assert!(
        complaint(&ended).contains("gerono recover"),
        "{}",
        complaint(&ended)
    );
    let info = fails(&place, &["info", "out", "--json"], 10);
    let info: serde_json::Value = serde_json::from_slice(&info.stdout).unwrap();
    assert_eq!((&info["state"], &info["chunks"]), (&"damaged".into(), &4.into()));

    succeed(&mut place.gerono(&["recover", "out/run.mcap", "--out", "new.mcap"]));
    let info = succeed(&mut place.gerono(&["info", "new.mcap", "--json"]));
    let info: serde_json::Value = serde_json::from_slice(&info.stdout).unwrap();
    assert_eq!(info["state"], "recovered");
    let truth = &info["topics"][0];
    assert_eq!((&truth["gaps"], &truth["missing"]), (&1.into(), &250.into()));
    let replayed = replay(&place.path("new.mcap"), &Options::default(), None).unwrap();
    // Flown in one process, it has no checkpoints with which services could go on.
    assert!(!replayed.is_identical() && replayed.lacks_samples && replayed.steps_without_inputs > 0);
    assert_eq!(
        (replayed.first_difference(), replayed.compared()),
        (None, 8 * 1000)
    );
}

#[test]
fn a_topic_is_exported_as_a_table_with_the_numbers_of_the_log() {
    let place = Place::new();
    succeed(&mut place.short_flight("out", 0.5, &["--host", "inprocess"]));
    let arguments = [
        "export",
        "out",
        "--csv",
        "--topic",
        "vehicle/truth",
        "--every",
        "100",
    ];
    let table = text(&succeed(&mut place.gerono(&arguments)).stdout);
    let mut lines = table.lines();
    let names: Vec<_> = lines.next().unwrap().split(',').collect();
    assert_eq!(names[..3], ["header.tick", "header.stamp_ns", "header.seq"]);
    let rows: Vec<Vec<&str>> = lines.map(|line| line.split(',').collect()).collect();
    assert_eq!(rows.len(), 6);
    let arguments = ["export", "out", "--topic", "vehicle/truth", "--every", "100"];
    let json = text(&succeed(&mut place.gerono(&arguments)).stdout);
    for (row, line) in rows.iter().zip(json.lines()) {
        let line: serde_json::Value = serde_json::from_str(line).unwrap();
        let position = names.iter().position(|name| *name == "position_world.2").unwrap();
        let exact = line["sample"]["position_world"][2].as_f64().unwrap();
        assert_eq!(row[position].parse::<f64>().unwrap().to_bits(), exact.to_bits());
        assert_eq!(row.len(), names.len());
    }
    let wrong = fails(&place, &["export", "out", "--csv", "--topic", "vehicle/truh"], 2);
    assert!(
        text(&wrong.stderr).contains("vehicle/truth"),
        "{}",
        text(&wrong.stderr)
    );
    fails(&place, &["export", "out", "--csv"], 2);
}

#[test]
fn what_a_log_or_a_scenario_says_does_not_reach_the_terminal_as_it_is() {
    let place = Place::new();
    // Sequences that clear the screen and name the window, one that turns text around, and a line that pretends to be another.
    let hostile = r#"description="\u001b[2J\u001b]0;owned\u0007\u009b31m\u202e\ncomplete""#;
    let flown = succeed(&mut place.short_flight("out", 0.1, &["--host", "inprocess", "--set", hostile]));
    let info = succeed(&mut place.gerono(&["info", "out"]));
    let json = succeed(&mut place.gerono(&["info", "out", "--json"]));
    let fig1 = common::scenario("fig1");
    let checked = succeed(&mut place.gerono(&["check", fig1.to_str().unwrap(), "--set", hostile]));
    let misplaced = r#"controller."\u001b[2J"=1"#;
    let refused = output(&mut place.gerono(&["check", fig1.to_str().unwrap(), "--set", misplaced]));
    assert_eq!(refused.status.code(), Some(2));
    for output in [&flown, &info, &json, &checked, &refused] {
        let said = common::said(output);
        let hidden = |character: char| {
            (character.is_control() && character != '\n') || matches!(character, '\u{202a}'..='\u{202e}')
        };
        assert!(!said.contains(hidden), "{said:?}");
    }
    let said = String::from_utf8(info.stdout).unwrap();
    assert!(said.contains("\ncontrol law: adaptive\n"), "{said}");
    assert!(
        said.contains(r"\u001b[2J") && said.contains(r"\u000acomplete"),
        "{said}"
    );
    let json: serde_json::Value = serde_json::from_slice(&json.stdout).unwrap();
    let description = json["scenario"]["description"].as_str().unwrap();
    assert!(description.starts_with("\u{1b}[2J") && description.ends_with("\u{202e}\ncomplete"));
}
