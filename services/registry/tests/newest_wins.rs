//! Flights with services that step by the clock, and are absent for a while ([`host::newest_wins`]).

use std::convert::Infallible;
use std::ops::ControlFlow;
use std::path::Path;

use host::in_process::{InProcess, TickSink};
use host::newest_wins::{NewestWins, Presence, Start};
use nalgebra::Vector3;
use registry::build_all;
use scenario::{LawKind, Scenario};
use shared_types::samples::{ControlAdaptation, PathReference, RcFrame, VehicleTruth};
use shared_types::service::{header_of, nanoseconds};
use shared_types::{FlightPhase, Schedule, ServiceId, Topic};

/// Speed of a touch-down above which the vehicle counts as lost, m/s: 1 m/s above that of the landing.
const FALL: f64 = 1.3;
/// Cosine of the tilt at which the envelope stops the motors, 1 rad.
const UPRIGHT: f64 = 0.54;

fn committed(name: &str) -> Scenario {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("../../scenarios/{name}.toml"));
    let table: toml::Table = std::fs::read_to_string(file).unwrap().parse().unwrap();
    table.try_into().unwrap()
}

/// A flight with the input policies of real time.
fn flight_of(scenario: &Scenario) -> NewestWins {
    let scenario = scenario.clone().with_real_time_policies();
    assert_eq!(scenario.problems(), []);
    let grace_ns = nanoseconds(scenario.real_time.unwrap_or_default().grace);
    NewestWins::new(
        scenario.schedule().unwrap(),
        grace_ns,
        build_all(&scenario).unwrap(),
    )
}

fn step(flight: &mut NewestWins) {
    flight.step(flight.planned_operator()).unwrap();
}

fn step_to(flight: &mut NewestWins, tick: u64) {
    while flight.next_tick() < tick {
        step(flight);
    }
}

/// Flies the same ticks by the clock, and compares their samples.
struct Beside {
    flight: NewestWins,
    samples: Vec<(Topic, Vec<u8>)>,
    compared: u64,
    last_tick: u64,
}

impl TickSink for Beside {
    type Error = Infallible;

    fn sample(&mut self, topic: Topic, bytes: &[u8]) -> Result<(), Infallible> {
        self.samples.push((topic, bytes.to_vec()));
        Ok(())
    }

    fn end_tick(&mut self, tick: u64) -> Result<ControlFlow<()>, Infallible> {
        step(&mut self.flight);
        for (topic, bytes) in &self.samples {
            assert!(
                self.flight.newest(*topic) == Some(bytes),
                "{topic} of tick {tick}"
            );
        }
        let is_new = |topic: &Topic| {
            let newest = self.flight.newest(*topic);
            newest.is_some_and(|bytes| header_of(bytes).tick == tick)
        };
        let new = Topic::ALL.iter().filter(|topic| is_new(topic)).count();
        assert_eq!(new, self.samples.len(), "topics of tick {tick}");
        self.compared += self.samples.len() as u64;
        self.samples.clear();
        Ok(if tick < self.last_tick {
            ControlFlow::Continue(())
        } else {
            ControlFlow::Break(())
        })
    }
}

/// Demands that a flight by the clock publishes the samples of the reference. Returns their number.
fn equals_in_process(scenario: &Scenario, schedule: &Schedule, duration: f64) -> u64 {
    let grace_ns = nanoseconds(scenario.real_time.unwrap_or_default().grace);
    let mut beside = Beside {
        flight: NewestWins::new(schedule.clone(), grace_ns, build_all(scenario).unwrap()),
        samples: Vec::new(),
        compared: 0,
        last_tick: nanoseconds(duration) / schedule.tick_ns(),
    };
    let mut reference = InProcess::new(schedule.clone(), build_all(scenario).unwrap());
    reference.fly(&mut beside).unwrap();
    beside.compared
}

#[test]
fn with_all_services_present_the_samples_equal_those_of_lock_step() {
    for (name, duration) in [
        ("fig1", 60.0_f64),
        ("takeoff_and_land", 40.0),
        ("fig3_6", 20.0),
        ("fault_isolation", 20.0),
        ("another_vehicle", 5.0),
        ("trajectory_tracking", 5.0),
        ("wind", 5.0),
    ] {
        let scenario = committed(name);
        let schedule = scenario.schedule().unwrap();
        let compared = equals_in_process(&scenario, &schedule, duration.min(scenario.duration));
        assert!(compared > 5_000, "{name}: {compared}");
    }
}

#[test]
fn with_the_policies_of_real_time_and_a_tilted_start_too() {
    let mut tilted = committed("fig1");
    tilted.vehicle.initial.roll_pitch_yaw = [1.2, -0.7, 2.0];
    let tilted = tilted.with_real_time_policies();
    equals_in_process(&tilted, &tilted.schedule().unwrap(), 5.0);
}

#[test]
fn with_other_laws_too() {
    for law in [LawKind::GeometricPid, LawKind::L1, LawKind::Indi, LawKind::Px4] {
        let mut scenario = committed("fig3_6");
        scenario.controller = scenario::Controller {
            law,
            rates: scenario.controller.rates.clone(),
            ..scenario::Controller::default()
        };
        assert_eq!(scenario.problems(), [], "{law:?}");
        equals_in_process(&scenario, &scenario.schedule().unwrap(), 5.0);
    }
}

#[test]
fn a_restart_between_two_ticks_leaves_no_trace() {
    let scenario = committed("fig1");
    let mut restarted = flight_of(&scenario);
    let mut undisturbed = flight_of(&scenario);
    let services = [
        ServiceId::Estimator,
        ServiceId::PathGenerator,
        ServiceId::Controller,
        ServiceId::RcOutput,
    ];
    for tick in 0..3_000 {
        for (service, period) in services.into_iter().zip([2, 3, 5, 7]) {
            if tick % period == 0 {
                restarted.restart(service, Start::FromCheckpoint);
            }
        }
        step(&mut restarted);
        step(&mut undisturbed);
        for topic in Topic::ALL {
            assert!(
                restarted.newest(topic) == undisturbed.newest(topic),
                "{topic} of tick {tick}"
            );
        }
    }
}

#[test]
fn a_saved_flight_goes_on_as_it_did() {
    let mut flight = flight_of(&committed("takeoff_and_land"));
    step_to(&mut flight, 14_000);
    flight.die_in_next_step(ServiceId::Controller, 0);
    step_to(&mut flight, 14_100);
    let state = flight.save();
    let mut places = [0, 1].map(|_| {
        flight.restore(&state);
        flight.restart(ServiceId::Controller, Start::FromCheckpoint);
        step_to(&mut flight, 15_000);
        flight.newest(Topic::VehicleTruth).unwrap().to_vec()
    });
    let [first, second] = &mut places;
    assert_eq!(first, second);
}

/// The process died in a step, before or after it sent its command: its successor begins with the state before the step.
#[test]
fn a_process_that_dies_in_a_step_loses_it() {
    let mut flight = flight_of(&committed("fig1"));
    for (sent, commanded) in [(0, 999), (1, 1_000)] {
        flight.restore(&{
            let mut fresh = flight_of(&committed("fig1"));
            step_to(&mut fresh, 1_000);
            fresh.save()
        });
        flight.die_in_next_step(ServiceId::Controller, sent);
        step(&mut flight);
        assert_eq!(flight.presence(ServiceId::Controller), Presence::Absent);
        assert_eq!(flight.steps_until(ServiceId::Controller), 1_000);
        let command = flight.newest(Topic::ControlCommand).unwrap();
        assert_eq!(header_of(command).tick, commanded);
        // The telemetry is sent after the command.
        let adaptation = flight.newest(Topic::ControlAdaptation).unwrap();
        assert_eq!(header_of(adaptation).tick, 999);
        flight.set_presence(ServiceId::Controller, Presence::Gone);
        step_to(&mut flight, 1_005);
        flight.open_ports(ServiceId::Controller, Start::FromCheckpoint);
        step(&mut flight);
        // It is started in this tick, when the others have done their steps, and is late.
        flight.set_presence(ServiceId::Controller, Presence::Present);
        step(&mut flight);
        let last = *flight.last_step(ServiceId::Controller).unwrap();
        assert_eq!((last.tick, last.previous, last.missed), (1_006, Some(1_005), 0));
        let frame = flight.last_step(ServiceId::RcOutput).unwrap();
        assert_eq!((frame.tick, frame.consumed[0]), (1_006, Some(1_006)));
    }
}

/// The estimator reads every frame and every capture, also those of the time in which its process was dead.
#[test]
fn a_restarted_estimator_reads_every_sample_of_its_absence() {
    let mut flight = flight_of(&committed("takeoff_and_land"));
    step_to(&mut flight, 14_000);
    let before = flight.last_step(ServiceId::Estimator).unwrap().tick;
    flight.set_presence(ServiceId::Estimator, Presence::Gone);
    step_to(&mut flight, 14_310);
    flight.restart(ServiceId::Estimator, Start::FromCheckpoint);
    assert_eq!(flight.steps_until(ServiceId::Estimator), before + 1);
    step(&mut flight);
    let last = flight.last_step(ServiceId::Estimator).unwrap();
    // Captures come 5 ms late at the multiples of 10 ms.
    assert!(last.tick > 14_300 && last.consumed[0] == Some(14_300), "{last:?}");
}

/// Each stage begins at the controller's first step at which the state is older than the stage's age.
#[test]
fn the_controller_fails_safe_at_the_stated_ages_of_a_state_that_does_not_come() {
    for presence in [Presence::Absent, Presence::Gone] {
        let mut flight = flight_of(&committed("takeoff_and_land"));
        step_to(&mut flight, 14_000);
        flight.set_presence(ServiceId::Estimator, presence);
        let mut stages = vec![0];
        let mut steps = 0;
        while flight.next_tick() < 25_500 {
            step(&mut flight);
            let state = header_of(flight.newest(Topic::VehicleState).unwrap()).tick;
            let adaptation: &ControlAdaptation = flight.newest_sample().unwrap();
            let age = adaptation.header.tick.saturating_sub(state);
            let expected = [200, 300, 1_000, 10_000]
                .into_iter()
                .filter(|&limit| age > limit)
                .count();
            assert_eq!(usize::from(adaptation.stage), expected, "age {age} ms");
            if stages.last() != Some(&expected) {
                stages.push(expected);
            }
            steps += 1;
        }
        assert!(steps > 10_000);
        assert_eq!(stages, [0, 1, 2, 3, 4], "{presence:?}");
    }
}

/// Facts about a flight from the ground to the ground.
#[derive(Clone, Debug)]
struct Flown {
    /// Places by tick, m.
    places: Vec<Vector3<f64>>,
    /// Smallest cosine of the tilt.
    upright: f64,
    /// Speed of the fastest touch-down, m/s.
    touch: f64,
    is_killed: bool,
    /// It is on the ground and disarmed after its flight.
    is_over: bool,
    has_lifted: bool,
    sinking: f64,
    /// Phases in their order.
    phases: Vec<FlightPhase>,
}

impl Flown {
    fn new() -> Self {
        Self {
            places: Vec::new(),
            upright: 1.0,
            touch: 0.0,
            is_killed: false,
            is_over: false,
            has_lifted: false,
            sinking: 0.0,
            phases: Vec::new(),
        }
    }

    fn watch(&mut self, flight: &NewestWins) {
        let truth: &VehicleTruth = flight.newest_sample().unwrap();
        let (r, [x, y, z]) = (truth.world_from_body, truth.velocity_body);
        let height = -truth.position_world[2];
        self.places.push(truth.position_world.into());
        self.upright = self.upright.min(r[8]);
        self.has_lifted |= height > 0.02;
        if self.has_lifted && height <= 1e-6 {
            self.has_lifted = false;
            self.touch = self.touch.max(self.sinking);
        }
        self.sinking = r[6] * x + r[7] * y + r[8] * z;
        let frame: Option<&RcFrame> = flight.newest_sample();
        self.is_killed |= frame.is_some_and(|frame| frame.action == RcFrame::ACTION_KILL);
        if let Some(reference) = flight.newest_sample::<PathReference>() {
            let phase = FlightPhase::from_code(reference.phase);
            if self.phases.last() != Some(&phase) {
                self.phases.push(phase);
            }
            self.is_over = !self.has_lifted && phase == FlightPhase::Disarmed;
        }
    }

    fn has_fallen(&self) -> bool {
        self.is_killed || self.touch > FALL || self.upright < UPRIGHT || !self.is_over
    }
}

/// An absence of a service: it hangs for a time, then is known to be dead for a time, ms.
struct AbsenceCase {
    words: &'static str,
    hangs: u64,
    dead: u64,
    /// Number of outputs of the lost step that were sent, if a step is lost.
    sent: Option<usize>,
}

const ABSENCES: [AbsenceCase; 6] = [
    AbsenceCase {
        words: "hangs 60 ms and continues",
        hangs: 60,
        dead: 0,
        sent: None,
    },
    AbsenceCase {
        words: "dead for 60 ms",
        hangs: 0,
        dead: 60,
        sent: None,
    },
    AbsenceCase {
        words: "dead for 60 ms, a step unpublished",
        hangs: 0,
        dead: 60,
        sent: Some(0),
    },
    AbsenceCase {
        words: "dead for 60 ms, a step without checkpoint",
        hangs: 0,
        dead: 60,
        sent: Some(9),
    },
    AbsenceCase {
        words: "hangs 250 ms, dead for 60 ms",
        hangs: 250,
        dead: 60,
        sent: None,
    },
    AbsenceCase {
        words: "hangs 310 ms and continues",
        hangs: 310,
        dead: 0,
        sent: None,
    },
];

/// Tick from which the vehicle lands.
const LANDS: usize = 25_000;

/// Lets a service be absent from now on, and flies to the end.
fn fly_through(flight: &mut NewestWins, flown: &mut Flown, service: ServiceId, case: &AbsenceCase) {
    let fly_on = |flight: &mut NewestWins, flown: &mut Flown| {
        step(flight);
        flown.watch(flight);
    };
    if let Some(sent) = case.sent {
        flight.die_in_next_step(service, sent);
        while flight.presence(service) == Presence::Present {
            fly_on(flight, flown);
        }
    }
    flight.set_presence(service, Presence::Absent);
    for _ in 0..case.hangs {
        fly_on(flight, flown);
    }
    if case.dead > 0 {
        flight.set_presence(service, Presence::Gone);
        for _ in 0..case.dead {
            fly_on(flight, flown);
        }
        flight.restart(service, Start::FromCheckpoint);
    } else {
        flight.set_presence(service, Presence::Present);
    }
    while flight.next_tick() <= flight.schedule().last_tick() {
        fly_on(flight, flown);
    }
}

/// Distance of a place from the way of an undisturbed flight, m.
fn distance(place: &Vector3<f64>, way: &[Vector3<f64>]) -> f64 {
    let distances = way.iter().step_by(5).map(|other| (place - other).norm());
    distances.fold(f64::INFINITY, f64::min)
}

#[test]
fn no_vehicle_falls_that_lacks_one_service_for_a_while() {
    let begins = |number: u64| 14_000 + 1_357 * number;
    let mut flight = flight_of(&committed("takeoff_and_land"));
    let (mut calm, mut states) = (Flown::new(), Vec::new());
    while flight.next_tick() <= flight.schedule().last_tick() {
        if flight.next_tick() == begins(states.len() as u64) && states.len() < BEGINS {
            states.push((flight.save(), calm.clone()));
        }
        step(&mut flight);
        calm.watch(&flight);
    }
    assert!(!calm.has_fallen());
    for service in ServiceId::ALL {
        for case in &ABSENCES {
            let (mut largest, mut lags, mut upright) = (Vec::new(), Vec::new(), 1.0_f64);
            for (state, before) in &states {
                let mut flown = before.clone();
                flight.restore(state);
                let begin = before.places.len();
                fly_through(&mut flight, &mut flown, service, case);
                assert!(
                    !flown.has_fallen() && flown.phases == calm.phases,
                    "{service} {} at {begin}: {:?}",
                    case.words,
                    flown.phases
                );
                let ticks = (begin..LANDS).step_by(20);
                let way = &calm.places[begin - 1_000..LANDS];
                let strayed = ticks.clone().map(|tick| distance(&flown.places[tick], way));
                largest.push(100.0 * strayed.fold(0.0, f64::max));
                let apart = ticks.map(|tick| (flown.places[tick] - calm.places[tick]).norm());
                lags.push(100.0 * apart.fold(0.0, f64::max));
                upright = upright.min(flown.upright);
            }
            largest.sort_by(f64::total_cmp);
            lags.sort_by(f64::total_cmp);
            let (middle, last) = (BEGINS / 2, BEGINS - 1);
            println!(
                "| {service} | {} | {:.1} | {:.1} | {:.1} | {:.2} |",
                case.words, largest[middle], largest[last], lags[last], upright
            );
            assert!(largest[last] < 15.0, "{service} {}: {largest:?} cm", case.words);
        }
    }
}

/// Number of moments at which each absence begins.
const BEGINS: usize = 7;

/// CPU time of this thread, ns.
fn cpu_ns() -> u64 {
    let text = std::fs::read_to_string("/proc/thread-self/schedstat").unwrap();
    text.split(' ').next().unwrap().parse().unwrap()
}

/// `cargo test --release -p registry --test newest_wins -- --ignored --nocapture`
#[test]
#[ignore = "measures the machine"]
fn ticks_per_second() {
    struct Nothing;

    impl TickSink for Nothing {
        type Error = Infallible;

        fn wants(&self, _: Topic) -> bool {
            false
        }

        fn sample(&mut self, _: Topic, _: &[u8]) -> Result<(), Infallible> {
            Ok(())
        }
    }

    let scenario = committed("fig1").with_real_time_policies();
    for _ in 0..8 {
        let mut flight = flight_of(&scenario);
        let schedule = flight.schedule().clone();
        let begun = cpu_ns();
        step_to(&mut flight, schedule.last_tick() + 1);
        let by_clock = cpu_ns() - begun;
        let last_tick = schedule.last_tick();
        let mut reference = InProcess::new(schedule, build_all(&scenario).unwrap());
        let begun = cpu_ns();
        reference.fly(&mut Nothing).unwrap();
        let in_process = cpu_ns() - begun;
        let rate = |ns: u64| 1e3 * last_tick as f64 / ns as f64;
        println!(
            "{:.2} million ticks a second by the clock, {:.2} in process",
            rate(by_clock),
            rate(in_process)
        );
    }
}
