//! Flights from the ground to the ground whose captures come late, not at all or turned: none falls.
//!
//! A vehicle falls that touches the ground faster than [`FALL`], tips over, or has its motors stopped by the envelope.

use std::convert::Infallible;
use std::ops::ControlFlow;
use std::path::Path;

use host::in_process::{InProcess, TickSink};
use nalgebra::Vector3;
use registry::build_all;
use scenario::Scenario;
use shared_types::rotation::{exp, from_row_major, to_row_major};
use shared_types::samples::{MocapPose, PathReference, RcFrame, VehicleTruth};
use shared_types::service::{ErasedService, InputView, Now, OutputSlot};
use shared_types::{FlightPhase, ServiceId, Topic};
use toml::{Table, Value};
use zerocopy::{FromBytes, IntoBytes};

/// Speed of a touch-down above which the vehicle counts as lost, m/s: 1 m/s above that of the landing.
const FALL: f64 = 1.3;
/// Cosine of the tilt at which the envelope stops the motors, 1 rad.
const UPRIGHT: f64 = 0.54;
/// Tick at which the vehicle has come to the path.
const ON_THE_PATH: u64 = 14_000;
/// Height from which on a touch counts, m.
const LIFTED: f64 = 0.02;

/// The facts about a flight.
#[derive(Clone, Debug)]
struct Flown {
    /// Time of the last touch, ms.
    touched_at: Option<u64>,
    /// Speed of the fastest touch, m/s.
    touch: f64,
    /// Smallest cosine of the tilt.
    upright: f64,
    is_killed: bool,
    /// `true` if the vehicle has been disarmed after it had flown.
    is_over: bool,
    phase: FlightPhase,
    has_lifted: bool,
    sinking: f64,
    /// Place of the reference on the path in {I}, m.
    reference: Option<Vector3<f64>>,
    /// Place in {I} at each tenth of a second, m.
    places: Vec<Vector3<f64>>,
    /// Largest distance from it once the vehicle has come to the path, m.
    strayed: f64,
}

impl Flown {
    fn has_fallen(&self) -> bool {
        self.is_killed || self.touch > FALL || self.upright < UPRIGHT || self.touched_at.is_none()
    }

    /// Horizontal way from where it was at a time (s) to where it came down, m.
    fn way_since(&self, time: f64) -> f64 {
        let from = self.places[(10.0 * time) as usize];
        (self.places[self.places.len() - 1] - from).xy().norm()
    }
}

impl TickSink for Flown {
    type Error = Infallible;

    fn wants(&self, topic: Topic) -> bool {
        matches!(topic, Topic::VehicleTruth | Topic::PathReference | Topic::RcFrame)
    }

    fn sample(&mut self, topic: Topic, bytes: &[u8]) -> Result<(), Infallible> {
        match topic {
            Topic::VehicleTruth => {
                let truth = VehicleTruth::read_from_bytes(bytes).unwrap();
                let (r, [x, y, z]) = (truth.world_from_body, truth.velocity_body);
                let height = -truth.position_world[2];
                if truth.header.tick % 100 == 0 {
                    self.places.push(truth.position_world.into());
                }
                self.upright = self.upright.min(r[8]);
                if let Some(reference) = self.reference
                    && truth.header.tick > ON_THE_PATH
                {
                    let distance = (Vector3::from(truth.position_world) - reference).norm();
                    self.strayed = self.strayed.max(distance);
                }
                self.has_lifted |= height > LIFTED;
                if self.has_lifted && height <= 1e-6 {
                    self.has_lifted = false;
                    self.touched_at = Some(truth.header.tick);
                    self.touch = self.touch.max(self.sinking);
                }
                self.sinking = r[6] * x + r[7] * y + r[8] * z;
            }
            Topic::PathReference => {
                let reference = PathReference::read_from_bytes(bytes).unwrap();
                self.phase = FlightPhase::from_code(reference.phase);
                self.reference =
                    (self.phase == FlightPhase::Fly).then(|| Vector3::from(reference.position_world));
                self.is_over |=
                    self.touched_at.is_some() && !self.has_lifted && self.phase == FlightPhase::Disarmed;
            }
            Topic::RcFrame => {
                let frame = RcFrame::read_from_bytes(bytes).unwrap();
                self.is_killed |= frame.action == RcFrame::ACTION_KILL;
            }
            _ => {}
        }
        Ok(())
    }

    fn end_tick(&mut self, _tick: u64) -> Result<ControlFlow<()>, Infallible> {
        Ok(if self.is_over || self.is_killed || self.upright < UPRIGHT {
            ControlFlow::Break(())
        } else {
            ControlFlow::Continue(())
        })
    }
}

/// Overwrites values of one table by another's, and adds new ones.
fn change(table: &mut Table, changes: Table) {
    for (key, value) in changes {
        match (table.get_mut(&key), value) {
            (Some(Value::Table(old)), Value::Table(new)) => change(old, new),
            (_, new) => drop(table.insert(key, new)),
        }
    }
}

/// Flies `takeoff_and_land.toml` with changes, until it is over.
fn fly(changes: &[&str]) -> Flown {
    fly_with(changes, |service| service)
}

/// Flies it with other services.
fn fly_with(changes: &[&str], other: impl Fn(Box<dyn ErasedService>) -> Box<dyn ErasedService>) -> Flown {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../scenarios/takeoff_and_land.toml");
    let mut table: Table = std::fs::read_to_string(file).unwrap().parse().unwrap();
    for changes in changes {
        change(&mut table, changes.parse().unwrap());
    }
    let scenario: Scenario = table.try_into().unwrap();
    assert_eq!(scenario.problems(), []);
    let mut flown = Flown {
        touched_at: None,
        touch: 0.0,
        upright: 1.0,
        is_killed: false,
        is_over: false,
        phase: FlightPhase::Disarmed,
        has_lifted: false,
        sinking: 0.0,
        reference: None,
        places: Vec::new(),
        strayed: 0.0,
    };
    let services = build_all(&scenario).unwrap().into_iter().map(other);
    let mut host = InProcess::new(scenario.schedule().unwrap(), services.collect());
    host.fly(&mut flown).unwrap();
    flown
}

/// A fault of the captures.
fn captures(at: f64, lasts: f64, kind: &str) -> String {
    format!("fault=[{{at={at:?}, edge=\"mocap/pose -> estimator\", for={lasts:?}, {kind}}}]")
}

/// A time (s) in which nothing comes over an edge.
fn lost(edge: &str, at: f64, lasts: f64) -> String {
    // To the millisecond: whole ticks.
    format!("{{at={at:.3}, edge=\"{edge}\", for={lasts:?}, kind=\"intermittent\", fraction=1.0}}")
}

/// Every law stands behind the same estimator and supervisor.
const LAWS: [&str; 4] = [
    "seed=1",
    "controller.law=\"indi\"",
    "controller.law=\"nmpc\"",
    "controller.law=\"px4\"",
];

/// The vehicle touches the ground at 31.96 s.
#[test]
fn captures_that_come_late_during_the_touch_down_do_not_tip_the_vehicle() {
    for by in ["0.1", "0.15", "0.2"] {
        for at in [31.4, 31.6, 31.8, 32.0, 32.2] {
            let fault = captures(at, 1.0, &format!("kind=\"delay\", by={by}"));
            let flown = fly(&[&fault]);
            assert!(!flown.has_fallen() && flown.is_over, "{fault}: {flown:?}");
        }
    }
}

#[test]
fn no_law_tips_the_vehicle_by_late_captures_during_the_touch_down() {
    for law in LAWS {
        let fault = captures(31.8, 1.0, "kind=\"delay\", by=0.2");
        let flown = fly(&[law, &fault]);
        assert!(!flown.has_fallen() && flown.is_over, "{law}: {flown:?}");
    }
}

#[test]
fn few_captures_during_the_landing_do_not_tip_the_vehicle() {
    for fraction in ["0.9", "0.95", "0.98"] {
        for at in [28.0, 31.0] {
            let fault = captures(at, 6.0, &format!("kind=\"intermittent\", fraction={fraction}"));
            let flown = fly(&[&fault]);
            assert!(!flown.has_fallen() && flown.is_over, "{fault}: {flown:?}");
        }
    }
}

/// Outages of the cameras, from the take-off to the ground.
fn assert_none_falls(durations: &[f64], places: std::ops::Range<u32>, apart: f64) {
    let (mut slow, mut fast) = (0, 0);
    for &lasts in durations {
        for place in places.clone() {
            let at = ((3.2 + apart * f64::from(place)) * 1e3).round() / 1e3;
            let flown = fly(&[&captures(at, lasts, "kind=\"intermittent\", fraction=1.0")]);
            assert!(
                !flown.has_fallen() && flown.is_over,
                "{lasts} s from {at} s: {flown:?}"
            );
            if flown.touch > 0.6 {
                fast += 1;
            } else {
                slow += 1;
            }
        }
    }
    println!("touch-downs up to 0.6 m/s: {slow}, faster: {fast}");
}

#[test]
fn no_outage_of_the_cameras_makes_the_vehicle_fall() {
    assert_none_falls(&[0.6, 2.0, 5.0], 0..5, 5.9);
}

#[test]
#[ignore = "300 flights take minutes"]
fn none_of_three_hundred_outages_of_the_cameras_makes_the_vehicle_fall() {
    let durations = [0.3, 0.6, 0.9, 1.2, 2.0, 3.0, 4.0, 4.5, 5.0, 6.0];
    assert_none_falls(&durations, 0..30, 0.97);
}

/// A vehicle that has landed without sight is turned and lifted by its law, which does not know that the ground holds it, when
/// it is seen again: a moment later the captures or the frames are lost once more.
#[test]
fn outages_around_the_touch_down_do_not_lift_or_tip_a_vehicle_on_the_ground() {
    let (captures, frames) = ("mocap/pose -> estimator", "rc/frame -> plant");
    for (unseen, after) in [
        ((30.269, 1.32), (captures, 31.654, 2.0)),
        ((30.4, 1.2), (frames, 31.644, 0.2)),
        ((30.269, 1.32), (frames, 31.666, 0.2)),
        ((30.269, 2.0), (frames, 32.348, 0.2)),
        ((30.684, 2.63), (frames, 33.39, 0.07)),
    ] {
        let ((at, lasts), (edge, later, short)) = (unseen, after);
        let faults = [lost(captures, at, lasts), lost(edge, later, short)].join(", ");
        let flown = fly(&[&format!("fault=[{faults}]")]);
        assert!(!flown.has_fallen() && flown.is_over, "{faults}: {flown:?}");
        assert!(flown.upright > 0.97, "{faults}: {flown:?}");
    }
}

/// It is met 6 cm above the ground at 1 m/s: the reference that slows it down leads on below the ground.
#[test]
fn a_vehicle_that_is_seen_again_just_before_its_blind_touch_down_is_disarmed_on_the_ground() {
    for lasts in [4.3, 4.4, 4.45, 4.5, 4.55] {
        let flown = fly(&[&captures(23.57, lasts, "kind=\"intermittent\", fraction=1.0")]);
        assert!(!flown.has_fallen() && flown.is_over, "{lasts} s: {flown:?}");
        assert!(flown.upright > 0.8, "{lasts} s: {flown:?}");
    }
}

/// A slow stop that is under way is no reason to keep the speed: the ways to the ground are 0.2 to 0.9 m, and were up to 2.9 m.
#[test]
fn a_landing_that_is_demanded_when_the_cameras_are_lost_comes_down_near() {
    for at in [16.0, 16.7, 17.4, 18.1] {
        let captures = captures(at, 30.0, "kind=\"intermittent\", fraction=1.0");
        let flown = fly(&[&captures, &format!("flight.land_at={at:?}")]);
        assert!(!flown.is_killed && flown.touch < FALL, "{at}: {flown:?}");
        assert!(flown.way_since(at) < 1.2, "{at}: {} m", flown.way_since(at));
    }
}

/// The vehicle turns to stop while it is not seen, and a frame or two of that do not come. What is left of the turn is an
/// unseen tilt: when the path stopped within 0.4 s, these 2.75 s led up to 4.4 m away, and ended at 3 m/s.
#[test]
fn frames_lost_while_the_vehicle_stops_without_sight_do_not_send_it_away() {
    for place in 0..4 {
        let begins = 16.0 + 0.7 * f64::from(place);
        let unseen = lost("mocap/pose -> estimator", begins, 2.75);
        for after in [0.13, 0.16, 0.3] {
            let late = lost("rc/frame -> plant", begins + after, 0.044);
            let faults = format!("fault=[{unseen}, {late}]");
            let flown = fly(&[&faults]);
            assert!(!flown.has_fallen() && flown.is_over, "{faults}: {flown:?}");
            assert!(flown.strayed < 1.5, "{faults}: {flown:?}");
        }
    }
}

/// The controller brings the path to rest meanwhile, and the path generator goes on from there: a path that stopped at once
/// turned the vehicle by 43 degrees.
#[test]
fn a_path_generator_that_is_away_does_not_tilt_the_vehicle() {
    // On the rise, on the way to the path, on the path, while it stops, and in the descent.
    for at in [3.2, 4.0, 5.5, 7.0, 15.0, 16.3, 17.7, 25.3, 26.0, 26.7, 28.5] {
        for away in [0.3, 0.6, 0.75, 1.2, 2.0] {
            let fault = format!("fault=[{}]", frozen(at, away));
            let flown = fly(&[&fault]);
            assert!(!flown.has_fallen() && flown.is_over, "{fault}: {flown:?}");
            assert!(flown.upright > 0.92 && flown.touch < 0.5, "{fault}: {flown:?}");
        }
    }
}

fn frozen(at: f64, away: f64) -> String {
    format!("{{at={at:?}, service=\"path_generator\", kind=\"freeze\", for={away:?}}}")
}

/// A stop without sight that the controller goes on with turns back nowhere.
#[test]
fn a_path_generator_that_is_away_while_it_stops_without_sight_does_not_send_the_vehicle_away() {
    let unseen = lost("mocap/pose -> estimator", 16.0, 2.75);
    for after in [0.15, 0.3, 0.45, 0.6] {
        for away in [0.2, 0.4, 0.7, 1.2] {
            let faults = format!("fault=[{unseen}, {}]", frozen(16.0 + after, away));
            let flown = fly(&[&faults]);
            assert!(!flown.has_fallen() && flown.is_over, "{faults}: {flown:?}");
            assert!(flown.strayed < 1.5, "{faults}: {flown:?}");
        }
    }
}

/// The state is predicted by the commands since, which change several times in that time.
#[test]
fn states_that_come_late_but_not_too_late_for_the_law_do_not_tip_the_vehicle() {
    for by in [0.05, 0.11, 0.13, 0.15, 0.18] {
        for at in [6.0, 20.0] {
            let late = format!(
                "fault = [{{ at = {at:?}, edge = \"vehicle/state -> controller\", for = 1.0, kind = \"delay\", by = {by:?} }}]"
            );
            let flown = fly(&[&late]);
            assert!(!flown.has_fallen(), "by {by} s at {at} s: {flown:?}");
        }
    }
}

/// What the path generator sees, the controller does not follow.
#[test]
fn a_descent_does_not_run_away_from_a_vehicle_that_does_not_follow_it() {
    for edge in ["path/reference -> controller", "vehicle/state -> controller"] {
        for (at, lasts) in [(29.0, 3.0), (29.0, 4.0), (30.5, 3.0), (31.9, 1.5), (31.9, 2.0)] {
            let flown = fly(&[&format!("fault=[{}]", lost(edge, at, lasts))]);
            assert!(!flown.has_fallen(), "{edge} from {at} s for {lasts} s: {flown:?}");
        }
    }
}

#[test]
fn a_landing_comes_down_although_its_path_generator_is_gone() {
    for at in [12.0, 27.9] {
        let flown = fly(&[&format!("fault=[{}]", frozen(at, 40.0 - at))]);
        assert!(
            flown.touch < FALL && flown.touched_at.is_some(),
            "from {at} s: {flown:?}"
        );
        assert!(
            flown.upright > UPRIGHT && !flown.is_killed,
            "from {at} s: {flown:?}"
        );
    }
}

/// A law that estimates nothing and believes in a mass that is too large, so in a thrust that is too large.
#[test]
fn a_blind_vehicle_goes_down_although_its_thrust_is_believed_too_large() {
    for mass in ["0.18", "0.185", "0.195"] {
        let outage = captures(20.0, 20.0, "kind=\"intermittent\", fraction=1.0");
        let mass = format!("vehicle.mass={mass}");
        let flown = fly(&["controller.law=\"px4\"", &mass, &outage]);
        assert!(!flown.has_fallen(), "{mass}: {flown:?}");
    }
}

/// An estimator to which the cameras show something else for a time.
struct Deceived {
    estimator: Box<dyn ErasedService>,
    deception: Deception,
}

/// What cameras show from [`DECEIVED`] on.
#[derive(Clone, Copy)]
struct Deception {
    /// Ticks for which they show it.
    lasts: u64,
    /// Ticks at its begin and after its end in which the driver refuses poses.
    settles: u64,
    shown: fn(&MocapPose, &Vector3<f64>) -> MocapPose,
    /// Parameter of what is shown.
    by: Vector3<f64>,
}

/// Tick from which cameras show something else.
const DECEIVED: u64 = 15_000;

impl ErasedService for Deceived {
    fn id(&self) -> ServiceId {
        self.estimator.id()
    }

    fn step(&mut self, now: &Now, inputs: &[InputView<'_>], outputs: &mut [OutputSlot<'_>]) {
        let (mut inputs, deception) = (inputs.to_vec(), self.deception);
        let end = DECEIVED + deception.lasts;
        let settles = [DECEIVED, end].map(|at| at..at + deception.settles);
        let mut shown = None;
        if settles.iter().any(|ticks| ticks.contains(&now.tick)) {
            inputs[0] = InputView::default();
        } else if (DECEIVED..end).contains(&now.tick) {
            let pose = inputs[0]
                .bytes
                .map(|bytes| MocapPose::read_from_bytes(bytes).unwrap());
            shown = pose.map(|pose| (deception.shown)(&pose, &deception.by));
        }
        if let Some(pose) = &shown {
            inputs[0].bytes = Some(pose.as_bytes());
        }
        self.estimator.step(now, &inputs, outputs);
    }

    fn state_size(&self) -> usize {
        self.estimator.state_size()
    }

    fn save_with(&self, keep: &mut dyn FnMut(&[u8])) {
        self.estimator.save_with(keep);
    }

    fn restore(&mut self, bytes: &[u8]) {
        self.estimator.restore(bytes);
    }
}

fn fly_deceived(changes: &[&str], deception: Deception) -> Flown {
    fly_with(changes, |service| match service.id() {
        ServiceId::Estimator => Box::new(Deceived {
            estimator: service,
            deception,
        }),
        _ => service,
    })
}

/// A body whose markers are confused: it turns about their centre, which is off the tracked point along x and z of {B}.
fn confused(pose: &MocapPose, turn: &Vector3<f64>, off: f64) -> MocapPose {
    let (rotation, turn, center) = (
        from_row_major(&pose.world_from_body),
        exp(turn),
        Vector3::new(off, 0.0, off),
    );
    MocapPose {
        position_world: (Vector3::from(pose.position_world) + rotation * (center - turn * center)).into(),
        world_from_body: to_row_major(&(rotation * turn)),
        ..*pose
    }
}

const GUSTS: &str =
    "vehicle={drag=[0.06,0.06,0.02],wind={mean=[3.0,0.0,0.0],gusts={deviation=1.2,correlation_time=0.5}}}";

/// The driver refuses jumps for 0.3 s, or knows at once that only the position is right.
#[test]
fn a_body_whose_markers_are_confused_flies_and_lands_by_its_positions() {
    type Shown = fn(&MocapPose, &Vector3<f64>) -> MocapPose;
    let cases: [(u64, u64, f64, Shown); 4] = [
        (2_000, 300, 0.0, |pose, turn| confused(pose, turn, 0.0)),
        (8_000, 300, 0.02, |pose, turn| confused(pose, turn, 0.02)),
        (30_000, 300, 0.01, |pose, turn| confused(pose, turn, 0.01)),
        (2_000, 0, 0.0, |pose, turn| {
            let mut shown = confused(pose, turn, 0.0);
            shown.set_parts(true, false);
            shown
        }),
    ];
    let turns = [
        Vector3::x() * 0.6,
        Vector3::z() * 1.6,
        Vector3::new(1.9, 1.9, 0.0),
    ];
    for change in [LAWS[0], LAWS[1], GUSTS] {
        for by in turns {
            for (lasts, settles, off, shown) in cases {
                let deception = Deception {
                    lasts,
                    settles,
                    shown,
                    by,
                };
                assert_flies_on(&[change], deception, 0.15 + 5.0 * off);
            }
        }
    }
}

fn assert_flies_on(changes: &[&str], deception: Deception, farthest: f64) {
    let flown = fly_deceived(changes, deception);
    let (by, lasts) = (deception.by, deception.lasts);
    let what = format!("{changes:?}, {by:?} for {lasts} ms: {flown:?}");
    assert!(!flown.has_fallen() && flown.is_over, "{what}");
    assert!(flown.strayed < farthest && flown.touch < 0.5, "{what}");
}

/// A turn of 30 degrees against which gusts turn the estimate comes near to what the vehicle could have reached.
#[test]
fn positions_do_not_bring_a_false_attitude_within_reach() {
    for law in ["controller={law=\"nmpc\"}", "controller={law=\"indi\"}"] {
        for turn in [Vector3::x(), Vector3::y()] {
            for by in [turn * 0.53, turn * -0.53] {
                let deception = Deception {
                    lasts: 30_000,
                    settles: 300,
                    shown: |pose, turn| confused(pose, turn, 0.0),
                    by,
                };
                assert_flies_on(&[GUSTS, law], deception, 0.5);
            }
        }
    }
}

/// The centre of the markers is 3 cm off the tracked point; fast cameras correct no faster than slow ones.
#[test]
fn a_turned_offset_does_not_make_the_vehicle_sway() {
    for period in ["0.005", "0.01", "0.02"] {
        let cameras = format!("schedule={{period={{\"mocap/pose\"={period}}}}}");
        for by in [
            Vector3::new(1.9, 1.9, 0.0),
            Vector3::x() * 3.1,
            Vector3::y() * -1.6,
        ] {
            let deception = Deception {
                lasts: 30_000,
                settles: 300,
                shown: |pose, turn| confused(pose, turn, 0.02),
                by,
            };
            let flown = fly_deceived(&[&cameras], deception);
            let what = format!("{period} s, {by:?}: {flown:?}");
            assert!(
                !flown.has_fallen() && flown.is_over && flown.upright > 0.7,
                "{what}"
            );
        }
    }
}

/// With its tilt known, the vehicle waits where it is until the cameras show its place again.
#[test]
fn a_body_whose_position_is_frozen_waits_level() {
    for change in LAWS.into_iter().chain([GUSTS, "vehicle={mass=0.24}"]) {
        for lasts in [500, 1_500, 2_800] {
            let shown = |pose: &MocapPose, place: &Vector3<f64>| {
                let mut shown = MocapPose {
                    position_world: (*place).into(),
                    ..*pose
                };
                shown.set_parts(false, true);
                shown
            };
            let by = Vector3::new(1.0, 1.0, -1.0);
            let flown = fly_deceived(
                &[change],
                Deception {
                    lasts,
                    settles: 0,
                    shown,
                    by,
                },
            );
            let what = format!("{change}, frozen for {lasts} ms: {flown:?}");

            assert!(!flown.has_fallen() && flown.is_over, "{what}");
            assert!(flown.strayed < 1.0 && flown.touch < 0.4, "{what}");
        }
    }
}
