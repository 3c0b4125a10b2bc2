//! `gerono doctor` on this machine: it tells live runs from dead ones, touches neither, and ends when it is asked to.

use crate::common;

use std::path::PathBuf;
use std::process::Command;

use common::processes::{await_catching, services_of, shared_memory_of, signal};
use common::{Begun, Place, begin, finish, output, until};
use rustix::process::Signal;
use serde_json::Value;

/// `gerono doctor` that measures for no longer than it must.
fn doctor(place: &Place, more: &[&str]) -> Command {
    let mut arguments = vec!["doctor", "--seconds", "0.01"];
    arguments.extend(more);
    place.gerono(&arguments)
}

/// Returns its findings, by the names of its checks.
fn found(place: &Place, more: &[&str]) -> impl Fn(&str) -> Value {
    let arguments = [more, &["--json"]].concat();
    let report: Value = serde_json::from_slice(&output(&mut doctor(place, &arguments)).stdout).unwrap();
    let checks = report["checks"].as_array().unwrap().clone();
    move |name| {
        let check = checks.iter().find(|check| check["name"] == name);
        check.unwrap_or_else(|| panic!("no check `{name}`")).clone()
    }
}

/// A flight without end, under way.
fn fly(place: &Place, out: &str) -> Begun {
    let child = begin(&mut place.short_flight(out, 3600.0, &[]));
    until("all services", || {
        (services_of(child.id()).len() == 5 && !shared_memory_of(child.id()).is_empty()).then_some(())
    });
    child
}

fn sorted(mut paths: Vec<PathBuf>) -> Vec<PathBuf> {
    paths.sort();
    paths
}

#[test]
fn live_and_dead_runs_are_told_apart_and_left_alone() {
    let place = Place::new();
    let live = fly(&place, "live");
    let dead = fly(&place, "dead");
    let killed = dead.id();
    signal(killed, Signal::KILL);
    finish(dead);
    let left = sorted(shared_memory_of(killed));

    let check = found(&place, &[]);
    let (runs, dead) = (check("other runs"), check("dead runs"));
    assert_eq!(
        (&runs["verdict"], &dead["verdict"]),
        (&"yellow".into(), &"yellow".into())
    );
    let names = |check: &Value, pid: u32| check["figure"].as_str().unwrap().contains(&format!("/{pid}-"));
    assert!(names(&runs, live.id()) && !names(&runs, killed), "{runs}");
    assert!(names(&dead, killed) && !names(&dead, live.id()), "{dead}");
    assert!(dead["fix"].as_str().unwrap().contains("gerono clean"));
    assert!(
        !left.is_empty() && sorted(shared_memory_of(killed)) == left,
        "who looks sweeps nothing"
    );

    signal(live.id(), Signal::TERM);
    assert_eq!(
        finish(live).status.code(),
        Some(143),
        "the live run was not disturbed"
    );
}

#[test]
fn what_a_scenario_insists_on_and_does_not_get_is_red_and_has_its_exit_code() {
    let place = Place::new();
    let fig1 = common::scenario("fig1");
    let insisting = [
        fig1.to_str().unwrap(),
        "--set",
        "deployment={core=1023, strict=true}",
    ];
    let examined = output(&mut doctor(&place, &insisting));
    assert_eq!(examined.status.code(), Some(6));
    let said = String::from_utf8(examined.stdout).unwrap();
    assert!(
        said.contains("red     cores") && said.contains("fix what is red"),
        "{said}"
    );
    assert!(
        !said.contains('\u{1b}'),
        "no colours where there is no terminal: {said}"
    );
    assert_eq!(found(&place, &insisting)("cores")["verdict"], "red");

    let lenient = [fig1.to_str().unwrap(), "--set", "deployment.core=1023"];
    assert_eq!(found(&place, &lenient)("cores")["verdict"], "yellow");
}

#[test]
fn a_wrong_scenario_is_refused_before_anything_is_measured() {
    let place = Place::new();
    let fig1 = common::scenario("fig1");
    let wrong = [fig1.to_str().unwrap(), "--set", "deployment.priority=100"];
    let examined = output(&mut doctor(&place, &wrong));
    assert_eq!(examined.status.code(), Some(2));
    assert!(examined.stdout.is_empty());
}

#[test]
fn a_signal_ends_the_measuring_and_nothing_is_said_or_left() {
    let place = Place::new();
    let child = begin(&mut place.gerono(&["doctor", "--seconds", "3600"]));
    await_catching(child.id(), Signal::INT);
    signal(child.id(), Signal::INT);
    let ended = finish(child);
    assert_eq!(ended.status.code(), Some(130));
    assert!(ended.stdout.is_empty() && ended.stderr.is_empty());
    let left: Vec<_> = std::fs::read_dir(place.path("")).unwrap().flatten().collect();
    assert_eq!(left.len(), 1, "its folder for temporary files alone: {left:?}");
}
