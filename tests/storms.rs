//! Storms of signals: services, newborn ones and the spare process get every signal that ends or stops a process, at any
//! moment. In simulated time the log shows nothing of it; in real time the flight goes on.
//!
//! `GERONO_SIGNALS` says how many, for each of the two; `.ci/full` asks for thousands.

mod common;

use std::time::{Duration, Instant};

use common::processes::{await_end, await_process, await_successor, processes_of, shared_memory_of, signal};
use common::{Begun, Place, begin, finish, said, succeed};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};
use rustix::process::{Pid, Signal, kill_process};
use shared_types::ServiceId;

/// Every signal that a shell, the system or a person sends.
const SIGNALS: [Signal; 13] = [
    Signal::KILL,
    Signal::TERM,
    Signal::SEGV,
    Signal::ABORT,
    Signal::BUS,
    Signal::FPE,
    Signal::ILL,
    Signal::HUP,
    Signal::INT,
    Signal::PIPE,
    Signal::USR1,
    Signal::QUIT,
    Signal::STOP,
];

/// Signals to one flight in simulated time.
const SIGNALS_PER_FLIGHT: u64 = 150;

/// Longest pause of a process that was stopped.
const PAUSE_MS: u32 = 30;

fn wanted() -> u64 {
    std::env::var("GERONO_SIGNALS").map_or(60, |count| count.parse().unwrap())
}

fn send(pid: u32, signal: Signal) -> bool {
    let pid = Pid::from_raw(i32::try_from(pid).unwrap()).unwrap();
    kill_process(pid, signal).is_ok()
}

/// A storm over one run, until it ends or as many signals were sent.
struct Storm {
    random: ChaCha8Rng,
    sent: u64,
}

impl Storm {
    fn below(&mut self, limit: u32) -> u32 {
        self.random.next_u32() % limit
    }

    /// Sends one signal to a process of a run, or to several at once; stopped ones are let go again.
    fn strike(&mut self, orchestrator: u32) {
        let processes = processes_of(orchestrator);
        if processes.is_empty() {
            return;
        }
        // Mostly one, now and then several at once.
        let victims = if self.below(10) == 0 { 1 + self.below(4) } else { 1 };
        for _ in 0..victims {
            let chosen = usize::try_from(self.below(u32::try_from(processes.len()).unwrap())).unwrap();
            let kind = usize::try_from(self.below(u32::try_from(SIGNALS.len()).unwrap())).unwrap();
            let (pid, signal) = (processes[chosen].1, SIGNALS[kind]);
            self.sent += u64::from(send(pid, signal));
            if signal == Signal::STOP {
                std::thread::sleep(Duration::from_millis(self.below(PAUSE_MS).into()));
                send(pid, Signal::CONT);
                if self.below(4) == 0 {
                    send(pid, Signal::KILL);
                }
            }
        }
    }

    /// Strikes until a run has ended, or has been struck often enough to be let fly on.
    fn over(&mut self, run: &mut Begun, longest_pause_us: u32) {
        let deadline = Instant::now() + Duration::from_secs(100);
        let enough = self.sent + SIGNALS_PER_FLIGHT;
        while run.try_wait().unwrap().is_none() && self.sent < enough && Instant::now() < deadline {
            let pause = self.below(longest_pause_us);
            std::thread::sleep(Duration::from_micros(pause.into()));
            self.strike(run.id());
        }
    }
}

#[test]
fn a_storm_in_simulated_time_leaves_no_trace_in_the_log_nor_anything_behind() {
    let place = Place::new();
    let takeoff = common::scenario("takeoff_and_land");
    let fly = |out: &str, more: &[&str]| {
        let arguments = ["run", takeoff.to_str().unwrap(), "--quiet", "--out", out];
        place.gerono(&[&arguments[..], more].concat())
    };
    succeed(&mut fly("undisturbed", &["--host", "inprocess"]));
    let undisturbed = std::fs::read(place.log("undisturbed")).unwrap();
    let mut storm = Storm {
        random: ChaCha8Rng::seed_from_u64(wanted()),
        sent: 0,
    };
    for flight in 0.. {
        let out = format!("out-{flight}");
        // Nine deaths in a row without a tick between are an end that is planned: no storm is to reach it.
        let mut run = begin(&mut fly(&out, &["--restarts", "1000000"]));
        let orchestrator = run.id();
        let longest_pause_us = [8_000, 30_000, 90_000][flight % 3];
        storm.over(&mut run, longest_pause_us);
        let ended = finish(run);
        assert!(
            ended.status.success(),
            "after {} signals: {}",
            storm.sent,
            said(&ended)
        );
        assert!(
            std::fs::read(place.log(&out)).unwrap() == undisturbed,
            "{out} differs"
        );
        assert!(shared_memory_of(orchestrator).is_empty() && processes_of(orchestrator).is_empty());
        assert_eq!(place.leftovers(), Vec::<String>::new());
        std::fs::remove_dir_all(place.path(&out)).unwrap();
        if storm.sent >= wanted() {
            println!("{} signals in {} flights", storm.sent, flight + 1);
            break;
        }
    }
}

#[test]
fn a_flight_in_real_time_goes_on_in_a_storm_and_leaves_nothing_behind() {
    let place = Place::new();
    let settings = ["--host", "realtime", "--quiet", "--restarts", "1000000"];
    let mut run = begin(&mut place.rig_flight("out", 100_000.0, &settings));
    let orchestrator = run.id();
    place.await_log("out", 20_000);
    let mut storm = Storm {
        random: ChaCha8Rng::seed_from_u64(wanted()),
        sent: 0,
    };
    while storm.sent < wanted() {
        assert!(
            run.try_wait().unwrap().is_none(),
            "after {} signals: {}",
            storm.sent,
            said(&finish(run))
        );
        let pause = storm.below(60_000);
        std::thread::sleep(Duration::from_micros(pause.into()));
        storm.strike(orchestrator);
    }
    signal(orchestrator, Signal::TERM);
    let ended = finish(run);
    assert_eq!(ended.status.code(), Some(143), "{}", said(&ended));
    place.assert_nothing_is_left_of(orchestrator);
    println!("{} signals", storm.sent);
}

/// Publishers wait for the recorder, which takes nothing while it is stopped; then a signal comes that Rust's runtime handles.
#[test]
fn a_signal_that_interrupts_a_blocked_send_ends_the_service_and_not_the_flight() {
    for signal_sent in [Signal::SEGV, Signal::BUS] {
        let place = Place::new();
        let run = begin(&mut place.short_flight("choked", 20.0, &[]));
        place.await_log("choked", 1_000_000);
        signal(run.id(), Signal::STOP);
        // Nobody can tell that a publisher waits; in this time the ring fills the recorder's buffers several times.
        std::thread::sleep(Duration::from_millis(300));
        let dead = ServiceId::ALL.map(|service| await_process(run.id(), service));
        for pid in dead {
            signal(pid, signal_sent);
            await_end(pid);
        }
        let plant = dead[ServiceId::Plant.index()];
        signal(run.id(), Signal::CONT);
        await_successor(run.id(), ServiceId::Plant, plant);
        let ended = finish(run);
        assert!(ended.status.success(), "{}", said(&ended));
        succeed(&mut place.short_flight("undisturbed", 20.0, &["--host", "inprocess"]));
        let bytes = |out: &str| std::fs::read(place.log(out)).unwrap();
        assert!(bytes("choked") == bytes("undisturbed"));
    }
}
