//! Shared memory that is truncated, overwritten or full: every flight ends with an error that says so, or goes on; nothing is
//! left behind and nobody waits for ever.

#![expect(clippy::disallowed_methods, reason = "tests make their own files")]

use crate::common;

use std::fs::{File, OpenOptions};
use std::io::Write;
use std::os::unix::fs::FileExt;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::time::{Duration, Instant};

use common::processes::{
    await_process, await_reserved_descriptors, await_successor, free_the_descriptors_of, is_alive,
    processes_of, services_of, shared_memory_of, signal, use_up_the_descriptors_of,
};
use common::{Begun, Place, begin, complaint, finish, output, scenario, succeed, until};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};
use runtime::process::SPARE;
use rustix::process::Signal;
use shared_types::ServiceId;

const HOSTS: [&str; 2] = ["lockstep", "realtime"];

/// Bytes of more than one chunk of a log, of which one may have been pending.
const CHUNKS: u64 = 2_500_000;

/// Time for which a flight with damaged memory is let be, as one with a hostile external service.
const WHILE: Duration = Duration::from_millis(700);

/// Begins a flight that lasts longer than any test, and waits until it is under way.
fn fly(place: &Place, host: &str) -> Begun {
    let run = begin(&mut place.rig_flight("out", 10_000.0, &["--host", host, "--quiet"]));
    place.await_log("out", 20_000);
    run
}

/// The flight ended by itself, with an exit code and words of the documentation, and took everything with it.
#[track_caller]
fn assert_ended_in_words(place: &Place, orchestrator: u32, pids: &[u32], ended: &Output, pieces: &[&str]) {
    let said = complaint(ended);
    assert!(
        matches!(ended.status.code(), Some(1 | 3)),
        "{:?}: {said}",
        ended.status
    );
    assert!(
        pieces.iter().any(|piece| said.contains(piece)),
        "none of {pieces:?} in: {said}"
    );
    until("the end of all processes", || {
        pids.iter().all(|&pid| !is_alive(pid)).then_some(())
    });
    assert_eq!(place.leftovers(), Vec::<String>::new(), "{said}");
    assert_eq!(shared_memory_of(orchestrator), Vec::<PathBuf>::new(), "{said}");
}

fn pids_of(run: &Begun) -> Vec<u32> {
    processes_of(run.id()).into_iter().map(|(_, pid)| pid).collect()
}

fn truncate(path: &Path) {
    let file = OpenOptions::new().write(true).open(path);
    // It may have been removed meanwhile.
    let _ = file.map(|file| file.set_len(0));
}

#[test]
fn a_flight_whose_shared_memory_is_truncated_ends_with_an_error_that_says_so() {
    for host in HOSTS {
        let place = Place::new();
        let run = fly(&place, host);
        let (orchestrator, pids) = (run.id(), pids_of(&run));
        shared_memory_of(orchestrator)
            .iter()
            .for_each(|path| truncate(path));
        let ended = finish(run);
        assert_ended_in_words(&place, orchestrator, &pids, &ended, &["truncated"]);
    }
}

/// The services go on alone and are waited for, also by one who is in a hurry.
#[test]
fn nothing_is_left_of_a_flight_that_is_interrupted_while_its_services_end_alone() {
    let place = Place::in_real_time();
    let mut run = fly(&place, "realtime");
    let (orchestrator, pids) = (run.id(), pids_of(&run));
    shared_memory_of(orchestrator)
        .iter()
        .for_each(|path| truncate(path));
    until("the end of the orchestrator as it was", || {
        let line = std::fs::read(format!("/proc/{orchestrator}/cmdline")).unwrap();
        (line.windows(10).any(|word| word == b"postmortem") || run.try_wait().unwrap().is_some())
            .then_some(())
    });
    while run.try_wait().unwrap().is_none() {
        signal(orchestrator, Signal::INT);
        std::thread::yield_now();
    }
    let ended = finish(run);
    assert_ended_in_words(&place, orchestrator, &pids, &ended, &["truncated"]);
}

#[test]
fn one_kind_of_shared_memory_that_is_truncated_stops_nobody_from_ending_the_flight_in_simulated_time() {
    damage_each_kind(Place::new, HOSTS[0], |path, _| truncate(path));
}

#[test]
fn one_kind_of_shared_memory_that_is_overwritten_stops_nobody_from_ending_the_flight_in_simulated_time() {
    damage_each_kind(Place::new, HOSTS[0], overwrite);
}

#[test]
fn one_kind_of_shared_memory_that_is_truncated_stops_nobody_from_ending_the_flight_in_real_time() {
    damage_each_kind(Place::in_real_time, HOSTS[1], |path, _| truncate(path));
}

#[test]
fn one_kind_of_shared_memory_that_is_overwritten_stops_nobody_from_ending_the_flight_in_real_time() {
    damage_each_kind(Place::in_real_time, HOSTS[1], overwrite);
}

/// Damages memory of one kind, of which only a part of the processes notices anything, in a flight for each kind.
fn damage_each_kind(place: fn() -> Place, host: &str, damage: fn(&Path, &mut ChaCha8Rng)) {
    let mut random = ChaCha8Rng::seed_from_u64(1);
    for kind in [".data", ".connection", ".dynamic", ".global_mgmt"] {
        let place = place();
        let mut run = fly(&place, host);
        let (orchestrator, mut pids) = (run.id(), pids_of(&run));
        let segments = shared_memory_of(orchestrator);
        for path in segments
            .iter()
            .filter(|path| path.to_string_lossy().ends_with(kind))
        {
            damage(path, &mut random);
        }
        let deadline = Instant::now() + WHILE;
        while run.try_wait().unwrap().is_none() && Instant::now() < deadline {
            std::thread::sleep(Duration::from_millis(20));
        }
        pids.extend(pids_of(&run));
        if run.try_wait().unwrap().is_none() {
            signal(orchestrator, Signal::TERM);
        }
        let ended = finish(run);
        if ended.status.code() == Some(143) {
            place.assert_nothing_is_left_of(orchestrator);
        } else {
            let words = ["shared memory", "a sample of", "gave up", "died after tick"];
            assert_ended_in_words(&place, orchestrator, &pids, &ended, &words);
        }
    }
}

fn overwrite(path: &Path, random: &mut ChaCha8Rng) {
    // It may have been removed meanwhile.
    let Ok(file) = OpenOptions::new().write(true).open(path) else {
        return;
    };
    let length = file.metadata().unwrap().len();
    let garbage: Vec<u8> = (0..length).map(|_| random.next_u32() as u8).collect();
    let _ = file.write_all_at(&garbage, 0);
}

/// iceoryx2 waits for ever for memory without a size to get one.
#[test]
fn whoever_opens_truncated_memory_is_ended_and_the_flight_with_it() {
    let place = Place::in_real_time();
    let run = fly(&place, "realtime");
    let orchestrator = run.id();
    let dynamic = shared_memory_of(orchestrator).into_iter();
    // No process reads these in flight, but one that opens a topic does.
    dynamic
        .filter(|path| path.to_string_lossy().ends_with(".dynamic"))
        .for_each(|path| truncate(&path));
    let controller = await_process(orchestrator, ServiceId::Controller);
    signal(controller, Signal::KILL);
    let pids = pids_of(&run);
    let ended = finish(run);
    let words = ["damaged or truncated by another program", "truncated", "damaged"];
    assert_ended_in_words(&place, orchestrator, &pids, &ended, &words);
}

#[test]
fn a_service_that_cannot_open_its_topics_ends_with_its_orchestrator() {
    let place = Place::in_real_time();
    let run = fly(&place, "realtime");
    let orchestrator = run.id();
    let controller = await_process(orchestrator, ServiceId::Controller);
    // Half of the memory that a service opens first: it comes as far as to wait for it.
    signal(orchestrator, Signal::STOP);
    for path in shared_memory_of(orchestrator) {
        if path.to_string_lossy().ends_with(".dynamic") {
            truncate(&path);
        }
    }
    signal(controller, Signal::KILL);
    signal(orchestrator, Signal::CONT);
    std::thread::sleep(Duration::from_millis(200));
    let pids = pids_of(&run);
    signal(orchestrator, Signal::KILL);
    finish(run);
    until("the end of all services", || {
        pids.iter().all(|&pid| !is_alive(pid)).then_some(())
    });
    succeed(&mut place.gerono(&["clean"]));
    assert_eq!(shared_memory_of(orchestrator), Vec::<PathBuf>::new());
}

/// `gerono` with a /dev/shm of its own, of so many bytes; none where that is not permitted.
fn with_own_memory(size: &str, mut flight: Command) -> Option<Command> {
    let probe = Command::new("unshare").args(["-m", "true"]).status();
    if !probe.is_ok_and(|status| status.success()) {
        eprintln!("SKIPPED: no mount namespace may be made here, a full /dev/shm was not tried");
        return None;
    }
    let mut command = Command::new("unshare");
    let mount = format!("mount -t tmpfs -o size={size} tmpfs /dev/shm && exec \"$0\" \"$@\"");
    command
        .args(["-m", "sh", "-c", &mount])
        .arg(flight.get_program())
        .args(flight.get_args())
        .current_dir(flight.get_current_dir().unwrap());
    for (name, value) in flight.get_envs() {
        command.env(name, value.unwrap());
    }
    flight.stdin(std::process::Stdio::null());
    Some(command)
}

#[test]
fn a_flight_whose_log_does_not_fit_on_its_disk_is_refused_with_both_sizes() {
    let place = Place::new();
    let fig1 = scenario("fig1");
    for host in ["lockstep", "inprocess"] {
        let flight = place.gerono(&[
            "run",
            fig1.to_str().unwrap(),
            "--host",
            host,
            "--out",
            "/dev/shm/runs/1",
        ]);
        let Some(mut flight) = with_own_memory("90m", flight) else {
            return;
        };
        let refused = output(&mut flight);
        let said = complaint(&refused);
        assert_eq!(refused.status.code(), Some(1), "{said}");
        let words = said.split_whitespace().collect::<Vec<_>>().join(" ");
        for piece in [
            "the log of 60 s needs 10",
            "MiB, and 90.0 MiB are free for /dev/shm;",
        ] {
            assert!(words.contains(piece), "no `{piece}` in {words}");
        }
    }
}

/// Fills the /dev/shm of a process to the last page.
fn fill_memory_of(pid: u32) -> File {
    let path = format!("/proc/{pid}/root/dev/shm/filling");
    let mut file = File::create(path).unwrap();
    for length in [1 << 20, 1 << 16, 1 << 12] {
        while file.write_all(&vec![1; length]).is_ok() {}
    }
    file
}

#[test]
fn a_run_for_which_there_is_no_room_in_shared_memory_is_refused_with_the_numbers() {
    for host in HOSTS {
        let place = Place::new();
        let flight = place.short_flight("out", 1.0, &["--host", host]);
        let Some(mut flight) = with_own_memory("12m", flight) else {
            return;
        };
        let ended = output(&mut flight);
        let said = complaint(&ended);
        assert_eq!(ended.status.code(), Some(1), "{said}");
        for piece in [
            "the run needs ",
            " MB in /dev/shm",
            "12.6 MB are free",
            "--shm-size",
        ] {
            assert!(said.contains(piece), "no `{piece}` in: {said}");
        }
        assert_eq!(place.leftovers(), Vec::<String>::new());
    }
}

#[test]
fn services_are_started_again_where_shared_memory_is_full() {
    for host in HOSTS {
        let place = Place::new();
        // It ends on request, however fast a machine flies it.
        let flight = place.rig_flight("out", 10_000.0, &["--host", host, "--quiet"]);
        let Some(mut flight) = with_own_memory("24m", flight) else {
            return;
        };
        let run = begin(&mut flight);
        let orchestrator = run.id();
        place.await_log("out", 20_000);
        let filling = fill_memory_of(orchestrator);
        let deaths = kill_each_and_all(&place, host, orchestrator);
        drop(filling);
        assert_all_were_replaced(&place, run, deaths);
    }
}

#[test]
fn services_are_started_again_where_the_orchestrator_can_open_no_more_files() {
    for host in HOSTS {
        let place = Place::new();
        let run = begin(&mut place.rig_flight("out", 10_000.0, &["--host", host, "--quiet"]));
        let orchestrator = run.id();
        // Its start is over: it opens files only for restarts from now on, for which it holds descriptors.
        place.await_log("out", 200_000);
        let is_standby = |(name, _): &(String, u32)| name == SPARE;
        until("the standby process", || {
            processes_of(orchestrator).iter().any(is_standby).then_some(())
        });
        await_reserved_descriptors(orchestrator);
        use_up_the_descriptors_of(orchestrator);
        assert_eq!(
            place.look().is_some(),
            host == HOSTS[1],
            "it answers in real time"
        );
        let deaths = kill_each_and_all(&place, host, orchestrator);
        free_the_descriptors_of(orchestrator);
        assert_all_were_replaced(&place, run, deaths);
    }
}

/// Kills each service twice, and then all of them at once, and waits until their successors fly. Returns the number of deaths.
fn kill_each_and_all(place: &Place, host: &str, orchestrator: u32) -> usize {
    let mut deaths = 0;
    for _ in 0..2 {
        for service in ServiceId::ALL {
            let pid = await_process(orchestrator, service);
            signal(pid, Signal::KILL);
            await_successor(orchestrator, service, pid);
            deaths += 1;
            await_restarts(place, host, deaths);
        }
    }
    signal(orchestrator, Signal::STOP);
    let all = services_of(orchestrator);
    all.iter().for_each(|(_, pid)| signal(*pid, Signal::KILL));
    signal(orchestrator, Signal::CONT);
    for (name, pid) in all {
        await_successor(orchestrator, ServiceId::from_name(&name).unwrap(), pid);
        deaths += 1;
    }
    await_restarts(place, host, deaths);
    deaths
}

/// Waits until `deaths` services were started again and fly: the death of one that does not fly yet is no further restart.
fn await_restarts(place: &Place, host: &str, deaths: usize) {
    if host == HOSTS[0] {
        // Lock step waits for all of them, and then goes on.
        return place.await_log("out", place.log_bytes("out") + CHUNKS);
    }
    until("the restarts", || {
        let services = place.look()?.services;
        let restarts: u64 = services.iter().map(|service| service.restarts).sum();
        (restarts == deaths as u64 && services.iter().all(|service| service.flies)).then_some(())
    });
}

/// Ends a flight, of which every death was followed by a restart.
#[track_caller]
fn assert_all_were_replaced(place: &Place, run: Begun, deaths: usize) {
    signal(run.id(), Signal::TERM);
    let ended = finish(run);
    assert_eq!(ended.status.code(), Some(143), "{}", complaint(&ended));
    let restarts = place.summary("out")["restarts"].as_array().unwrap().len();
    assert_eq!(restarts, deaths);
}

#[test]
fn too_few_descriptors_are_called_so() {
    for limit in ["24", "40", "60"] {
        let place = Place::new();
        let flight = place.short_flight("out", 0.1, &["--quiet"]);
        let mut command = Command::new("sh");
        command
            .args(["-c", &format!("ulimit -n {limit}; exec \"$0\" \"$@\"")])
            .arg(flight.get_program())
            .args(flight.get_args())
            .current_dir(flight.get_current_dir().unwrap())
            .env("XDG_RUNTIME_DIR", place.path("tmp"));
        let ended = output(&mut command);
        let said = complaint(&ended);
        assert!(matches!(ended.status.code(), Some(1 | 3 | 4)), "{limit}: {said}");
        assert!(!said.contains("one build"), "{limit}: {said}");
        assert!(
            said.contains("file descriptors") || said.contains("Too many open files"),
            "{limit}: {said}"
        );
        assert_eq!(place.leftovers(), Vec::<String>::new());
    }
}
