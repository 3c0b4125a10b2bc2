//! `gerono top` as its user has it: in a terminal, beside a flight that goes on.

use crate::common;

use std::process::{Child, Command};

use common::processes::{is_alive, pid_of, signal};
use common::terminal::{Screen, Terminal};
use common::{Begun, Place, begin, finish, output, scenario, succeed, until, wait};
use rustix::process::Signal;
use shared_types::ServiceId;

const UP: &str = "\x1b[A";
const DOWN: &str = "\x1b[B";

/// A flight in real time under way.
fn take_off(place: &Place) -> Begun {
    let hover = scenario("hover");
    let more = [
        "--host",
        "realtime",
        "--out",
        "out",
        "--set",
        "duration=300.0",
        "--quiet",
    ];
    let arguments = [&["run", hover.to_str().unwrap()], &more[..]].concat();
    let child = begin(&mut place.gerono(&arguments));
    let is_live = || succeeds(&mut place.gerono(&["top", "--once"])).then_some(());
    until("a flight that can be looked at", is_live);
    child
}

fn succeeds(command: &mut Command) -> bool {
    output(command).status.success()
}

/// The row of a service: process id and rate.
fn row_of(screen: &Screen, service: &str) -> Option<(u32, u64)> {
    let rows = screen.lines();
    let mut cells = rows.filter_map(|line| {
        let mut words = line.trim_start_matches('>').split_whitespace();
        let is_own = words.next() == Some(service);
        is_own.then(|| Some((words.next()?.parse().ok()?, words.next()?.parse().ok()?)))
    });
    cells.next()?
}

fn await_rates(terminal: &mut Terminal) {
    for service in ServiceId::ALL {
        terminal.await_screen(service.name(), |screen| {
            row_of(screen, service.name()).filter(|(_, rate)| *rate > 0)
        });
    }
}

/// Demands that a program has left the terminal as it was, with this exit code.
fn assert_left_clean(terminal: &mut Terminal, mut program: Child, code: i32, settings: &str) {
    let status = terminal.await_exit(&mut program);
    assert_eq!(status.code(), Some(code), "{}", terminal.screen().text());
    assert!(!terminal.screen().is_alternate, "the alternate screen was left");
    assert!(terminal.screen().has_cursor, "the cursor is hidden");
    assert_eq!(terminal.settings(), settings);
}

#[test]
fn a_live_flight_is_looked_at_broken_and_left_behind_with_the_terminal_as_it_was() {
    let place = Place::in_real_time();
    let flight = take_off(&place);
    let mut terminal = Terminal::open(80, 24);
    let settings = terminal.settings();

    let top = terminal.start(&mut place.gerono(&["top", "--allow-faults"]));
    await_rates(&mut terminal);
    assert!(terminal.screen().is_alternate);
    assert_ne!(terminal.settings(), settings, "raw mode");
    resized(&mut terminal);
    killed_only_after_a_yes(&mut terminal, flight.id());
    terminal.press("q");
    assert_left_clean(&mut terminal, top, 0, &settings);

    let top = terminal.start(&mut place.gerono(&["top"]));
    await_rates(&mut terminal);
    terminal.press("k");
    terminal.await_text("only looking; `gerono top --allow-faults` can");
    set_after_enter(&mut terminal);
    signal(top.id(), Signal::TERM);
    assert_left_clean(&mut terminal, top, 143, &settings);

    printed_once(&place);

    let mut gone = Terminal::open(80, 24);
    let mut top = gone.start(&mut place.gerono(&["top"]));
    await_rates(&mut gone);
    drop(gone);
    let status = wait(&mut top);
    assert!(matches!(status.code(), Some(0 | 129)), "{status:?}");

    let top = terminal.start(&mut place.gerono(&["top"]));
    await_rates(&mut terminal);
    signal(flight.id(), Signal::INT);
    assert_left_clean(&mut terminal, top, 0, &settings);
    assert!(
        terminal.screen().text().contains("has ended"),
        "{}",
        terminal.screen().text()
    );
    assert_eq!(finish(flight).status.code(), Some(130));
    assert_eq!(place.leftovers(), Vec::<String>::new());
}

/// The picture follows the size of the terminal.
fn resized(terminal: &mut Terminal) {
    terminal.resize(130, 40);
    terminal.await_text("inputs, by age");
    terminal.resize(40, 10);
    terminal.await_screen("a small picture", |screen| {
        let has_row = row_of(screen, "controller").is_some();
        (has_row && screen.text().ends_with("f freeze")).then_some(())
    });
    terminal.resize(80, 24);
    await_rates(terminal);
    let text = terminal.screen().text();
    assert!(
        text.contains("── events ─") && text.contains(" distance "),
        "{text}"
    );
}

fn killed_only_after_a_yes(terminal: &mut Terminal, orchestrator: u32) {
    let place = ServiceId::Controller.index();
    terminal.press(&(DOWN.repeat(place + 1) + UP));
    terminal.await_screen("the selected service", |screen| {
        screen
            .lines()
            .any(|line| line.starts_with(">controller"))
            .then_some(())
    });
    let pid = until("the controller", || pid_of(orchestrator, ServiceId::Controller));

    terminal.press("k");
    terminal.await_text(&format!("kill controller ({pid})? y: yes, else: no"));
    terminal.press("n");
    terminal.await_text("nothing was done");
    assert!(is_alive(pid) && pid_of(orchestrator, ServiceId::Controller) == Some(pid));

    terminal.press("k");
    terminal.await_text(&format!("kill controller ({pid})?"));
    terminal.press("y");
    let successor = terminal.await_screen("a successor that flies", |screen| {
        row_of(screen, "controller").filter(|&(now, rate)| now != pid && rate > 0)
    });
    assert!(!is_alive(pid));
    assert_eq!(pid_of(orchestrator, ServiceId::Controller), Some(successor.0));
    terminal.await_text("`controller` was killed by hand");

    terminal.press("?");
    terminal.await_text("SIGSTOP");
    terminal.press("q");
    await_rates(terminal);
}

/// A gain is typed and set, what cannot be is refused with its reason, and both without leaving the view.
fn set_after_enter(terminal: &mut Terminal) {
    terminal.press("s");
    terminal.await_text("set controller.▏");
    terminal.await_text("controller.k1=");
    terminal.press("k2=2.25\r");
    terminal.await_text("controller.k2=2.25 from");
    terminal.press("s");
    terminal.await_text("controller.k2=2.25");
    terminal.press("k2=-1\r");
    terminal.await_text("refused: not set:");
    await_rates(terminal);
}

/// Returns where there is no terminal, a view is printed, or its numbers.
fn printed_once(place: &Place) {
    let printed = succeed(&mut place.gerono(&["top", "--once"])).stdout;
    let printed = String::from_utf8(printed).unwrap();
    for service in ServiceId::ALL {
        assert!(printed.contains(service.name()), "{printed}");
    }
    assert!(
        printed.lines().all(|line| line.chars().count() <= 82) && !printed.contains('\x1b'),
        "{printed}"
    );
    let json = succeed(&mut place.gerono(&["top", "--once", "--json"])).stdout;
    let json: serde_json::Value = serde_json::from_slice(&json).unwrap();
    assert_eq!(json["services"].as_array().unwrap().len(), ServiceId::ALL.len());
    assert_eq!(json["services"][ServiceId::Controller.index()]["restarts"], 1);
}

#[test]
fn without_a_terminal_or_a_run_it_says_what_to_do() {
    let place = Place::in_real_time();
    let no_terminal = output(&mut place.gerono(&["top"]));
    assert_eq!(no_terminal.status.code(), Some(1));
    let reason = String::from_utf8_lossy(&no_terminal.stderr).into_owned();
    assert!(reason.contains("--once"), "{reason}");

    let mut terminal = Terminal::open(80, 24);
    let settings = terminal.settings();
    let no_run = terminal.start(&mut place.gerono(&["top"]));
    assert_left_clean(&mut terminal, no_run, 1, &settings);
    assert!(
        terminal.screen().text().contains("no run in real time"),
        "{}",
        terminal.screen().text()
    );
}
