//! Logs in several files: every command reads them as one, whatever host has flown, and however the flight ended.
//! And logs of a part of the samples: what they have is as ever, and every command says what they have not.

#![expect(clippy::disallowed_methods, reason = "tests make their own files")]

use std::path::{Path, PathBuf};

use crate::common::processes::{fill_the_disk_of, signal};
use crate::common::{Place, begin, complaint, finish, output, said, succeed, until};
use run_log::{files_of_log, is_whole, written_files};
use rustix::process::Signal;

const EACH_SECOND: [&str; 2] = ["--set", "record.split.after_seconds=1"];

/// A flight of so many seconds to the folder `out`, whose log goes on in another file each second.
fn fly_split(place: &Place, out: &str, seconds: f64, more: &[&str]) {
    let arguments = [&EACH_SECOND, more].concat();
    succeed(&mut place.short_flight(out, seconds, &arguments));
}

fn names(files: &[PathBuf]) -> Vec<&str> {
    let names = files
        .iter()
        .map(|file| file.file_name().unwrap().to_str().unwrap());
    names.collect()
}

/// What a command says about a log.
fn answer(place: &Place, arguments: &[&str]) -> String {
    said(&succeed(&mut place.gerono(arguments)))
}

/// Demands that a replay with these arguments finds everything as it was recorded.
fn assert_replayed(place: &Place, arguments: &[&str]) {
    let words = answer(place, &[&["replay"], arguments].concat());
    assert!(
        words.contains("identical") && !words.contains("not identical"),
        "{words}"
    );
}

fn bytes(file: &Path) -> Vec<u8> {
    std::fs::read(file).unwrap()
}

#[test]
fn every_command_reads_a_split_log_as_one_and_every_host_writes_the_same_files() {
    let place = Place::new();
    succeed(&mut place.short_flight("whole", 3.0, &["--host", "inprocess"]));
    fly_split(&place, "split", 3.0, &["--host", "inprocess"]);
    fly_split(&place, "processes", 3.0, &[]);
    let files = files_of_log(&place.log("split"));
    assert_eq!(
        names(&files),
        ["run.mcap", "run.1.mcap", "run.2.mcap", "run.3.mcap"]
    );
    for (file, other) in files.iter().zip(files_of_log(&place.log("processes"))) {
        assert!(bytes(file) == bytes(&other), "{file:?}");
    }

    for command in [
        &["digest"][..],
        &["export", "--topic", "control/errors", "--csv"],
        &["export", "--every", "100"],
    ] {
        let of = |log| answer(&place, &[command, &[log]].concat());
        let expected = of("whole");
        assert!(
            of("split") == expected && of("split/run.mcap") == expected,
            "{command:?}"
        );
        assert!(of("processes") == expected, "{command:?}");
    }
    assert!(answer(&place, &["diff", "whole", "split"]).starts_with("identical"));
    for flight in ["split", "processes"] {
        assert_replayed(&place, &[flight]);
    }
    assert_replayed(&place, &["processes", "--from", "1.5", "--to", "2.5"]);

    let info = |log| -> serde_json::Value {
        serde_json::from_str(&answer(&place, &["info", log, "--json"])).unwrap()
    };
    let (whole, split) = (info("whole"), info("split"));
    for key in ["state", "samples", "topics", "judged", "chunks", "last_tick"] {
        assert_eq!(whole[key], split[key], "{key}");
    }
    assert_eq!((&whole["files"], &split["files"]), (&1.into(), &4.into()));
    let sizes = files.iter().map(|file| bytes(file).len() as u64);
    assert_eq!(split["bytes"], sizes.sum::<u64>());

    for log in ["whole", "split"] {
        succeed(&mut place.gerono(&["plot", log, "-o", &format!("{log}.svg")]));
        succeed(&mut place.gerono(&["export", log, "--view", "--out", &format!("{log}.view.mcap")]));
        succeed(&mut place.gerono(&["report", log, "-o", &format!("{log}-report")]));
        answer(&place, &["recover", log]);
    }
    let messages = |log: &str| {
        let file = bytes(&place.path(log));
        let messages = mcap::MessageStream::new(&file).unwrap();
        messages
            .map(|message| message.unwrap().data.into_owned())
            .collect::<Vec<_>>()
    };
    assert!(messages("whole.view.mcap") == messages("split.view.mcap"));
    assert!(place.path("split-report").exists() && place.path("split.svg").exists());
    assert_eq!(written_files(&place.log("split")), files, "nothing was recovered");
}

#[test]
fn a_killed_orchestrator_leaves_whole_files_and_a_newest_one_that_is_recovered() {
    let place = Place::new();
    let run = begin(&mut place.short_flight("out", 100.0, &EACH_SECOND));
    let newest = place.path("out/run.2.mcap.partial");
    until("a chunk of the third file", || {
        let size = std::fs::metadata(&newest).map_or(0, |file| file.len());
        (size > 100_000).then_some(())
    });
    signal(run.id(), Signal::KILL);
    finish(run);
    let files = written_files(&place.log("out"));
    let (newest, before) = files.split_last().unwrap();
    assert!(newest.to_str().unwrap().ends_with(".partial"));
    assert!(before.len() >= 2);
    assert!(before.iter().all(|file| is_whole(file).unwrap()), "{before:?}");
    let refused = output(&mut place.gerono(&["digest", "out"]));
    let reason = complaint(&refused);
    assert!(
        refused.status.code() == Some(10) && reason.contains(".mcap.partial was never completed"),
        "{reason}"
    );
    answer(&place, &["recover", "out"]);
    assert!(!place.path("out/run.recovered.mcap").exists());
    let replayed = output(&mut place.gerono(&["replay", "out"]));
    let words = String::from_utf8_lossy(&replayed.stdout);
    assert!(
        replayed.status.code() == Some(10) && words.contains("samples") && words.contains("agree"),
        "{words} {}",
        complaint(&replayed)
    );
    assert!(answer(&place, &["info", "out"]).contains("recovered"));
}

#[test]
fn a_full_disk_ends_the_run_with_the_newest_file_incomplete() {
    let place = Place::new();
    let run = begin(&mut place.short_flight("out", 100.0, &EACH_SECOND));
    until("the third file", || {
        place.path("out/run.2.mcap.partial").exists().then_some(())
    });
    fill_the_disk_of(run.id());
    let ended = finish(run);
    assert_eq!(ended.status.code(), Some(4), "{}", complaint(&ended));
    assert!(
        complaint(&ended).contains(".mcap.partial"),
        "{}",
        complaint(&ended)
    );
    let files = written_files(&place.log("out"));
    // The disk may have been full just when the third file was begun, so that the second one is incomplete as well.
    let whole = files.iter().take_while(|file| is_whole(file).unwrap()).count();
    assert!(whole >= 1 && whole < files.len(), "{files:?}");
    let is_incomplete = |file: &PathBuf| file.to_str().unwrap().ends_with(".mcap.partial");
    assert!(files[whole..].iter().all(is_incomplete), "{files:?}");
    answer(&place, &["recover", "out"]);
    let summary = answer(&place, &["info", "out"]);
    assert!(summary.contains("recovered"), "{summary}");
}

#[test]
fn a_missing_file_is_named_and_the_replay_says_what_it_could_not_do() {
    let place = Place::new();
    fly_split(&place, "out", 3.0, &["--host", "inprocess"]);
    let digest = answer(&place, &["digest", "out"]);
    std::fs::rename(place.path("out/run.1.mcap"), place.path("lost.mcap")).unwrap();
    for command in [
        &["digest", "out"][..],
        &["diff", "out", "out"],
        &["export", "out"],
    ] {
        let refused = output(&mut place.gerono(command));
        assert_eq!(refused.status.code(), Some(10), "{command:?}");
        let reason = complaint(&refused);
        assert!(
            reason.contains("run.1.mcap") && reason.contains("missing"),
            "{reason}"
        );
    }
    let shown = output(&mut place.gerono(&["info", "out"]));
    assert_eq!(shown.status.code(), Some(10));
    let shown = said(&shown);
    assert!(
        shown.contains("run.1.mcap") && shown.contains("missing"),
        "{shown}"
    );
    answer(&place, &["recover", "out"]);
    let replayed = output(&mut place.gerono(&["replay", "out"]));
    assert_eq!(replayed.status.code(), Some(8));
    let words = said(&replayed);
    assert!(
        words.contains("not identical") && words.contains("were not recorded"),
        "{words}"
    );
    // Services of a flight in one process have no checkpoints to go on from.
    assert!(words.contains("steps could not be repeated"), "{words}");
    // The file is found again: the log is whole, and the note does not say that it ends where the recovered file does.
    std::fs::rename(place.path("lost.mcap"), place.path("out/run.1.mcap")).unwrap();
    let whole = succeed(&mut place.gerono(&["digest", "out"]));
    assert_eq!(String::from_utf8_lossy(&whole.stdout), digest);
    let note = complaint(&whole);
    assert!(
        note.contains("the log goes on in its file 1") && !note.contains("planned end"),
        "{note}"
    );
}

#[test]
fn a_flight_in_real_time_is_split_without_a_gap() {
    let place = Place::new();
    let settings = ["duration=3.0", "record.split.after_seconds=1"];
    succeed(
        place
            .live_flight("hover", "out", &settings)
            .args(["--durable", "0.2"]),
    );
    let info: serde_json::Value = serde_json::from_str(&answer(&place, &["info", "out", "--json"])).unwrap();
    assert_eq!(info["state"], "complete");
    assert!(info["files"].as_u64() >= Some(3), "{}", info["files"]);
    // Steps that a busy machine lets fall out are not flown; what was published is recorded.
    for topic in place.summary("out")["topics"].as_array().unwrap() {
        assert_eq!(topic["not_recorded"], 0, "{topic}");
    }
    assert_replayed(&place, &["out"]);
}

/// One in ten errors, one in a hundred samples of the adaptation, and nothing of the truth.
const IN_PART: [&str; 4] = [
    "--set",
    r#"record.every={"control/errors"=10,"control/adaptation"=100}"#,
    "--set",
    r#"record.leave_out=["vehicle/truth"]"#,
];

#[test]
fn a_log_has_the_samples_that_the_scenario_wants_and_the_summary_those_of_the_flight() {
    let place = Place::new();
    succeed(&mut place.short_flight("whole", 2.0, &["--host", "inprocess"]));
    succeed(&mut place.short_flight("part", 2.0, &[&IN_PART[..], &["--host", "inprocess"]].concat()));
    succeed(&mut place.short_flight("processes", 2.0, &IN_PART));
    assert!(bytes(&place.log("part")) == bytes(&place.log("processes")));
    let samples = |log, topic| -> Vec<serde_json::Value> {
        let text = answer(&place, &["export", log, "--topic", topic]);
        // Notes are no samples.
        let lines = text.lines().filter(|line| line.starts_with('{'));
        let samples = lines.map(|line| serde_json::from_str(line).unwrap());
        samples.collect()
    };
    for (topic, every) in [
        ("control/errors", 10),
        ("control/adaptation", 100),
        ("vehicle/state", 1),
        ("run/events", 1),
    ] {
        let expected: Vec<_> = samples("whole", topic).into_iter().step_by(every).collect();
        assert!(samples("part", topic) == expected, "{topic}");
    }
    assert_eq!(samples("part", "vehicle/truth"), [] as [serde_json::Value; 0]);

    let [whole, part] = ["whole", "part"].map(|flight| place.summary(flight));
    for key in ["stretches", "loss", "outcome"] {
        assert_eq!(whole[key], part[key], "{key}");
    }
    let counted = |summary: &serde_json::Value| -> Vec<_> {
        let topics = summary["topics"].as_array().unwrap().iter();
        let count = |topic: &serde_json::Value| {
            assert_eq!(
                (&topic["not_recorded"], &topic["not_flown"]),
                (&0.into(), &0.into())
            );
            topic["recorded"].as_u64().unwrap()
        };
        topics.map(count).collect()
    };
    assert_eq!(counted(&whole)[..3], [2001, 2001, 2001]);
    assert_eq!(counted(&part)[..3], [0, 2001, 2001]);
    let info = succeed(&mut place.gerono(&["info", "part", "--json"]));
    let info: serde_json::Value = serde_json::from_slice(&info.stdout).unwrap();
    assert_eq!(info["samples"], counted(&part).iter().sum::<u64>());
    for topic in info["topics"].as_array().unwrap() {
        assert_eq!(
            (&topic["gaps"], &topic["missing"]),
            (&0.into(), &0.into()),
            "{topic}"
        );
    }
}

#[test]
fn a_replay_says_what_it_cannot_prove_of_a_log_that_has_not_everything() {
    let place = Place::new();
    succeed(&mut place.short_flight("outputs", 2.0, &IN_PART));
    let replayed = succeed(&mut place.gerono(&["replay", "outputs"]));
    let words = said(&replayed);
    // 2001 of the truth, 1800 of the errors, 1980 of the adaptation.
    assert!(
        words.contains("5781 samples are excluded from the log"),
        "{words}"
    );
    assert!(
        words.contains("\nidentical: 10227 samples of 10005 steps"),
        "{words}"
    );
    let note = complaint(&replayed);
    assert!(
        note.contains("nothing of vehicle/truth, one in 100 samples of control/adaptation"),
        "{note}"
    );

    let inputs = ["--set", r#"record.every={"vehicle/state"=2}"#];
    succeed(&mut place.short_flight("inputs", 2.0, &inputs));
    let words = answer(&place, &["replay", "inputs"]);
    let names_service = words.contains("The steps of controller cannot be repeated");
    assert!(names_service && words.contains("`vehicle/state`"), "{words}");
    assert!(words.contains("\nidentical: "), "{words}");
    let alone = output(&mut place.gerono(&["replay", "inputs", "--service", "controller"]));
    assert_eq!(alone.status.code(), Some(8), "nothing was compared");
    // A sample that is not as recorded is found all the same.
    let changed = output(&mut place.gerono(&["replay", "outputs", "--set", "controller.k1=1.5"]));
    assert!(said(&changed).contains("not identical"), "{}", said(&changed));
}

#[test]
fn a_recovered_log_of_a_part_counts_what_is_lost_of_that_part() {
    let place = Place::new();
    let part = [&IN_PART[..], &["--host", "inprocess"]].concat();
    succeed(&mut place.short_flight("out", 2.0, &part));
    let log = place.log("out");
    let mut damaged = bytes(&log);
    let middle = damaged.len() / 2;
    damaged[middle] ^= 1;
    std::fs::write(place.path("damaged.mcap"), damaged).unwrap();
    let words = answer(&place, &["recover", "damaged.mcap", "--out", "saved.mcap"]);
    // A chunk of 250 ticks.
    assert!(
        words.contains("250 of vehicle/state") && words.contains("25 of control/errors"),
        "{words}"
    );
}
