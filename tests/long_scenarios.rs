//! Scenarios of any length fly, are set, shown and taken over: no packet, width of a format or depth of a text bounds them.

#![expect(clippy::disallowed_methods, reason = "tests make their own files")]

use crate::common;

use std::f64::consts::TAU;
use std::fmt::Write;
use std::path::PathBuf;
use std::process::{Command, Output};

use common::{Place, begin, complaint, finish, output, succeed, until};

/// Points of a path whose scenario is longer than a packet of the control channel, and of one that no packet holds.
const LONG: [usize; 2] = [3000, 5000];

/// Writes a scenario with this number of waypoints around a circle. Returns its path.
fn waypoints(place: &Place, points: usize) -> PathBuf {
    let committed = std::fs::read_to_string(common::scenario("waypoints")).unwrap();
    let (before, rest) = committed.split_once("points = [").unwrap();
    let (_, behind) = rest.split_once("\n]\n").unwrap();
    let mut text = before.replace("#:schema scenario.schema.json", "") + "points = [\n";
    for point in 0..points {
        let angle = TAU * point as f64 / points as f64;
        let (y, x) = (libm::sin(angle), libm::cos(angle));
        writeln!(text, "    [{x:.17}, {y:.17}, -1.00000000000000000],").unwrap();
    }
    text += "]\n";
    text += &behind.replace(
        "interval = 3.0",
        &format!("interval = {:.6}", 60.0 / points as f64),
    );
    let path = place.path(&format!("waypoints-{points}.toml"));
    std::fs::write(&path, text).unwrap();
    path
}

/// `gerono run` of it for a time in seconds to the folder `out`; every setting is behind a document of hundreds of kilobytes.
fn flight(place: &Place, points: usize, seconds: f64, out: &str, more: &[&str]) -> Command {
    let scenario = waypoints(place, points);
    let duration = format!("duration={seconds:?}");
    let mut command = place.gerono(&["run", scenario.to_str().unwrap(), "--set", &duration]);
    command.args([
        "--set",
        "vehicle.initial.position=[1.0,0.0,-1.0]",
        "--out",
        out,
        "--quiet",
    ]);
    command.args(more);
    command
}

fn digest(place: &Place, out: &str) -> Vec<u8> {
    succeed(&mut place.gerono(&["digest", out])).stdout
}

#[test]
fn a_long_scenario_flies_in_processes_as_in_one_also_past_deaths() {
    let place = Place::new();
    for points in LONG {
        let size = std::fs::metadata(waypoints(&place, points)).unwrap().len();
        assert!(size > 128 * 1024, "{size}");
        let [alone, processes] = ["alone", "processes"].map(|host| format!("{host}-{points}"));
        succeed(&mut flight(&place, points, 0.3, &alone, &["--host", "inprocess"]));
        // A standby process has the scenario as well.
        let crash = ["--crash", "controller@100:before-step"];
        succeed(&mut flight(&place, points, 0.3, &processes, &crash));
        assert_eq!(digest(&place, &alone), digest(&place, &processes), "{points}");
        let replayed = output(&mut place.gerono(&["replay", &processes, "--processes", "--quiet"]));
        assert_eq!(replayed.status.code(), Some(0), "{}", complaint(&replayed));
    }
}

#[test]
fn a_long_scenario_is_set_described_and_taken_over_in_real_time() {
    let place = Place::new();
    let points = LONG[1];
    let lonely = "real_time.orchestrator_loss=\"continue\"";
    let more = ["--host", "realtime", "--set", lonely];
    let mut first = begin(&mut flight(&place, points, 100.0, "first", &more));
    // Its manifest alone is of hundreds of kilobytes.
    place.await_log("first", 1_000_000);
    let set = output(&mut place.gerono(&["set", "controller.k1=5.5"]));
    assert_eq!(set.status.code(), Some(0), "{}", complaint(&set));
    let get = succeed(&mut place.gerono(&["get", "controller.k1"]));
    assert!(String::from_utf8_lossy(&get.stdout).contains("5.5"));

    let mut view = begin(&mut place.gerono(&["view", "--port", "0"]));
    let flown = described(&mut view);
    assert!(flown["path"].as_array().unwrap().len() > 1, "{flown}");
    assert_eq!(flown["is_in_real_time"], true);
    drop(view);

    first.kill().unwrap();
    first.wait().unwrap();
    let second = begin(&mut place.gerono(&["attach", "--out", "second", "--quiet"]));
    place.await_log("second", 1_000_000);
    succeed(&mut place.gerono(&["set", "controller.k1=5.0"]));
    succeed(&mut place.gerono(&["stop"]));
    let ended = finish(second);
    assert!(!complaint(&ended).contains("panicked"), "{}", complaint(&ended));
    assert_eq!(place.leftovers(), Vec::<String>::new());
}

/// Returns the first message that a browser gets of the flight.
fn described(view: &mut common::Begun) -> serde_json::Value {
    use std::io::{BufRead, BufReader, Write};
    let mut out = BufReader::new(view.stdout.take().unwrap());
    let mut line = String::new();
    out.read_line(&mut line).unwrap();
    let (_, url) = line.trim().split_once("http://").unwrap();
    let (address, _) = url.split_once('/').unwrap();
    until("a description", || {
        let mut stream = std::net::TcpStream::connect(address).ok()?;
        stream
            .set_read_timeout(Some(std::time::Duration::from_secs(30)))
            .ok()?;
        write!(stream, "GET /live HTTP/1.1\r\nHost: {address}\r\n\r\n").ok()?;
        let mut is_flight = false;
        for line in BufReader::new(stream).lines() {
            let line = line.ok()?;
            if let Some(data) = line.strip_prefix("data: ").filter(|_| is_flight) {
                return serde_json::from_str(data).ok();
            }
            is_flight = line == "event: flight" || (is_flight && !line.is_empty());
        }
        None
    })
}

/// A command on a scenario's text; it neither panics nor overflows its stack, and says what is wrong in few words.
fn refused(place: &Place, arguments: &[&str]) -> Output {
    let refused = output(&mut place.gerono(arguments));
    assert_eq!(refused.status.code(), Some(2), "{}", cut(&complaint(&refused)));
    assert!(refused.stderr.len() < 20_000, "{} bytes", refused.stderr.len());
    refused
}

fn cut(text: &str) -> String {
    text.chars().take(1000).collect()
}

#[test]
fn long_names_and_deep_nesting_are_refused_in_few_words() {
    let place = Place::new();
    let fig1 = std::fs::read_to_string(common::scenario("fig1")).unwrap();
    let long = "x".repeat(70_000);
    let dotted = "a.".repeat(40_000) + "a";
    let nested = "[".repeat(40_000) + &"]".repeat(40_000);
    let inline = "{a=".repeat(30_000) + "1" + &"}".repeat(30_000);
    let texts = [
        format!("{long} = 1\n{fig1}"),
        format!("{fig1}\n[{long}]\na = 1\n"),
        format!("{fig1}\n[{dotted}]\na = 1\n"),
        format!("{dotted} = 1\n{fig1}"),
        format!("nested = {nested}\n{fig1}"),
        format!("nested = {inline}\n{fig1}"),
        format!("{fig1}\n[[{dotted}]]\n"),
    ];
    for (number, text) in texts.iter().enumerate() {
        let path = place.path(&format!("{number}.toml"));
        std::fs::write(&path, text).unwrap();
        refused(&place, &["check", path.to_str().unwrap()]);
    }
    let fig1 = common::scenario("fig1");
    for setting in [
        format!("{long}=1"),
        format!("controller.k1={long}"),
        format!("{dotted}=1"),
        format!("controller.k1={nested}"),
        format!("controller.k1={inline}"),
    ] {
        refused(&place, &["check", fig1.to_str().unwrap(), "--set", &setting]);
    }
}
