//! Programs in place of services that do what they must not, on purpose or by a defect: they freeze, slow and blind nothing
//! but themselves. The flight goes on, or ends with an error that names the service or its topic; and a user who wants its end
//! gets it, at any moment.

#![expect(clippy::disallowed_methods, reason = "tests make their own files")]

mod common;
#[path = "common/external_service.rs"]
mod external_service;

use std::fs::{File, OpenOptions};
use std::io::Write;
use std::os::fd::BorrowedFd;
use std::path::PathBuf;
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

use common::processes::signal;
use common::{Begun, Place, begin, complaint, finish, until};
use external_service::{CONDUCT, ExternalService, MANIFEST, external_service};
use runtime::control::{ToOrchestrator, ToService};
use runtime::descriptors::inherited;
use rustix::process::{Signal, getpid, kill_process};
use shared_types::samples::ControlCommand;
use shared_types::{Header, ServiceId};
use zerocopy::{FromBytes, IntoBytes};

/// Names the file that an external service makes when it begins.
const MARK: &str = "GERONO_TEST_MARK";

/// From this tick on it does what it must not.
const BEGIN: u64 = 100;

/// A full counter of an eventfd.
const FULL: u64 = u64::MAX - 1;

/// In real time a flight has the machine for itself.
static MACHINE: Mutex<()> = Mutex::new(());

/// Flights in simulated time that go on at once: they mostly wait.
const AT_ONCE: usize = 4;

/// Of so many kinds of external services one flies in real time, unless `GERONO_TEST_CONDUCT` chooses: all of them fly in simulated time.
const SHARE: usize = 3;

/// The expected end of the flight.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Then {
    /// It goes on until it is ended.
    GoesOn,
    /// It ends by itself, and the error has this piece.
    Ends(&'static str),
    /// It goes on, or ends by itself with an error that names the external service or its topic: what comes first.
    Either,
}
use Then::{Either, Ends, GoesOn};

/// The names of the external service: its service, or a topic that it alone publishes.
const NAMES: [&str; 2] = ["`controller`", "`control/"];

/// Every kind of external service, and what becomes of a flight in simulated time and of one in real time, where a program that dies
/// again and again without a step is given up, sooner or later.
const CONDUCTS: [(&str, Then, Then); 54] = [
    // What it publishes.
    ("past_ticks", Ends("`control/command`"), GoesOn),
    ("future_ticks", Ends("`control/command`"), GoesOn),
    ("random_ticks", Ends("`control/command`"), GoesOn),
    ("one_random_tick", Ends("`control/command`"), GoesOn),
    ("the_largest_tick", Ends("`control/command`"), GoesOn),
    ("the_same_tick", Ends("`control/command`"), GoesOn),
    ("tick_zero", Ends("`control/command`"), GoesOn),
    ("random_stamps", Ends("`control/command`"), GoesOn),
    ("stamps_of_zero", Ends("`control/command`"), GoesOn),
    ("random_numbers", Ends("`control/command`"), GoesOn),
    ("numbers_that_go_back", Ends("`control/command`"), GoesOn),
    ("headers_of_zeros", Ends("`control/command`"), GoesOn),
    ("headers_of_ones", Ends("`control/command`"), GoesOn),
    ("samples_of_ones", Ends("`control/command`"), GoesOn),
    ("garbage", Either, Either),
    ("nan", Either, Either),
    ("infinity", Either, Either),
    ("enormous_numbers", Either, Either),
    ("zeros", Either, Either),
    // Possible by itself, and the end of the plant's numbers.
    (
        "the_largest_thrust",
        Ends("code than Gerono's flies in place of `controller`"),
        Either,
    ),
    ("the_same_sample_again", Ends("`control/command`"), GoesOn),
    ("floods_with_one_tick", Ends("`control/command`"), GoesOn),
    ("floods_with_later_ticks", Ends("`control/command`"), GoesOn),
    ("only_telemetry_is_wrong", Ends("`control/errors`"), GoesOn),
    // What it does not do.
    ("silence", GoesOn, GoesOn),
    ("sleeps_between_steps", GoesOn, GoesOn),
    ("stops_itself", GoesOn, GoesOn),
    ("spins", GoesOn, GoesOn),
    // Its line to the orchestrator.
    ("closes_its_line", Ends("has closed its control channel"), Either),
    (
        "closes_all_descriptors",
        Ends("has closed its control channel"),
        Either,
    ),
    (
        "fills_its_line_with_garbage",
        Ends("no message of the contract"),
        Either,
    ),
    ("fills_its_line_with_answers", GoesOn, GoesOn),
    ("says_bytes", Ends("no message of the contract"), Either),
    ("says_an_empty_packet", Either, Either),
    (
        "says_what_is_nested_deeply",
        Ends("no message of the contract"),
        Either,
    ),
    (
        "says_what_is_too_long",
        Ends("no message of the contract"),
        Either,
    ),
    ("says_what_controls_a_terminal", Ends("gave up: "), Either),
    ("speaks_out_of_turn", Ends("not its turn to send"), Either),
    (
        "says_that_it_has_finished",
        Ends("says that it has finished"),
        Either,
    ),
    ("claims_to_be_connected", GoesOn, GoesOn),
    // Its descriptors.
    ("fills_its_bell", GoesOn, GoesOn),
    ("fills_all_bells", GoesOn, GoesOn),
    ("takes_all_rings", GoesOn, GoesOn),
    ("writes_into_all_descriptors", Either, Either),
    ("uses_up_its_descriptors", Either, Either),
    ("unlocks_the_place", GoesOn, GoesOn),
    // Processes and signals.
    ("forks_and_lives", GoesOn, GoesOn),
    ("forks_and_ends", Ends("ended: it exited with code 0"), Either),
    ("aborts", Ends("ended: killed (SIGABRT)"), Either),
    ("dies_of_a_fault", Ends("ended: killed (SIGSEGV)"), Either),
    // Its memory.
    ("truncates_its_memory", Either, Either),
    ("scribbles_on_its_memory", Either, Either),
    ("writes_into_what_it_has_sent", Either, Either),
    ("removes_its_memory", Either, Either),
];

/// Not the next number that anybody expects.
fn random(seed: u64) -> u64 {
    let mixed = (seed ^ (seed >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    (mixed ^ (mixed >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb)
}

fn alter_headers(tick: u64, samples: &mut [&mut [u8]], alter: impl Fn(Header) -> Header) {
    for sample in samples {
        let header = shared_types::service::header_of(sample);
        let altered = if tick < BEGIN { header } else { alter(header) };
        sample[..size_of::<Header>()].copy_from_slice(altered.as_bytes());
    }
}

/// Fills what comes behind the header with a word.
fn fill_numbers(tick: u64, samples: &mut [&mut [u8]], word: impl Fn(usize) -> u64) {
    if tick < BEGIN {
        return;
    }
    for sample in samples {
        let numbers = sample[size_of::<Header>()..].chunks_exact_mut(8);
        for (at, number) in numbers.enumerate() {
            number.copy_from_slice(&word(at).to_ne_bytes());
        }
    }
}

/// Says that the external service has begun.
fn mark() {
    let path = std::env::var_os(MARK).unwrap();
    drop(File::create(path).unwrap());
}

fn sleep_for_ever() -> ! {
    loop {
        std::thread::sleep(Duration::from_secs(3600));
    }
}

/// The shared memory that this process has made.
fn own_memory() -> Vec<PathBuf> {
    let entries = std::fs::read_dir("/dev/shm").unwrap().flatten();
    let is_mine = |path: &PathBuf| {
        let name = path.file_name().unwrap().to_string_lossy().into_owned();
        let number = name
            .strip_suffix(".data")
            .and_then(|name| name.rsplit('_').next());
        let number: Option<u128> = number.and_then(|number| number.parse().ok());
        number.is_some_and(|number| (number >> 64) as u32 == std::process::id())
    };
    entries.map(|entry| entry.path()).filter(is_mine).collect()
}

/// The descriptors of all bells, by the contract.
fn bells() -> impl Iterator<Item = BorrowedFd<'static>> {
    let numbers = 6..6 + i32::try_from(ServiceId::ALL.len()).unwrap();
    #[expect(unsafe_code, reason = "inherited descriptors are reached by their numbers")]
    // SAFETY: they are open for as long as this process lives.
    numbers.map(|number| unsafe { BorrowedFd::borrow_raw(number) })
}

fn control() -> BorrowedFd<'static> {
    #[expect(unsafe_code, reason = "inherited descriptors are reached by their numbers")]
    // SAFETY: it is open unless the external service has closed it, and then writing fails.
    unsafe {
        BorrowedFd::borrow_raw(3)
    }
}

fn say(bytes: &[u8]) {
    let _ = rustix::io::write(control(), bytes);
}

fn close_from(first: i32) {
    runtime::descriptors::close_from(first).unwrap();
}

/// Scribbles on memory for as long as the process lives.
fn scribble(from: usize) -> ! {
    let files: Vec<_> = own_memory()
        .iter()
        .map(|path| OpenOptions::new().read(true).write(true).open(path).unwrap())
        .collect();
    for round in 0.. {
        for file in &files {
            let length = usize::try_from(file.metadata().unwrap().len()).unwrap();
            let at = from + usize::try_from(random(round)).unwrap() % (length - from - 8);
            let _ = std::os::unix::fs::FileExt::write_all_at(file, &random(!round).to_ne_bytes(), at as u64);
        }
    }
    unreachable!()
}

/// Does the external service's single act in the middle of a step.
fn act(conduct: &str) {
    match conduct {
        "silence" => sleep_for_ever(),
        "stops_itself" => kill_process(getpid(), Signal::STOP).unwrap(),
        "spins" => loop {
            std::hint::spin_loop();
        },
        "closes_its_line" => {
            // Others of it are duplicates of the external service's own library; all of them go.
            (0..4096).filter(|&number| is_control(number)).for_each(close);
            sleep_for_ever();
        }
        "closes_all_descriptors" => {
            close_from(0);
            sleep_for_ever();
        }
        "fills_its_line_with_garbage" => loop {
            say(b"garbage");
        },
        "fills_its_line_with_answers" => loop {
            say(br#"{"Connected":{"birth":7}}"#);
        },
        "says_bytes" => say(&[0xff, 0, 1, 2, 0xfe]),
        "says_an_empty_packet" => say(b""),
        "says_what_is_nested_deeply" => say("[".repeat(50_000).as_bytes()),
        "says_what_is_too_long" => say(&[b' '; 140_000]),
        "says_what_controls_a_terminal" => {
            say(format!(
                r#"{{"Failed":{{"reason":"\u001b]0;gotcha\u0007{}"}}}}"#,
                "x".repeat(5000)
            )
            .as_bytes());
            sleep_for_ever();
        }
        "speaks_out_of_turn" => say(br#""CaughtUp""#),
        "says_that_it_has_finished" => {
            say(br#""Finished""#);
            sleep_for_ever();
        }
        "claims_to_be_connected" => say(br#"{"Connected":{"birth":4294967295}}"#),
        "fills_its_bell" => {
            let own = bells().nth(ServiceId::Controller.index()).unwrap();
            let _ = rustix::io::write(own, &FULL.to_ne_bytes());
            sleep_for_ever();
        }
        "fills_all_bells" => {
            for bell in bells() {
                let _ = rustix::io::write(bell, &FULL.to_ne_bytes());
            }
        }
        "takes_all_rings" => {
            std::thread::spawn(|| {
                loop {
                    for bell in bells() {
                        let _ = rustix::io::read(bell, &mut [0u8; 8]);
                    }
                }
            });
        }
        "writes_into_all_descriptors" => {
            for number in 3..64 {
                let path = format!("/proc/self/fd/{number}");
                if let Ok(mut file) = OpenOptions::new().write(true).open(path) {
                    let _ = file.write_all(b"garbage in a descriptor");
                }
                say_to(number, b"garbage");
            }
        }
        "uses_up_its_descriptors" => {
            let mut all = Vec::new();
            while let Ok(file) = File::open("/dev/null") {
                all.push(file);
            }
            std::mem::forget(all);
        }
        "unlocks_the_place" => {
            #[expect(unsafe_code, reason = "inherited descriptors are reached by their numbers")]
            // SAFETY: it is open for as long as this process lives.
            let lock = unsafe { BorrowedFd::borrow_raw(5) };
            let _ = rustix::fs::flock(lock, rustix::fs::FlockOperation::Unlock);
        }
        "forks_and_lives" | "forks_and_ends" => {
            // It holds all that this process holds, and outlives it.
            let mut command = std::process::Command::new("sleep");
            command.arg("1000");
            hand_on_everything(&mut command);
            std::mem::forget(command.spawn().unwrap());
            if conduct == "forks_and_ends" {
                std::process::exit(0);
            }
        }
        "aborts" => std::process::abort(),
        "dies_of_a_fault" => {
            runtime::deployment::die_by_signals();
            kill_process(getpid(), Signal::SEGV).unwrap();
            sleep_for_ever();
        }
        "truncates_its_memory" => {
            for path in own_memory() {
                OpenOptions::new()
                    .write(true)
                    .open(path)
                    .unwrap()
                    .set_len(0)
                    .unwrap();
            }
            sleep_for_ever();
        }
        "removes_its_memory" => {
            own_memory()
                .iter()
                .for_each(|path| std::fs::remove_file(path).unwrap());
        }
        "scribbles_on_its_memory" => {
            std::thread::spawn(|| scribble(0));
        }
        "writes_into_what_it_has_sent" => {
            // Behind what iceoryx2 keeps at the beginning.
            std::thread::spawn(|| scribble(32 << 10));
        }
        _ => {}
    }
}

fn is_control(number: i32) -> bool {
    let of = |number: i32| std::fs::read_link(format!("/proc/self/fd/{number}")).ok();
    of(number).is_some() && of(number) == of(3)
}

fn close(number: i32) {
    drop(inherited(number));
}

fn say_to(number: i32, bytes: &[u8]) {
    #[expect(unsafe_code, reason = "descriptors are tried by their numbers")]
    // SAFETY: a number that is not open is refused by the system.
    let file = unsafe { BorrowedFd::borrow_raw(number) };
    let _ = rustix::io::write(file, bytes);
}

/// Lets a program inherit all descriptors of the contract.
fn hand_on_everything(_command: &mut std::process::Command) {
    for number in 3..12 {
        #[expect(unsafe_code, reason = "inherited descriptors are reached by their numbers")]
        // SAFETY: a number that is not open is refused by the system.
        let file = unsafe { BorrowedFd::borrow_raw(number) };
        let _ = rustix::io::fcntl_setfd(file, rustix::io::FdFlags::empty());
    }
}

/// Alters the external service's samples of every step from [`BEGIN`] on.
fn alter(conduct: &str, tick: u64, samples: &mut [&mut [u8]]) {
    let header = |alter: fn(Header) -> Header| move |header| alter(header);
    match conduct {
        "past_ticks" => alter_headers(
            tick,
            samples,
            header(|it| Header {
                tick: it.tick - 3,
                ..it
            }),
        ),
        "future_ticks" => alter_headers(
            tick,
            samples,
            header(|it| Header {
                tick: it.tick + 500,
                ..it
            }),
        ),
        "random_ticks" => alter_headers(
            tick,
            samples,
            header(|it| Header {
                tick: random(it.tick),
                ..it
            }),
        ),
        "one_random_tick" if tick == BEGIN => {
            alter_headers(
                tick,
                samples,
                header(|it| Header {
                    tick: random(it.tick),
                    ..it
                }),
            );
        }
        "the_largest_tick" => alter_headers(tick, samples, header(|it| Header { tick: u64::MAX, ..it })),
        "the_same_tick" => alter_headers(tick, samples, header(|it| Header { tick: BEGIN, ..it })),
        "tick_zero" => alter_headers(tick, samples, header(|it| Header { tick: 0, ..it })),
        "random_stamps" => alter_headers(
            tick,
            samples,
            header(|it| Header {
                stamp_ns: random(it.tick),
                ..it
            }),
        ),
        "stamps_of_zero" => alter_headers(tick, samples, header(|it| Header { stamp_ns: 0, ..it })),
        "random_numbers" => alter_headers(
            tick,
            samples,
            header(|it| Header {
                seq: random(it.tick),
                ..it
            }),
        ),
        "numbers_that_go_back" => alter_headers(
            tick,
            samples,
            header(|it| Header {
                seq: it.seq - 7,
                ..it
            }),
        ),
        "headers_of_zeros" => {
            alter_headers(
                tick,
                samples,
                header(|_| Header {
                    tick: 0,
                    stamp_ns: 0,
                    seq: 0,
                }),
            );
        }
        "headers_of_ones" | "samples_of_ones" => {
            let ones = |_| Header {
                tick: u64::MAX,
                stamp_ns: u64::MAX,
                seq: u64::MAX,
            };
            alter_headers(tick, samples, ones);
            if conduct == "samples_of_ones" {
                fill_numbers(tick, samples, |_| u64::MAX);
            }
        }
        "only_telemetry_is_wrong" => {
            let telemetry = &mut samples[2..];
            alter_headers(
                tick,
                telemetry,
                header(|it| Header {
                    tick: it.tick - 3,
                    ..it
                }),
            );
        }
        "garbage" => fill_numbers(tick, samples, |at| random(tick * 1000 + at as u64)),
        "nan" => fill_numbers(tick, samples, |_| f64::NAN.to_bits()),
        "infinity" => fill_numbers(tick, samples, |_| f64::INFINITY.to_bits()),
        "enormous_numbers" => fill_numbers(tick, samples, |_| 1e308_f64.to_bits()),
        "zeros" => fill_numbers(tick, samples, |_| 0),
        "the_largest_thrust" if tick >= BEGIN => {
            ControlCommand::mut_from_bytes(samples[0]).unwrap().thrust = f64::MAX;
        }
        "sleeps_between_steps" if tick >= BEGIN => std::thread::sleep(Duration::from_millis(100)),
        _ => {}
    }
}

/// Publishes samples of one tick again and again, or those of all later ticks, without ever waiting.
fn flood(external_service: &mut ExternalService, goes_on: bool) -> ! {
    let last = external_service.schedule.last_tick();
    for round in 0.. {
        let tick = if goes_on { (BEGIN + round).min(last) } else { BEGIN };
        publish_again(external_service, tick);
    }
    unreachable!()
}

fn publish_again(external_service: &mut ExternalService, tick: u64) {
    if external_service
        .outputs
        .loan(tick, &mut host::step::Slots::default())
        .is_ok()
    {
        let _ = external_service
            .outputs
            .send(tick, runtime::crash::CrashPoint::default());
    }
}

/// No test unless it was started as an external service.
#[test]
fn an_external_service() {
    let Ok(conduct) = std::env::var(CONDUCT) else {
        return;
    };
    let real_time = std::fs::read_to_string(format!("/proc/self/fd/{MANIFEST}"))
        .is_ok_and(|about| about.contains(r#""host":"real_time""#));
    let mut external_service = ExternalService::join();
    assert_eq!(external_service.id, ServiceId::Controller);
    let repeats = [
        "the_same_sample_again",
        "floods_with_one_tick",
        "floods_with_later_ticks",
    ];
    let until = if repeats.contains(&conduct.as_str()) {
        BEGIN
    } else {
        u64::MAX
    };
    let mut has_begun = false;
    let mine = conduct.clone();
    external_service.mischief = Box::new(move |tick, samples| {
        alter(&mine, tick, samples);
        if tick >= BEGIN && !has_begun {
            has_begun = true;
            mark();
            act(&mine);
        }
    });
    if real_time {
        external_service.fly_in_real_time(until);
    } else {
        external_service.fly_in_lock_step(until);
    }
    match conduct.as_str() {
        "floods_with_one_tick" => flood(&mut external_service, false),
        "floods_with_later_ticks" => flood(&mut external_service, true),
        "the_same_sample_again" => {
            publish_again(&mut external_service, BEGIN);
            sleep_for_ever();
        }
        _ => {}
    }
    let _ = external_service.channel.send(&ToOrchestrator::Finished);
    while !matches!(external_service.channel.receive(), Ok(ToService::Stop) | Err(_)) {}
    std::process::exit(0);
}

/// Time for which a user who wants the end of a flight waits for it: services may take 2 s to stop, on a machine that is in use.
const PATIENCE: Duration = Duration::from_secs(20);

/// Time for which a hostile external service is let be.
const WHILE: Duration = Duration::from_millis(700);

/// Flies with an external service until the flight ends by itself or is ended, and says what is not as it should be.
fn trouble_with(conduct: &str, then: Then, real_time: bool, ended_by: Signal) -> Option<String> {
    let place = Place::new();
    let marked = place.path("begun");
    let setting = external_service(ServiceId::Controller, conduct);
    let mut command = if real_time {
        // The laboratory's vehicle holds its rates by itself while nobody commands.
        place.rig_flight(
            "out",
            1000.0,
            &["--host", "realtime", "--quiet", "--set", &setting],
        )
    } else {
        place.short_flight("out", 1000.0, &["--quiet", "--set", &setting])
    };
    let mut run = begin(command.env(MARK, &marked));
    let orchestrator = run.id();
    until("the external service's misconduct", || {
        (marked.exists() || run.try_wait().unwrap().is_some()).then_some(())
    });
    let mut ends_by_itself = ends_within(&mut run, if matches!(then, Ends(_)) { PATIENCE } else { WHILE });
    let asked = Instant::now();
    let mut obeys = true;
    if !ends_by_itself {
        if real_time {
            // The user who asks for it is answered, and then the flight ends.
            let answered = place.gerono(&["kill"]).output().unwrap();
            // It may just be ending: a program that dies again and again is given up.
            ends_by_itself = !answered.status.success() && ends_within(&mut run, PATIENCE);
            obeys = answered.status.success() || ends_by_itself;
        }
        if !ends_by_itself {
            signal(orchestrator, ended_by);
            obeys &= ends_within(&mut run, PATIENCE);
        }
    }
    if !obeys {
        return Some(format!(
            "{conduct}: nobody could end it within {:?}",
            asked.elapsed()
        ));
    }
    let output = finish(run);
    let (said, code) = (complaint(&output), output.status.code());
    let left = (
        place.leftovers(),
        common::processes::shared_memory_of(orchestrator),
    );
    let by_signal = Some(128 + ended_by.as_raw());
    // Lines are broken also within names.
    let words = said.replace(' ', "");
    let says = |piece: &str| words.contains(&piece.replace(' ', ""));
    let is_named = code != by_signal && NAMES.iter().any(|name| says(name));
    let is_right = match then {
        GoesOn => !ends_by_itself && code == by_signal,
        Ends(piece) => ends_by_itself && code == Some(3) && is_named && says(piece),
        Either => (!ends_by_itself && code == by_signal) || (matches!(code, Some(1 | 3)) && is_named),
    };
    // Processes whose memory was overwritten may report a panic.
    let is_calm = !said.contains("thread 'main'") || says("shared memory was damaged");
    let is_clean = left == (Vec::new(), Vec::new()) && !said.contains('\u{1b}') && is_calm;
    (!is_right || !is_clean).then(|| format!("{conduct}: {then:?}, code {code:?}, left {left:?}: {said}"))
}

fn ends_within(run: &mut Begun, limit: Duration) -> bool {
    let deadline = Instant::now() + limit;
    loop {
        if run.try_wait().unwrap().is_some() {
            return true;
        }
        if Instant::now() > deadline {
            return false;
        }
        std::thread::sleep(Duration::from_millis(5));
    }
}

/// Flies with the external services whose name contains what `GERONO_TEST_CONDUCT` says, all of them if it is empty.
fn fly_with_all(real_time: bool) {
    let _machine = MACHINE.lock().unwrap_or_else(PoisonError::into_inner);
    let (chosen, share) = match std::env::var("GERONO_TEST_CONDUCT") {
        Ok(chosen) => (chosen, 1),
        Err(_) => (String::new(), if real_time { SHARE } else { 1 }),
    };
    let flown = CONDUCTS.iter().step_by(share);
    let flown = flown.filter(|(conduct, ..)| conduct.contains(chosen.as_str()));
    let signals = [Signal::INT, Signal::TERM].into_iter().cycle();
    let flights = Mutex::new(flown.zip(signals));
    let fly = || {
        let mut troubles = Vec::new();
        loop {
            let next = flights.lock().unwrap().next();
            let Some((&(conduct, simulated, by_the_clock), ended_by)) = next else {
                return troubles;
            };
            let then = if real_time { by_the_clock } else { simulated };
            troubles.extend(trouble_with(conduct, then, real_time, ended_by));
        }
    };
    let troubles: Vec<String> = std::thread::scope(|scope| {
        let pilots = if real_time { 1 } else { AT_ONCE };
        let pilots: Vec<_> = (0..pilots).map(|_| scope.spawn(fly)).collect();
        pilots
            .into_iter()
            .flat_map(|pilot| pilot.join().unwrap())
            .collect()
    });
    assert!(troubles.is_empty(), "{}", troubles.join("\n"));
}

#[test]
fn in_simulated_time_a_hostile_external_service_harms_nothing_but_itself_or_is_named() {
    fly_with_all(false);
}

#[test]
fn in_real_time_a_hostile_external_service_harms_nothing_but_itself_or_is_named() {
    fly_with_all(true);
}
