//! Replays: what the services make of their recorded inputs is what was recorded, whatever happened in the flight;
//! and what is not is found.

#![expect(clippy::disallowed_methods, reason = "tests make their own files")]

use crate::common;
use crate::plugins::compile;

use std::path::{Path, PathBuf};

use common::logs::{
    assert_only_the_controller_differs, published, replayed, replayed_with_another_controller,
};
use common::processes::{await_process, await_successor, signal};
use common::{Place, begin, finish, fly_to_the_end, output, scenario, succeed};
use run_log::{Compression, LogReader, Manifest, RunLogWriter};
use rustix::process::Signal;
use shared_types::samples::ControlCommand;
use shared_types::{ServiceId, Topic};
use zerocopy::FromBytes;

#[test]
fn every_scenario_is_replayed_identically() {
    let place = Place::new();
    let scenarios = std::fs::read_dir(scenario("fig1").parent().unwrap()).unwrap();
    let names: Vec<_> = scenarios
        .map(|entry| entry.unwrap().path())
        .filter(|path| path.extension().is_some_and(|extension| extension == "toml"))
        .collect();
    assert!(names.len() > 10);
    for path in names {
        let out = path.file_stem().unwrap().to_str().unwrap().to_owned();
        let arguments = [
            "run",
            path.to_str().unwrap(),
            "--host",
            "inprocess",
            "--quiet",
            "--out",
            &out,
        ];
        let mut command = place.gerono(&arguments);
        let stated = scenario_file::load(&path, &[], None).unwrap();
        // As it is tried without a laboratory.
        let without = [
            (
                stated.capture_system().is_some(),
                ["motion_capture.source=simulated", "flight.arm_at=2.0"],
            ),
            (
                stated.real_receivers().is_some(),
                ["receivers.sources=[]", "flight.arm_at=14.0"],
            ),
        ];
        for (_, settings) in without.iter().filter(|(is_stated, _)| *is_stated) {
            command.args(settings.iter().flat_map(|setting| ["--set", setting]));
        }
        succeed(&mut command);
        let log = place.log(&out);
        let replayed = replayed(&log);
        assert!(
            replayed.is_identical(),
            "{out}: {:?}",
            replayed.first_difference()
        );
        assert_eq!(replayed.compared(), published(&log, |_| true), "{out}");
        std::fs::remove_dir_all(place.path(&out)).unwrap();
    }
}

/// Logs of earlier versions, in folders named by their commits.
fn old_log(commit: &str, kind: &str) -> PathBuf {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../tests/old_logs");
    folder.join(commit).join(kind).join("run.mcap")
}

/// In lock step, in several files, and in real time with services that died.
#[test]
fn logs_of_earlier_versions_are_replayed_identically() {
    for commit in ["f7d5687", "3077b11a"] {
        for (kind, in_real_time) in [("lock_step", false), ("split", false), ("real_time", true)] {
            let replayed = replayed(&old_log(commit, kind));
            assert_eq!(replayed.in_real_time, in_real_time, "{commit} {kind}");
            assert!(replayed.compared() > 500, "{commit} {kind}");
            assert!(
                replayed.is_identical(),
                "{commit} {kind}: {:?}",
                replayed.first_difference()
            );
        }
    }
}

/// Its plug-in was compiled for the layouts of that version, and is compiled for those of now.
#[test]
fn a_log_of_an_earlier_version_is_replayed_identically_with_its_plug_in() {
    let place = Place::new();
    compile("examples/plugin_c/pid.c", &place.path("libpid.so"), &[]);
    let log = old_log("f7d5687", "plugin");
    let folder = format!("plugins.folder={:?}", place.path(""));
    let library = ["--set", &folder, "--set", "plugins.sha256={}"];
    succeed(
        place
            .gerono(&["replay", log.to_str().unwrap(), "--quiet"])
            .args(library),
    );
}

/// A copy states the layouts of its source, so that what they lack is not compared.
#[test]
fn a_recovered_log_of_an_earlier_version_is_replayed_identically() {
    let place = Place::new();
    let copy = place.path("run.mcap");
    let log = std::fs::read(old_log("f7d5687", "lock_step")).unwrap();
    std::fs::write(&copy, &log[..log.len() * 9 / 10]).unwrap();
    succeed(&mut place.gerono(&["recover", copy.to_str().unwrap()]));
    let recovered = replayed(&run_log::recovered_path(&copy));
    assert!(recovered.compared() > 300);
    assert!(recovered.is_identical(), "{:?}", recovered.first_difference());
}

#[test]
fn a_flight_of_processes_in_which_all_fails_is_replayed_identically() {
    let place = Place::new();
    let faults = "fault=[\
        {at = 0.2, service = \"controller\", kind = \"off\", for = 0.1, state = \"cold\"}, \
        {at = 0.4, service = \"estimator\", kind = \"freeze\", for = 0.05}, \
        {at = 0.5, edge = \"vehicle/state -> controller\", kind = \"delay\", for = 0.1, by = 0.02}, \
        {at = 0.6, edge = \"mocap/pose -> estimator\", kind = \"stuck\", for = 0.1}, \
        {at = 0.7, edge = \"control/command -> rc_output\", kind = \"intermittent\", for = 0.2, fraction = 0.5}]";
    fly_to_the_end(&mut place.rig_flight("out", 1.2, &["--set", faults]));
    let log = place.log("out");
    let replayed = replayed(&log);
    assert!(replayed.is_identical(), "{:?}", replayed.first_difference());
    assert_eq!(replayed.compared(), published(&log, |_| true));
}

#[test]
fn a_flight_in_real_time_is_replayed_identically_although_services_died_in_it() {
    let place = Place::new();
    let child = begin(&mut place.live_hover("out", &[]));
    place.await_log("out", 20_000);
    for service in [ServiceId::Controller, ServiceId::Estimator, ServiceId::Controller] {
        let pid = await_process(child.id(), service);
        signal(pid, Signal::KILL);
        await_successor(child.id(), service, pid);
        place.await_log("out", place.log_bytes("out") + 500_000);
    }
    signal(child.id(), Signal::INT);
    assert_eq!(finish(child).status.code(), Some(130));
    let replayed = replayed(&place.log("out"));
    assert!(replayed.in_real_time);
    assert!(replayed.is_identical(), "{:?}", replayed.first_difference());
}

#[test]
fn a_flight_in_real_time_is_replayed_identically_wherever_in_a_step_its_services_died() {
    let place = Place::new();
    let (mut command, deaths) = place.flight_with_deaths_everywhere("out");
    fly_to_the_end(&mut command);
    let summary = place.summary("out");
    // On a machine in use one may hang too, and be replaced.
    assert!(summary["restarts"].as_array().unwrap().len() >= deaths);
    let replayed = replayed(&place.log("out"));
    assert!(replayed.in_real_time);
    assert!(replayed.is_identical(), "{:?}", replayed.first_difference());
}

#[test]
fn samples_that_stand_in_the_log_far_behind_younger_ones_are_found() {
    let place = Place::new();
    fly_to_the_end(&mut place.rig_flight("out", 3.0, &["--host", "realtime"]));
    let before = replayed(&place.log("out"));
    // A controller that lags: what it publishes is recorded at the end of the flight, and in part comes seconds late.
    let late = |topic, tick| topic == Topic::ControlCommand && tick % 3 == 0;
    let late_log = place.path("out/late.mcap");
    rewrite_late(&place.log("out"), &late_log, late);
    std::fs::rename(&late_log, place.log("out")).unwrap();
    let after = replayed(&place.log("out"));
    assert!(after.in_real_time && after.compared() > 0);
    assert_eq!(after.comparisons, before.comparisons);
    assert_eq!(
        (after.steps, after.steps_without_inputs),
        (before.steps, before.steps_without_inputs)
    );
}

#[test]
fn one_bit_that_is_not_as_it_was_is_found() {
    let place = Place::new();
    succeed(&mut place.short_flight("out", 0.5, &["--host", "inprocess"]));
    let altered = place.path("altered.mcap");
    rewrite(&place.log("out"), &altered, |topic, tick, bytes| {
        if (topic, tick) == (Topic::ControlCommand, 123) {
            let command = ControlCommand::mut_from_bytes(bytes).unwrap();
            command.thrust = f64::from_bits(command.thrust.to_bits() ^ 1);
        }
    });
    let found = replayed(&altered);
    let first = found.first_difference().unwrap();
    assert_eq!(
        (first.topic, first.tick, first.field.as_str()),
        (Topic::ControlCommand, 123, "thrust")
    );
    assert_ne!(first.recorded, first.replayed);
    assert!(!found.is_identical());
    let output = output(&mut place.gerono(&["replay", altered.to_str().unwrap(), "--quiet"]));
    assert_eq!(output.status.code(), Some(8));
    let text = String::from_utf8_lossy(&output.stdout).into_owned();
    assert!(
        text.contains("tick 123") && text.contains("`thrust` of `control/command`"),
        "{text}"
    );
}

#[test]
fn a_log_that_breaks_off_is_replayed_as_far_as_it_goes() {
    let place = Place::new();
    succeed(&mut place.short_flight("out", 2.0, &["--host", "inprocess"]));
    let whole = std::fs::read(place.log("out")).unwrap();
    let cut = place.path("cut.mcap");
    std::fs::write(&cut, &whole[..whole.len() * 2 / 3]).unwrap();
    let replayed = replayed(&cut);
    assert!(replayed.is_identical() && replayed.log_ends.is_some());
    assert!(replayed.compared() > 1000);
}

#[test]
fn what_would_have_been_commanded_differs_where_the_change_acts_and_nowhere_else() {
    let place = Place::new();
    succeed(&mut place.short_flight("out", 0.5, &["--host", "inprocess"]));
    let log = place.log("out");
    assert_only_the_controller_differs(&replayed_with_another_controller(&log));
    let slower = place
        .gerono(&["replay", "out", "--set", "schedule.tick=0.002"])
        .output()
        .unwrap();
    assert_eq!(slower.status.code(), Some(2));
    assert!(String::from_utf8_lossy(&slower.stderr).contains("another schedule"));
}

/// Writes a log again, with the samples of which `is_late` says so behind all others.
fn rewrite_late(from: &Path, to: &Path, is_late: impl Fn(Topic, u64) -> bool) {
    let mut reader = LogReader::open(from).unwrap();
    let manifest = Manifest::new(&reader.manifest().scenario);
    let mut writer = RunLogWriter::create(to, &manifest, Compression::None).unwrap();
    let mut late = Vec::new();
    while let Some(sample) = reader.next_sample().unwrap() {
        let mut words = vec![0u64; sample.bytes.len().div_ceil(8)];
        let bytes = &mut zerocopy::IntoBytes::as_mut_bytes(words.as_mut_slice())[..sample.bytes.len()];
        bytes.copy_from_slice(sample.bytes);
        if is_late(sample.topic, sample.header.tick) {
            late.push((sample.topic, words, sample.bytes.len()));
        } else {
            writer.write(sample.topic, bytes).unwrap();
        }
    }
    for (topic, words, size) in late {
        let bytes = zerocopy::IntoBytes::as_bytes(words.as_slice());
        writer.write(topic, &bytes[..size]).unwrap();
    }
    writer.finish().unwrap();
}

/// Writes a log again, with samples changed.
fn rewrite(from: &Path, to: &Path, change: impl Fn(Topic, u64, &mut [u8])) {
    let mut reader = LogReader::open(from).unwrap();
    let manifest = Manifest::new(&reader.manifest().scenario);
    let mut writer = RunLogWriter::create(to, &manifest, Compression::None).unwrap();
    while let Some(sample) = reader.next_sample().unwrap() {
        let (topic, tick) = (sample.topic, sample.header.tick);
        // Whole words: samples are written in place.
        let mut words = vec![0u64; sample.bytes.len().div_ceil(8)];
        let bytes = &mut zerocopy::IntoBytes::as_mut_bytes(words.as_mut_slice())[..sample.bytes.len()];
        bytes.copy_from_slice(sample.bytes);
        change(topic, tick, bytes);
        writer.write(topic, bytes).unwrap();
    }
    writer.finish().unwrap();
}
