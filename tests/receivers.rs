//! Flights by the packets of receivers, which `gerono world` sends over UDP.

#![expect(clippy::disallowed_methods, reason = "tests make their own files")]

use crate::common;

use std::net::UdpSocket;

use common::pilot::{ask, comes_to_the_path};
use common::ports::free_port;
use common::processes::signal;
use common::world::{World, arguments_of, kept_time, samples};
use common::{Begun, Place, begin, complaint, finish, output, said, succeed, until};
use rustix::process::Signal;
use serde_json::Value;
use shared_types::ServiceId;
use shared_types::samples::{
    BaselineInnovations, GnssFix, ImuSample, MocapPose, PathReference, VehicleState, VehicleTruth,
};

const OUTDOOR: &str = "laboratory_outdoor";

/// In and out of a hall with cameras.
const HALL: &str = "laboratory_indoor_outdoor";

/// Time for which the vehicle flies on the path, s, before and after the death of the driver.
const FLOWN: f64 = 6.0;

/// Largest distance of the estimate's flight from the path, root mean square, m: RTK in steps of 11 mm, in gusts.
const ASTRAY: f64 = 0.1;

/// Age of the last inertial sample after which the vehicle may be lost, ns: half of that at which it is.
const UNMEASURED_NS: u64 = 50_000_000;

/// Ports of this test's own, and an operator who does not dawdle.
fn settings() -> Vec<String> {
    let [fixes, motion, link] = [free_port(), free_port(), free_port()];
    vec![
        format!("receivers.sources=['udp:127.0.0.1:{fixes}','udp:127.0.0.1:{motion}']"),
        format!("rc_output.transmitter.udp='127.0.0.1:{link}'"),
        "navigation.healthy_for=2.0".to_owned(),
        "flight.spool_up=0.2".to_owned(),
    ]
}

/// Two antennas, 0.8 m apart.
fn antennas() -> [String; 3] {
    [
        "navigation.baseline=[0.8,0.0,0.0]",
        "sensors.gnss.baseline=[0.8,0.0,0.0]",
        "schedule.period.\"gnss/baseline\"=0.1",
    ]
    .map(str::to_owned)
}

/// Flies from the ground to the path, through a death of the driver, and to the ground, with two antennas. Returns whether the machine
/// let it.
fn flown(place: &Place, flight: &str, world: &str) -> bool {
    let settings = [settings(), antennas().to_vec()].concat();
    let simulated = World::begin_of(OUTDOOR, place, &settings, &["--out", world]);
    until("the world", || place.path(world).exists().then_some(()));
    let run = ["--host", "realtime", "--out", flight];
    let run = begin(&mut place.gerono(&arguments_of(OUTDOOR, "run", &settings, &run)));
    let mut flies = comes_to_the_path(place);
    if flies {
        let now = || Some(place.look()?.time);
        let wait = || {
            let began = ask("the time", now);
            ask("the flight", || (now()? > began + FLOWN).then_some(()));
        };
        wait();
        let shown = ask("the receivers", || place.look()?.receivers);
        assert!(
            shown.packets > 1000 && shown.rates.iter().all(|rate| *rate > 1.0),
            "{shown:?}"
        );
        kill_driver(place);
        wait();
        flies = is_on_the_path(place);
    }
    landed(place, flies, run, simulated, world)
}

/// Kills the driver, and waits for its successor.
fn kill_driver(place: &Place) {
    let driver = || Some(place.look()?.services.swap_remove(ServiceId::Plant.index()));
    let before = ask("the driver", driver).pid;
    signal(before, Signal::KILL);
    ask("its successor", || {
        driver().filter(|service| service.flies && service.pid != before)
    });
}

fn is_on_the_path(place: &Place) -> bool {
    let phase = || place.look()?.phase;
    phase().as_deref() == Some("fly")
}

/// Ends a flight. Returns whether it flew and landed; the machine may have prevented it.
fn landed(place: &Place, flies: bool, run: Begun, simulated: World, world: &str) -> bool {
    place.gerono(&["stop"]).output().unwrap();
    let ended = finish(run);
    simulated.end();
    let kept_time = kept_time(place, world);
    let flew = flies && ended.status.success();
    assert!(flew || !kept_time, "{}", said(&ended));
    if flew {
        assert!(said(&ended).contains("Receivers: "), "{}", said(&ended));
    }
    flew
}

/// Flies from the hall through its gate, where the driver dies, and back into the hall. Returns whether the machine let it.
fn flown_through_the_gate(place: &Place, flight: &str, world: &str) -> bool {
    let mut settings = settings();
    settings.push(format!("motion_capture.port={}", free_port()));
    let simulated = World::begin_of(HALL, place, &settings, &["--out", world]);
    until("the world", || place.path(world).exists().then_some(()));
    let run = ["--host", "realtime", "--out", flight];
    let run = begin(&mut place.gerono(&arguments_of(HALL, "run", &settings, &run)));
    let mut flies = comes_to_the_path(place);
    // What does not see the vehicle says so.
    let mut goes = |what: &str, is_outside: bool| {
        flies = flies
            && ask(what, || {
                let snapshot = place.look()?;
                let (cameras, receivers) = (snapshot.cameras?, snapshot.receivers?);
                let is_there =
                    cameras.trouble.is_some() == is_outside && receivers.trouble.is_none() == is_outside;
                let is_over = snapshot.phase.as_deref() != Some("fly");
                (is_there || is_over).then_some(!is_over)
            });
        flies
    };
    if goes("the way out", true) {
        kill_driver(place);
    }
    goes("the way back", false);
    let flies = flies && is_on_the_path(place);
    landed(place, flies, run, simulated, world)
}

/// Returns the names of the flight that the machine let fly, and of its world.
fn first_flown(place: &Place, fly: impl Fn(&Place, &str, &str) -> bool) -> [String; 2] {
    let names =
        ["1", "2", "3", "4", "5"].map(|attempt| [format!("flight{attempt}"), format!("world{attempt}")]);
    let flown = names
        .into_iter()
        .find(|[flight, world]| fly(place, flight, world));
    flown.expect("the machine stands still in every flight")
}

/// Returns the distance of the true vehicle from the path in the last of the parts that are compared, root mean square, m.
fn from_the_path(place: &Place, flight: &str, world: &str, more: &[&str]) -> f64 {
    let compared = [&["truth", flight, "--world", world, "--json"], more].concat();
    let compared = succeed(&mut place.gerono(&compared));
    let truth: Value = serde_json::from_slice(&compared.stdout).unwrap();
    let parts = truth["parts"].as_array().unwrap();
    let last = parts.iter().find(|part| part["name"] == "last").unwrap();
    let rmse = last["rmse"].as_f64().unwrap();
    println!("{rmse} m from the path");
    rmse
}

#[test]
fn a_vehicle_flies_out_of_a_hall_with_cameras_and_back_by_poses_and_fixes() {
    let place = Place::in_real_time();
    let [flight, world] = &first_flown(&place, flown_through_the_gate);
    let log = place.log(flight);
    let fixes: Vec<GnssFix> = samples(&log);
    let fix = fixes.iter().find(|fix| fix.measured.is_set()).unwrap();
    let references: Vec<PathReference> = samples(&log);
    let airborne = references
        .iter()
        .find(|reference| reference.airborne.is_set())
        .unwrap();
    assert!(
        airborne.header.stamp_ns + 1_000_000_000 < fix.header.stamp_ns,
        "no fix before the gate"
    );
    let (mut seconds_seen, mut last_ns) = ([0.0; 2], 0);
    let poses: Vec<MocapPose> = samples(&log);
    for pose in poses.iter().filter(|pose| pose.tracked.is_set()) {
        seconds_seen[usize::from(pose.header.stamp_ns > fix.header.stamp_ns)] += 0.02;
        last_ns = pose.header.stamp_ns;
        assert!(pose.capture_time_ns < pose.header.stamp_ns);
    }
    assert!(seconds_seen[0] > 5.0 && seconds_seen[1] > 1.0, "{seconds_seen:?}");
    let last_fix = fixes.iter().rfind(|fix| fix.measured.is_set()).unwrap();
    assert!(last_fix.header.stamp_ns < last_ns, "it is back");
    let states: Vec<VehicleState> = samples(&log);
    let landed = references
        .iter()
        .rfind(|reference| reference.airborne.is_set())
        .unwrap();
    // On the ground it is not tracked while poses are refused.
    let in_the_air = airborne.header.stamp_ns..landed.header.stamp_ns;
    let flown = states
        .iter()
        .filter(|state| in_the_air.contains(&state.header.stamp_ns));
    // It is lost only while nobody measures its motion: between the driver and its successor.
    let inertial: Vec<ImuSample> = samples(&log);
    let measured = inertial.iter().filter(|sample| sample.measured.is_set());
    let measured: Vec<u64> = measured.map(|sample| sample.header.stamp_ns).collect();
    let lost: Vec<u64> = flown
        .clone()
        .filter(|state| !state.tracked.is_set())
        .map(|state| state.header.stamp_ns)
        .collect();
    for at_ns in &lost {
        let before = measured.partition_point(|stamp_ns| stamp_ns <= at_ns);
        let age_ns = at_ns - before.checked_sub(1).map_or(0, |newest| measured[newest]);
        assert!(
            age_ns > UNMEASURED_NS,
            "lost at {at_ns} ns, {age_ns} ns after a sample"
        );
    }
    println!("lost for {} of {} states", lost.len(), flown.clone().count());
    assert!(flown.clone().count() > 10 * lost.len());
    let farthest = flown
        .map(|state| state.position_world[0])
        .fold(f64::NEG_INFINITY, f64::max);
    assert!(farthest > 6.0, "{farthest} m from the gate");

    assert!(from_the_path(&place, flight, world, &[]) < ASTRAY);
    let truths = samples::<VehicleTruth>(&place.log(world));
    assert_eq!(
        truths.last().map(|truth| truth.position_world[2]),
        Some(0.0),
        "it has landed"
    );
    let report = &place.summary(flight)["laboratory"];
    assert!(
        report["motion_capture"]["believed"].as_u64() > Some(500),
        "{report:#}"
    );
    assert!(
        report["receivers"]["samples"]["fixes"].as_u64() > Some(20),
        "{report:#}"
    );
}

#[test]
fn a_vehicle_outdoors_flies_by_the_packets_of_a_receiver_and_an_autopilot() {
    let place = Place::in_real_time();
    let [flight, world] = &first_flown(&place, flown);

    assert!(from_the_path(&place, flight, world, &["--last", "5"]) < ASTRAY);

    let truths = samples::<VehicleTruth>(&place.log(world));
    let height = |truth: &VehicleTruth| -truth.position_world[2];
    assert!(truths.iter().map(height).fold(0.0, f64::max) > 0.9);
    assert_eq!(truths.last().map(height), Some(0.0), "it has landed");
    let measured: Vec<ImuSample> = samples(&place.log(flight));
    let measured = measured.iter().filter(|sample| sample.measured.is_set());
    let times: Vec<u64> = measured.map(|sample| sample.measured_ns).collect();
    assert!(times.is_sorted() && times.len() > 1000, "{}", times.len());
    let fixes: Vec<GnssFix> = samples(&place.log(flight));
    // A step that begins late has packets that arrived after its tick, so that a fix of theirs is younger.
    let mut ages: Vec<u64> = fixes
        .iter()
        .filter(|fix| fix.measured.is_set())
        .map(|fix| fix.header.stamp_ns - fix.valid_ns)
        .collect();
    ages.sort_unstable();
    let median = ages[ages.len() / 2];
    assert!(median >= 100_000_000, "a fix is as old as stated: {median} ns");
    // Before and after the death of the driver the heading is that of the antennas.
    let baselines: Vec<BaselineInnovations> = samples(&place.log(flight));
    let last = baselines.last().unwrap();
    assert!(
        last.fused[0] > 100 && last.fused[0] > 20 * last.refused[0],
        "{last:?}"
    );
    let report = &place.summary(flight)["laboratory"]["receivers"];
    for sensor in ["inertial", "fixes", "altitudes", "fields"] {
        assert!(report["samples"][sensor].as_u64() > Some(20), "{report:#}");
    }
}

#[test]
fn receivers_that_cannot_be_flown_by_are_refused_with_the_fix() {
    let place = Place::in_real_time();
    let settings = settings();
    let run = |more: &[&str]| output(&mut place.gerono(&arguments_of(OUTDOOR, "run", &settings, more)));
    let in_lock_step = run(&[]);
    assert_eq!(in_lock_step.status.code(), Some(2));
    assert!(
        complaint(&in_lock_step).contains("fly with --host realtime"),
        "{}",
        complaint(&in_lock_step)
    );
    let recorded = place.path("recorded.bin");
    std::fs::write(&recorded, [0xb5, 0x62]).unwrap();
    let recorded = recorded.display().to_string();
    let taken = UdpSocket::bind("127.0.0.1:0").unwrap();
    let taken = format!("udp:{}", taken.local_addr().unwrap());
    for (source, piece) in [
        ("/dev/no-such-receiver", "is it plugged in?"),
        (
            "upd:127.0.0.1:14550",
            "`upd:127.0.0.1:14550` is not the address of a receiver",
        ),
        (&recorded, "name a serial device or a socket"),
        (&taken, "a port that no other program uses"),
    ] {
        let source = format!("receivers.sources=['{source}']");
        let refused = run(&["--set", &source, "--host", "realtime"]);
        assert!(!refused.status.success());
        assert!(complaint(&refused).contains(piece), "{}", complaint(&refused));
    }
    // Packets of a simulation could be taken for those of a vehicle.
    let foreign = [
        "--set",
        "receivers.sources=['udp:192.0.2.1:14550']",
        "--out",
        "world",
    ];
    let refused = output(&mut place.gerono(&arguments_of(OUTDOOR, "world", &settings, &foreign)));
    assert_eq!(refused.status.code(), Some(2));
    let complaint = complaint(&refused);
    assert!(
        complaint.contains("`udp:192.0.2.1:14550` is no address of this machine"),
        "{complaint}"
    );
    assert!(!place.path("world").exists());
    // A flight that waits for a second antenna would never be armed.
    let [assumed, _, period] = antennas();
    let single = ["--set", &assumed, "--set", &period, "--out", "world"];
    let refused = output(&mut place.gerono(&arguments_of(OUTDOOR, "world", &settings, &single)));
    assert_eq!(refused.status.code(), Some(2));
    let complaint = common::complaint(&refused);
    assert!(complaint.contains("state `sensors.gnss.baseline`"), "{complaint}");
    assert!(!place.path("world").exists());
}

#[test]
fn a_vehicle_whose_samples_come_at_another_rate_than_scheduled_is_not_armed() {
    let place = Place::in_real_time();
    let settings = settings();
    // Twice that of the world.
    let of_the_flight = [
        "schedule.period.\"imu/sample\"=0.002",
        "schedule.period.estimator=0.002",
    ];
    let fast = [&settings[..], &of_the_flight.map(str::to_owned)].concat();
    let simulated = World::begin_of(OUTDOOR, &place, &settings, &["--out", "world"]);
    until("the world", || place.path("world").exists().then_some(()));
    let run = ["--host", "realtime", "--out", "flight"];
    let run = begin(&mut place.gerono(&arguments_of(OUTDOOR, "run", &fast, &run)));
    ask("the refusal", || {
        place.look()?;
        let refused = output(&mut place.gerono(&["arm"]));
        assert!(!refused.status.success(), "{}", said(&refused));
        let complaint = complaint(&refused);
        complaint
            .contains("`schedule.period.\"imu/sample\"` states 500.0")
            .then_some(())
    });
    place.gerono(&["stop"]).output().unwrap();
    finish(run);
    simulated.end();
}
