//! Results of commands are whole or not there: a command that fails, or is given a file that it reads as its target, costs no
//! log and no earlier result.

#![expect(clippy::disallowed_methods, reason = "tests make their own files")]

use crate::common;

use std::fs;
use std::os::unix::fs::symlink;
use std::process::{Command, Stdio};

use common::{Place, complaint, output, succeed};

/// A place with a flight in the folder `out`, and the bytes of its log.
fn flown(more: &[&str]) -> (Place, Vec<u8>) {
    let place = Place::new();
    let coarse = ["--set", "schedule.tick=0.005", "--host", "inprocess", "--quiet"];
    succeed(place.short_flight("out", 2.0, &coarse).args(more));
    let log = fs::read(place.log("out")).unwrap();
    (place, log)
}

/// Names in the folder of the flight, sorted.
fn names(place: &Place) -> Vec<String> {
    let entries = fs::read_dir(place.path("out")).unwrap();
    let mut names: Vec<_> = entries
        .map(|entry| entry.unwrap().file_name().into_string().unwrap())
        .collect();
    names.sort();
    names
}

/// Runs a command of a shell in the place, with `gerono` as `$0`.
fn shell(place: &Place, script: &str) -> std::process::Output {
    let mut command = Command::new("sh");
    command
        .args(["-c", script, env!("CARGO_BIN_EXE_gerono")])
        .current_dir(place.path("."))
        .stdin(Stdio::null());
    command.output().unwrap()
}

#[test]
fn a_disk_that_is_full_during_a_recovery_costs_nothing_of_the_source() {
    let (place, log) = flown(&[]);
    let partial = place.path("out/run.mcap.partial");
    fs::rename(place.log("out"), &partial).unwrap();
    let cut = &log[..log.len() * 9 / 10];
    fs::write(&partial, cut).unwrap();
    let before = names(&place);

    // A third of the log; the unit is 512 or 1024 bytes by shell.
    let blocks = log.len() / 3 / 1024;
    let full = shell(
        &place,
        &format!("ulimit -f {blocks}; exec \"$0\" recover out/run.mcap.partial --out out/run.mcap"),
    );
    assert_eq!(full.status.code(), Some(4), "{}", complaint(&full));
    assert!(
        complaint(&full).contains("nothing of it is kept"),
        "{}",
        complaint(&full)
    );
    assert_eq!(fs::read(&partial).unwrap(), cut);
    assert_eq!(names(&place), before);

    succeed(&mut place.gerono(&["recover", "out/run.mcap.partial", "--out", "out/run.mcap"]));
    assert_eq!(fs::read(&partial).unwrap(), cut);
    assert!(place.log("out").exists());
}

#[test]
fn no_command_overwrites_a_file_that_it_reads() {
    let (place, log) = flown(&[]);
    symlink("run.mcap", place.path("out/link.svg")).unwrap();
    fs::hard_link(place.log("out"), place.path("out/hard.csv")).unwrap();
    let csv = ["export", "out", "--csv", "--topic", "vehicle/truth", "--out"];
    let commands: [(&[&str], &str); 6] = [
        (&csv, "out/run.mcap"),
        (&csv, "out/hard.csv"),
        (&csv, "out/../out/run.mcap"),
        (&["export", "out", "--out"], "out/run.mcap"),
        (&["export", "out", "--view", "--out"], "out/hard.csv"),
        (&["plot", "out", "-o"], "out/link.svg"),
    ];
    for (command, target) in commands {
        let arguments = [command, &[target]].concat();
        let refused = output(&mut place.gerono(&arguments));
        assert_ne!(refused.status.code(), Some(0), "{arguments:?}");
        assert!(
            complaint(&refused).contains("name another file"),
            "{}",
            complaint(&refused)
        );
        assert!(fs::read(place.log("out")).unwrap() == log, "{arguments:?}");
    }
    // A link to another log than the one that is read is replaced, and that log stays.
    let other = place.path("other.mcap");
    fs::write(&other, "another log").unwrap();
    symlink(&other, place.path("figure.svg")).unwrap();
    succeed(&mut place.gerono(&["plot", "out", "-o", "figure.svg"]));
    assert_eq!(fs::read(&other).unwrap(), b"another log");
    assert!(
        fs::read_to_string(place.path("figure.svg"))
            .unwrap()
            .starts_with("<svg")
    );
}

#[test]
fn no_command_overwrites_a_file_of_another_kind() {
    let (place, log) = flown(&[]);
    fs::create_dir(place.path("other")).unwrap();
    let others = ["other/run.mcap", "other/summary.json", "other/fig1.toml"];
    let scenario = fs::read(common::scenario("fig1")).unwrap();
    let contents = [log, fs::read(place.path("out/summary.json")).unwrap(), scenario];
    for (other, content) in others.iter().zip(&contents) {
        fs::write(place.path(other), content).unwrap();
    }
    let results = [
        (
            "f.csv",
            &["export", "out", "--csv", "--topic", "vehicle/truth", "-o"][..],
        ),
        ("f.jsonl", &["export", "out", "--every", "100", "-o"]),
        ("f.view.mcap", &["export", "out", "--view", "-o"]),
        ("f.svg", &["plot", "out", "-o"]),
    ];
    for (own, command) in results {
        for other in others.iter().filter(|_| command[0] != "plot") {
            let refused = output(&mut place.gerono(&[command, &[other]].concat()));
            assert_eq!(refused.status.code(), Some(4), "{command:?} {other}");
            assert!(
                complaint(&refused).contains("name another file"),
                "{}",
                complaint(&refused)
            );
        }
        for _ in 0..2 {
            succeed(&mut place.gerono(&[command, &[own]].concat()));
        }
    }
    for (other, content) in others.iter().zip(&contents) {
        assert!(&fs::read(place.path(other)).unwrap() == content, "{other}");
    }
}

#[test]
fn a_command_that_fails_leaves_the_earlier_result() {
    let (place, log) = flown(&[]);
    let table = place.path("p.csv");
    let csv = |log: &str| {
        let arguments = [
            "export",
            log,
            "--csv",
            "--topic",
            "vehicle/truth",
            "--out",
            "p.csv",
        ];
        output(&mut place.gerono(&arguments))
    };
    assert_eq!(csv("out").status.code(), Some(0));
    let before = fs::read(&table).unwrap();
    assert!(before.starts_with(b"header.tick"));
    fs::write(place.path("cut.mcap"), &log[..log.len() / 2]).unwrap();
    for (log, code) in [("nothere", 1), ("cut.mcap", 10)] {
        assert_eq!(csv(log).status.code(), Some(code), "{log}");
        assert_eq!(fs::read(&table).unwrap(), before, "{log}");
    }
    let full = shell(
        &place,
        "ulimit -f 1; exec \"$0\" export out --csv --topic vehicle/truth --out p.csv",
    );
    assert_eq!(full.status.code(), Some(4), "{}", complaint(&full));
    assert_eq!(fs::read(&table).unwrap(), before);
}

#[test]
fn standard_output_pipes_and_devices_are_targets_as_before() {
    let (place, _) = flown(&[]);
    let table = "export out --csv --topic vehicle/truth --out";
    let expected = shell(&place, &format!("exec \"$0\" {table} -")).stdout;
    assert!(expected.starts_with(b"header.tick") && expected.len() > 10_000);
    let same = [
        format!("\"$0\" {table} /dev/stdout"),
        format!("\"$0\" {table} /dev/stdout | cat"),
        format!("\"$0\" {table} /dev/fd/3 3>&1"),
        format!("\"$0\" {table} /dev/stdout > direct; cat direct"),
        format!("mkfifo fifo; cat fifo & \"$0\" {table} fifo; wait"),
        format!("\"$0\" {table} /dev/null; \"$0\" {table} -"),
    ];
    for script in same {
        let found = shell(&place, &script);
        assert!(found.stdout == expected, "{script}: {}", complaint(&found));
        assert_eq!(complaint(&found), "", "{script}");
    }
    let appended = shell(
        &place,
        &format!("echo first > all; \"$0\" {table} /dev/stdout >> all; cat all"),
    );
    assert!(appended.stdout == [b"first\n", &expected[..]].concat());
}

#[test]
fn an_error_keeps_its_exit_code_although_standard_error_is_full() {
    let place = Place::new();
    for arguments in [
        ["info", "nothing"],
        ["run", "nothing.toml"],
        ["report", "nothing"],
    ] {
        let told = output(&mut place.gerono(&arguments)).status.code();
        let full = std::fs::OpenOptions::new().write(true).open("/dev/full").unwrap();
        let untold = place.gerono(&arguments).stderr(full).status().unwrap().code();
        assert_eq!(untold, told, "{arguments:?}");
        assert!(!matches!(told, None | Some(0 | 101)), "{arguments:?}: {told:?}");
    }
}

#[test]
fn results_that_a_full_standard_output_does_not_take_are_not_written() {
    let place = Place::new();
    for arguments in [&["schema"][..], &["header"], &["completions", "bash"], &["man"]] {
        let full = std::fs::OpenOptions::new().write(true).open("/dev/full").unwrap();
        let ended = place.gerono(arguments).stdout(full).output().unwrap();
        assert_eq!(ended.status.code(), Some(4), "{arguments:?}");
        assert!(complaint(&ended).contains("standard output"), "{arguments:?}");
    }
}
