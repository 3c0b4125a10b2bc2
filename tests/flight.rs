//! Flights from the ground to the ground, and what the transmitter does about a controller that misbehaves.

use crate::common;

use std::convert::Infallible;

use common::{Place, output, scenario, succeed};
use flight::interrupt::Interrupt;
use flight::{Outcome, in_process};
use host::in_process::TickSink;
use shared_types::samples::{ControlAdaptation, PathReference, RcFrame, VehicleState, VehicleTruth};
use shared_types::{FlightPhase, Topic};
use zerocopy::FromBytes;

/// Thrust and rates that the envelope of `takeoff_and_land.toml` lets through, and a step of each channel.
const MOST_THRUST: (f64, f64) = (4.5, 2.0 * 3.138 / 2047.0);
const MOST_RATES: [(f64, f64); 3] = [(12.0, 0.019), (12.0, 0.019), (6.0, 0.008)];

/// All that is to be known of a flight.
#[derive(Default)]
struct Flight {
    /// Phases, each with the time of its first reference in ms.
    phases: Vec<(FlightPhase, u64)>,
    truths: Vec<VehicleTruth>,
    states: Vec<VehicleState>,
    references: Vec<PathReference>,
    adaptations: Vec<ControlAdaptation>,
    frames: Vec<RcFrame>,
}

impl TickSink for Flight {
    type Error = Infallible;

    fn sample(&mut self, topic: Topic, bytes: &[u8]) -> Result<(), Infallible> {
        match topic {
            Topic::VehicleTruth => self.truths.push(VehicleTruth::read_from_bytes(bytes).unwrap()),
            Topic::VehicleState => self.states.push(VehicleState::read_from_bytes(bytes).unwrap()),
            Topic::PathReference => {
                let reference = PathReference::read_from_bytes(bytes).unwrap();
                let phase = FlightPhase::from_code(reference.phase);
                if self.phases.last().map(|(last, _)| *last) != Some(phase) {
                    self.phases.push((phase, reference.header.stamp_ns / 1_000_000));
                }
                self.references.push(reference);
            }
            Topic::ControlAdaptation => {
                let adaptation = ControlAdaptation::read_from_bytes(bytes).unwrap();
                self.adaptations.push(adaptation);
            }
            Topic::RcFrame => self.frames.push(RcFrame::read_from_bytes(bytes).unwrap()),
            _ => {}
        }
        Ok(())
    }
}

/// The laboratory's rig.
const RIG: &str = "takeoff_and_land";
/// The ideal flight of Fig. 1 with phases and an envelope.
const IDEAL: [&str; 5] = [
    "vehicle.initial={position = [0.5, 0.4, 0.0]}",
    "vehicle.change=[]",
    "duration=40.0",
    "flight={arm_at = 1.0, land_at = 25.0}",
    "envelope={tilt = {max = 1.2, action = \"kill\"}, estimate = {position_sigma = 0.05, action = \"warn\"}}",
];

fn fly(name: &str, settings: &[&str]) -> Flight {
    let settings: Vec<_> = settings.iter().map(|&setting| setting.to_owned()).collect();
    let scenario = scenario_file::load(&scenario(name), &settings, None).unwrap();
    let mut flight = Flight::default();
    let ending = in_process::fly(&scenario, &mut flight, &Interrupt::never()).unwrap();
    assert!(
        matches!(ending.outcome, Outcome::Completed),
        "{name} {settings:?}"
    );
    flight
}

impl Flight {
    /// Returns when a phase began first, ms.
    fn begin(&self, phase: FlightPhase) -> u64 {
        let begun = self.phases.iter().find(|(other, _)| *other == phase);
        begun
            .unwrap_or_else(|| panic!("no {phase:?} in {:?}", self.phases))
            .1
    }

    fn order(&self) -> Vec<FlightPhase> {
        self.phases.iter().map(|(phase, _)| *phase).collect()
    }

    fn truth(&self, millisecond: u64) -> &VehicleTruth {
        &self.truths[usize::try_from(millisecond).unwrap()]
    }

    fn highest(&self) -> f64 {
        self.truths
            .iter()
            .fold(0.0, |most, truth| most.max(-truth.position_world[2]))
    }

    /// Returns what acted on the vehicle in the last frame that did anything.
    fn last_deed(&self) -> (u8, u8) {
        let deed = self
            .frames
            .iter()
            .rfind(|frame| frame.action != RcFrame::ACTION_NONE);
        deed.map_or((0, 0), |frame| (frame.limit, frame.action))
    }

    fn rests_on_the_ground_at_the_end(&self) -> bool {
        let truth = self.truths.last().unwrap();
        truth.position_world[2] == 0.0
            && truth.velocity_body == [0.0; 3]
            && self.frames.last().unwrap().failsafe.is_set()
    }

    fn assert_frames_are_within_the_limits(&self) {
        for frame in &self.frames {
            let within = |value: f64, (most, step): (f64, f64)| value.abs() <= most + step;
            assert!(
                frame.thrust >= 0.0 && within(frame.thrust, MOST_THRUST),
                "{frame:?}"
            );
            for (rate, most) in frame.rates_body.iter().zip(MOST_RATES) {
                assert!(within(*rate, most), "{frame:?}");
            }
        }
    }
}

fn horizontal_distance(a: &[f64; 3], b: &[f64; 3]) -> f64 {
    ((a[0] - b[0]) * (a[0] - b[0]) + (a[1] - b[1]) * (a[1] - b[1])).sqrt()
}

/// All phases once, in their order.
const WHOLE: [FlightPhase; 6] = [
    FlightPhase::Disarmed,
    FlightPhase::Armed,
    FlightPhase::TakeOff,
    FlightPhase::Fly,
    FlightPhase::Land,
    FlightPhase::Disarmed,
];

fn assert_whole_flight(name: &str, settings: &[&str], near: f64) {
    let flight = fly(name, settings);
    assert_eq!(flight.order(), WHOLE, "{name}");
    assert_eq!(
        flight.last_deed(),
        (RcFrame::LIMIT_NONE, RcFrame::ACTION_NONE),
        "{name}"
    );
    let disarmed = flight.phases.last().unwrap().1;

    // On the ground it neither moves nor learns, and the motors rest.
    let start = flight.truths[0];
    for truth in &flight.truths[..usize::try_from(flight.begin(FlightPhase::TakeOff)).unwrap()] {
        assert_eq!(truth.position_world, start.position_world, "{name}");
        assert!(
            truth.thrust <= MOST_THRUST.1,
            "{name}: {} N while the motors idle",
            truth.thrust
        );
    }
    for frame in &flight.frames {
        let at = frame.header.stamp_ns / 1_000_000;
        let is_disarmed = at < flight.begin(FlightPhase::Armed) || at > disarmed + 50;
        assert!(
            !is_disarmed || frame.failsafe.is_set() && frame.thrust == 0.0,
            "{name} at {at} ms"
        );
    }
    for pair in flight.adaptations.windows(2) {
        let at = pair[0].header.tick;
        let reference = flight
            .references
            .iter()
            .rfind(|reference| reference.header.tick <= at);
        if reference.is_none_or(|reference| !reference.airborne.is_set()) {
            assert!(pair[0].resting.is_set(), "{name} at {at} ms");
            assert_eq!(pair[0].eta_hat, pair[1].eta_hat, "{name} at {at} ms");
        }
    }
    assert!(
        flight
            .adaptations
            .iter()
            .any(|adaptation| !adaptation.resting.is_set())
    );

    // It comes down where the path stood still, softly, and stays.
    let end = flight.truths.last().unwrap();
    assert!(flight.rests_on_the_ground_at_the_end(), "{name}: {end:?}");
    let landing = flight
        .references
        .iter()
        .rfind(|reference| reference.phase == PathReference::PHASE_LAND);
    let landing = landing.unwrap();
    let missed = horizontal_distance(&end.position_world, &landing.position_world);
    assert!(missed < near, "{name}: {missed} m beside its place");
    let touched = flight
        .truths
        .iter()
        .rposition(|truth| truth.velocity_body != [0.0; 3])
        .unwrap();
    let sinks = flight.truths[touched].velocity_body[2];
    assert!((0.0..0.6).contains(&sinks), "{name}: touches down at {sinks} m/s");
    assert!(
        disarmed - touched as u64 <= 1500,
        "{name}: {touched} to {disarmed}"
    );
    assert!(end.thrust < 1e-6);

    // On the path it is where it is in a flight that begins there.
    let settled = flight.begin(FlightPhase::Fly) + 6000;
    let flown = flight
        .references
        .iter()
        .filter(|reference| reference.phase == PathReference::PHASE_FLY && reference.header.tick >= settled);
    for reference in flown {
        let truth = flight.truth(reference.reference_time_ns / 1_000_000);
        let pairs = truth.position_world.iter().zip(reference.position_world);
        let distance = pairs.map(|(p, pd)| (p - pd) * (p - pd)).sum::<f64>().sqrt();
        assert!(
            distance < 0.06,
            "{name}: {distance} m from the path at {} ms",
            reference.header.tick
        );
    }
}

#[test]
fn the_rig_takes_off_flies_the_eight_and_lands() {
    assert_whole_flight(RIG, &[], 0.05);
}

#[test]
fn a_vehicle_that_lies_on_its_side_does_not_arm() {
    // 62° about x.
    let lying = "vehicle.initial.roll_pitch_yaw=[1.0821, 0.0, 0.0]";
    let flight = fly(RIG, &[lying]);
    assert_eq!(flight.order(), [FlightPhase::Disarmed]);
    assert_eq!(
        flight.references.last().unwrap().cause,
        PathReference::CAUSE_NOT_READY_LEVEL
    );
    assert!(flight.frames.iter().all(|frame| frame.failsafe.is_set()));
}

/// A marker is hidden while the motors idle, and found again 15 s later.
#[test]
fn a_vehicle_that_was_not_ready_does_not_take_off_by_itself_later() {
    let flight = fly(RIG, &["cameras.occlusion=[{at=2.5, lasts=15.0}]"]);
    assert_eq!(
        flight.order(),
        [FlightPhase::Disarmed, FlightPhase::Armed, FlightPhase::Disarmed]
    );
    let (_, disarmed_at) = flight.phases[2];
    assert!((2500..2600).contains(&disarmed_at), "{disarmed_at} ms");
    assert_eq!(
        flight.references.last().unwrap().cause,
        PathReference::CAUSE_NOT_READY_SIGHT
    );
    assert_eq!(flight.highest(), 0.0);
    let after = flight
        .frames
        .iter()
        .filter(|frame| frame.header.tick > disarmed_at + 50);
    assert!(after.clone().count() > 1000 && after.clone().all(|frame| frame.failsafe.is_set()));
}

/// The request to arm comes while a marker is hidden.
#[test]
fn a_planned_request_to_arm_waits_half_a_second_and_no_longer() {
    for (found_at, expected) in [(2.4, WHOLE.as_slice()), (2.7, &WHOLE[..1])] {
        let occlusion = format!("cameras.occlusion=[{{at=1.0, lasts={:?}}}]", found_at - 1.0);
        let flight = fly(RIG, &[&occlusion]);
        assert_eq!(flight.order(), expected, "found at {found_at} s");
    }
}

#[test]
fn the_ideal_vehicle_takes_off_flies_the_eight_and_lands() {
    assert_whole_flight("fig1", &IDEAL, 0.05);
}

#[test]
fn a_heavier_vehicle_than_believed_takes_off_and_lands_too() {
    let heavier = [IDEAL.as_slice(), &["vehicle.mass=0.25"]].concat();
    let flight = fly("fig1", &heavier);
    assert_eq!(flight.order(), WHOLE);
    assert!(flight.rests_on_the_ground_at_the_end());
}

fn distance(a: &[f64; 3], b: &[f64; 3]) -> f64 {
    a.iter()
        .zip(b)
        .map(|(a, b)| (a - b) * (a - b))
        .sum::<f64>()
        .sqrt()
}

/// The ground's support until then is no disturbance.
#[test]
fn at_every_speed_of_take_off_the_vehicle_is_known_and_led_from_the_first_moment() {
    for speed in [0.2, 0.4, 0.8, 1.5] {
        for mass in [0.15, 0.19, 0.24] {
            let settings = [
                format!("flight.takeoff_speed={speed:?}"),
                format!("vehicle.mass={mass:?}"),
                "flight.land_at=29.0".to_owned(),
                "duration=30.0".to_owned(),
            ];
            let flight = fly(RIG, &settings.each_ref().map(String::as_str));
            let [begins, ends] =
                [FlightPhase::TakeOff, FlightPhase::Fly].map(|phase| 1_000_000 * flight.begin(phase));
            let from_truth = |time_ns: u64, position: &[f64; 3]| {
                distance(position, &flight.truth(time_ns / 1_000_000).position_world)
            };
            let known = flight.states.iter().filter(|state| state.tracked.is_set());
            let known = known
                .map(|state| (state.state_time_ns, &state.position_world))
                .filter(|(time_ns, _)| *time_ns < ends)
                .map(|(time_ns, position)| from_truth(time_ns, position))
                .fold(0.0, f64::max);
            let led = flight.references.iter();
            let led = led
                .map(|reference| (reference.header.stamp_ns, &reference.position_world))
                .filter(|(time_ns, _)| (begins..ends).contains(time_ns))
                .map(|(time_ns, position)| from_truth(time_ns, position))
                .fold(0.0, f64::max);
            assert!(
                known < 0.003 && led < 0.12,
                "{speed} m/s, {mass} kg: {known:.4} m, {led:.4} m"
            );
        }
    }
}

#[test]
fn a_kill_in_the_air_stops_the_motors_for_ever() {
    let flight = fly(RIG, &["flight.kill_at=18.0"]);
    assert_eq!(flight.order().last(), Some(&FlightPhase::Disarmed));
    let after = flight
        .frames
        .iter()
        .filter(|frame| frame.header.stamp_ns >= 18_000_000_000);
    for frame in after {
        assert!(frame.failsafe.is_set());
        assert_eq!(
            (frame.limit, frame.action),
            (RcFrame::LIMIT_NONE, RcFrame::ACTION_KILL)
        );
    }
    assert!(flight.rests_on_the_ground_at_the_end());
}

#[test]
fn a_vehicle_that_leaves_the_box_lands_without_being_asked() {
    let flight = fly(RIG, &["envelope.box.max=[0.5, 2.0, 0.5]", "flight.land_at=39.0"]);
    assert_eq!(flight.order(), WHOLE);
    assert!(flight.begin(FlightPhase::Land) < 20_000, "{:?}", flight.phases);
    assert_eq!(flight.last_deed(), (RcFrame::LIMIT_BOX, RcFrame::ACTION_LAND));
    assert!(flight.rests_on_the_ground_at_the_end());
}

/// A fault of what the transmitter hears from the controller, from 15 s on.
fn misheard(what: &str) -> String {
    format!("fault=[{{at = 15.004, edge = \"control/command -> rc_output\", {what}}}]")
}

/// Cosine of the largest tilt on the way back, 0.7 rad: the envelope stops the motors at 1.0 rad.
const LED_BACK: f64 = 0.765;

#[test]
fn a_vehicle_that_the_cameras_lose_for_seconds_is_led_back_from_where_it_is_seen_again() {
    let mut strayed = 0;
    // The last one begins just before the landing is demanded.
    for at in [14.0, 16.7, 19.9, 21.2, 24.8] {
        for lasts in [0.6, 0.9, 1.2, 2.0, 2.7, 3.5] {
            let edge = "mocap/pose -> estimator";
            let outage = format!(
                "fault=[{{at={at:?}, edge=\"{edge}\", kind=\"intermittent\", fraction=1.0, for={lasts:?}}}]"
            );
            let flight = fly(RIG, &[&outage]);
            let kills = flight
                .frames
                .iter()
                .any(|frame| frame.action == RcFrame::ACTION_KILL);
            assert!(!kills, "{outage}");
            assert!(flight.rests_on_the_ground_at_the_end(), "{outage}");
            let mut upright = flight.truths.iter().map(|truth| truth.world_from_body[8]);
            assert!(upright.all(|cosine| cosine > LED_BACK), "{outage}");
            let backwards = flight
                .references
                .iter()
                .find(|reference| reference.gamma_dot < -1e-9);
            assert!(backwards.is_none(), "{outage}: {backwards:?}");
            let cause = PathReference::CAUSE_STRAYED;
            strayed += usize::from(flight.references.iter().any(|reference| reference.cause == cause));
        }
    }
    assert!(strayed >= 5, "{strayed}");
}

#[test]
fn a_controller_that_misbehaves_never_gets_past_the_limits_and_the_vehicle_ends_on_the_ground() {
    for (words, what, deed) in [
        (
            "full thrust",
            "kind = \"wrong\", field = \"thrust\", bias = 50.0",
            RcFrame::ACTION_KILL,
        ),
        (
            "spin",
            "kind = \"wrong\", field = \"rates_body.0\", bias = 30.0",
            RcFrame::ACTION_KILL,
        ),
        (
            "spin about all axes",
            "kind = \"wrong\", field = \"rates_body\", scale = -50.0",
            RcFrame::ACTION_KILL,
        ),
        (
            "numbers of any size",
            "kind = \"garbage\", range = 100.0",
            RcFrame::ACTION_KILL,
        ),
        ("always the same", "kind = \"stuck\"", RcFrame::ACTION_NONE),
        (
            "any bits, NaN among them",
            "kind = \"garbage\"",
            RcFrame::ACTION_NONE,
        ),
        (
            "silence",
            "kind = \"intermittent\", fraction = 1.0",
            RcFrame::ACTION_NONE,
        ),
    ] {
        let flight = fly(RIG, &[&misheard(what)]);
        flight.assert_frames_are_within_the_limits();
        assert!(
            flight.rests_on_the_ground_at_the_end(),
            "{words}: {:?}",
            flight.truths.last()
        );
        assert!(flight.highest() < 8.0, "{words}: {} m", flight.highest());
        let (_, action) = flight.last_deed();
        assert!(
            deed == RcFrame::ACTION_NONE || action == deed,
            "{words}: {:?}",
            flight.last_deed()
        );
    }
}

#[test]
fn a_limit_of_thrust_with_kill_ends_full_thrust_at_once() {
    let fault = misheard("kind = \"wrong\", field = \"thrust\", bias = 50.0");
    let flight = fly(RIG, &[&fault, "envelope.thrust.action=kill"]);
    let acting = flight
        .frames
        .iter()
        .find(|frame| frame.action == RcFrame::ACTION_KILL)
        .unwrap();
    assert_eq!(acting.limit, RcFrame::LIMIT_THRUST);
    let late = acting.header.stamp_ns - 15_004_000_000;
    assert!(late <= 100_000_000, "{late} ns");
}

#[test]
fn each_service_that_dies_in_the_air_and_forgets_all_is_flown_with_again_and_lands() {
    for (service, lasts) in [
        ("rc_output", 0.1),
        ("path_generator", 0.2),
        ("controller", 0.1),
        ("estimator", 0.1),
    ] {
        let fault = format!(
            "fault=[{{at = 15.004, service = \"{service}\", kind = \"off\", for = {lasts}, state = \"cold\"}}]"
        );
        let flight = fly(RIG, &[&fault, "envelope.speed.max=9.0"]);
        assert_eq!(
            flight.order().last(),
            Some(&FlightPhase::Disarmed),
            "{service}: {:?}",
            flight.phases
        );
        assert!(
            flight.begin(FlightPhase::Land) >= 25_000,
            "{service}: {:?}",
            flight.phases
        );
        assert!(flight.rests_on_the_ground_at_the_end(), "{service}");
    }
}

/// A flight of all phases in nine seconds.
const SHORT: [&str; 6] = [
    "duration=9.0",
    "flight={arm_at = 0.3, land_at = 5.0, spool_up = 0.1, takeoff_height = 0.4, takeoff_speed = 2.0, \
     transition_time = 0.5, landing_speed = 0.8}",
    "path.curve={hover = {position = [0.3, 0.2, -0.6]}}",
    "vehicle.turbulence={deviation = 0.05, correlation_time = 1.0}",
    "envelope.box.max=[0.6, 2.0, 0.5]",
    "safety.\"rc/frame -> path_generator\".max_age=0.1",
];

#[test]
fn six_processes_and_one_write_the_same_bytes_of_a_flight_with_phases_also_when_services_die() {
    let place = Place::new();
    let file = scenario(RIG);
    let fly = |out: &str, more: &[&str]| {
        let mut arguments = vec!["run", file.to_str().unwrap(), "--out", out];
        arguments.extend(SHORT.iter().flat_map(|setting| ["--set", setting]));
        arguments.extend(more);
        succeed(&mut place.gerono(&arguments));
        std::fs::read(place.path(out).join("run.mcap")).unwrap()
    };
    let alone = fly("in-process", &["--host", "inprocess"]);
    assert!(fly("processes", &[]) == alone);
    // In take-off, on the path, on its way down.
    let crashes: Vec<_> = [
        "rc_output@1012:after-step",
        "path_generator@1034:before-step",
        "path_generator@4004:after-step",
        "rc_output@5390:before-step",
        "controller@5412:after-step",
    ]
    .iter()
    .flat_map(|crash| ["--crash", crash])
    .collect();
    assert!(fly("dying", &crashes) == alone);
    let summary = std::fs::read_to_string(place.path("dying").join("summary.json")).unwrap();
    for phase in FlightPhase::ALL {
        assert!(
            summary.contains(&format!("\"phase\": \"{}\"", phase.name())),
            "{summary}"
        );
    }
    assert_eq!(place.leftovers(), Vec::<String>::new());
}

#[test]
fn a_simulated_flight_that_nobody_arms_is_refused_with_the_way_out() {
    let place = Place::new();
    let fig1 = scenario("fig1");
    for host in ["inprocess", "lockstep"] {
        let arguments = [
            "run",
            fig1.to_str().unwrap(),
            "--host",
            host,
            "--out",
            "out",
            "--set",
            "flight={}",
        ];
        let refused = output(&mut place.gerono(&arguments));
        assert_eq!(refused.status.code(), Some(2), "{refused:?}");
        let told = String::from_utf8_lossy(&refused.stderr).into_owned();
        assert!(
            told.contains("flight.arm_at") && told.contains("arm_at = 1.0"),
            "{told}"
        );
        assert!(!place.path("out").exists(), "nothing is begun");
    }
}

#[test]
fn options_that_would_do_nothing_are_refused_before_anything_is_begun() {
    let place = Place::new();
    let fig1 = scenario("fig1");
    let cases: [(&[&str], &str); 3] = [
        (
            &["--host", "inprocess", "--core", "1"],
            "--core applies to processes",
        ),
        (
            &["--host", "inprocess", "--crash", "controller@5:before-step"],
            "--crash applies to processes",
        ),
        (
            &[
                "--set",
                "vehicle.change=[]",
                "--set",
                "duration=2",
                "--crash",
                "controller@2001:before-step",
            ],
            "--crash controller@2001: the last tick of the flight is 2000",
        ),
    ];
    for (options, reason) in cases {
        let arguments = [&["run", fig1.to_str().unwrap(), "--out", "out"], options].concat();
        let refused = output(&mut place.gerono(&arguments));
        let told = String::from_utf8_lossy(&refused.stderr).into_owned();
        assert_eq!(
            (refused.status.code(), told.contains(reason)),
            (Some(2), true),
            "{told}"
        );
        assert!(!place.path("out").exists());
    }
}
