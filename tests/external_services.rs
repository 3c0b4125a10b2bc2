//! External services: one that keeps the process contract flies as the service itself would,
//! and what becomes of those that do not.
//!
//! The external services are processes of this very test, which `an_external_service` is when it finds itself started as one,
//! and shells.

#![expect(clippy::disallowed_methods, reason = "tests make their own files")]

mod common;
#[path = "common/external_service.rs"]
mod external_service;

use std::path::Path;
use std::process::Output;
use std::sync::{PoisonError, RwLock, RwLockReadGuard, RwLockWriteGuard};
use std::time::{Duration, Instant};

use common::logs::last_tick;
use common::processes::{await_end, signal};
use common::{Begun, Place, begin, complaint, finish, output, scenario, succeed, until};
use external_service::{CONDUCT, ExternalService, external_service, program};
use run_log::LogReader;
use runtime::control::{ToOrchestrator, ToService};
use rustix::process::Signal;
use serde_json::Value;
use shared_types::{Header, ServiceId, Topic};

/// Longer than a process of the run may take in flight to become ready, and than a step may.
const SLOW_START: Duration = Duration::from_millis(1_200);

/// Flights in real time have the machine for themselves.
static MACHINE: RwLock<()> = RwLock::new(());

fn alone() -> RwLockWriteGuard<'static, ()> {
    MACHINE.write().unwrap_or_else(PoisonError::into_inner)
}

fn among_others() -> RwLockReadGuard<'static, ()> {
    MACHINE.read().unwrap_or_else(PoisonError::into_inner)
}

/// A setting by which a script flies in place of the controller.
fn script(text: &str) -> String {
    program(ServiceId::Controller, &["sh", "-c", text])
}

/// Lets an external service in place of the controller publish nothing but zeros of these topics.
fn erase(external_service: &mut ExternalService, topics: &'static [Topic]) {
    external_service.mischief = Box::new(move |_, samples| {
        let all = ServiceId::Controller.outputs().iter();
        let outputs = all.filter(|output| {
            output.topic != Topic::ControlTelemetry && !output.topic.is_of_flight_outdoors()
        });
        assert_eq!(
            samples.len(),
            outputs.clone().count(),
            "the controller publishes all of its topics with each step"
        );
        for (sample, output) in samples.iter_mut().zip(outputs) {
            if topics.contains(&output.topic) {
                sample[size_of::<Header>()..].fill(0);
            }
        }
    });
}

/// No test unless it was started as an external service.
#[test]
fn an_external_service() {
    let Ok(conduct) = std::env::var(CONDUCT) else {
        return;
    };
    let mut external_service = ExternalService::join();
    match conduct.as_str() {
        "lock_step" => external_service.fly_in_lock_step(u64::MAX),
        "real_time" => external_service.fly_in_real_time(u64::MAX),
        "starts_slowly" => {
            // An interpreter that loads what it needs, and compiles the first step as it comes to it.
            std::thread::sleep(SLOW_START);
            let mut is_first = true;
            external_service.mischief = Box::new(move |_, _| {
                if std::mem::take(&mut is_first) {
                    std::thread::sleep(SLOW_START);
                }
            });
            external_service.fly_in_real_time(u64::MAX);
        }
        "tells_nothing" => {
            erase(
                &mut external_service,
                &[Topic::ControlErrors, Topic::ControlAdaptation],
            );
            external_service.fly_in_lock_step(u64::MAX);
        }
        "does_nothing" => {
            erase(
                &mut external_service,
                &[
                    Topic::ControlErrors,
                    Topic::ControlAdaptation,
                    Topic::ControlCommand,
                ],
            );
            external_service.fly_in_lock_step(u64::MAX);
        }
        "finishes_early" => external_service.fly_in_lock_step(100),
        "dies" => {
            external_service.fly_in_lock_step(100);
            std::process::exit(9);
        }
        "forgets_its_receivers" => {
            external_service.await_go(&[]);
        }
        "babbles" => {
            let receivers = external_service.receivers();
            external_service.await_go(&receivers);
            external_service.channel.send(&ToOrchestrator::CaughtUp).unwrap();
        }
        other => panic!("no conduct `{other}`"),
    }
    // Who is to be killed for what it has said need not say more.
    let _ = external_service.channel.send(&ToOrchestrator::Finished);
    while !matches!(external_service.channel.receive(), Ok(ToService::Stop) | Err(_)) {}
    std::process::exit(0);
}

/// Flies with a setting for an external service, which must come to nothing: with this exit code and these words.
fn fails(setting: &str, code: i32, pieces: &[&str]) -> Place {
    let place = Place::new();
    let child = begin(&mut place.short_flight("out", 0.5, &["--set", setting]));
    let orchestrator = child.id();
    let output = finish(child);
    let said = complaint(&output);
    assert_eq!(output.status.code(), Some(code), "{said}");
    for piece in pieces {
        assert!(said.contains(piece), "no `{piece}` in:\n{said}");
    }
    place.assert_nothing_is_left_of(orchestrator);
    place
}

const BROKEN_CONTRACT: i32 = 3;

fn assert_same_samples(place: &Place, one: &str, other: &str) {
    let said = succeed(&mut place.gerono(&["diff", one, other])).stdout;
    let said = String::from_utf8(said).unwrap();
    assert!(said.starts_with("identical"), "{said}");
}

#[test]
fn an_external_service_with_a_services_own_law_publishes_the_same_bytes() {
    let _machine = among_others();
    let place = Place::new();
    succeed(&mut place.short_flight("services", 0.3, &["--host", "inprocess"]));
    for service in ServiceId::ALL {
        let out = service.name();
        let setting = external_service(service, "lock_step");
        succeed(&mut place.short_flight(out, 0.3, &["--set", &setting]));
        assert_same_samples(&place, "services", out);
    }
}

#[test]
fn external_services_among_themselves_fly_with_all_rates_and_latencies_of_the_rig() {
    let _machine = among_others();
    let place = Place::new();
    let settings = ServiceId::ALL.map(|service| external_service(service, "lock_step"));
    let settings: Vec<&str> = settings.iter().flat_map(|setting| ["--set", setting]).collect();
    succeed(&mut place.rig_flight("services", 0.5, &["--host", "inprocess"]));
    succeed(&mut place.rig_flight("external_services", 0.5, &settings));
    assert_same_samples(&place, "services", "external_services");
}

#[test]
fn an_external_service_is_judged_by_the_truth_and_not_by_what_it_says_of_itself() {
    let _machine = among_others();
    let place = Place::new();
    succeed(&mut place.short_flight("services", 1.5, &["--host", "inprocess"]));
    let setting = external_service(ServiceId::Controller, "tells_nothing");
    succeed(&mut place.short_flight("silent", 1.5, &["--set", &setting]));
    let [own, silent] = ["services", "silent"].map(|out| place.summary(out));
    assert!(own["metrics"]["max"].as_f64().unwrap() > 1.0);
    assert_eq!(silent["metrics"], own["metrics"], "the same flight");
    assert_eq!(silent["phases"][0]["ultimate"], own["phases"][0]["ultimate"]);
    // The theorem is that of Gerono's own law.
    assert!(own["ultimate_bound"].as_f64().is_some());
    assert_eq!(silent["ultimate_bound"], Value::Null);
    assert_eq!(silent["phases"][0]["against_bound"], Value::Null);
}

#[test]
fn an_external_service_that_lets_the_vehicle_fall_has_lost_it() {
    let _machine = among_others();
    let place = Place::new();
    let setting = external_service(ServiceId::Controller, "does_nothing");
    let flown = output(&mut place.short_flight("out", 1.5, &["--set", &setting]));
    assert_eq!(flown.status.code(), Some(9), "{}", complaint(&flown));
    let lost = &place.summary("out")["lost"];
    assert_eq!(lost["reason"], "left_path");
    // 5 m of free fall from 1.2 m away.
    assert!((0.8..1.1).contains(&lost["time"].as_f64().unwrap()), "{lost}");
    let text = String::from_utf8(flown.stdout).unwrap();
    assert!(text.contains("LOST at") && !text.contains("theorem"), "{text}");
}

#[test]
fn services_that_die_beside_an_external_service_are_mended_and_the_flight_shows_nothing_of_it() {
    let _machine = among_others();
    let place = Place::new();
    let setting = external_service(ServiceId::Controller, "lock_step");
    let fly = |out: &str, more: &[&str]| {
        let mut arguments = vec!["--set", &setting];
        arguments.extend(more);
        succeed(&mut place.short_flight(out, 0.5, &arguments));
        std::fs::read(place.log(out)).unwrap()
    };
    let undisturbed = fly("undisturbed", &[]);
    let crashes = [
        "path_generator@100:after-step",
        "rc_output@200:before-step",
        "estimator@300:after-publishing",
        "plant@400:between-publishes",
    ];
    let crashes: Vec<&str> = crashes.iter().flat_map(|crash| ["--crash", crash]).collect();
    assert!(fly("disturbed", &crashes) == undisturbed);
}

#[test]
fn a_log_says_which_program_flew_and_its_steps_are_not_done_again() {
    let _machine = among_others();
    let place = Place::new();
    let setting = external_service(ServiceId::Controller, "lock_step");
    succeed(&mut place.short_flight("out", 0.2, &["--set", &setting, "--set", "programs.folder='/'"]));
    let programs = LogReader::open(&place.log("out"))
        .unwrap()
        .manifest()
        .scenario
        .programs
        .clone()
        .unwrap();
    assert_eq!(programs.command_of(ServiceId::Controller).unwrap()[0], "env");
    assert_eq!(programs.folder, None);

    let said = String::from_utf8(succeed(&mut place.gerono(&["replay", "out"])).stdout).unwrap();
    assert!(
        said.contains("The steps of controller cannot be computed again"),
        "{said}"
    );
    assert!(said.contains("\nidentical: "), "{said}");
}

#[test]
fn a_program_is_started_in_the_folder_of_the_scenarios_file() {
    let _machine = among_others();
    let place = Place::new();
    let flights = place.path("flights");
    std::fs::create_dir(&flights).unwrap();
    std::fs::copy(scenario("hover"), flights.join("mine.toml")).unwrap();
    let setting = script("pwd >where; exit 7");
    let arguments = ["run", "flights/mine.toml", "--out", "out", "--set", &setting];
    assert_eq!(
        output(&mut place.gerono(&arguments)).status.code(),
        Some(BROKEN_CONTRACT)
    );
    let found = std::fs::read_to_string(flights.join("where")).unwrap();
    assert_eq!(Path::new(found.trim_end()), flights.canonicalize().unwrap());
}

#[test]
fn what_cannot_be_started_is_named_with_the_place_where_it_was_looked_for() {
    let _machine = among_others();
    for name in ["no-such-program", "./no-such-program"] {
        let pieces = [
            &format!("its program `{name}` cannot be started in"),
            "No such file or directory",
            "programs.folder",
        ];
        fails(&program(ServiceId::Controller, &[name]), BROKEN_CONTRACT, &pieces);
    }
}

#[test]
fn who_ends_before_it_is_ready_ends_the_run() {
    let _machine = among_others();
    let pieces = [
        "in place of `controller`",
        "ended before it was ready: it exited with code 7",
        "process_contract.md",
    ];
    let place = fails(&script("exit 7"), BROKEN_CONTRACT, &pieces);
    // Nothing was flown: there is no log to keep.
    let results = std::fs::read_dir(place.path("out")).unwrap();
    let names: Vec<_> = results.map(|entry| entry.unwrap().file_name()).collect();
    assert_eq!(names, ["summary.json"]);
    fails(
        &script("kill -9 $$"),
        BROKEN_CONTRACT,
        &["ended before it was ready: killed (SIG"],
    );
}

#[test]
fn who_never_says_that_it_is_ready_is_not_waited_for_for_ever() {
    let _machine = among_others();
    let began = Instant::now();
    fails(
        &script("exec sleep 1000"),
        BROKEN_CONTRACT,
        &[
            "in place of `controller`",
            "has not said that it is ready within 10 s",
        ],
    );
    assert!(began.elapsed() < Duration::from_secs(60));
}

#[test]
fn who_says_what_is_no_message_ends_the_run() {
    let _machine = among_others();
    for words in ["garbage", r#"{"Reddy":{}}"#, r#"{"Ready":{"receivers":1}}"#] {
        let script = script(&format!("printf '%s' '{words}' >&3; exec sleep 1000"));
        fails(
            &script,
            BROKEN_CONTRACT,
            &["says what is no message of the contract"],
        );
    }
}

#[test]
fn who_speaks_out_of_turn_ends_the_run() {
    let _machine = among_others();
    let script = script(r#"printf '"Finished"' >&3; exec sleep 1000"#);
    fails(
        &script,
        BROKEN_CONTRACT,
        &[r#"says "Finished", which it is not its turn to send"#],
    );
}

#[test]
fn who_gives_up_is_quoted() {
    let _machine = among_others();
    let script = script(r#"printf '{"Failed":{"reason":"no battery"}}' >&3; exec sleep 1000"#);
    fails(
        &script,
        BROKEN_CONTRACT,
        &["the service `controller` gave up: no battery"],
    );
}

#[test]
fn who_is_ready_without_a_receiver_for_each_input_ends_the_run() {
    let _machine = among_others();
    fails(
        &external_service(ServiceId::Controller, "forgets_its_receivers"),
        BROKEN_CONTRACT,
        &["is ready with 0 receivers, and has 2 inputs"],
    );
}

#[test]
fn who_dies_in_simulated_time_ends_the_flight_with_the_last_whole_tick() {
    let _machine = among_others();
    let place = Place::new();
    let setting = external_service(ServiceId::Controller, "dies");
    let output = output(&mut place.short_flight("out", 0.5, &["--set", &setting]));
    assert_eq!(output.status.code(), Some(BROKEN_CONTRACT));
    let said = complaint(&output);
    for piece in ["ended: it exited with code 9", "cannot be restarted in lock-step"] {
        assert!(said.contains(piece), "no `{piece}` in:\n{said}");
    }
    assert_eq!(last_tick(&place.log("out")), 100);
}

#[test]
fn who_says_too_early_that_it_has_finished_ends_the_flight() {
    let _machine = among_others();
    fails(
        &external_service(ServiceId::Controller, "finishes_early"),
        BROKEN_CONTRACT,
        &["says that it has finished, and has not published all its samples"],
    );
}

#[test]
fn one_process_cannot_fly_programs_and_says_so() {
    let _machine = among_others();
    let setting = script("exit 7");
    let place = Place::new();
    let output_of = |more: &[&str]| {
        let mut arguments = vec!["--set", setting.as_str()];
        arguments.extend(more);
        output(&mut place.short_flight("out", 0.5, &arguments))
    };
    let refused = output_of(&["--host", "inprocess"]);
    assert_eq!(refused.status.code(), Some(2));
    assert!(
        complaint(&refused).contains("fly with --host lockstep or --host realtime"),
        "{}",
        complaint(&refused)
    );
    let refused = output_of(&["--crash", "controller@100:before-step"]);
    assert_eq!(refused.status.code(), Some(2));
    assert!(
        complaint(&refused).contains("is an external service"),
        "{}",
        complaint(&refused)
    );
}

#[test]
fn who_breaks_the_contract_in_real_time_is_replaced_and_it_is_said_why() {
    let _machine = alone();
    let place = Place::new();
    let setting = external_service(ServiceId::Controller, "babbles");
    let run = begin(&mut place.live_hover("out", &["--set", &setting, "--restarts", "2"]));
    let output = finish(run);
    assert_eq!(output.status.code(), Some(BROKEN_CONTRACT));
    let said = complaint(&output);
    for piece in [
        "killed, because it says \"CaughtUp\"",
        "not its turn to send",
        "--restarts",
    ] {
        assert!(said.contains(piece), "no `{piece}` in:\n{said}");
    }
    assert!(
        place.summary("out")["restarts"].as_array().unwrap().len() >= 2,
        "{said}"
    );
    assert_eq!(place.leftovers(), Vec::<String>::new());
}

/// The process of a live run that is an external service of this test.
fn external_service_of(orchestrator: u32) -> Option<u32> {
    let children =
        std::fs::read_to_string(format!("/proc/{orchestrator}/task/{orchestrator}/children")).ok()?;
    let is_external_service = |pid: &u32| {
        std::fs::read_to_string(format!("/proc/{pid}/cmdline"))
            .is_ok_and(|line| line.contains("an_external_service"))
    };
    children
        .split_whitespace()
        .filter_map(|pid| pid.parse().ok())
        .find(is_external_service)
}

fn end(run: Begun) -> Output {
    signal(run.id(), Signal::TERM);
    finish(run)
}

#[test]
fn who_dies_in_real_time_is_followed_by_one_that_begins_anew() {
    let _machine = alone();
    let place = Place::new();
    let setting = external_service(ServiceId::Controller, "real_time");
    // The laboratory's vehicle holds its rates by itself while nobody commands.
    let settings = ["--host", "realtime", "--set", &setting];
    let run = begin(&mut place.rig_flight("out", 100.0, &settings));
    place.await_log("out", 20_000);
    let first = until("the external service", || external_service_of(run.id()));
    signal(first, Signal::KILL);
    until("another external service in flight", || {
        let shown = output(&mut place.gerono(&["top", "--once", "--json"]));
        let shown: Value = serde_json::from_slice(&shown.stdout).ok()?;
        shown["events"]
            .to_string()
            .contains("`controller` was restarted")
            .then_some(())
    });
    assert_ne!(external_service_of(run.id()).unwrap(), first);
    let output = end(run);
    assert_eq!(output.status.code(), Some(143), "{}", complaint(&output));
    let restarts = &place.summary("out")["restarts"];
    assert_eq!(restarts[0]["service"], "controller", "{restarts}");
    assert_eq!(place.leftovers(), Vec::<String>::new());
}

/// It is given twice the time that it has taken before, to become ready and for its first step.
#[test]
fn an_external_service_that_starts_slowly_is_waited_for_in_flight() {
    let _machine = alone();
    let place = Place::new();
    let setting = external_service(ServiceId::PathGenerator, "starts_slowly");
    let settings = ["--host", "realtime", "--set", &setting];
    let run = begin(&mut place.rig_flight("out", 100.0, &settings));
    place.await_log("out", 20_000);
    let first = until("the external service", || external_service_of(run.id()));
    signal(first, Signal::KILL);
    until("another external service in flight", || {
        let services = place.look()?.services;
        services
            .iter()
            .any(|service| service.restarts > 0 && service.flies)
            .then_some(())
    });
    let second = external_service_of(run.id()).unwrap();
    place.await_log("out", place.log_bytes("out") + 500_000);
    assert_eq!(external_service_of(run.id()), Some(second));
    let output = end(run);
    assert_eq!(output.status.code(), Some(143), "{}", complaint(&output));
    let restarts = &place.summary("out")["restarts"];
    assert_eq!(restarts.as_array().unwrap().len(), 1, "{restarts}");
}

#[test]
fn an_external_service_ends_with_the_orchestrator_and_whoever_takes_over_starts_another() {
    let _machine = alone();
    let place = Place::new();
    let setting = external_service(ServiceId::Controller, "real_time");
    let lonely = "real_time.orchestrator_loss=\"continue\"";
    // The laboratory's vehicle holds its rates by itself while nobody commands. Without pipes, which services would hold open.
    let settings = [
        "--host", "realtime", "--quiet", "--set", &setting, "--set", lonely,
    ];
    let mut first = begin(&mut place.rig_flight("first", 300.0, &settings));
    place.await_log("first", 20_000);
    let external_service = until("the external service", || external_service_of(first.id()));
    first.kill().unwrap();
    first.wait().unwrap();
    await_end(external_service);

    let second = begin(&mut place.gerono(&["attach", "--out", "second", "--quiet"]));
    place.await_log("second", 20_000);
    until("another external service", || external_service_of(second.id()));
    let output = end(second);
    assert_eq!(output.status.code(), Some(143), "{}", complaint(&output));
    assert_eq!(place.leftovers(), Vec::<String>::new());
}
