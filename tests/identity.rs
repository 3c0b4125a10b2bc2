//! The determinism contract: the same scenario and seed give the same bytes of `run.mcap`,
//! in one process or six, pinned or not, on a quiet machine or a loaded one; an interrupted run is a prefix.

use crate::common;

use std::path::Path;
use std::process::{Child, Command};

use common::processes::signal;
use common::{Place, begin, finish, output, succeed, until};
use run_log::LogReader;
use rustix::process::Signal;

const SECONDS: f64 = 2.0;

fn log(place: &Place, out: &str) -> Vec<u8> {
    std::fs::read(place.path(out).join("run.mcap")).unwrap()
}

#[test]
fn six_processes_and_one_write_the_same_bytes() {
    let place = Place::new();
    for (out, more) in [
        ("first", &[][..]),
        ("second", &[]),
        ("unpinned", &["--no-pin"]),
        ("sleeping", &["--no-yield"]),
        ("fifo", &["--fifo"]),
        ("in-process", &["--host", "inprocess"]),
    ] {
        succeed(&mut place.short_flight(out, SECONDS, more));
        assert!(log(&place, out) == log(&place, "first"), "{out} differs");
    }
    assert_eq!(place.leftovers(), Vec::<String>::new());
}

/// The use of the machine is no part of the experiment: neither of its samples nor of the manifest.
#[test]
fn a_deployment_changes_no_byte() {
    let place = Place::new();
    let deployed = [
        "--set",
        "deployment={core=0, priority=30, lock_memory=true, timer_slack=1e-6, plant={core=1, priority=10}}",
        "--set",
        "real_time={grace=0.001, orchestrator_loss=\"continue\"}",
    ];
    let on_the_command_line = [&deployed[..], &["--core", "0", "--fifo"]].concat();
    let in_process = [&deployed[..], &["--host", "inprocess"]].concat();
    for (out, more) in [
        ("first", &[][..]),
        ("deployed", &deployed),
        ("on-the-command-line", &on_the_command_line),
        ("in-process", &in_process),
    ] {
        succeed(&mut place.short_flight(out, 0.5, more));
        assert!(log(&place, out) == log(&place, "first"), "{out} differs");
    }
    assert_eq!(place.leftovers(), Vec::<String>::new());
}

#[test]
fn the_rig_writes_the_same_bytes_from_six_processes_and_one() {
    let place = Place::new();
    for (out, more) in [
        ("first", &[][..]),
        ("second", &[]),
        ("sleeping", &["--no-yield"]),
        ("in-process", &["--host", "inprocess"]),
    ] {
        succeed(&mut place.rig_flight(out, 1.0, more));
        assert!(log(&place, out) == log(&place, "first"), "{out} differs");
    }
    succeed(&mut place.rig_flight("other", 1.0, &["--host", "inprocess", "--seed", "2"]));
    assert!(
        log(&place, "other") != log(&place, "first"),
        "the seed has no effect"
    );
    assert_eq!(place.leftovers(), Vec::<String>::new());
}

#[test]
fn a_loaded_machine_writes_the_same_bytes() {
    let place = Place::new();
    succeed(&mut place.short_flight("quiet", SECONDS, &[]));
    let _load = Load::start();
    succeed(&mut place.short_flight("loaded", SECONDS, &[]));
    succeed(&mut place.short_flight("loaded-unpinned", SECONDS, &["--no-pin"]));
    assert!(log(&place, "loaded") == log(&place, "quiet"));
    assert!(log(&place, "loaded-unpinned") == log(&place, "quiet"));
}

#[test]
fn every_compression_carries_the_same_messages() {
    let place = Place::new();
    let mut digests = Vec::new();
    for compression in ["none", "lz4", "zstd"] {
        for host in ["lockstep", "inprocess"] {
            let out = format!("{compression}-{host}");
            succeed(&mut place.short_flight(&out, 0.5, &["--compression", compression, "--host", host]));
            digests.push(succeed(&mut place.gerono(&["digest", &out])).stdout);
        }
        let pair = [
            format!("{compression}-lockstep"),
            format!("{compression}-inprocess"),
        ];
        assert!(log(&place, &pair[0]) == log(&place, &pair[1]), "{compression}");
    }
    assert!(digests.iter().all(|digest| *digest == digests[0]), "{digests:?}");
}

#[test]
fn a_log_that_is_forced_to_the_disk_holds_the_same_bytes() {
    let place = Place::new();
    let hosts = ["lockstep", "inprocess"];
    for host in hosts {
        let durable = ["--host", host, "--durable", "0.01"];
        succeed(&mut place.short_flight(host, 3.0, &durable));
    }
    succeed(&mut place.short_flight("plain", 3.0, &["--host", "inprocess"]));
    for host in hosts {
        assert!(log(&place, host) == log(&place, "plain"), "{host}");
    }
    for period in ["0", "-1", "NaN", "soon"] {
        let durable = format!("--durable={period}");
        let refused = output(&mut place.short_flight("refused", 1.0, &[&durable]));
        assert_eq!(refused.status.code(), Some(2), "{period}");
        assert!(!place.path("refused").exists());
    }
}

#[test]
fn another_scenario_writes_other_bytes() {
    let place = Place::new();
    succeed(&mut place.short_flight("one", 0.2, &["--host", "inprocess"]));
    succeed(&mut place.short_flight(
        "other",
        0.2,
        &["--host", "inprocess", "--set", "controller.k1=4.000001"],
    ));
    let digest = |out: &str| succeed(&mut place.gerono(&["digest", out])).stdout;
    assert_ne!(digest("one"), digest("other"));
}

#[test]
fn an_interrupted_run_is_a_prefix_that_ends_with_a_whole_tick() {
    let place = Place::new();
    succeed(&mut place.short_flight("whole", 60.0, &["--host", "inprocess"]));
    for (out, number) in [("interrupted", Signal::INT), ("terminated", Signal::TERM)] {
        let child = begin(&mut place.short_flight(out, 60.0, &[]));
        wait_for_ticks(&place.path(out));
        signal(child.id(), number);
        let output = finish(child);
        assert_eq!(output.status.code(), Some(128 + number.as_raw()), "{output:?}");
        assert_prefix(
            &place.path(out).join("run.mcap"),
            &place.path("whole").join("run.mcap"),
        );
        let summary = std::fs::read_to_string(place.path(out).join("summary.json")).unwrap();
        assert!(summary.contains("\"interrupted\""), "{summary}");
    }
    assert_eq!(place.leftovers(), Vec::<String>::new());
}

/// Waits until something of the flight itself is on disk.
fn wait_for_ticks(out: &Path) {
    let partial = out.join("run.mcap.partial");
    until("a first chunk of the log", || {
        std::fs::metadata(&partial)
            .ok()
            .filter(|metadata| metadata.len() > 500_000)
    });
}

/// The messages of `part` are the first ones of `whole`, up to the end of a tick.
fn assert_prefix(part: &Path, whole: &Path) {
    let (mut part, mut whole) = (LogReader::open(part).unwrap(), LogReader::open(whole).unwrap());
    let mut last = None;
    let mut count = 0;
    while let Some(sample) = part.next_sample().unwrap() {
        let other = whole.next_sample().unwrap().expect("not longer than the whole");
        assert_eq!((sample.topic, sample.bytes), (other.topic, other.bytes));
        last = Some(sample.header.tick);
        count += 1;
    }
    assert!(count > 1000, "only {count} samples");
    let next = whole.next_sample().unwrap().expect("shorter than the whole");
    assert_eq!(
        Some(next.header.tick),
        last.map(|tick| tick + 1),
        "a tick is torn"
    );
}

/// Busy processes, two a core.
struct Load(Vec<Child>);

impl Load {
    fn start() -> Self {
        let cores = std::thread::available_parallelism().unwrap().get();
        let spin = || {
            Command::new("sh")
                .args(["-c", "while :; do :; done"])
                .spawn()
                .unwrap()
        };
        Self((0..2 * cores).map(|_| spin()).collect())
    }
}

impl Drop for Load {
    fn drop(&mut self) {
        for child in &mut self.0 {
            child.kill().unwrap();
            child.wait().unwrap();
        }
    }
}
