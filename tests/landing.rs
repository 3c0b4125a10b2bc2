//! Failures outside of the control path land the vehicle: none of them ends a flight in the air.

use crate::common;

use std::process::Stdio;
use std::time::{Duration, Instant};

use common::pilot::{await_phase, flight_on_the_ground, take_off_from_the_ground, wait_on_the_ground};
use common::processes::{fill_the_disk_of, pid_of, services_of, signal};
use common::terminal::Terminal;
use common::{Begun, Place, begin, complaint, finish, said, succeed, until, wait};
use run_log::LogReader;
use rustix::process::Signal;
use shared_types::flight_phase::GROUNDED_AFTER;
use shared_types::samples::{RcFrame, RunEvent, VehicleTruth};
use shared_types::service::seconds;
use shared_types::{Published, ServiceId};

/// Fastest touch-down that is a landing and no fall, m/s: the scenario states 0.5 m/s.
const TOUCH_DOWN: f64 = 0.8;

/// A vehicle on its path, and the place of its run.
fn in_the_air() -> (Place, Begun) {
    let place = Place::in_real_time();
    let run = wait_on_the_ground(&place);
    take_off_from_the_ground(&place);
    (place, run)
}

/// Waits for the end of a flight that lands, with its exit code and what it says.
#[track_caller]
fn assert_it_lands(place: &Place, run: Begun, code: i32) -> String {
    let orchestrator = run.id();
    await_phase(place, "land");
    await_phase(place, "disarmed");
    let ended = finish(run);
    assert_eq!(ended.status.code(), Some(code), "{}", said(&ended));
    place.assert_nothing_is_left_of(orchestrator);
    complaint(&ended)
}

#[test]
fn a_full_disk_lands_the_vehicle() {
    let (place, run) = in_the_air();
    fill_the_disk_of(run.id());
    let complaint = assert_it_lands(&place, run, 4);
    let begins =
        "The vehicle stands on the ground, disarmed. To take off, in another terminal: gerono arm --run ";
    assert!(complaint.contains(begins), "{complaint}");
    assert!(complaint.contains("The vehicle lands."), "{complaint}");
    assert!(complaint.contains("File too large"), "{complaint}");
    assert!(place.path("out/run.mcap.partial").exists());
}

#[test]
fn a_log_that_is_deleted_lands_the_vehicle() {
    let (place, run) = in_the_air();
    std::fs::remove_dir_all(place.path("out")).unwrap();
    let complaint = assert_it_lands(&place, run, 4);
    assert!(complaint.contains("was removed"), "{complaint}");
}

#[test]
fn a_service_beyond_its_restarts_lands_the_vehicle() {
    let place = Place::in_real_time();
    let run = begin(flight_on_the_ground(&place).args(["--restarts", "0"]));
    take_off_from_the_ground(&place);
    let controller = until("the controller", || pid_of(run.id(), ServiceId::Controller));
    signal(controller, Signal::KILL);
    let complaint = assert_it_lands(&place, run, 3);
    assert!(complaint.contains("The vehicle lands."), "{complaint}");
    assert_is_down(&place);
}

#[test]
fn a_pipe_that_nobody_reads_holds_up_no_flight() {
    let place = Place::in_real_time();
    let (unread, full) = std::io::pipe().unwrap();
    rustix::io::ioctl_fionbio(&full, true).unwrap();
    while rustix::io::write(&full, &[b'.'; 4096]).is_ok() {}
    rustix::io::ioctl_fionbio(&full, false).unwrap();
    let mut command = flight_on_the_ground(&place);
    let begun = command.stdout(Stdio::null()).stderr(full).spawn();
    let mut run = Begun::from(begun.unwrap());
    take_off_from_the_ground(&place);
    signal(run.id(), Signal::INT);
    await_phase(&place, "land");
    let ended = wait(&mut run);
    assert_eq!(ended.code(), Some(130));
    assert_is_down(&place);
    drop(unread);
}

#[test]
fn a_terminal_that_is_closed_lands_the_vehicle() {
    let place = Place::in_real_time();
    let terminal = Terminal::open(100, 30);
    let mut run = Begun::from(terminal.start(&mut flight_on_the_ground(&place)));
    take_off_from_the_ground(&place);
    drop(terminal);
    await_phase(&place, "land");
    let ended = wait(&mut run);
    assert_eq!(ended.code(), Some(128 + Signal::HUP.as_raw()));
    assert_is_down(&place);
}

#[test]
fn in_the_air_repeated_interrupts_land_the_vehicle_and_say_how_to_kill() {
    let (place, run) = in_the_air();
    for number in [Signal::INT, Signal::INT, Signal::TERM, Signal::INT] {
        signal(run.id(), number);
        let services = services_of(run.id()).len();
        assert_eq!(services, ServiceId::ALL.len(), "all services still fly");
        await_phase(&place, "land");
    }
    succeed(&mut place.gerono(&["stop"]));
    let said = assert_it_lands(&place, run, 130);
    for piece in ["The vehicle lands.", "still landing", "gerono kill --run"] {
        assert!(said.contains(piece), "{piece}: {said}");
    }
    assert_is_down(&place);
}

#[test]
fn after_a_kill_in_the_air_the_log_goes_on_to_the_ground() {
    let (place, run) = in_the_air();
    signal(run.id(), Signal::INT);
    await_phase(&place, "land");
    succeed(&mut place.gerono(&["kill"]));
    let stopped = succeed(&mut place.gerono(&["stop"]));
    assert!(
        said(&stopped).contains("The motors were killed."),
        "{}",
        said(&stopped)
    );
    let ended = finish(run);
    assert_eq!(ended.status.code(), Some(130), "{}", said(&ended));
    let truths = samples::<VehicleTruth>(&place);
    let (first, last) = (truths.first().unwrap(), truths.last().unwrap());
    assert!((first.position_world[2] - last.position_world[2]).abs() < 0.01);
    let frames = samples::<RcFrame>(&place);
    let killed = frames.iter().find(|frame| frame.action == RcFrame::ACTION_KILL);
    let rests_for = last.header.stamp_ns - killed.unwrap().header.stamp_ns;
    assert!(seconds(rests_for) >= GROUNDED_AFTER - 0.1, "{rests_for} ns");
    let kinds: Vec<_> = samples::<RunEvent>(&place)
        .iter()
        .map(|event| event.kind)
        .filter(|&kind| kind >= RunEvent::KIND_OPERATOR_ARMS)
        .collect();
    let asked = [
        RunEvent::KIND_OPERATOR_ARMS,
        RunEvent::KIND_OPERATOR_LANDS,
        RunEvent::KIND_OPERATOR_KILLS,
    ];
    assert_eq!(kinds[kinds.len() - 3..], asked);
    let phases = &place.summary("out")["flight"];
    let reasons: Vec<_> = phases
        .as_array()
        .unwrap()
        .iter()
        .rev()
        .map(|phase| &phase["reason"])
        .take(2)
        .collect();
    assert_eq!(reasons, ["gerono kill", "a signal"], "{phases}");
}

#[test]
fn an_orchestrator_that_was_stopped_replaces_nobody_when_it_goes_on() {
    let (place, run) = in_the_air();
    signal(run.id(), Signal::STOP);
    let stopped = Instant::now();
    until("four times the time of a service that hangs", || {
        (stopped.elapsed() > Duration::from_secs(1)).then_some(())
    });
    signal(run.id(), Signal::CONT);
    signal(run.id(), Signal::INT);
    let ended = finish(run);
    assert_eq!(ended.status.code(), Some(130), "{}", said(&ended));
    assert_eq!(place.summary("out").get("restarts"), None);
    assert_is_down(&place);
}

fn samples<T: Published>(place: &Place) -> Vec<T> {
    let log = LogReader::open(&place.log("out")).unwrap();
    log.samples().map(Result::unwrap).collect()
}

/// The log ends with the vehicle on the ground, to which it came slowly.
#[track_caller]
fn assert_is_down(place: &Place) {
    let truths = samples::<VehicleTruth>(place);
    let (first, last) = (truths.first().unwrap(), truths.last().unwrap());
    let height = |truth: &VehicleTruth| first.position_world[2] - truth.position_world[2];
    assert!(height(last).abs() < 0.01, "{} m above the ground", height(last));
    let touch_down = truths.iter().rposition(|truth| height(truth) > 0.01);
    let [x, y, z] = truths[touch_down.expect("it has flown")].velocity_body;
    let speed = (x * x + y * y + z * z).sqrt();
    assert!(speed < TOUCH_DOWN, "it came down at {speed} m/s");
}
