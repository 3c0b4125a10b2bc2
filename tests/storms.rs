//! Storms of signals: services, newborn ones and the spare process get every signal that ends or stops a process, at any
//! moment. In simulated time the log shows nothing of it; in real time the flight goes on.
//!
//! `GERONO_SIGNALS` says how many, for each of the two; `.ci/full` asks for thousands.

mod common;

use std::time::{Duration, Instant};

use common::pilot::{take_off_from_the_ground, wait_on_the_ground};
use common::processes::{
    await_end, await_process, await_successor, fill_the_disk_of, processes_of, shared_memory_of, signal,
};
use common::{Begun, Place, begin, complaint, finish, said, succeed};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};
use run_log::LogReader;
use rustix::process::{Pid, Signal, kill_process};
use shared_types::ServiceId;
use shared_types::rotation::tilt;
use shared_types::samples::VehicleTruth;

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

/// Signals to one flight in real time whose disk is full at the end, and the longest pause between two of them.
const SIGNALS_BEFORE_THE_DISK: u64 = 60;
const LONGEST_PAUSE_BEFORE_THE_DISK: Duration = Duration::from_millis(900);

/// Height above the ground and tilt of a vehicle in the air, m and rad.
const LEAST_HEIGHT: f64 = 0.1;
const LARGEST_TILT: f64 = 0.5;

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
    fn over(&mut self, run: &mut Begun, longest_pause_us: u32, signals: u64) {
        let deadline = Instant::now() + Duration::from_secs(100);
        let enough = self.sent.saturating_add(signals);
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
        storm.over(&mut run, longest_pause_us, SIGNALS_PER_FLIGHT);
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
    let mut run = begin(&mut place.rig_flight("out", 10_000.0, &settings));
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

/// Services and the standby process are hit twice a second, then the disk is full as well: the vehicle lands, while they are
/// hit on.
#[test]
#[ignore = "needs a machine of its own; .ci/full flies it"]
fn a_flight_in_a_storm_lands_when_its_disk_is_full() {
    let mut storm = Storm {
        random: ChaCha8Rng::seed_from_u64(wanted()),
        sent: 0,
    };
    let longest_pause_us = u32::try_from(LONGEST_PAUSE_BEFORE_THE_DISK.as_micros()).unwrap();
    let mut judged = 0;
    for flight in 1.. {
        let place = Place::in_real_time();
        let mut run = wait_on_the_ground(&place);
        let orchestrator = run.id();
        take_off_from_the_ground(&place);
        storm.over(&mut run, longest_pause_us, SIGNALS_BEFORE_THE_DISK);
        let flies = place
            .look()
            .is_some_and(|snapshot| snapshot.phase.as_deref() == Some("fly"));
        fill_the_disk_of(orchestrator);
        storm.over(&mut run, longest_pause_us, u64::MAX);
        let ended = finish(run);
        assert_eq!(ended.status.code(), Some(4), "{}", said(&ended));
        let complaint = complaint(&ended);
        place.assert_nothing_is_left_of(orchestrator);
        if flies {
            assert!(complaint.contains("The vehicle lands."), "{complaint}");
            assert_it_has_stayed_in_the_air(&place);
            judged += 1;
        } else {
            // A machine that stands still has hidden it from the cameras, and it has landed by itself.
            assert!(complaint.contains("touched down"), "{complaint}");
            assert!(
                judged > 0 || flight < 5,
                "the machine stands still in every flight"
            );
        }
        if storm.sent >= wanted() && judged > 0 {
            println!("{} signals in {judged} of {flight} flights", storm.sent);
            break;
        }
    }
}

/// From its takeoff to the end of what is recorded, the vehicle was in the air and upright.
#[track_caller]
fn assert_it_has_stayed_in_the_air(place: &Place) {
    let log = LogReader::open(&place.path("out/run.mcap.partial")).unwrap();
    let mut truths: Vec<VehicleTruth> = Vec::new();
    for sample in log.samples() {
        // The full disk has cut off what follows.
        let Ok(sample) = sample else { break };
        truths.push(sample);
    }
    let ground = truths[0].position_world[2];
    let height = |truth: &VehicleTruth| ground - truth.position_world[2];
    let flown = truths
        .iter()
        .skip_while(|truth| height(truth) < 2.0 * LEAST_HEIGHT);
    let mut count = 0;
    for truth in flown {
        let (height, tilt) = (height(truth), tilt(&truth.world_from_body));
        let at = truth.header.tick;
        assert!(height > LEAST_HEIGHT, "{height} m above the ground at tick {at}");
        assert!(tilt < LARGEST_TILT, "it tilts by {tilt} rad at tick {at}");
        count += 1;
    }
    assert!(count > 1_000, "only {count} samples of the flight");
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
