//! Replays into service processes say what a replay in one process says, word for word, and leave nothing behind
//! whatever becomes of them.

use crate::common;

use std::process::Output;

use common::processes::{is_alive, pid_of, services_of, signal};
use common::{Begun, Place, begin, complaint, finish, fly_to_the_end, output, succeed, until};
use rustix::process::Signal;
use shared_types::ServiceId;

/// The addition of a replay into processes to its last line.
const IN_PROCESSES: &str = ", in service processes";

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

fn replay(place: &Place, arguments: &[&str]) -> Output {
    let arguments: Vec<_> = ["replay", "--quiet"].iter().chain(arguments).copied().collect();
    output(&mut place.gerono(&arguments))
}

/// Replays in one process and into processes. What both say, and how both end.
fn replayed(place: &Place, arguments: &[&str]) -> (String, Option<i32>) {
    let in_one = replay(place, arguments);
    let in_processes = replay(place, &[arguments, &["--processes"]].concat());
    let said = text(&in_processes.stdout);
    assert!(
        said.contains(IN_PROCESSES),
        "{said}\n{}",
        text(&in_processes.stderr)
    );
    assert_eq!(said.replace(IN_PROCESSES, ""), text(&in_one.stdout));
    assert_eq!(in_processes.status, in_one.status);
    assert_eq!(place.leftovers(), Vec::<String>::new());
    (said, in_processes.status.code())
}

#[track_caller]
fn assert_identical((said, code): &(String, Option<i32>)) {
    assert!(
        said.contains("\nidentical: ") || said.starts_with("identical: "),
        "{said}"
    );
    assert_eq!(*code, Some(0));
}

#[test]
fn a_flight_in_which_everything_fails_as_planned_is_identical_in_processes() {
    let place = Place::new();
    let faults = "fault=[\
        {at = 0.2, service = \"controller\", kind = \"off\", for = 0.1, state = \"cold\"}, \
        {at = 0.4, service = \"estimator\", kind = \"freeze\", for = 0.05}, \
        {at = 0.5, edge = \"vehicle/state -> controller\", kind = \"delay\", for = 0.1, by = 0.02}, \
        {at = 0.6, edge = \"mocap/pose -> estimator\", kind = \"stuck\", for = 0.1}, \
        {at = 0.7, edge = \"control/command -> rc_output\", kind = \"intermittent\", for = 0.2, fraction = 0.5}, \
        {at = 1.0, service = \"path_generator\", kind = \"off\", for = 1.5}]";
    fly_to_the_end(&mut place.rig_flight("out", 3.0, &["--set", faults]));
    assert_identical(&replayed(&place, &["out"]));
    // Services begin with what they are recorded to have known, and what they know is compared.
    let part = replayed(&place, &["out", "--from", "2.2", "--to", "2.8"]);
    assert_identical(&part);
}

#[test]
fn a_long_flight_and_one_service_of_it_are_identical_in_processes() {
    let place = Place::new();
    // More ticks than there are places in a buffer, and than samples are remembered.
    succeed(&mut place.short_flight("out", 5.0, &["--host", "inprocess"]));
    assert_identical(&replayed(&place, &["out"]));
    let alone = replayed(&place, &["out", "--service", "controller"]);
    assert_identical(&alone);
    assert!(alone.0.contains("15003 samples of 5001 steps"), "{}", alone.0);
}

#[test]
fn of_a_flight_in_real_time_in_which_services_died_anywhere_in_a_step_processes_say_the_same() {
    let place = Place::new();
    let (mut command, _) = place.flight_with_deaths_everywhere("out");
    fly_to_the_end(&mut command);
    // A machine that has no time for the recorder makes it lose samples; then both say of which steps nothing is known.
    let (said, _) = replayed(&place, &["out"]);
    assert!(!said.contains("identical: 0 samples"), "{said}");
}

#[test]
fn a_changed_gain_is_found_at_the_same_tick_and_member() {
    let place = Place::new();
    succeed(&mut place.short_flight("out", 1.0, &["--host", "inprocess"]));
    let (said, code) = replayed(&place, &["out", "--set", "controller.k1=5.5"]);
    assert!(said.contains("The first difference is at tick "), "{said}");
    assert!(said.contains("not identical: "), "{said}");
    // What was asked for is no failure.
    assert_eq!(code, Some(0));
}

#[test]
fn what_is_not_finite_is_not_published_and_does_not_end_the_replay() {
    let place = Place::new();
    succeed(&mut place.short_flight("out", 1.0, &["--host", "inprocess"]));
    // A body without inertia spins beyond all numbers with the first torque.
    let weightless = "vehicle.inertia=[1e-100, 1e-100, 1e-100]";
    let (said, _) = replayed(&place, &["out", "--service", "plant", "--set", weightless]);
    assert!(said.contains(" 2 samples of 1001 steps"), "{said}");
}

/// A replay into processes of a log that is long enough.
fn long_replay(place: &Place) -> Begun {
    succeed(&mut place.short_flight("out", 60.0, &["--host", "inprocess", "--quiet"]));
    begin(&mut place.gerono(&["replay", "--quiet", "--processes", "out"]))
}

/// By so many sleeps a service process has done steps, and has not done the last: it sleeps about thirty times until it is
/// ready, and then before each of the 235 batches of a long replay.
const SLEEPS: u32 = 100;

/// The process that replays a service, once it is in the middle of it.
fn in_the_middle(replay: &Begun, service: ServiceId) -> u32 {
    until("steps of the service", || {
        let pid = pid_of(replay.id(), service)?;
        let status = std::fs::read_to_string(format!("/proc/{pid}/status")).ok()?;
        let mut lines = status.lines();
        let sleeps = lines.find_map(|line| line.strip_prefix("voluntary_ctxt_switches:"))?;
        (sleeps.trim().parse::<u32>().ok()? > SLEEPS).then_some(pid)
    })
}

#[test]
fn the_death_of_a_service_ends_the_replay_which_names_it() {
    let place = Place::new();
    let replay = long_replay(&place);
    let (id, service) = (replay.id(), ServiceId::Controller);
    let killed = in_the_middle(&replay, service);
    signal(killed, Signal::KILL);
    let output = finish(replay);
    assert_eq!(output.status.code(), Some(1));
    let said = complaint(&output);
    let what = format!("the process {killed} that replayed `controller` died after its step at tick ");
    assert!(said.contains(&what) && said.contains("KILL"), "{said}");
    assert_eq!(text(&output.stdout), "");
    place.assert_nothing_is_left_of(id);
}

#[test]
fn a_signal_ends_a_replay_in_good_order() {
    let place = Place::new();
    let replay = long_replay(&place);
    let id = replay.id();
    in_the_middle(&replay, ServiceId::Plant);
    let services = services_of(id);
    signal(id, Signal::INT);
    let output = finish(replay);
    assert_eq!(output.status.code(), Some(130), "{}", text(&output.stderr));
    assert!(services.iter().all(|&(_, pid)| !is_alive(pid)));
    place.assert_nothing_is_left_of(id);
}
