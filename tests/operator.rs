//! An operator's requests reach the flight, from whatever environment and whatever else is in the way.

use crate::common;

use std::fs::File;
use std::os::fd::OwnedFd;
use std::process::Command;

use common::pilot::{await_phase, flight_on_the_ground, wait_on_the_ground};
use common::processes::{free_the_descriptors_of, leave_no_descriptor_to, processes_of, signal};
use common::terminal::Terminal;
use common::{Begun, Place, begin, complaint, finish, output, said, succeed, until};
use run_client::runs::SCOPE;
use run_client::{SOCKET, Snapshot};
use rustix::fs::{FlockOperation, flock};
use rustix::net::{AddressFamily, SocketAddrUnix, SocketFlags, SocketType, connect, socket_with};
use rustix::process::Signal;

/// A flight in real time without phases, under way.
fn take_off(place: &Place, out: &str) -> Begun {
    let child = begin(&mut place.live_hover(out, &["--quiet"]));
    until("a flight that can be looked at", || look(place, &child));
    child
}

/// Returns the state of a run.
fn look(place: &Place, run: &Begun) -> Option<Snapshot> {
    let looked = place
        .gerono(&["top", "--once", "--json", "--run", &name_of(run)])
        .output()
        .unwrap();
    serde_json::from_slice(&looked.stdout).ok()
}

fn name_of(run: &Begun) -> String {
    format!("{}-0", run.id())
}

fn end(run: Begun) {
    signal(run.id(), Signal::INT);
    assert_eq!(finish(run).status.code(), Some(130));
}

/// `gerono` as cron, a service of the system, or a login as another user starts it: with next to no environment.
fn bare(place: &Place, arguments: &[&str]) -> Command {
    let mut command = place.gerono(arguments);
    command.env_clear().env(SCOPE, place.path(""));
    command
}

#[test]
fn a_run_is_found_from_every_environment() {
    let (place, elsewhere) = (Place::in_real_time(), tempfile::tempdir().unwrap());
    let run = take_off(&place, "out");
    let other_folder = |arguments: &[&str]| {
        let mut command = place.gerono(arguments);
        command.env("XDG_RUNTIME_DIR", elsewhere.path());
        command
    };
    for environment in [&bare as &dyn Fn(&Place, &[&str]) -> Command, &|_, arguments| {
        other_folder(arguments)
    }] {
        let shown = said(&succeed(&mut environment(&place, &["top", "--once"])));
        assert!(shown.contains(&name_of(&run)), "{shown}");
        let found = said(&output(&mut environment(
            &place,
            &["doctor", "--seconds", "0.01"],
        )));
        assert!(found.contains(&format!("/{}", name_of(&run))), "{found}");
        let refused = output(&mut environment(&place, &["arm"]));
        assert_eq!(
            refused.status.code(),
            Some(7),
            "the run itself refuses: {}",
            said(&refused)
        );
        let alive = output(&mut environment(&place, &["attach", "--out", "none"]));
        assert!(
            complaint(&alive).contains("nothing to take over"),
            "{}",
            said(&alive)
        );
    }
    assert!(!look(&place, &run).unwrap().killed);
    let killed = said(&succeed(&mut bare(&place, &["kill"])));
    assert!(
        killed.contains("killed") && !killed.contains("directly"),
        "{killed}"
    );
    let seen = look(&place, &run).unwrap();
    assert!(seen.killed);
    assert_eq!(
        seen.killed_by.as_deref(),
        Some("the operator killed, `gerono kill`")
    );
    assert_eq!(seen.refusal_to_arm, None, "a flight without phases is not armed");
    end(run);
}

#[test]
fn a_run_is_one_run_and_is_found_while_all_of_its_services_die() {
    let place = Place::in_real_time();
    let run = begin(&mut place.live_hover("out", &[]));
    until("a flight that can be looked at", || look(&place, &run));
    for _ in 0..3 {
        for (_, pid) in processes_of(run.id()) {
            signal(pid, Signal::KILL);
        }
        for arguments in [&["get", "controller.k1"][..], &["top", "--once"]] {
            succeed(&mut place.gerono(arguments));
        }
        until("all services", || {
            let seen = look(&place, &run)?;
            seen.services.iter().all(|service| service.flies).then_some(())
        });
    }
    // They are not restarted now, and no question is answered: the memory of the orchestrator is left.
    signal(run.id(), Signal::STOP);
    for (_, pid) in processes_of(run.id()) {
        signal(pid, Signal::KILL);
    }
    let killed = said(&succeed(&mut place.gerono(&["kill"])));
    assert!(killed.contains("services directly"), "{killed}");
    signal(run.id(), Signal::CONT);
    until("the kill, once services live again", || {
        look(&place, &run).filter(|seen| seen.killed)
    });
    let killed = said(&succeed(&mut place.gerono(&["kill"])));
    assert!(
        killed.contains(&format!("killed run {}, ", name_of(&run))),
        "{killed}"
    );
    signal(run.id(), Signal::INT);
    let ended = complaint(&finish(run));
    let deaths = ended.matches("died: killed (SIGKILL); another process takes its place");
    assert!(deaths.count() >= 5, "{ended}");
}

#[test]
fn with_several_runs_the_commands_ask_which_and_reach_no_other() {
    let place = Place::in_real_time();
    let runs = ["one", "other"].map(|out| take_off(&place, out));
    for command in ["kill", "disarm", "stop", "arm"] {
        let asked = output(&mut place.gerono(&[command]));
        assert_eq!(asked.status.code(), Some(1));
        let said = complaint(&asked);
        assert!(
            said.contains("--run") && runs.iter().all(|run| said.contains(&name_of(run))),
            "{said}"
        );
    }
    let [one, other] = runs;
    succeed(&mut place.gerono(&["kill", "--run", &name_of(&one)]));
    assert_eq!(
        [&one, &other].map(|run| look(&place, run).unwrap().killed),
        [true, false]
    );
    // By the number of a process, which tells runs of one name apart.
    let process = look(&place, &other).unwrap().services[0].pid.to_string();
    succeed(&mut place.gerono(&["kill", "--run", &process]));
    assert!(look(&place, &other).unwrap().killed);
    [one, other].into_iter().for_each(end);
}

/// In an emergency there is no time to look up a name. The list says which is which.
#[test]
fn of_several_runs_the_only_one_that_is_not_disarmed_is_killed() {
    let place = Place::in_real_time();
    let waits = wait_on_the_ground(&place);
    until("a disarmed vehicle", || {
        look(&place, &waits).filter(|seen| seen.phase.as_deref() == Some("disarmed"))
    });
    let flies = take_off(&place, "other");
    let asked = complaint(&output(&mut place.gerono(&["stop"])));
    assert!(asked.contains("(disarmed: "), "{asked}");
    let killed = said(&succeed(&mut place.gerono(&["kill"])));
    assert!(
        killed.contains(&format!("killed run {}", name_of(&flies))),
        "{killed}"
    );
    let are_killed = [&waits, &flies].map(|run| look(&place, run).unwrap().killed);
    assert_eq!(are_killed, [false, true]);
    [waits, flies].into_iter().for_each(end);
}

#[test]
fn where_there_is_no_run_it_is_said_and_where_was_looked() {
    let place = Place::in_real_time();
    for arguments in [
        &["kill"][..],
        &["top", "--once"],
        &["stop", "--run", "1-0"],
        &["attach", "--out", "none"],
    ] {
        let refused = output(&mut place.gerono(arguments));
        assert_eq!(refused.status.code(), Some(1));
        let said = complaint(&refused);
        assert!(
            said.contains("no run in real time") || said.contains("no live run `1-0`"),
            "{said}"
        );
        // A name is looked for everywhere.
        assert_eq!(said.contains(SCOPE), !arguments.contains(&"--run"), "{said}");
    }
}

#[test]
fn a_lock_on_the_folder_of_runs_keeps_no_operator_out_and_a_run_waits_for_it_no_longer_than_seconds() {
    let place = Place::in_real_time();
    let run = take_off(&place, "out");
    let folder = format!("gerono-{}", rustix::process::geteuid().as_raw());
    let door = place.path("tmp").join(folder).join("door");
    let held = File::open(&door).unwrap();
    flock(&held, FlockOperation::LockExclusive).unwrap();
    let shown = said(&succeed(&mut place.gerono(&["top", "--once"])));
    assert!(shown.contains(&name_of(&run)), "{shown}");
    let killed = said(&succeed(&mut place.gerono(&["kill"])));
    assert!(killed.contains("killed"), "{killed}");
    let refused = output(&mut place.live_hover("second", &[]));
    assert_eq!(refused.status.code(), Some(1));
    assert!(complaint(&refused).contains("fuser"), "{}", said(&refused));
    drop(held);
    end(run);
}

#[test]
fn programs_that_connect_and_say_nothing_keep_no_operator_out() {
    let place = Place::in_real_time();
    let run = take_off(&place, "out");
    let silent: Vec<_> = (0..200).map(|_| say_nothing(&place, &run)).collect();
    let killed = said(&succeed(&mut place.gerono(&["kill"])));
    assert!(
        killed.contains("killed") && !killed.contains("directly"),
        "the orchestrator answers: {killed}"
    );
    assert!(look(&place, &run).unwrap().killed);
    drop(silent);
    end(run);
}

#[test]
fn a_kill_arrives_although_the_orchestrator_can_open_no_more_files() {
    let place = Place::in_real_time();
    let run = take_off(&place, "out");
    leave_no_descriptor_to(run.id());
    let silent: Vec<_> = (0..3).map(|_| say_nothing(&place, &run)).collect();
    let killed = said(&succeed(&mut place.gerono(&["kill"])));
    assert!(
        killed.contains("killed") && !killed.contains("directly"),
        "{killed}"
    );
    drop(silent);
    free_the_descriptors_of(run.id());
    end(run);
}

/// Connects to the orchestrator, and asks nothing.
fn say_nothing(place: &Place, run: &Begun) -> OwnedFd {
    let folder = format!("gerono-{}/{}", rustix::process::geteuid().as_raw(), name_of(run));
    let address = SocketAddrUnix::new(place.path("tmp").join(folder).join(SOCKET)).unwrap();
    let (family, kind) = (AddressFamily::UNIX, SocketType::SEQPACKET);
    let socket = socket_with(family, kind, SocketFlags::CLOEXEC, None).unwrap();
    connect(&socket, &address).unwrap();
    socket
}

/// The path generator decides on a request that the orchestrator has accepted: here it sees no vehicle.
#[test]
fn a_request_to_arm_that_lapses_is_answered_as_refused_and_a_kill_is_shown_in_the_run_s_terminal() {
    let place = Place::in_real_time();
    let unseen =
        r#"fault=[{at=0.0, edge="vehicle/state -> path_generator", kind="intermittent", fraction=1.0}]"#;
    let run = begin(flight_on_the_ground(&place).args(["--set", unseen]));
    await_phase(&place, "disarmed");
    for _ in 0..2 {
        let answer = until("a state of the vehicle", || {
            let asked = place.gerono(&["arm"]).output().unwrap();
            let answer = complaint(&asked);
            assert_eq!(asked.status.code(), Some(7), "{answer}");
            (!answer.contains("no state of the vehicle")).then_some(answer)
        });
        let reason = "the vehicle was not ready, there was no recent state of a tracked vehicle";
        assert!(
            answer.contains(reason) && answer.contains("arm again"),
            "{answer}"
        );
    }
    succeed(&mut place.gerono(&["kill"]));
    signal(run.id(), Signal::INT);
    let killed = "killed: the motors rest until the end of the run (gerono kill)";
    let shown = complaint(&finish(run));
    assert!(shown.contains(killed), "{shown}");
}

#[test]
fn another_login_has_to_confirm_what_turns_motors() {
    let login = std::fs::read_to_string("/proc/self/loginuid").unwrap_or_default();
    if !rustix::process::geteuid().is_root() || login.trim().parse().is_ok_and(|login: u32| login != u32::MAX)
    {
        eprintln!("SKIPPED: only root without a login can act as the `sudo` of another login");
        return;
    }
    let place = Place::in_real_time();
    let run = wait_on_the_ground(&place);
    await_phase(&place, "disarmed");
    let name = name_of(&run);
    let arm = || {
        let mut command = place.gerono(&["arm"]);
        command.env("SUDO_UID", "65534");
        command
    };
    let prompt = |terminal: &mut Terminal| {
        terminal.await_text("[y/N]");
        let shown = terminal.screen().text();
        for piece in [&name, "Arm run", "started by root", "The motors may turn."] {
            assert!(shown.contains(piece), "{piece}: {shown}");
        }
    };
    // Where nobody can be asked, and where the answer is no.
    let refused = output(&mut arm());
    let mut terminal = Terminal::open(300, 30);
    let mut asked = terminal.start(&mut arm());
    prompt(&mut terminal);
    terminal.press("\n");
    let answered = terminal.await_exit(&mut asked);
    for (code, shown) in [
        (refused.status.code(), complaint(&refused)),
        (answered.code(), terminal.screen().text()),
    ] {
        assert_eq!(code, Some(1), "{shown}");
        assert!(shown.contains(&format!("gerono arm --run {name}")), "{shown}");
    }
    assert_eq!(place.look().unwrap().phase.as_deref(), Some("disarmed"));
    // Confirmed, but refused while no state of the vehicle was received: asked again, each time on a screen of its own.
    until("the take-off", || {
        let mut terminal = Terminal::open(300, 30);
        let mut asked = terminal.start(&mut arm());
        prompt(&mut terminal);
        terminal.press("y\n");
        let answered = terminal.await_exit(&mut asked);
        let shown = terminal.screen().text();
        let is_asked_again = ["no state of the vehicle was received yet", "arm again"]
            .iter()
            .any(|reason| shown.contains(reason));
        assert!(answered.success() || is_asked_again, "{shown}");
        answered.success().then_some(())
    });
    await_phase(&place, "take-off");
    succeed(&mut place.gerono(&["kill"]));
    end(run);
}
