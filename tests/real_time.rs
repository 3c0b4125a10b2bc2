//! Flights in real time: what they are compared with lock-step, and what becomes of services that die or hang in them.
//!
//! Nothing here depends on how fast or how punctual the machine is: what is late is told, and that is what is checked.

mod common;

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use common::logs::host_samples;
use common::pilot::{ask, await_phase, flight_on_the_ground, take_off_from_the_ground, wait_on_the_ground};
use common::processes::{await_successor, pid_of, processes_of, services_of, signal};
use common::{Begun, Place, assert_flown_to_the_end, begin, finish, output, said, scenario, succeed, until};
use metrics::tracker::Tracker;
use run_client::Snapshot;
use run_log::{HostEvent, LogReader, ServiceStep};
use rustix::process::Signal;
use shared_types::samples::{RcFrame, RunEvent, VehicleTruth};
use shared_types::service::seconds;
use shared_types::{Schedule, ServiceId, Topic};

/// Flights in real time share the machine with nobody else of these tests.
static MACHINE: Mutex<()> = Mutex::new(());

fn the_machine() -> MutexGuard<'static, ()> {
    MACHINE.lock().unwrap_or_else(PoisonError::into_inner)
}

/// All samples of a log, by tick and topic.
fn samples(log: &Path) -> BTreeMap<(u64, usize), Vec<u8>> {
    let mut reader = LogReader::open(log).unwrap();
    let mut samples = BTreeMap::new();
    while let Some(sample) = reader.next_sample().unwrap() {
        samples.insert((sample.header.tick, sample.topic.index()), sample.bytes.to_vec());
    }
    samples
}

/// A flight in real time under way, to the folder `out`: of the laboratory's vehicle, which nobody's absence turns over
/// on a machine in use.
fn take_off(place: &Place, out: &str, seconds: f64) -> Begun {
    let child = begin(&mut place.rig_flight(out, seconds, &["--host", "realtime"]));
    until("all services", || {
        (services_of(child.id()).len() == ServiceId::ALL.len()).then_some(())
    });
    place.await_log(out, 20_000);
    child
}

/// The settings that make of `hover.toml` a short flight that any machine has the time for.
const SHORT_HOVER: [&str; 2] = ["schedule.tick=0.002", "duration=2.0"];

#[test]
fn until_something_is_late_a_flight_in_real_time_is_that_of_lock_step() {
    let _machine = the_machine();
    let place = Place::new();
    let fly = |out: &str, host: &str| {
        let hover = scenario("hover");
        let mut arguments = vec!["run", hover.to_str().unwrap(), "--out", out, "--host", host];
        arguments.extend(SHORT_HOVER.iter().flat_map(|setting| ["--set", setting]));
        succeed(&mut place.gerono(&arguments));
    };
    let settings = SHORT_HOVER.map(str::to_owned);
    let flown = scenario_file::load(&scenario("hover"), &settings, None).unwrap();
    let schedule = flown.schedule().unwrap();
    fly("lock-step", "lockstep");
    let theirs = samples(&place.log("lock-step"));
    // A machine in use may be late from the first tick on, but not every time.
    let punctual = (0..5).map(|flight| {
        let out = format!("real-time-{flight}");
        fly(&out, "realtime");
        punctual_samples(&place, &out, &theirs, &schedule)
    });
    assert!(punctual.into_iter().any(|samples| samples > 0));
}

/// Demands of a flight in real time that its samples are those of lock-step until something was late; how many.
fn punctual_samples(
    place: &Place,
    out: &str,
    theirs: &BTreeMap<(u64, usize), Vec<u8>>,
    schedule: &Schedule,
) -> usize {
    let steps: Vec<ServiceStep> = host_samples(place, out, "host/steps");
    let timing = &place.summary(out)["timing"];
    assert_eq!(timing["unrecorded"], serde_json::json!([]));
    let rows = timing["services"].as_array().unwrap().iter();
    let steps_in_summary: u64 = rows.map(|row| row["steps"].as_u64().unwrap()).sum();
    assert_eq!(steps_in_summary, steps.len() as u64);

    let is_punctual = |step: &&ServiceStep| {
        let service = ServiceId::ALL[step.service as usize];
        // A step tells 1 + the number of each sample that it saw, which is its tick where there is one at every tick.
        let mut inputs = (0..service.inputs().len()).zip(step.consumed);
        step.missed == 0
            && inputs.all(|(input, consumed)| {
                let due = schedule.edge(service, input).due_sample(step.tick);
                consumed == due.map_or(0, |due| due + 1)
            })
    };
    let late = steps
        .iter()
        .filter(|step| !is_punctual(step))
        .map(|step| step.tick);
    let first_late = late.min().unwrap_or(u64::MAX);
    let ours = samples(&place.log(out));
    let punctual = theirs.range(..(first_late, 0));
    punctual
        .map(|(key, sample)| assert!(ours.get(key) == Some(sample), "another sample at tick {}", key.0))
        .count()
}

/// A service's own steps.
fn of_service(steps: &[ServiceStep], service: ServiceId) -> impl Iterator<Item = &ServiceStep> {
    let is_own = move |step: &&ServiceStep| step.service as usize == service.index();
    steps.iter().filter(is_own)
}

#[test]
fn every_service_that_is_killed_in_flight_flies_again_and_so_does_the_vehicle() {
    let _machine = the_machine();
    let place = Place::new();
    let child = take_off(&place, "out", 100.0);
    let orchestrator = child.id();
    for service in ServiceId::ALL {
        let pid = until("the service", || pid_of(orchestrator, service));
        signal(pid, Signal::KILL);
        await_successor(orchestrator, service, pid);
    }
    // Soon all is as before; on a machine in use, which keeps the services waiting too, a little later.
    place.await_log("out", place.log_bytes("out") + 500_000);
    until("the vehicle on its path", || {
        place
            .look()
            .filter(|snapshot| snapshot.position_error.is_some_and(|error| error < 0.1))
    });
    signal(orchestrator, Signal::INT);
    let output = finish(child);
    assert_eq!(
        output.status.code(),
        Some(130),
        "{}",
        String::from_utf8_lossy(&output.stderr)
    );

    let summary = place.summary("out");
    let restarted: Vec<_> = summary["restarts"]
        .as_array()
        .unwrap()
        .iter()
        .map(|one| one["service"].as_str().unwrap().to_owned())
        .collect();
    let names: BTreeSet<_> = restarted.into_iter().collect();
    assert_eq!(
        names,
        ServiceId::ALL.map(|service| service.name().to_owned()).into()
    );
    // It ends where it should be, on the path that waited for it.
    let mut log = LogReader::open(&place.log("out")).unwrap();
    let schedule = log.manifest().scenario.schedule().unwrap();
    let mut distance = f64::INFINITY;
    let followed = Tracker::new(&schedule, false).follow(&mut log, |moment| {
        distance = moment.distance.unwrap_or(distance);
    });
    followed.unwrap();
    assert!(distance < 0.2, "it ended {distance} m from its path");
    let steps: Vec<ServiceStep> = host_samples(&place, "out", "host/steps");
    for service in ServiceId::ALL {
        let own = of_service(&steps, service);
        // A step that its process did not survive is told, but not remembered by the next.
        let apart: Vec<_> = own
            .filter_map(|step| Some((step.tick - step.previous.checked_sub(1)?, u64::from(step.missed))))
            .collect();
        let period = apart.iter().map(|(ticks, _)| *ticks).min().unwrap();
        for (ticks, left_out) in apart {
            assert_eq!(
                ticks,
                period * (1 + left_out),
                "{service}: a step is neither told nor missed"
            );
        }
    }
    place.assert_nothing_is_left_of(orchestrator);
}

#[test]
fn nobody_waits_for_the_dead() {
    let _machine = the_machine();
    let place = Place::new();
    // Its successors die before they fly, each after a longer pause: it is dead for some 0.2 s.
    let deaths = [
        vec!["path_generator@1500:before-step"],
        vec!["path_generator@0:before-ports"; 7],
    ]
    .concat();
    let crashes = deaths.into_iter().flat_map(|death| ["--crash", death]);
    let settings: Vec<_> = ["--host", "realtime"].into_iter().chain(crashes).collect();
    let child = begin(&mut place.rig_flight("out", 100.0, &settings));
    let orchestrator = child.id();
    until("all services after the deaths", || {
        let snapshot = place.look().filter(|snapshot| snapshot.time > 2.5)?;
        snapshot
            .services
            .iter()
            .all(|service| service.flies)
            .then_some(())
    });
    signal(orchestrator, Signal::INT);
    assert_eq!(finish(child).status.code(), Some(130));

    let steps: Vec<ServiceStep> = host_samples(&place, "out", "host/steps");
    let controller = ServiceId::Controller;
    let in_vain: Vec<_> = of_service(&steps, controller)
        .filter(|step| step.late_inputs != 0)
        .collect();
    assert!(in_vain.len() > 5, "{} steps without a reference", in_vain.len());
    let flown = scenario_file::load(&scenario("fig3_6"), &[], None).unwrap();
    let schedule = flown.schedule().unwrap();
    let tick_ns = schedule.tick_ns();
    let half_a_period_ns = schedule.service_rate(controller).period * tick_ns / 2;
    let prompt = in_vain.iter().filter(|step| {
        let begins_ns = step.tick * tick_ns;
        step.began_ns < begins_ns + half_a_period_ns
    });
    // Not the one that waited when it died, and not all where the machine keeps them waiting.
    let (prompt, all) = (prompt.count(), in_vain.len());
    assert!(
        2 * prompt > all,
        "{prompt} of {all} steps did not wait for the dead"
    );
    place.assert_nothing_is_left_of(orchestrator);
}

#[test]
fn a_restarted_estimator_takes_in_the_frames_of_its_gap() {
    let _machine = the_machine();
    let place = Place::new();
    // Its successors die before they fly, each after a longer pause: it is dead for some 0.1 s.
    let deaths = [
        vec!["estimator@1500:before-step"],
        vec!["estimator@0:before-ports"; 6],
    ]
    .concat();
    let crashes = deaths.into_iter().flat_map(|death| ["--crash", death]);
    let settings: Vec<_> = ["--host", "realtime", "--quiet"]
        .into_iter()
        .chain(crashes)
        .collect();
    assert_flown_to_the_end(&output(&mut place.rig_flight("out", 3.0, &settings)));

    let steps: Vec<ServiceStep> = host_samples(&place, "out", "host/steps");
    let steps: Vec<_> = of_service(&steps, ServiceId::Estimator).collect();
    let flown = scenario_file::load(&scenario("fig3_6"), &[], None).unwrap();
    let tick_ns = flown.schedule().unwrap().tick_ns();
    let lateness_ns = steps
        .iter()
        .map(|step| step.began_ns.saturating_sub(step.tick * tick_ns));
    assert!(
        lateness_ns.max() > Some(22_000_000),
        "no frame was published in the gap"
    );
    let mut inputs = ServiceId::Estimator.inputs().iter();
    let input = inputs.position(|input| input.topic == Topic::RcFrame).unwrap();
    let taken_in: BTreeSet<u64> = steps.iter().map(|step| step.consumed[input]).collect();
    let log = LogReader::open(&place.log("out")).unwrap();
    let frames = log.samples::<RcFrame>().map(|frame| frame.unwrap().header);
    let around = frames.filter(|header| (1400..2500).contains(&header.tick));
    let missed: Vec<u64> = around
        .filter(|header| !taken_in.contains(&(header.seq + 1)))
        .map(|header| header.tick)
        .collect();
    assert_eq!(missed, Vec::<u64>::new());
}

#[test]
fn a_service_that_hangs_is_replaced() {
    let _machine = the_machine();
    let place = Place::new();
    let child = take_off(&place, "out", 5.0);
    let orchestrator = child.id();
    let services = [ServiceId::Controller, ServiceId::RcOutput];
    for service in services {
        let pid = until("the service", || pid_of(orchestrator, service));
        signal(pid, Signal::STOP);
        await_successor(orchestrator, service, pid);
    }
    let output = finish(child);
    assert_flown_to_the_end(&output);
    let events: Vec<HostEvent> = host_samples(&place, "out", "host/events");
    let hung: Vec<_> = events
        .iter()
        .filter(|event| event.kind == HostEvent::KIND_HUNG)
        .map(|event| event.service as usize)
        .collect();
    assert_eq!(hung, services.map(ServiceId::index));
    place.assert_nothing_is_left_of(orchestrator);
}

/// Asks a live run for something; what it says.
fn ask_run(place: &Place, arguments: &[&str]) -> String {
    let output = succeed(&mut place.gerono(arguments));
    String::from_utf8_lossy(&output.stdout).trim().to_owned()
}

#[test]
fn gains_that_are_set_in_flight_survive_the_death_of_the_controller_and_are_replayed_to_the_bit() {
    let _machine = the_machine();
    let place = Place::new();
    let child = take_off(&place, "out", 100.0);
    let orchestrator = child.id();
    let set = ask_run(
        &place,
        &["set", "controller.k1=3", "controller.lambda_disturbance.2=9.5"],
    );
    assert!(
        set.contains("controller.k1=3.0") && set.contains(" s on"),
        "{set}"
    );
    for setting in ["controller.k1=-3", "controller.law=px4", "controller.beta=1e-6"] {
        let refused = output(&mut place.gerono(&["set", "controller.k2=3", setting]));
        assert_eq!(refused.status.code(), Some(7), "{setting}: {}", said(&refused));
    }
    assert_eq!(ask_run(&place, &["get", "controller.k1"]), "controller.k1=3.0");
    assert_eq!(ask_run(&place, &["get", "controller.k2"]), "controller.k2=4.0");
    let controller = until("the controller", || pid_of(orchestrator, ServiceId::Controller));
    signal(controller, Signal::KILL);
    await_successor(orchestrator, ServiceId::Controller, controller);
    assert_eq!(ask_run(&place, &["get", "controller.k1"]), "controller.k1=3.0");
    ask_run(&place, &["set", "controller.k2=3.5"]);
    place.await_log("out", place.log_bytes("out") + 100_000);
    signal(orchestrator, Signal::INT);
    finish(child);

    let steps: Vec<ServiceStep> = host_samples(&place, "out", "host/steps");
    let of_controller = steps
        .iter()
        .filter(|step| step.service as usize == ServiceId::Controller.index());
    let changes: BTreeSet<_> = of_controller.map(|step| step.operator >> 8).collect();
    assert_eq!(changes, BTreeSet::from([0, 1, 2]));
    let log = LogReader::open(&place.log("out")).unwrap();
    let events: Vec<RunEvent> = log.samples().map(Result::unwrap).collect();
    let words: Vec<_> = events
        .iter()
        .filter(|event| event.kind == RunEvent::KIND_OPERATOR_TUNES)
        .map(|event| event.words())
        .collect();
    assert_eq!(
        words,
        [
            "controller.k1=3.0 (change 1)",
            "controller.lambda_disturbance=[18.0, 18.0, 9.5] (change 1)",
            "controller.k2=3.5 (change 2)"
        ]
    );
    for processes in [&[][..], &["--processes"]] {
        let mut arguments = vec!["replay", "out"];
        arguments.extend(processes);
        let replayed = said(&succeed(&mut place.gerono(&arguments)));
        assert!(replayed.contains("identical: "), "{replayed}");
    }
    place.assert_nothing_is_left_of(orchestrator);
}

/// Stops the processes for a time that is well beyond the limit of a service that hangs, and lets them go on.
fn stop_for_long(limit: Duration, processes: &[u32]) {
    processes.iter().for_each(|&pid| signal(pid, Signal::STOP));
    let stopped = Instant::now();
    until("twice the time of a service that hangs", || {
        (stopped.elapsed() > 2 * limit).then_some(())
    });
    processes.iter().rev().for_each(|&pid| signal(pid, Signal::CONT));
}

#[test]
fn when_all_services_are_late_at_once_nobody_is_replaced() {
    let _machine = the_machine();
    let limit = Duration::from_secs(1);
    for with_orchestrator in [true, false] {
        let place = Place::new();
        let child = begin(&mut place.rig_flight(
            "out",
            5.0,
            &["--host", "realtime", "--set", "real_time.hang_limit=1.0"],
        ));
        let orchestrator = child.id();
        until("all services", || {
            (services_of(orchestrator).len() == ServiceId::ALL.len()).then_some(())
        });
        place.await_log("out", 20_000);
        let services: Vec<_> = services_of(orchestrator)
            .into_iter()
            .map(|(_, pid)| pid)
            .collect();
        let stopped: Vec<_> = with_orchestrator
            .then_some(orchestrator)
            .into_iter()
            .chain(services.iter().copied())
            .collect();
        stop_for_long(limit, &stopped);
        let output = finish(child);
        assert_flown_to_the_end(&output);
        let events: Vec<HostEvent> = host_samples(&place, "out", "host/events");
        let hung = events.iter().filter(|event| event.kind == HostEvent::KIND_HUNG);
        assert_eq!(hung.count(), 0, "{}", said(&output));
        assert_eq!(place.summary("out").get("restarts"), None);
        place.assert_nothing_is_left_of(orchestrator);
    }
}

#[test]
fn an_interrupt_ends_a_flight_with_its_log_whole() {
    let _machine = the_machine();
    let place = Place::new();
    let child = take_off(&place, "out", 60.0);
    let orchestrator = child.id();
    signal(orchestrator, Signal::INT);
    let output = finish(child);
    assert_eq!(output.status.code(), Some(130));
    let ticks = samples(&place.log("out"));
    assert!(ticks.len() > 100, "only {} samples", ticks.len());
    place.assert_nothing_is_left_of(orchestrator);
}

/// The cause may be gone by then; here it is not, being the world's own state.
#[test]
fn who_computes_a_number_that_is_not_finite_is_replaced_until_that_is_in_vain() {
    let _machine = the_machine();
    let place = Place::new();
    let spinning = "vehicle.initial.angular_velocity_body=[1e9, 0.0, 1e9]";
    let child = begin(&mut place.live_hover("out", &["--set", spinning, "--restarts", "plant=3"]));
    let orchestrator = child.id();
    let output = finish(child);
    let said = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(3), "{said}");
    assert!(said.contains("`plant`") && said.contains("not finite"), "{said}");
    let events: Vec<HostEvent> = host_samples(&place, "out", "host/events");
    let stops = events
        .iter()
        .filter(|event| event.text.windows(10).any(|words| words == b"not finite") && event.pid != 0);
    let processes: BTreeSet<_> = stops.map(|event| event.pid).collect();
    assert_eq!(
        processes.len(),
        5,
        "the first, which had flown some ticks, and four of which none did"
    );
    place.assert_nothing_is_left_of(orchestrator);
}

#[test]
fn arming_warns_of_cameras_that_scatter_more_than_stated() {
    let _machine = the_machine();
    let place = Place::new();
    let told_of = "estimator.kalman.position_deviation=5e-5";
    let child = begin(flight_on_the_ground(&place).args(["--set", told_of]));
    // A few captures do not show it yet.
    ask("a second of captures", || {
        place.look().filter(|snapshot| snapshot.time > 1.0)
    });
    let told = said(&succeed(&mut place.gerono(&["arm"])));
    assert!(told.contains("the cameras scatter by some"), "{told}");
    succeed(&mut place.gerono(&["kill"]));
    succeed(&mut place.gerono(&["stop"]));
    finish(child);
}

#[test]
fn an_operator_arms_and_stops_and_the_run_ends_on_the_ground() {
    let _machine = the_machine();
    let place = Place::new();
    assert_eq!(
        place.gerono(&["arm"]).output().unwrap().status.code(),
        Some(1),
        "there is no run yet"
    );
    let child = wait_on_the_ground(&place);
    take_off_from_the_ground(&place);
    succeed(&mut place.gerono(&["stop"]));
    await_phase(&place, "land");
    let output = finish(child);
    assert_flown_to_the_end(&output);
    let last = |frames: Vec<RcFrame>| *frames.last().unwrap();
    let log = || LogReader::open(&place.log("out")).unwrap();
    let frame = last(log().samples::<RcFrame>().map(Result::unwrap).collect());
    assert!(frame.failsafe.is_set() && frame.thrust == 0.0);
    let truth = log().samples::<VehicleTruth>().last().unwrap().unwrap();
    let first = log().samples::<VehicleTruth>().next().unwrap().unwrap();
    assert!(
        (truth.position_world[2] - first.position_world[2]).abs() < 0.01,
        "not on the ground"
    );
}

#[test]
fn a_kill_outlives_the_service_that_obeys_it() {
    let _machine = the_machine();
    let place = Place::new();
    let child = wait_on_the_ground(&place);
    take_off_from_the_ground(&place);
    succeed(&mut place.gerono(&["kill"]));
    await_phase(&place, "disarmed");
    let pid = until("the transmitter", || pid_of(child.id(), ServiceId::RcOutput));
    signal(pid, Signal::KILL);
    await_successor(child.id(), ServiceId::RcOutput, pid);
    // Nothing lets the motors turn again.
    let refused = place.gerono(&["arm"]).output().unwrap();
    assert_eq!(refused.status.code(), Some(7), "{}", said(&refused));
    assert!(
        said(&refused).contains("a kill stopped the motors"),
        "{}",
        said(&refused)
    );
    let flown = |snapshot: &Snapshot| snapshot.services[ServiceId::RcOutput.index()].flies;
    let restarted_by = until("the new transmitter", || place.look().filter(flown)).time;
    until("half a second more", || {
        place.look().filter(|snapshot| snapshot.time > restarted_by + 0.5)
    });
    signal(child.id(), Signal::INT);
    assert_eq!(finish(child).status.code(), Some(130));
    let log = LogReader::open(&place.log("out")).unwrap();
    let frames: Vec<_> = log.samples::<RcFrame>().map(Result::unwrap).collect();
    assert!(
        frames.iter().any(|frame| frame.thrust > 1.0),
        "it has never flown"
    );
    let mut after = frames
        .iter()
        .filter(|frame| seconds(frame.header.stamp_ns) > restarted_by);
    assert!(after.clone().count() > 20 && after.all(|frame| frame.failsafe.is_set()));
}

/// Returns whether a process runs; one that is dead and not waited for does not.
fn runs(pid: u32) -> bool {
    let state = std::fs::read_to_string(format!("/proc/{pid}/stat")).unwrap_or_default();
    state
        .rsplit(')')
        .next()
        .is_some_and(|rest| !rest.is_empty() && !rest.trim_start().starts_with('Z'))
}

#[test]
fn services_whose_orchestrator_is_killed_end_and_the_next_run_finds_nothing() {
    let _machine = the_machine();
    let place = Place::new();
    let mut child = take_off(&place, "out", 100.0);
    let services = processes_of(child.id());
    let shared = child.id();
    child.kill().unwrap();
    child.wait().unwrap();
    until("the end of all services", || {
        services.iter().all(|&(_, pid)| !runs(pid)).then_some(())
    });
    succeed(&mut place.gerono(&["clean"]));
    place.assert_nothing_is_left_of(shared);
}

#[test]
fn a_vehicle_whose_orchestrator_is_killed_lands() {
    let _machine = the_machine();
    let place = Place::new();
    let mut child = wait_on_the_ground(&place);
    take_off_from_the_ground(&place);
    let services = services_of(child.id());
    assert_eq!(services.len(), ServiceId::ALL.len());
    child.kill().unwrap();
    child.wait().unwrap();
    // They fly on, and their place is not swept meanwhile.
    succeed(&mut place.gerono(&["clean"]));
    assert!(
        services.iter().all(|&(_, pid)| runs(pid)),
        "who has not landed has ended"
    );
    until("the landing", || {
        services.iter().all(|&(_, pid)| !runs(pid)).then_some(())
    });
    succeed(&mut place.gerono(&["clean"]));
    assert_eq!(place.leftovers(), Vec::<String>::new());
}

#[test]
fn whoever_takes_over_a_flight_records_it_and_replaces_who_dies() {
    let _machine = the_machine();
    let place = Place::new();
    let lonely = "real_time.orchestrator_loss=\"continue\"";
    // The laboratory's vehicle: it holds its rates by itself while nobody commands.
    let settings = ["--host", "realtime", "--quiet", "--set", lonely];
    let mut first = begin(&mut place.rig_flight("first", 300.0, &settings));
    place.await_log("first", 20_000);
    let services = services_of(first.id());
    assert!(
        place
            .gerono(&["attach", "--out", "none"])
            .output()
            .unwrap()
            .status
            .code()
            == Some(1),
        "its orchestrator lives"
    );
    first.kill().unwrap();
    first.wait().unwrap();
    let [dead, killed] = [ServiceId::Controller, ServiceId::Estimator].map(|service| {
        let found = services.iter().find(|(name, _)| name == service.name());
        found.unwrap().1
    });
    signal(dead, Signal::KILL);
    until("its end", || (!runs(dead)).then_some(()));
    let second = begin(&mut place.gerono(&["attach", "--out", "second", "--quiet"]));
    place.await_log("second", 20_000);
    signal(killed, Signal::KILL);
    for service in [ServiceId::Controller, ServiceId::Estimator] {
        until("a new process", || pid_of(second.id(), service));
    }
    let events = || {
        let shown = output(&mut place.gerono(&["top", "--once", "--json"]));
        let shown: serde_json::Value = serde_json::from_slice(&shown.stdout).ok()?;
        Some(shown["events"].to_string()).filter(|events| events.contains("`estimator` was restarted"))
    };
    until("the estimator", events);
    succeed(&mut place.gerono(&["stop"]));
    let ended = finish(second);
    assert_flown_to_the_end(&ended);
    assert_eq!(place.leftovers(), Vec::<String>::new());
    assert!(services.iter().all(|&(_, pid)| !runs(pid)));

    let reader = LogReader::open(&place.log("second")).unwrap();
    let ticks: Vec<_> = reader
        .samples::<VehicleTruth>()
        .map(|truth| truth.unwrap().header.tick)
        .collect();
    assert!(ticks[0] > 0 && ticks.len() > 100);
    let period = ticks[1] - ticks[0];
    assert!(ticks.windows(2).all(|pair| pair[1] == pair[0] + period));
    // What the services knew at the beginning stands in no log.
    let replayed = output(&mut place.gerono(&["replay", "second", "--quiet"]));
    assert_eq!(replayed.status.code(), Some(8));
    // The new orchestrator has recorded what the services knew when it came.
    let said = String::from_utf8_lossy(&replayed.stdout);
    assert!(said.contains("Resumed from a checkpoint"), "{said}");
}
