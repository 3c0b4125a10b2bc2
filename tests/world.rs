//! `gerono world`: a flight in real time whose vehicle, cameras and receiver are another program, met over a socket and a
//! pseudo-terminal only.

#![expect(clippy::disallowed_methods, reason = "tests make their own files")]

use crate::common;

use std::net::{TcpListener, UdpSocket};
use std::path::Path;
use std::time::Duration;

use common::logs::last_of_host;
use common::pilot::{ask, comes_to_the_path};
use common::ports::free_port;
use common::processes::{await_end, fill_the_disk_of, services_of, signal};
use common::world::{World, arguments, arguments_of, kept_time, samples};
use common::{Place, begin, complaint, finish, output, said, scenario, succeed, until, wait};
use run_log::CaptureFigures;
use rustix::process::Signal;
use serde_json::Value;
use shared_types::ServiceId;
use shared_types::samples::{MocapPose, RcFrame, VehicleTruth};

/// The paper's error in Fig. 7, root mean square, m.
const PAPER: f64 = 0.017;

/// The largest distance from the path, m, that the fan or the death of any service may cause: less than the vehicle's
/// own size.
const ASTRAY: f64 = 0.1;

/// Time at which the fan is switched on, s after the world began.
const FAN: f64 = 14.0;

/// Time for which the vehicle flies in its jet, s.
const IN_THE_JET: f64 = 14.0;

/// A place in the network and on the disk of this test's own, and an operator who does not dawdle.
fn settings(place: &Place, port: u16) -> Vec<String> {
    vec![
        format!("motion_capture.port={port}"),
        format!("rc_output.transmitter.device='{}'", place.path("radio").display()),
        format!("vehicle.fan.on_at={FAN:?}"),
        "flight.spool_up=0.2".to_owned(),
    ]
}

/// Kills the process of a service and waits until another one flies in its place.
fn kill(place: &Place, service: ServiceId) {
    let now = || Some(place.look()?.services.swap_remove(service.index()));
    let before = ask("the service", now).pid;
    signal(before, Signal::KILL);
    ask("its successor", || {
        now().filter(|service| service.flies && service.pid != before)
    });
}

fn part<'a>(truth: &'a Value, name: &str) -> &'a Value {
    let parts = truth["parts"].as_array().unwrap();
    parts.iter().find(|part| part["name"] == name).unwrap()
}

/// Flies from the ground to the ground: along the path, in the jet, and while every service dies once. Whether the machine
/// let it: one that stands still for longer than samples may be old is no laboratory.
fn flown(place: &Place, flight: &str, world: &str) -> bool {
    let settings = settings(place, free_port());
    let simulated = World::begin(place, &settings, &["--out", world]);
    until("the device", || place.path("radio").exists().then_some(()));
    let run = ["--host", "realtime", "--out", flight];
    let run = begin(&mut place.gerono(&arguments("run", &settings, &run)));
    let orchestrator = run.id();
    let stayed = flies_in_the_jet_and_through_deaths(place);
    succeed(&mut place.gerono(&["stop"]));
    let ended = finish(run);
    place.assert_nothing_is_left_of(orchestrator);
    simulated.end();
    assert!(!place.path("radio").exists());

    let kept_time = kept_time(place, world);
    // A machine that stands still loses the vehicle by itself.
    let flew = stayed && ended.status.success();
    assert!(flew || !kept_time, "{}", said(&ended));
    kept_time
}

/// Returns whether the vehicle comes to the path and stays there.
fn flies_in_the_jet_and_through_deaths(place: &Place) -> bool {
    let is_flying = || {
        place
            .look()
            .is_some_and(|snapshot| snapshot.phase.as_deref() == Some("fly"))
    };
    if !comes_to_the_path(place) {
        return false;
    }
    let stayed = ask("the time in the jet", || {
        let snapshot = place.look()?;
        let is_over = snapshot.time >= FAN + IN_THE_JET;
        (is_over || matches!(snapshot.phase.as_deref(), Some("land" | "disarmed"))).then(is_flying)
    });
    stayed
        && ServiceId::ALL.into_iter().all(|service| {
            kill(place, service);
            is_flying()
        })
}

#[test]
fn a_flight_whose_world_is_another_program_keeps_to_its_path_in_a_jet_and_while_its_services_die() {
    let place = Place::in_real_time();
    let names =
        ["1", "2", "3", "4", "5"].map(|attempt| [format!("flight{attempt}"), format!("world{attempt}")]);
    let flown = names.iter().find(|[flight, world]| flown(&place, flight, world));
    let [flight, world] = flown.expect("the machine stands still in every flight");

    let compared = ["truth", flight, "--world", world, "--last", "10", "--json"];
    let compared = succeed(&mut place.gerono(&compared));
    let truth: Value = serde_json::from_slice(&compared.stdout).unwrap();
    for name in ["before", "last"] {
        let rmse = part(&truth, name)["rmse"].as_f64().unwrap();
        assert!(rmse < PAPER, "{name}: {truth:#}");
    }
    let largest = part(&truth, "all")["largest"].as_f64().unwrap();
    assert!(largest < ASTRAY, "{truth:#}");
    let [_, push, _] = [0, 1, 2].map(|axis| truth["disturbance"][axis].as_f64().unwrap());
    let [_, believed, _] = [0, 1, 2].map(|axis| truth["disturbance_estimate"][axis].as_f64().unwrap());
    assert!(push > 0.7 && believed > 0.5 * push, "the jet is felt: {truth:#}");

    assert_it_came_from_the_ground_and_returned(&place.log(world));
    let alone = output(&mut place.gerono(&["truth", flight]));
    assert_eq!(alone.status.code(), Some(1));
    assert!(complaint(&alone).contains("name the log of `gerono world` with --world"));
    let replayed = said(&succeed(&mut place.gerono(&["replay", flight, "--quiet"])));
    assert!(replayed.contains("identical: "), "{replayed}");
}

/// Flies a file that `gerono new` wrote, to its path and to the ground. Returns whether the machine let it.
fn flown_as_written(place: &Place, file: &str, flight: &str, world: &str) -> bool {
    let device = format!("rc_output.transmitter.device='{}'", place.path("radio").display());
    let port = format!("motion_capture.port={}", free_port());
    let of = |command| [command, file, "--set", &device, "--set", &port, "--out"];
    let simulated = World::begin_with(place, &[&of("world")[..], &[world]].concat());
    until("the device", || place.path("radio").exists().then_some(()));
    let run = begin(&mut place.gerono(&[&of("run")[..], &[flight, "--host", "realtime"]].concat()));
    let came = comes_to_the_path(place);
    succeed(&mut place.gerono(&["stop"]));
    let ended = finish(run);
    simulated.end();
    let kept_time = kept_time(place, world);
    let flew = came && ended.status.success();
    assert!(flew || !kept_time, "{}", said(&ended));
    flew
}

#[test]
fn a_file_of_gerono_new_flies_in_the_simulated_laboratory_as_it_is() {
    let place = Place::in_real_time();
    let vehicle = [
        "--mass",
        "0.9",
        "--size",
        "0.5",
        "--propeller",
        "10",
        "--cells",
        "4",
    ];
    let laboratory = ["--radio", "sbus", "--cameras", "natnet"];
    succeed(&mut place.gerono(&[&["new", "mine.toml"][..], &vehicle, &laboratory].concat()));
    let flown = ["1", "2", "3"].iter().any(|attempt| {
        flown_as_written(
            &place,
            "mine.toml",
            &format!("flight{attempt}"),
            &format!("world{attempt}"),
        )
    });
    assert!(flown, "the machine stands still in every flight");
}

/// The world's own log says so, and what frames began to act.
/// Longest time without a pose beyond the time without a driver: the connection to the server, and some captures.
const CONNECTION_NS: u64 = 100_000_000;

/// Deaths of the driver in one flight.
const DEATHS: usize = 3;

/// Flies while the driver of the cameras dies; `None` if the machine stands still.
fn flown_through_deaths_of_the_cameras_driver(place: &Place, flight: &str, world: &str) -> Option<()> {
    let settings = settings(place, free_port());
    let simulated = World::begin(place, &settings, &["--out", world]);
    until("the device", || place.path("radio").exists().then_some(()));
    let run = ["--host", "realtime", "--out", flight];
    let run = begin(&mut place.gerono(&arguments("run", &settings, &run)));
    let comes = comes_to_the_path(place);
    if comes {
        for _ in 0..DEATHS {
            kill(place, ServiceId::Plant);
            let now = place.look().map_or(0.0, |snapshot| snapshot.time);
            ask("a second", || (place.look()?.time > now + 1.0).then_some(()));
        }
    }
    // One that is down already has ended by itself.
    place.gerono(&["stop"]).output().unwrap();
    finish(run);
    simulated.end();
    (comes && kept_time(place, world)).then_some(())
}

/// A restarted driver goes on with the clock, the track and the pose that it had.
#[test]
fn a_death_of_the_cameras_driver_costs_the_poses_of_its_restart() {
    let place = Place::in_real_time();
    let names =
        ["1", "2", "3", "4", "5"].map(|attempt| [format!("flight{attempt}"), format!("world{attempt}")]);
    let flown = names
        .iter()
        .find(|[flight, world]| flown_through_deaths_of_the_cameras_driver(&place, flight, world).is_some());
    let [flight, _] = flown.expect("the machine stands still in every flight");

    // The driver publishes at every tick, with a pose or without one.
    let published: Vec<MocapPose> = samples(&place.log(flight));
    let stamps: Vec<u64> = published.iter().map(|pose| pose.header.stamp_ns).collect();
    let gaps = |stamps: &[u64]| -> Vec<[u64; 2]> {
        let pairs = stamps.windows(2).map(|pair| [pair[0], pair[1]]);
        pairs.collect()
    };
    let mut deaths = gaps(&stamps);
    deaths.sort_by_key(|[from, to]| to - from);
    let deaths = &deaths[deaths.len() - DEATHS..];
    let seen = published.iter().filter(|pose| pose.tracked.is_set());
    let poses: Vec<u64> = seen.map(|pose| pose.header.stamp_ns).collect();
    let flies_from = deaths.iter().map(|[from, _]| *from).min().unwrap();
    for [from, to] in gaps(&poses)
        .into_iter()
        .filter(|[from, _]| *from + CONNECTION_NS > flies_from)
    {
        let dead = deaths.iter().filter(|death| from <= death[1] && death[0] <= to);
        let dead_ns: u64 = dead.map(|death| death[1] - death[0]).sum();
        assert!(
            to - from <= dead_ns + CONNECTION_NS,
            "no pose for {} ms from {} ms on, no driver for {} ms: {deaths:?}",
            (to - from) / 1_000_000,
            from / 1_000_000,
            dead_ns / 1_000_000,
        );
    }
    let last: CaptureFigures = last_of_host(&place, flight, "host/motion_capture");
    assert!(last.believed > 50, "{last:?}");
    assert_eq!(
        (last.unsettled, last.settled, last.clock_steps),
        (0, 0, 0),
        "{last:?}"
    );
}

fn assert_it_came_from_the_ground_and_returned(log: &Path) {
    let truths = samples::<VehicleTruth>(log);
    let height = |truth: &VehicleTruth| -truth.position_world[2];
    let [first, .., last] = truths.as_slice() else {
        panic!()
    };
    assert_eq!([height(first), height(last)], [0.0, 0.0]);
    let highest = truths.iter().map(height).fold(0.0, f64::max);
    assert!((1.15..1.4).contains(&highest), "{highest}");
    let ticks: Vec<_> = truths.iter().map(|truth| truth.header.tick).collect();
    assert!((0..ticks.len() as u64).eq(ticks), "every tick, in its order");
    let frames = samples::<RcFrame>(log);
    assert!(
        frames
            .windows(2)
            .all(|pair| pair[0].header.seq < pair[1].header.seq)
    );
    assert!(frames[0].failsafe.is_set());
    // On the ground before it may disarm and be armed again.
    let takes_off = truths
        .iter()
        .find(|truth| height(truth) > 0.0)
        .unwrap()
        .header
        .tick;
    let since = frames.iter().filter(|frame| frame.header.tick >= takes_off);
    let mut at_rest: Vec<_> = since.map(|frame| frame.failsafe.is_set()).collect();
    at_rest.dedup();
    assert_eq!(at_rest, [false, true], "not lost on the way");
}

/// Fastest touch-down that is a landing and no fall, m/s: the scenario states 0.3 m/s.
const TOUCH_DOWN: f64 = 0.6;

/// Flies to the path, where something ends the flight of an orchestrator, with this exit code. Whether the machine let it.
fn lands(place: &Place, attempt: u32, duration: f64, end: impl FnOnce(u32), code: i32) -> bool {
    let [flight, world] = ["flight", "world"].map(|name| format!("{name}{attempt}"));
    let mut settings = settings(place, free_port());
    let simulated = World::begin(place, &settings, &["--out", &world]);
    until("the device", || place.path("radio").exists().then_some(()));
    settings.push(format!("duration={duration:?}"));
    let run = ["--host", "realtime", "--out", &flight];
    let run = begin(&mut place.gerono(&arguments("run", &settings, &run)));
    let came_to_the_path = comes_to_the_path(place);
    end(run.id());
    let ended = finish(run);
    simulated.end();
    let kept_time = kept_time(place, &world);
    if kept_time {
        assert!(came_to_the_path, "{}", said(&ended));
        assert_eq!(ended.status.code(), Some(code), "{}", said(&ended));
        let truths = samples::<VehicleTruth>(&place.log(&world));
        let height = |truth: &VehicleTruth| -truth.position_world[2];
        assert_eq!(truths.last().map(height), Some(0.0));
        let touch_down = truths.iter().rposition(|truth| height(truth) > 0.0).unwrap();
        let [x, y, z] = truths[touch_down].velocity_body;
        let speed = (x * x + y * y + z * z).sqrt();
        assert!(speed < TOUCH_DOWN, "it came down at {speed} m/s");
    }
    kept_time
}

#[test]
fn a_full_disk_lands_a_vehicle_in_the_laboratory() {
    let place = Place::in_real_time();
    let landed = (0..5).any(|attempt| lands(&place, attempt, 120.0, fill_the_disk_of, 4));
    assert!(landed, "the machine stands still in every flight");
}

#[test]
fn a_vehicle_that_nobody_lands_is_on_the_ground_at_the_end_of_the_duration() {
    let place = Place::in_real_time();
    let landed = (0..5).any(|attempt| lands(&place, attempt, 30.0, |_| (), 0));
    assert!(landed, "the machine stands still in every flight");
}

/// Scenario of a vehicle that takes packets of its own.
const CRAZYFLIE: &str = "laboratory_crazyflie";

/// Largest error of the vehicle by its own packets, as a multiple of that by CRSF.
const BY_ITS_OWN_PACKETS: f64 = 1.1;

/// Time that it flies on the path, s, and time of that in which the error is measured.
const FLOWN_AND_MEASURED: [f64; 2] = [20.0, 12.0];

/// Flies the Crazyflie by a link from the ground to the ground, in a world of more options. Returns its error in flight, root
/// mean square, m; `None` if the machine stands still.
fn error_of_a_crazyflie(place: &Place, name: &str, link: &[String], more: &[&str]) -> Option<f64> {
    let [flight, world] = ["flight", "world"].map(|kind| format!("{kind}-{name}"));
    let port = format!("motion_capture.port={}", free_port());
    let mut settings = vec![port, "flight.spool_up=0.2".to_owned()];
    settings.extend_from_slice(link);
    let options = [&["--out", &world], more].concat();
    let simulated = World::begin_of(CRAZYFLIE, place, &settings, &options);
    until("the world", || place.path(&world).exists().then_some(()));
    let run = ["--host", "realtime", "--out", &flight];
    let run = begin(&mut place.gerono(&arguments_of(CRAZYFLIE, "run", &settings, &run)));
    let comes = comes_to_the_path(place);
    let now = || Some(place.look()?.time);
    if comes {
        let began = ask("the time", now);
        ask("the flight", || {
            (now()? > began + FLOWN_AND_MEASURED[0]).then_some(())
        });
    }
    place.gerono(&["stop"]).output().unwrap();
    let ended = finish(run);
    simulated.end();
    if !comes || !kept_time(place, &world) {
        return None;
    }
    assert!(ended.status.success(), "{}", said(&ended));
    assert_it_came_from_the_ground_and_returned(&place.log(&world));
    let measured = format!("{}", FLOWN_AND_MEASURED[1]);
    let compared = ["truth", &flight, "--world", &world, "--last", &measured, "--json"];
    let compared = succeed(&mut place.gerono(&compared));
    let truth: Value = serde_json::from_slice(&compared.stdout).unwrap();
    part(&truth, "last")["rmse"].as_f64()
}

#[test]
fn a_crazyflie_flies_as_well_by_its_own_packets_as_by_crsf() {
    let place = Place::in_real_time();
    let free = UdpSocket::bind("127.0.0.1:0").unwrap().local_addr().unwrap();
    let own = [format!("rc_output.transmitter.uri='udp://{free}'")];
    let device = place.path("radio").display().to_string();
    let crsf = [
        "rc_output.link=crsf".to_owned(),
        format!("rc_output.transmitter={{device='{device}',arming_channel=5}}"),
    ];
    let flown = |name: &str, link: &[String], more: &[&str]| {
        let attempt = |number| error_of_a_crazyflie(&place, &format!("{name}{number}"), link, more);
        (0..5)
            .find_map(attempt)
            .expect("the machine stands still in every flight")
    };
    // Its motors turn only if it is armed by the packets.
    let by_its_own = flown("own", &own, &["--require-arming"]);
    let by_crsf = flown("crsf", &crsf, &[]);
    println!("by its own packets {by_its_own} m, by CRSF {by_crsf} m");
    assert!(
        by_its_own <= BY_ITS_OWN_PACKETS * by_crsf,
        "{by_its_own} {by_crsf}"
    );
}

/// Slowest descent that is a fall and no landing, m/s: from the path it comes to more than twice that.
const FALL: f64 = 1.5;

/// Kills a vehicle in the air whose orchestrator has been sent a signal. Whether the machine let it come there.
fn falls_by_a_kill_in_spite_of(signal_sent: Signal, place: &Place, flight: &str, world: &str) -> bool {
    let settings = settings(place, free_port());
    let simulated = World::begin(place, &settings, &["--out", world]);
    until("the device", || place.path("radio").exists().then_some(()));
    let run = ["--host", "realtime", "--out", flight];
    let mut run = begin(&mut place.gerono(&arguments("run", &settings, &run)));
    if !comes_to_the_path(place) {
        return false;
    }
    let services = services_of(run.id());
    signal(run.id(), signal_sent);
    if signal_sent == Signal::KILL {
        // Not for the end of its output, which the services share.
        wait(&mut run);
        let stopped = output(&mut place.gerono(&["stop"]));
        let said = complaint(&stopped);
        assert!(
            said.contains("gerono attach") && said.contains("gerono kill"),
            "{said}"
        );
        kill_directly(place, "has died");
        // They see the vehicle at rest, and end.
        services.iter().for_each(|&(_, pid)| await_end(pid));
        succeed(&mut place.gerono(&["clean"]));
    } else {
        kill_directly(place, "does not answer");
        signal(run.id(), Signal::CONT);
        let killed = ask("the kill in the answer of a run that goes on", || {
            place
                .look()
                .filter(|snapshot| snapshot.phase.as_deref() == Some("disarmed"))
        });
        assert!(killed.killed);
        signal(run.id(), Signal::INT);
        assert_eq!(finish(run).status.code(), Some(130));
    }
    assert_eq!(place.leftovers(), Vec::<String>::new());
    simulated.end();
    assert_it_fell(&place.log(world));
    true
}

/// Kills the only live run, whose orchestrator does nothing.
fn kill_directly(place: &Place, why: &str) {
    let killed = said(&succeed(&mut place.gerono(&["kill"])));
    assert!(
        killed.contains(why) && killed.contains("services directly"),
        "{killed}"
    );
}

fn assert_it_fell(log: &Path) {
    let frames = samples::<RcFrame>(log);
    let last_with_thrust = frames.iter().rfind(|frame| !frame.failsafe.is_set()).unwrap();
    let truths = samples::<VehicleTruth>(log);
    let after = || {
        truths
            .iter()
            .filter(|truth| truth.header.tick > last_with_thrust.header.tick)
    };
    let height = |truth: &VehicleTruth| -truth.position_world[2];
    let highest = after().map(height).fold(0.0, f64::max);
    assert!(highest > 1.0, "it was on the way down before: {highest} m");
    // The world may end before its vehicle is down: nothing waits for that once the motors rest.
    let speed = |truth: &VehicleTruth| {
        truth
            .velocity_body
            .map(|axis| axis * axis)
            .iter()
            .sum::<f64>()
            .sqrt()
    };
    let fastest = after().map(speed).fold(0.0, f64::max);
    assert!(fastest > FALL, "it was landed: {fastest} m/s");
}

#[test]
fn a_kill_reaches_the_motors_while_the_orchestrator_is_stopped_and_after_its_death() {
    let place = Place::in_real_time();
    for signal in [Signal::STOP, Signal::KILL] {
        let fell = (0..5).any(|attempt| {
            let [flight, world] = ["flight", "world"].map(|name| format!("{name}-{signal:?}-{attempt}"));
            falls_by_a_kill_in_spite_of(signal, &place, &flight, &world)
        });
        assert!(fell, "the machine stands still in every flight");
    }
}

#[test]
fn every_system_that_a_world_seems_to_have_is_believed() {
    let place = Place::in_real_time();
    for (source, probed) in [("natnet", "natnet"), ("vicon_udp", "vicon")] {
        let port = free_port();
        let mut settings = settings(&place, port);
        settings.push(format!("motion_capture.source={source}"));
        let _world = World::begin(&place, &settings, &["--out", source, "--quiet"]);
        let port = port.to_string();
        let probe = [
            "mocap",
            "probe",
            "--source",
            probed,
            "--object",
            "quad",
            "--seconds",
            "3",
            "--port",
            &port,
        ];
        let probed = output(&mut place.gerono(&probe));
        assert!(
            probed.status.success() && said(&probed).contains("malformed 0, from strangers 0"),
            "{}",
            said(&probed)
        );
    }
}

#[test]
fn a_world_that_stands_still_says_how_late_its_cameras_were() {
    let place = Place::in_real_time();
    let settings = settings(&place, free_port());
    let more = ["--seconds", "3", "--out", "world"];
    let simulated = begin(&mut place.gerono(&arguments("world", &settings, &more)));
    until("the world", || place.path("radio").exists().then_some(()));
    std::thread::sleep(Duration::from_millis(300));
    signal(simulated.id(), Signal::STOP);
    std::thread::sleep(Duration::from_millis(100));
    signal(simulated.id(), Signal::CONT);
    let ended = finish(simulated);
    assert!(ended.status.success(), "{}", said(&ended));
    assert!(
        said(&ended).contains("the cameras are late: a pose was sent"),
        "{}",
        said(&ended)
    );
    let summary = std::fs::read(place.path("world").join("summary.json")).unwrap();
    let summary: Value = serde_json::from_slice(&summary).unwrap();
    assert!(summary["late_poses"].as_u64().unwrap() >= 5, "{summary:#}");
    assert!(summary["latest_pose"].as_f64().unwrap() > 0.08, "{summary:#}");
}

#[test]
fn what_a_world_cannot_be_is_refused_with_the_fix() {
    let place = Place::in_real_time();
    let taken = place.path("taken");
    std::fs::write(&taken, "").unwrap();
    let port = TcpListener::bind("127.0.0.1:0").unwrap();
    let occupied = format!("motion_capture.port={}", port.local_addr().unwrap().port());
    let device = format!("rc_output.transmitter.device='{}'", taken.display());
    for (setting, code, piece) in [
        (
            "motion_capture.source=simulated",
            2,
            "state `vicon_udp`, `vrpn` or `natnet`",
        ),
        ("motion_capture.object='quad#7'", 1, "without a number"),
        (&occupied, 1, "as `port` one that is free"),
        (&device, 1, "give a path that is free"),
    ] {
        let mut settings = settings(&place, free_port());
        settings.push(setting.to_owned());
        let refused = output(&mut place.gerono(&arguments("world", &settings, &[])));
        assert_eq!(refused.status.code(), Some(code), "{setting}: {}", said(&refused));
        assert!(complaint(&refused).contains(piece), "{}", complaint(&refused));
        assert!(!place.path("runs").exists() && !place.path("radio").exists());
    }
    let fig7 = scenario("fig7");
    let refused = output(&mut place.gerono(&["world", fig7.to_str().unwrap()]));
    assert_eq!(refused.status.code(), Some(2));
    assert!(Path::new(&taken).exists());
}

#[test]
fn the_truth_of_a_simulated_flight_is_in_its_own_log() {
    let place = Place::new();
    let fig7 = scenario("fig7");
    let flown = [
        "run",
        fig7.to_str().unwrap(),
        "--host",
        "inprocess",
        "--out",
        "flight",
        "--quiet",
    ];
    succeed(&mut place.gerono(&flown));
    let compared = succeed(&mut place.gerono(&["truth", "flight", "--json"]));
    let truth: Value = serde_json::from_slice(&compared.stdout).unwrap();
    let spans = ["before", "after", "last", "all"].map(|name| {
        let span = &part(&truth, name)["span"];
        [0, 1].map(|end| span[end].as_f64().unwrap().round())
    });
    assert_eq!(spans, [[25.0, 30.0], [30.0, 60.0], [60.0, 80.0], [0.0, 80.0]]);
    let rmse = part(&truth, "last")["rmse"].as_f64().unwrap();
    assert!(rmse < 0.004, "the bar of the figure: {truth:#}");
}

/// Plays the hand test with the cameras of a world that may know another body. Returns the result.
fn hand_test(place: &Place, name: &str, world_only: &[String]) -> Value {
    let settings = settings(place, free_port());
    let simulated = World::begin(
        place,
        &[&settings, world_only].concat(),
        &["--by-hand", "--out", name],
    );
    let file = format!("{name}.json");
    let check = ["--seconds", "200", "--out", &file];
    let mut check = arguments("check", &settings, &check);
    check.insert(0, "lab");
    let ended = output(&mut place.gerono(&check));
    simulated.end();
    let text = std::fs::read(place.path(&file)).unwrap_or_else(|error| panic!("{error}: {}", said(&ended)));
    let result: Value = serde_json::from_slice(&text).unwrap();
    let passed = result["hand_test_passed"] == true;
    assert_eq!(
        ended.status.code(),
        Some(if passed { 0 } else { 6 }),
        "{}",
        said(&ended)
    );
    result
}

#[test]
fn a_hand_test_passes_and_names_a_body_that_was_created_turned() {
    let place = Place::in_real_time();
    let right = hand_test(&place, "right", &[]);
    assert_eq!(right["causes"].as_array().unwrap().len(), 0, "{right:#}");
    assert_eq!(right["hand_test_passed"], true, "{right:#}");
    let turned = "motion_capture.body_from_markers={roll_pitch_yaw=[3.14159265, 0.0, 1.57079633]}";
    let wrong = hand_test(&place, "wrong", &[turned.to_owned()]);
    let cause = wrong["causes"][0].as_str().unwrap();
    assert!(cause.starts_with("the body was created turned by"), "{wrong:#}");
}
