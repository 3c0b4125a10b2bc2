//! The services' states in the log: replayed services start from them, a replay of a part of a flight begins with them,
//! and behind a gap services go on with it.

#![expect(clippy::disallowed_methods, reason = "tests make their own files")]

use crate::common;

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

use common::logs::{
    assert_only_the_controller_differs, published, replayed, replayed_with_another_controller,
};
use common::{Place, fly_to_the_end, output, succeed};
use replay::{Options, Replayed, replay};
use run_log::{
    Compression, HostEntry, HostLogWriter, HostReader, LogReader, LoggedCheckpoint, Manifest, RunLogWriter,
    ServiceStep,
};
use shared_types::{ServiceId, Topic};

const SERVICES: usize = ServiceId::ALL.len();

fn part(log: &Path, from: f64, to: f64) -> Replayed {
    let options = Options {
        from: Some(from),
        to: Some(to),
        ..Options::default()
    };
    replay(log, &options, None).unwrap()
}

/// The checkpoints beside a flight's log, each once.
fn recorded(log: &Path) -> BTreeMap<(ServiceId, u64), LoggedCheckpoint> {
    let host = log.with_file_name("host.mcap");
    let entries = HostReader::open(&host).unwrap().map(Result::unwrap);
    let checkpoints = entries.filter_map(|entry| match entry {
        HostEntry::Checkpoint(found) => Some(((found.service, found.checkpoint.next_tick), found)),
        HostEntry::Step(..) => None,
    });
    checkpoints.collect()
}

fn text_of(place: &Place, arguments: &[&str], code: i32) -> String {
    let ended = output(&mut place.gerono(arguments));
    let text = [ended.stdout, ended.stderr].concat();
    let text = String::from_utf8_lossy(&text).into_owned();
    assert_eq!(ended.status.code(), Some(code), "{text}");
    text
}

/// A flight of processes in simulated time, in whose log there are some checkpoints of every service.
fn flown_in_lock_step(place: &Place) -> PathBuf {
    succeed(&mut place.rig_flight("out", 6.0, &["--quiet"]));
    place.log("out")
}

#[test]
fn what_was_recorded_of_every_service_is_what_the_replayed_one_knows() {
    let place = Place::new();
    let log = flown_in_lock_step(&place);
    let recorded = recorded(&log);
    for service in ServiceId::ALL {
        let own = recorded.keys().filter(|(whose, _)| *whose == service);
        assert!(own.count() >= 3, "{service}");
    }
    let replayed = replayed(&log);
    assert!(replayed.is_identical(), "{:?}", replayed.first_checkpoint);
    assert_eq!(replayed.checkpoints, recorded.len() as u64);
    assert_eq!(replayed.resumptions, 0);
}

#[test]
fn a_part_of_a_flight_begins_with_checkpoints_and_is_compared_alone() {
    let place = Place::new();
    let log = flown_in_lock_step(&place);
    let found = part(&log, 3.2, 4.1);
    assert!(found.is_identical(), "{:?}", found.first_difference());
    assert_eq!(
        found.compared(),
        published(&log, |tick| (3200..=4100).contains(&tick))
    );
    assert_eq!(found.starts.len(), SERVICES);
    assert!(
        found
            .starts
            .iter()
            .all(|start| start.time > 0.0 && start.time <= 3.2)
    );
    let in_part = |&(_, next_tick): &(ServiceId, u64)| (3201..=4101).contains(&next_tick);
    let recorded = recorded(&log);
    assert_eq!(
        found.checkpoints,
        recorded.keys().copied().filter(in_part).count() as u64
    );
    let said = text_of(
        &place,
        &["replay", "out", "--from", "3.2", "--to", "4.1", "--quiet"],
        0,
    );
    assert!(
        said.contains("Started from checkpoints: plant at") && said.contains("identical: "),
        "{said}"
    );
    for (arguments, reason) in [
        (
            ["--from", "3.0", "--to", "2.0"],
            "between --from 3 s and --to 2 s",
        ),
        (["--from", "1.0", "--to", "7.0"], "--to 7 s is beyond it"),
        (["--from", "6.001", "--to", "7.0"], "--from 6.001 s is beyond it"),
    ] {
        let said = text_of(&place, &[&["replay", "out"], &arguments[..]].concat(), 2);
        assert!(said.contains(reason), "{said}");
    }
    let said = text_of(&place, &["replay", "out", "--from=-1"], 2);
    assert!(said.contains("give 0 to"), "{said}");
}

#[test]
fn a_part_of_a_flight_without_checkpoints_begins_with_the_flight() {
    let place = Place::new();
    succeed(&mut place.rig_flight("out", 2.0, &["--host", "inprocess", "--quiet"]));
    let log = place.log("out");
    let found = part(&log, 1.0, 1.5);
    assert!(found.is_identical() && found.starts.is_empty());
    assert_eq!(
        found.compared(),
        published(&log, |tick| (1000..=1500).contains(&tick))
    );
    let cut = place.path("cut.mcap");
    let whole = fs::read(&log).unwrap();
    fs::write(&cut, &whole[..whole.len() / 2]).unwrap();
    let said = text_of(&place, &["replay", "cut.mcap", "--from", "1.5", "--quiet"], 2);
    assert!(said.contains("--from 1.5 s is beyond it"), "{said}");
}

#[test]
fn a_part_of_a_flight_with_faults_sees_what_was_repeated_and_held_back_since_before_it() {
    let place = Place::new();
    let faults = "fault=[\
        {at = 0.9, edge = \"mocap/pose -> estimator\", kind = \"stuck\", for = 3.0}, \
        {at = 1.4, edge = \"vehicle/state -> controller\", kind = \"delay\", for = 1.0, by = 0.3}, \
        {at = 1.8, edge = \"control/command -> rc_output\", kind = \"intermittent\", for = 1.0, fraction = 0.5}, \
        {at = 2.2, service = \"path_generator\", kind = \"off\", for = 0.1, state = \"cold\"}]";
    fly_to_the_end(&mut place.rig_flight("out", 4.0, &["--quiet", "--set", faults]));
    let log = place.log("out");
    for (from, to) in [(1.6, 2.0), (2.1, 2.6), (2.25, 4.0)] {
        let found = part(&log, from, to);
        assert!(
            found.is_identical(),
            "{from}: {:?} {:?}",
            found.first_difference(),
            found.first_checkpoint
        );
        assert!(!found.starts.is_empty());
    }
}

#[test]
fn one_bit_of_a_checkpoint_that_is_not_as_it_was_is_found() {
    let place = Place::new();
    let log = flown_in_lock_step(&place);
    let mut checkpoints: Vec<_> = recorded(&log).into_values().collect();
    let of_the_controller = |found: &&mut LoggedCheckpoint| {
        found.service == ServiceId::Controller && found.checkpoint.next_tick > 1
    };
    let altered = checkpoints.iter_mut().find(of_the_controller).unwrap();
    altered.checkpoint.state[0] ^= 1;
    let after = altered.checkpoint.next_tick - 1;
    write_host_log(&log, &checkpoints);
    let found = replayed(&log);
    let first = found.first_checkpoint.unwrap();
    assert_eq!((first.service, first.tick), (ServiceId::Controller, after));
    assert_eq!(found.checkpoints_different, 1);
    assert!(!found.is_identical() && found.first_difference().is_none());
    let said = text_of(&place, &["replay", "out", "--quiet"], 8);
    let expected = format!("the state of `controller` after its step at tick {after} ");
    assert!(
        said.contains(&expected) && said.contains("not identical"),
        "{said}"
    );
}

#[test]
fn checkpoints_of_another_build_are_not_looked_at() {
    let place = Place::new();
    let log = flown_in_lock_step(&place);
    let recorded = recorded(&log);
    let of = |service| {
        let own = recorded.keys().filter(move |(whose, _)| *whose == service);
        own.map(|(_, next_tick)| *next_tick)
    };
    // On a busy machine the first ones come late.
    let all_known = ServiceId::ALL
        .into_iter()
        .filter_map(|service| of(service).next());
    let all_known = all_known.max().unwrap();
    // One that includes the last step of the flight is behind every part of it.
    let of_plant = of(ServiceId::Plant).filter(|&next_tick| next_tick <= 6000);
    let last_of_plant = of_plant.max().unwrap();
    assert!(all_known < last_of_plant);
    let mut checkpoints: Vec<_> = recorded.into_values().collect();
    for found in checkpoints
        .iter_mut()
        .filter(|found| found.service == ServiceId::Plant)
    {
        // Of one it is the layout that is strange, of the others the size.
        found.layout ^= u64::from(found.checkpoint.next_tick < last_of_plant);
        found.checkpoint.state.truncate(5);
    }
    write_host_log(&log, &checkpoints);
    for from in [all_known, last_of_plant] {
        #[expect(clippy::cast_precision_loss, reason = "few ticks, of 1 ms")]
        let from = from as f64 * 1e-3;
        let found = part(&log, from, 6.0);
        assert!(found.is_identical(), "{found:?}");
        assert_eq!(found.starts.len(), SERVICES - 1, "{found:?}");
        assert_eq!(found.foreign_checkpoints, [ServiceId::Plant]);
    }
}

#[test]
fn behind_a_gap_in_a_log_of_simulated_time_services_go_on_with_what_they_knew() {
    let place = Place::new();
    let log = flown_in_lock_step(&place);
    // Of a recovered log the last tick is not replayed: it may be broken.
    let whole = part(&log, 0.0, 5.999);
    let mut file = fs::read(&log).unwrap();
    let chunks = mcap::Summary::read(&file).unwrap().unwrap().chunk_indexes;
    file[usize::try_from(chunks[6].chunk_start_offset).unwrap() + 1000] ^= 1;
    fs::write(&log, &file).unwrap();
    succeed(&mut place.gerono(&["recover", "out"]));
    let recovered = place.path("out").join("run.recovered.mcap");

    let found = replayed(&recovered);
    assert!(!found.is_identical() && found.lacks_samples);
    assert_eq!((found.first_difference(), found.checkpoints_different), (None, 0));
    // Whose checkpoint lies in the gap goes on twice.
    assert!(found.resumptions >= SERVICES as u64);
    assert_eq!(found.steps + found.steps_without_inputs, whole.steps);
    assert!(found.compared() > published(&recovered, |tick| tick < 1500));
    let said = text_of(&place, &["replay", "out/run.recovered.mcap", "--quiet"], 8);
    assert!(said.contains("Resumed from a checkpoint"), "{said}");

    // Where nothing is missing, nothing is said of what is missing elsewhere.
    assert!(part(&recovered, 0.2, 1.2).is_identical());
    assert!(part(&recovered, 5.0, 5.9).is_identical());
    assert!(!part(&recovered, 1.2, 1.8).is_identical());

    let found = replayed_with_another_controller(&recovered);
    assert!(found.checkpoints == 0 && found.resumptions >= SERVICES as u64);
    assert_only_the_controller_differs(&found);
}

#[test]
fn where_the_recorder_in_real_time_has_dropped_samples_services_go_on_with_what_they_knew() {
    let place = Place::new();
    fly_to_the_end(&mut place.rig_flight("out", 3.5, &["--host", "realtime", "--quiet"]));
    let log = place.log("out");
    let whole = replayed(&log);
    assert!(
        whole.is_identical() && whole.in_real_time,
        "{:?} {:?}",
        whole.first_difference(),
        whole.first_checkpoint
    );
    assert!(whole.checkpoints > SERVICES as u64);
    let middle = part(&log, 1.6, 2.4);
    assert!(middle.is_identical() && middle.starts.len() == SERVICES);
    assert!(middle.starts.iter().all(|start| start.time > 0.0));
    assert!(middle.steps < whole.steps / 2 && middle.compared() > 0);

    let late = place.path("late");
    fs::create_dir(&late).unwrap();
    fs::copy(&log, late.join("run.mcap")).unwrap();
    write_checkpoints_last(&log, &late.join("host.mcap"));
    let late = replayed(&late.join("run.mcap"));
    assert!(late.is_identical(), "{:?}", late.first_checkpoint);
    assert_eq!(late.checkpoints, whole.checkpoints, "none is left out");

    let folder = place.path("holed");
    fs::create_dir(&folder).unwrap();
    fs::copy(log.with_file_name("host.mcap"), folder.join("host.mcap")).unwrap();
    let holed = folder.join("run.mcap");
    without(
        &log,
        &holed,
        Topic::VehicleState,
        state_seen_by_the_controller_at(&log, 1200),
    );
    let found = replayed(&holed);
    assert!(!found.is_identical());
    assert_eq!((found.first_difference(), found.checkpoints_different), (None, 0));
    assert!(found.steps_without_inputs > 0 && found.resumptions > 0);
    assert_eq!(found.steps + found.steps_without_inputs, whole.steps);
}

/// Number of the vehicle's state that the controller saw at its first step after a tick.
fn state_seen_by_the_controller_at(log: &Path, tick: u64) -> u64 {
    let mut inputs = ServiceId::Controller.inputs().iter();
    let input = inputs
        .position(|input| input.topic == Topic::VehicleState)
        .unwrap();
    let host = HostReader::open(&log.with_file_name("host.mcap")).unwrap();
    let mut steps = host.steps().map(Result::unwrap);
    let is_it = |(service, step): &(ServiceId, ServiceStep)| {
        *service == ServiceId::Controller && step.tick >= tick && step.consumed[input] > 0
    };
    steps.find(is_it).unwrap().1.consumed[input] - 1
}

/// Writes a log again without the sample of a number.
fn without(from: &Path, to: &Path, topic: Topic, seq: u64) {
    let mut reader = LogReader::open(from).unwrap();
    let manifest = Manifest::new(&reader.manifest().scenario);
    let mut writer = RunLogWriter::create(to, &manifest, Compression::None).unwrap();
    while let Some(sample) = reader.next_sample().unwrap() {
        if (sample.topic, sample.header.seq) != (topic, seq) {
            writer.write(sample.topic, sample.bytes).unwrap();
        }
    }
    writer.finish().unwrap();
}

/// Writes the record of the machine beside a log again, with all checkpoints behind all steps.
fn write_checkpoints_last(log: &Path, to: &Path) {
    let mut writer = HostLogWriter::create(to, Compression::None).unwrap();
    let host = || HostReader::open(&log.with_file_name("host.mcap")).unwrap();
    for (_, step) in host().steps().map(Result::unwrap) {
        writer.write(&step).unwrap();
    }
    for entry in host().map(Result::unwrap) {
        if let HostEntry::Checkpoint(found) = entry {
            found.pieces(0).for_each(|piece| writer.write(&piece).unwrap());
        }
    }
    writer.finish().unwrap();
}

/// Writes a record of the machine beside a log that has these checkpoints alone.
fn write_host_log(log: &Path, checkpoints: &[LoggedCheckpoint]) {
    let mut writer = HostLogWriter::create(&log.with_file_name("host.mcap"), Compression::None).unwrap();
    for piece in checkpoints.iter().flat_map(|checkpoint| checkpoint.pieces(0)) {
        writer.write(&piece).unwrap();
    }
    writer.finish().unwrap();
}
