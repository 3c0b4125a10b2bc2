//! Operators on both sides of a container: a flight in PID and mount namespaces of its own, with the memory of the machine or its
//! own. docs/security.md has the table.
//!
//! Namespaces are not permitted everywhere; where they are not, these tests are skipped with a message.

use crate::common;

use std::io::{PipeWriter, pipe};
use std::os::fd::AsFd;
use std::path::Path;
use std::process::Output;

use common::container::{OWN_MEMORY, SHARED_MEMORY, contained, may_contain};
use common::processes::signal;
use common::{Begun, Place, begin, complaint, finish, output, said, until};
use run_client::Snapshot;
use runtime::descriptors::hand_on;
use rustix::process::Signal;

/// A flight in real time in a container, as seen from the host.
fn take_off(place: &Place, preparation: &str) -> Begun {
    let mut flight = contained(&place.live_hover("out", &["--quiet"]), preparation);
    let run = begin(&mut flight);
    until("a flight that can be looked at from the host", || place.look());
    run
}

/// A row of the table: what a command says, and its exit code.
fn row(from: &str, command: &str, output: &Output) -> (Option<i32>, String) {
    let text = said(output).lines().next().unwrap_or_default().to_owned();
    eprintln!(
        "| {from} | `gerono {command}` | {:?} | {text} |",
        output.status.code()
    );
    let all = said(output).replace('│', " ");
    (
        output.status.code(),
        all.split_whitespace().collect::<Vec<_>>().join(" "),
    )
}

fn assert_row(from: &str, command: &str, output: &Output, code: i32, words: &str) {
    let (found, text) = row(from, command, output);
    assert_eq!(found, Some(code), "{from}, {command}: {text}");
    assert!(text.contains(words), "{from}, {command}: no {words:?} in {text}");
}

/// Every operator command from the host, the last of which ends the flight.
fn operate_from_the_host(preparation: &str, from: &str) {
    if !may_contain() {
        return;
    }
    let place = Place::in_real_time();
    let run = take_off(&place, preparation);
    for (arguments, code, words) in [
        (&["top", "--once"][..], 0, "1-0"),
        (&["get", "controller.k1"], 0, "run 1-0, "),
        (&["set", "controller.k1=3"], 0, "run 1-0, "),
        (&["arm"], 7, "has no phases"),
        (&["attach", "--out", "none"], 1, "nothing to take over"),
        (&["disarm"], 0, "disarmed run 1-0, "),
        (&["kill"], 0, "killed run 1-0, "),
    ] {
        let said = output(&mut place.gerono(arguments));
        assert_row(from, &arguments.join(" "), &said, code, words);
    }
    let seen: Snapshot = place.look().unwrap();
    assert!(seen.killed, "{seen:?}");
    let said = output(&mut place.gerono(&["stop"]));
    assert_row(from, "stop", &said, 0, "run 1-0, ");
    let ended = finish(run);
    // Its motors were stopped in the air.
    assert_eq!(ended.status.code(), Some(9), "{}", common::said(&ended));
}

#[test]
fn every_command_works_from_the_host_on_a_flight_in_a_container() {
    operate_from_the_host(SHARED_MEMORY, "host");
}

#[test]
fn every_command_works_from_the_host_on_a_flight_in_a_container_with_its_own_memory() {
    operate_from_the_host(OWN_MEMORY, "host, other /dev/shm");
}

#[test]
fn inside_of_a_container_a_flight_outside_is_said_to_be_there_and_not_to_be_seen() {
    if !may_contain() {
        return;
    }
    let place = Place::in_real_time();
    let run = begin(&mut place.live_hover("out", &["--quiet"]));
    until("a flight that can be looked at", || place.look());
    for arguments in [
        &["stop"][..],
        &["kill"],
        &["disarm"],
        &["arm"],
        &["top", "--once"],
        &["set", "controller.k1=3"],
        &["get"],
        &["attach", "--out", "none"],
    ] {
        let refused = output(&mut contained(&place.gerono(arguments), SHARED_MEMORY));
        let words = format!(
            "{}-0 is in use by processes that cannot be seen from this container",
            run.id()
        );
        assert_row("inside", &arguments.join(" "), &refused, 1, &words);
    }
    let seen = place.look().unwrap();
    assert!(!seen.killed && !seen.landing, "{seen:?}");
    assert_row(
        "outside",
        "stop",
        &output(&mut place.gerono(&["stop"])),
        0,
        "run ",
    );
    assert_eq!(finish(run).status.code(), Some(0));
}

/// A flight in a container whose orchestrator was killed, its name, and what its end waits for.
fn lose_the_orchestrator(place: &Place, preparation: &str) -> (Begun, String, PipeWriter) {
    // Process 1 of the namespaces is a shell: with the orchestrator in its place they would end with it.
    let below_a_shell = format!("{preparation} && (\"$@\" & wait); read line <&3; false");
    let goes_on = ["--quiet", "--set", "real_time.orchestrator_loss=\"continue\""];
    let mut command = contained(&place.live_hover("out", &goes_on), &below_a_shell);
    let (input, holds) = pipe().unwrap();
    hand_on(&mut command, 3, [input.as_fd()]).unwrap();
    let run = begin(&mut command);
    until("a flight that can be looked at from the host", || place.look());
    let shown = said(&output(&mut place.gerono(&["disarm"])));
    let (_, rest) = shown.split_once("run ").unwrap();
    let name = rest.split(',').next().unwrap().to_owned();
    signal(orchestrator_of(run.id()), Signal::KILL);
    until("the words for it", || {
        let refused = output(&mut place.gerono(&["stop"]));
        let text = complaint(&refused);
        assert!(!text.contains("has ended"), "{text}");
        (refused.status.code() == Some(1) && text.contains("has died")).then_some(())
    });
    (run, name, holds)
}

#[test]
fn a_flight_in_a_container_that_has_lost_its_orchestrator_is_killed_from_the_host() {
    if !may_contain() {
        return;
    }
    let place = Place::in_real_time();
    let (run, name, holds) = lose_the_orchestrator(&place, OWN_MEMORY);
    let refused = output(&mut place.gerono(&["attach", "--out", "none"]));
    assert_row(
        "host, other /dev/shm",
        "attach",
        &refused,
        1,
        "flies in a container",
    );
    let killed = output(&mut place.gerono(&["kill", "--run", &name]));
    assert_row("host, other /dev/shm", "kill", &killed, 0, "services directly");
    drop((run, holds));
}

#[test]
fn a_flight_in_a_container_that_shares_the_memory_is_taken_over_from_the_host() {
    if !may_contain() {
        return;
    }
    let place = Place::in_real_time();
    let (run, name, holds) = lose_the_orchestrator(&place, SHARED_MEMORY);
    let attached = begin(&mut place.gerono(&["attach", "--quiet", "--out", "attached"]));
    let seen = until("the flight that was taken over", || place.look());
    until("the flight that goes on", || {
        place.look().filter(|now| now.time > seen.time)
    });
    let stopped = output(&mut place.gerono(&["stop"]));
    assert_row("host", "attach, stop", &stopped, 0, &format!("run {name}, "));
    let ended = finish(attached);
    assert_eq!(ended.status.code(), Some(0), "{}", said(&ended));
    drop((run, holds));
}

/// The process of `gerono run` below another one.
fn orchestrator_of(above: u32) -> u32 {
    let children = std::fs::read_to_string(format!("/proc/{above}/task/{above}/children")).unwrap();
    let mut children = children.split_whitespace().map(|word| word.parse().unwrap());
    let child: u32 = children.next().expect("it has a child");
    let line = std::fs::read(Path::new("/proc").join(child.to_string()).join("cmdline")).unwrap();
    let mut words = line.split(|&byte| byte == 0);
    let is_orchestrator = words.next().is_some_and(|program| program.ends_with(b"gerono"));
    if is_orchestrator {
        child
    } else {
        orchestrator_of(child)
    }
}
