//! Effects of processes on each other, and their leftovers: deaths, neighbours, observers, full disks.

#![expect(clippy::disallowed_methods, reason = "tests make their own files")]

use crate::common;

use std::process::Command;

use common::logs::last_tick;
use common::processes::{await_end, processes_of, services_of, shared_memory_of, signal};
use common::{Begun, Place, begin, complaint, finish, output, scenario, succeed, until};
use iceoryx2::prelude::*;
use run_log::LogReader;
use rustix::process::Signal;
use shared_types::ServiceId;

/// Begins a long flight and waits until it is under way.
fn fly(place: &Place, out: &str) -> (Begun, Vec<(String, u32)>) {
    let child = begin(&mut place.short_flight(out, 3600.0, &[]));
    place.await_log(out, 500_000);
    let services = services_of(child.id());
    assert_eq!(services.len(), ServiceId::ALL.len());
    (child, services)
}

/// The samples of a log, as (topic, tick), if it can be read to its end.
#[test]
fn services_end_with_a_killed_orchestrator_and_the_next_run_sweeps_up() {
    let place = Place::new();
    let (child, _) = fly(&place, "killed");
    let orchestrator = child.id();
    let processes = until("a standby process beside the services", || {
        Some(processes_of(orchestrator)).filter(|processes| processes.len() > ServiceId::ALL.len())
    });
    signal(orchestrator, Signal::KILL);
    finish(child);
    processes.into_iter().for_each(|(_, pid)| await_end(pid));
    assert!(place.path("killed/run.mcap.partial").exists() && !place.path("killed/run.mcap").exists());
    assert!(!place.leftovers().is_empty() && !shared_memory_of(orchestrator).is_empty());

    succeed(&mut place.short_flight("next", 0.1, &[]));
    place.assert_nothing_is_left_of(orchestrator);
}

#[test]
fn clean_removes_what_dead_runs_have_left_and_no_more() {
    let place = Place::new();
    let (dead, _) = fly(&place, "dead");
    let killed = dead.id();
    signal(killed, Signal::KILL);
    finish(dead);
    let (live, _) = fly(&place, "live");
    // It has swept what the dead one left.
    let (dead, _) = fly(&place, "dead-again");
    let killed_again = dead.id();
    signal(killed_again, Signal::KILL);
    finish(dead);

    let said = String::from_utf8(succeed(&mut place.gerono(&["clean"])).stdout).unwrap();
    assert!(said.contains("removed") && said.contains("in use"), "{said}");
    for orchestrator in [killed, killed_again] {
        assert_eq!(shared_memory_of(orchestrator), Vec::<std::path::PathBuf>::new());
    }
    assert!(!shared_memory_of(live.id()).is_empty());
    signal(live.id(), Signal::TERM);
    assert_eq!(finish(live).status.code(), Some(143));
    assert_eq!(place.leftovers(), Vec::<String>::new());
    let said = String::from_utf8(succeed(&mut place.gerono(&["clean"])).stdout).unwrap();
    assert!(said.contains("no leftovers"), "{said}");
}

#[test]
fn two_runs_at_once_do_not_see_each_other() {
    let place = Place::new();
    let spawn = |out: &str| begin(&mut place.short_flight(out, 3.0, &[]));
    let (one, other) = (spawn("one"), spawn("other"));
    for output in [finish(one), finish(other)] {
        assert!(
            output.status.success(),
            "{}",
            String::from_utf8_lossy(&output.stderr)
        );
    }
    let bytes = |out: &str| std::fs::read(place.log(out)).unwrap();
    assert!(bytes("one") == bytes("other"));
    assert_eq!(place.leftovers(), Vec::<String>::new());
}

/// A stranger subscribes with iceoryx2's own means and never takes a sample.
#[test]
fn a_foreign_observer_does_not_stall_a_run() {
    let place = Place::new();
    // Long enough for the stranger to come, however busy the machine is.
    let child = begin(&mut place.short_flight("observed", 3600.0, &[]));
    let configuration = until("the run's iceoryx2 configuration", || {
        let base = std::fs::read_dir(place.path("tmp"))
            .ok()?
            .flatten()
            .next()?
            .path();
        let run = std::fs::read_dir(base)
            .ok()?
            .flatten()
            .find(|entry| entry.path().is_dir())?
            .path();
        Some(run.join("iceoryx2.toml")).filter(|file| file.exists())
    });
    let path = FilePath::new(configuration.as_os_str().as_encoded_bytes()).unwrap();
    let config = Config::from_file(&path).unwrap();
    let node = NodeBuilder::new()
        .config(&config)
        .create::<ipc::Service>()
        .unwrap();
    let name = ServiceName::new("vehicle/state").unwrap();
    let subscribers = until("the topic's subscriber", || {
        let topic = node
            .service_builder(&name)
            .publish_subscribe::<StrangersState>()
            .open()
            .ok()?;
        let subscriber = topic.subscriber_builder().buffer_size(1).create().ok()?;
        Some((topic, subscriber))
    });
    place.await_log("observed", place.log_bytes("observed") + 2_000_000);
    signal(child.id(), Signal::INT);
    let output = finish(child);
    assert_eq!(
        output.status.code(),
        Some(130),
        "{}",
        String::from_utf8_lossy(&output.stderr)
    );
    drop(subscribers);
    drop(node);

    let observed = place.log("observed");
    let seconds = 1.0 + (last_tick(&observed) / 1000) as f64;
    succeed(&mut place.short_flight("alone", seconds, &["--host", "inprocess"]));
    let mut observed = LogReader::open(&observed).unwrap();
    let mut alone = LogReader::open(&place.log("alone")).unwrap();
    while let Some(sample) = observed.next_sample().unwrap() {
        let expected = alone.next_sample().unwrap().unwrap();
        assert_eq!((sample.topic, sample.bytes), (expected.topic, expected.bytes));
    }
}

/// The same size, alignment and name as the sample; a stranger need know no more.
#[derive(Debug, ZeroCopySend)]
#[repr(C)]
#[type_name("gerono_msgs/msg/VehicleState")]
struct StrangersState {
    words: [u64; size_of::<shared_types::samples::VehicleState>() / 8],
}

#[test]
fn a_full_disk_ends_the_run_and_nothing_half_written_is_called_complete() {
    let place = Place::new();
    for host in ["lockstep", "inprocess"] {
        let flight = place.short_flight(host, 60.0, &["--host", host]);
        // A limit on the size of files fails writes as a full disk does; `ulimit -f` counts blocks of 512 bytes.
        let mut command = Command::new("sh");
        command
            .args(["-c", "ulimit -f 8000; exec \"$0\" \"$@\""])
            .arg(flight.get_program())
            .args(flight.get_args())
            .current_dir(flight.get_current_dir().unwrap())
            .env("XDG_RUNTIME_DIR", place.path("tmp"));
        let output = output(&mut command);
        let errors = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(4), "{errors}");
        assert!(errors.contains("run.mcap"), "{errors}");
        assert!(!place.log(host).exists() && place.path(host).join("run.mcap.partial").exists());
        let summary = std::fs::read_to_string(place.path(host).join("summary.json")).unwrap();
        assert!(summary.contains("\"failed\""), "{summary}");
    }
    assert_eq!(place.leftovers(), Vec::<String>::new());
}

#[test]
fn a_place_that_cannot_be_written_is_refused_before_anything_starts() {
    let place = Place::new();
    std::fs::write(place.path("file"), "").unwrap();
    let output = output(&mut place.short_flight("file/out", 1.0, &[]));
    assert_eq!(output.status.code(), Some(4));
    assert!(String::from_utf8_lossy(&output.stderr).contains("--out"));
    assert_eq!(place.leftovers(), Vec::<String>::new());
}

/// Every service is refused the same core: it is said once.
#[test]
fn what_the_machine_does_not_permit_is_said_once_and_flown_without() {
    let place = Place::new();
    let flight = succeed(&mut place.short_flight("out", 0.1, &["--set", "deployment.core=1023"]));
    let said = String::from_utf8_lossy(&flight.stderr).into_owned();
    assert_eq!(said.matches("core 1023 cannot be used").count(), 1, "{said}");
    assert!(said.contains("gerono doctor"), "no fix: {said}");

    let on_a_core_that_is_there = ["--set", "deployment.core=1023", "--no-pin"];
    let flight = succeed(&mut place.short_flight("unpinned", 0.1, &on_a_core_that_is_there));
    let said = String::from_utf8_lossy(&flight.stderr).into_owned();
    assert!(!said.contains("1023"), "the command line goes first: {said}");
}

#[test]
fn a_core_that_the_machine_does_not_have_is_refused_before_anything_starts() {
    let place = Place::new();
    for core in ["1024", "99999999999", "1023"] {
        let refused = output(&mut place.short_flight("out", 1.0, &["--core", core]));
        assert_eq!(refused.status.code(), Some(2), "{}", complaint(&refused));
        let said = complaint(&refused);
        assert!(
            said.contains("no such core") && said.contains("this machine has"),
            "{said}"
        );
    }
    assert!(!place.path("out").exists());
}

#[test]
fn a_strict_deployment_that_is_not_permitted_is_not_flown() {
    let place = Place::new();
    let sets = [
        "--set",
        "deployment.strict=true",
        "--set",
        "deployment.controller.core=1023",
    ];
    let flight = output(&mut place.short_flight("out", 1.0, &sets));
    assert_eq!(flight.status.code(), Some(1));
    let said = complaint(&flight);
    for piece in [
        "`deployment.strict`",
        "core 1023 cannot be used",
        "`gerono doctor`",
        "nothing was flown",
    ] {
        assert!(said.contains(piece), "no `{piece}` in: {said}");
    }
    assert!(!place.path("out").exists(), "the same command may be given again");
    assert_eq!(place.leftovers(), Vec::<String>::new());
}

#[test]
fn a_number_that_is_not_finite_is_stopped_where_it_was_made_in_every_host() {
    let place = Place::new();
    let mut said = Vec::new();
    for host in ["lockstep", "inprocess"] {
        // The estimator of the inertia runs away.
        let wild = ["--set", "controller.lambda_inertia=1e9", "--host", host];
        let output = output(&mut place.short_flight(host, 5.0, &wild));
        let errors = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(3), "{errors}");
        let last = last_tick(&place.log(host));
        let names = [
            "`plant`",
            "`world_from_body`",
            "`vehicle/truth`",
            &format!("tick {}", last + 1),
        ];
        let text = complaint(&output);
        assert!(
            names.iter().all(|name| text.contains(name)),
            "{names:?}\n{errors}"
        );
        said.push(errors);
    }
    assert_eq!(said[0], said[1]);
    let bytes = |out: &str| std::fs::read(place.log(out)).unwrap();
    assert!(bytes("lockstep") == bytes("inprocess"));
}

#[test]
fn a_service_started_by_hand_says_how_it_is_started() {
    let place = Place::new();
    let output = output(&mut place.gerono(&["service", "plant"]));
    assert_eq!(output.status.code(), Some(2));
    assert!(String::from_utf8_lossy(&output.stderr).contains("gerono run"));
}

#[test]
fn a_wrong_scenario_is_refused_before_anything_is_made() {
    let place = Place::new();
    let fig1 = scenario("fig1");
    let wrong = ["run", fig1.to_str().unwrap(), "--set", "controller.delta=0.0"];
    let output = output(&mut place.gerono(&wrong));
    assert_eq!(output.status.code(), Some(2));
    assert!(String::from_utf8_lossy(&output.stderr).contains("controller.delta"));
    assert!(!place.path("runs").exists());
}
