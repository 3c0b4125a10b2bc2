//! Storms over the cameras: the simulated laboratory flies behind an adversary, which spoils what the cameras send. The
//! vehicle never falls, and strangers in the room take no pose away.
//!
//! The storm's size is in variables of the environment; `.ci/full` flies the long one.
//!
//! A flight counts until the machine first stands still: what becomes of a vehicle after that is the machine's doing.
//!
//! * `GERONO_CAMERA_MINUTES`: minutes in the air that count, 1 unless stated;
//! * `GERONO_CAMERA_SEED`: the first flight's seed, the next one has the next;
//! * `GERONO_CAMERA_KINDS`: `turns`, `freezes`, `strangers`, `network`, with commas between; all unless stated;
//! * `GERONO_CAMERA_RATE`: rate of the cameras, Hz, 100 unless stated;
//! * `GERONO_CAMERA_FIFO`: flies with real-time priorities if it is 1.

use crate::adversary;
use crate::common;

use std::fmt::{Display, Formatter};

use adversary::{Adversary, Event, KINDS, Kind, Ports, Served, Spoil, plan};
use common::logs::last_of_host;
use common::pilot::{ask, comes_to_the_path};
use common::ports::free_port;
use common::world::{World, arguments, samples};
use common::{Place, begin, finish, said, until};
use run_log::CaptureFigures;
use runtime::flight_clock::monotonic_ns;
use scenario::CaptureSystem;
use shared_types::samples::{MocapPose, VehicleTruth};

/// Every system, VRPN first.
const SYSTEMS: [CaptureSystem; CaptureSystem::ALL.len()] = {
    let mut systems = CaptureSystem::ALL;
    systems.rotate_left(1);
    systems
};

/// Fastest touch-down that is a landing and no fall, m/s: 1 m/s above that of the landing, as `impact_speed_max` has it. A blind
/// descent from 1.2 m alone ends at 0.85 m/s, and one that begins on the way down at 0.9 m/s.
const TOUCH_DOWN: f64 = 1.3;

/// Rates of the cameras of each of these systems in the short test, Hz.
const RATES: [u64; 3] = [50, 100, 200];

/// Least share of the poses beside strangers that are believed: of all that came to the driver, and of the share without
/// strangers where the machine loses some on the way.
const BELIEVED: f64 = 0.99;

/// Most flights for each minute that is to count.
const FLIGHTS_PER_MINUTE: u64 = 4;

/// Time after a spoiled part in which poses may still be refused, ns.
const RECOVERY_NS: u64 = 2_000_000_000;

/// What a flight is.
#[derive(Clone, Copy)]
struct Flight<'a> {
    seed: u64,
    system: CaptureSystem,
    /// Of the cameras, Hz.
    rate: u64,
    is_moving: bool,
    kinds: &'a [Kind],
    seconds: f64,
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Outcome {
    /// It was on its path until its end.
    Flew,
    /// It was down before, and came down as a landing does.
    Landed,
    /// It came down with this speed, m/s.
    Fell(f64),
    /// It was on its path when the machine stood still.
    Interrupted,
    /// The machine did not let it come to the path, or stood still while the vehicle came down.
    Spoilt,
}

/// What became of a flight.
struct Minute {
    outcome: Outcome,
    /// Believed and sent poses beside strangers, and without any.
    beside: [u64; 2],
    alone: [u64; 2],
    /// Packets and poses that the driver has refused for what they held.
    refused: u64,
    /// Time in the air that counts, s.
    seconds: f64,
    plan: Vec<Event>,
    shown: String,
}

impl Display for Minute {
    fn fmt(&self, formatter: &mut Formatter<'_>) -> std::fmt::Result {
        let share = |[believed, sent]: [u64; 2]| {
            let percent = 100.0 * believed as f64 / sent.max(1) as f64;
            format!("{percent:.1} % of {sent}")
        };
        write!(
            formatter,
            "{:?}, {:.1} s count; believed beside strangers {}, alone {}, refused {}",
            self.outcome,
            self.seconds,
            share(self.beside),
            share(self.alone),
            self.refused,
        )
    }
}

/// Settings of both ends: those of the world or those of the flight.
fn settings(place: &Place, flight: &Flight<'_>, port: u16) -> Vec<String> {
    let mut settings = vec![
        format!("motion_capture.source={}", flight.system.name()),
        format!("motion_capture.port={port}"),
        format!("rc_output.transmitter.device='{}'", place.path("radio").display()),
        format!("duration={:?}", flight.seconds + 60.0),
        format!("vehicle.fan.on_at={:?}", flight.seconds + 50.0),
        "flight.spool_up=0.2".to_owned(),
        format!(
            "motion_capture.rate=[{:?}, {:?}]",
            0.9 * flight.rate as f64,
            1.1 * flight.rate as f64
        ),
    ];
    if flight.system == CaptureSystem::Natnet {
        // Its stamps are those of the exposure.
        settings.push("motion_capture.latency=0.0".to_owned());
    }
    if flight.is_moving {
        let circle = "path.curve={circle = {center = [0.0, 0.0, -1.2], radius = 0.6, frequency = 1.0}}";
        settings.push(circle.to_owned());
    }
    settings
}

fn fly(place: &Place, name: &str, flight: &Flight<'_>) -> Minute {
    let ports = Ports {
        system: free_port(),
        flight: free_port(),
        frames: free_port(),
    };
    let plan = plan(flight.seed, flight.kinds, (1e9 * flight.seconds) as u64);
    let [run_name, world_name] = ["flight", "world"].map(|end| format!("{name}-{end}"));
    let adversary = Adversary::start(flight.system, ports, plan.clone());
    let simulated = World::begin(
        place,
        &settings(place, flight, ports.system),
        &["--out", &world_name],
    );
    until("the device", || place.path("radio").exists().then_some(()));
    let mut more = vec!["--host", "realtime", "--out", &run_name];
    if std::env::var("GERONO_CAMERA_FIFO").is_ok_and(|value| value == "1") {
        more.push("--fifo");
    }
    let stated = settings(place, flight, ports.flight);
    let run = begin(&mut place.gerono(&arguments("run", &stated, &more)));
    let has_come = comes_to_the_path(place);
    let began_ns = monotonic_ns();
    adversary.begin();
    let is_over = || 1e-9 * (monotonic_ns() - began_ns) as f64 >= flight.seconds;
    let stayed = has_come
        && ask("the end of the storm", || {
            let phase = place.look()?.phase?;
            let is_down = matches!(phase.as_str(), "land" | "disarmed");
            // Looked at after the phase: what the machine does to a vehicle is seen later than that it does.
            let ends = adversary.has_stood_still() || is_over();
            (ends || is_down).then_some(ends || !is_down)
        });
    let until_ns = monotonic_ns();
    // The clock of the flight, to some ms: the look takes as long.
    let start_ns = place.look().map(|look| monotonic_ns() - (1e9 * look.time) as u64);
    let stopped = place.gerono(&["stop"]).output().unwrap();
    let ended = finish(run);
    let record = adversary.end();
    simulated.end();
    let stood_still_ns = record.stood_still_ns;
    let speed = touch_down(&samples(&place.log(&world_name)));
    let outcome = match (has_come, stayed, stood_still_ns, speed) {
        (false, ..) | (_, false, Some(_), _) => Outcome::Spoilt,
        (_, true, Some(_), _) => Outcome::Interrupted,
        (_, _, None, Some(speed)) if speed > TOUCH_DOWN => Outcome::Fell(speed),
        (_, true, None, _) => Outcome::Flew,
        (_, false, None, _) => Outcome::Landed,
    };
    let until_ns = stood_still_ns.unwrap_or(u64::MAX).min(until_ns);
    let poses: Vec<u64> = samples::<MocapPose>(&place.log(&run_name))
        .iter()
        .filter(|pose| pose.tracked.is_set())
        .map(|pose| pose.header.stamp_ns + start_ns.unwrap_or(0))
        .collect();
    let counted = record.served.partition_point(|served| served.at_ns < until_ns);
    let [beside, alone] = believed(&record.served[..counted], &plan, &poses);
    Minute {
        outcome,
        beside,
        alone,
        refused: refused(&last_of_host(place, &run_name, "host/motion_capture")),
        seconds: match outcome {
            Outcome::Spoilt => 0.0,
            _ => 1e-9 * (until_ns - began_ns) as f64,
        },
        plan,
        shown: format!("{}{}", said(&ended), said(&stopped)),
    }
}

/// Returns the speed with which a vehicle that was in the air last came to the ground, m/s.
fn touch_down(truths: &[VehicleTruth]) -> Option<f64> {
    let height = |truth: &VehicleTruth| -truth.position_world[2];
    let last = truths.iter().rposition(|truth| height(truth) > 0.0)?;
    let [x, y, z] = truths[last].velocity_body;
    // One that is still in the air when its world ends has not come down.
    (last + 1 < truths.len()).then(|| (x * x + y * y + z * z).sqrt())
}

/// Returns how many poses were believed and sent beside strangers, and without strangers, while nothing
/// spoiled the vehicle's own.
fn believed(served: &[Served], plan: &[Event], poses: &[u64]) -> [[u64; 2]; 2] {
    let mut counts = [[0; 2]; 2];
    let is_stranger = |index: usize| matches!(plan[index].spoil, Spoil::Strange(_));
    let mut spoiled_ns = None;
    let mut pieces = served
        .chunk_by(|first, second| first.event == second.event)
        .peekable();
    while let Some(piece) = pieces.next() {
        let (first, last) = (piece[0].at_ns, piece[piece.len() - 1].at_ns);
        // The pose of a frame is published before the next frame comes.
        let end = pieces.peek().map_or(last, |next| next[0].at_ns);
        let kind = match piece[0].event {
            Some(index) if is_stranger(index) => 0,
            Some(_) => {
                spoiled_ns = Some(last);
                continue;
            }
            None => 1,
        };
        if spoiled_ns.is_some_and(|spoiled_ns| first < spoiled_ns + RECOVERY_NS) {
            continue;
        }
        let within = poses.partition_point(|at| *at < end) - poses.partition_point(|at| *at < first);
        counts[kind][0] += (within as u64).min(piece.len() as u64);
        counts[kind][1] += piece.len() as u64;
    }
    counts
}

/// Returns how many packets and poses the driver has refused for what they held. Those that came at a wrong time are the
/// machine's.
fn refused(figures: &CaptureFigures) -> u64 {
    let CaptureFigures {
        malformed,
        absent,
        occluded,
        frozen,
        jumped,
        exchanged,
        ..
    } = *figures;
    malformed + absent + occluded + frozen + jumped + exchanged
}

fn share([believed, sent]: [u64; 2]) -> f64 {
    believed as f64 / sent.max(1) as f64
}

/// Some seconds of every system, in a room of strangers.
#[test]
fn strangers_take_no_pose_away() {
    let place = Place::new();
    for (index, system) in SYSTEMS.into_iter().enumerate() {
        let flown = (0..3).find_map(|attempt| {
            let flight = Flight {
                seed: 1 + index as u64,
                system,
                rate: RATES[index % RATES.len()],
                is_moving: index == 1,
                kinds: &[Kind::Strangers],
                seconds: 12.0,
            };
            let minute = fly(&place, &format!("{}-{attempt}", system.name()), &flight);
            println!("{}, {} Hz: {minute}", system.name(), flight.rate);
            (!matches!(minute.outcome, Outcome::Interrupted | Outcome::Spoilt)).then_some(minute)
        });
        // A machine that stands still loses vehicles by itself, whatever the cameras send.
        let Some(minute) = flown else {
            println!(
                "SKIPPED: {}: the machine stands still in every flight",
                system.name()
            );
            continue;
        };
        let facts = format!("{minute}\n{:#?}\n{}", minute.plan, minute.shown);
        assert_eq!(minute.outcome, Outcome::Flew, "{facts}");
        assert!(share(minute.beside) >= BELIEVED * share(minute.alone), "{facts}");
        let [_, beside] = minute.beside;
        assert!(
            beside > RATES[index % RATES.len()],
            "strangers for more than a second: {facts}"
        );
        assert!(
            minute.refused as f64 <= (1.0 - BELIEVED) * beside as f64,
            "{facts}"
        );
    }
}

/// As many minutes as the environment states.
#[test]
#[ignore = "takes minutes on a machine that has nothing else to do: see .ci/full"]
fn minutes_of_everything() {
    let number = |name: &str| std::env::var(name).ok().map(|text| text.parse::<u64>().unwrap());
    let minutes = number("GERONO_CAMERA_MINUTES").unwrap_or(1);
    let rate = number("GERONO_CAMERA_RATE").unwrap_or(100);
    let first_seed = number("GERONO_CAMERA_SEED").unwrap_or(1);
    let stated = std::env::var("GERONO_CAMERA_KINDS").unwrap_or_default();
    let kinds: Vec<Kind> = KINDS
        .into_iter()
        .filter(|(name, _)| stated.is_empty() || stated.split(',').any(|stated| stated == *name))
        .map(|(_, kind)| kind)
        .collect();
    let mut fallen = Vec::new();
    let (mut seconds, mut outcomes, mut beside, mut alone) = (0.0, [0; 3], [0; 2], [0; 2]);
    for seed in first_seed..first_seed + FLIGHTS_PER_MINUTE * minutes {
        if seconds >= 60.0 * minutes as f64 {
            break;
        }
        let mut place = Place::new();
        let flight = Flight {
            seed,
            system: SYSTEMS[seed as usize % SYSTEMS.len()],
            rate,
            is_moving: seed as usize / SYSTEMS.len() % 2 == 1,
            kinds: &kinds,
            seconds: 60.0,
        };
        let minute = fly(&place, "minute", &flight);
        let course = if flight.is_moving { "circle" } else { "hover" };
        println!("seed {seed}, {}, {course}: {minute}", flight.system.name());
        match minute.outcome {
            Outcome::Flew => outcomes[0] += 1,
            Outcome::Landed => outcomes[1] += 1,
            Outcome::Interrupted => outcomes[2] += 1,
            Outcome::Fell(_) | Outcome::Spoilt => {}
        }
        seconds += minute.seconds;
        for part in 0..2 {
            beside[part] += minute.beside[part];
            alone[part] += minute.alone[part];
        }
        if let Outcome::Fell(speed) = minute.outcome {
            fallen.push((seed, speed));
            let kept = place.keep().display().to_string();
            println!("{:#?}\n{}\nkept in {kept}", minute.plan, minute.shown);
        }
    }
    let [flew, landed, interrupted] = outcomes;
    println!(
        "{:.1} minutes count: {flew} flights to the end, {landed} landed, {interrupted} until the machine stood still, {} fell \
         {fallen:?}; believed beside strangers {:.2} % of {}, alone {:.2} % of {}",
        seconds / 60.0,
        fallen.len(),
        100.0 * share(beside),
        beside[1],
        100.0 * share(alone),
        alone[1]
    );
    assert!(fallen.is_empty(), "{fallen:?}");
    assert!(seconds > 0.0, "the machine stands still in every flight");
    assert!(share(beside) >= BELIEVED * share(alone));
}
