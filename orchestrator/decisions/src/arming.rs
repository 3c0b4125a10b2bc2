//! Why a vehicle may not be armed now.

use std::path::Path;

use hand_test::record::HandTestRecord;
use metrics::summary::{limit_in_words, not_level_in_words};
use scenario::Scenario;
use shared_types::ServiceId;
use shared_types::flight_phase::{FlightPhase, GROUNDED_AFTER, NotReady, ReadyLimits};
use shared_types::gnss::FixKind;
use shared_types::rotation::tilt;
use shared_types::samples::{RcFrame, VehicleState};
use shared_types::service::{Operator, nanoseconds, seconds};

use crate::shutdown::Shutdown;

/// Maximum age of the vehicle's state for arming, s.
const STALE: f64 = 0.1;

/// Distance from `vehicle.initial.position` that is permitted with real receivers, m: horizontally, and vertically without the errors of
/// the fixes.
const OFF_THE_PLACE: [f64; 2] = [10.0, 3.0];
/// Number of standard deviations of a fix's height that are permitted besides.
const DEVIATIONS: f64 = 3.0;

/// What is known when the operator asks to arm.
#[derive(Debug)]
pub struct Situation<'a> {
    /// Earlier requests.
    pub operator: Operator,
    pub shutdown: Shutdown,
    /// Time until the end of `duration`, s; `None` if the world ends with the flight, as a simulated one does.
    pub time_left: Option<f64>,
    /// Time of the flight, ns.
    pub elapsed_ns: u64,
    pub phase: Option<FlightPhase>,
    /// Newest samples.
    pub frame: Option<&'a RcFrame>,
    pub state: Option<&'a VehicleState>,
    /// A service that does not fly.
    pub missing: Option<ServiceId>,
    /// Reason for which the kill switch is lost, if it is.
    pub kill_switch: Option<&'a str>,
    /// Failure of the radio link or of the cameras, if there is one.
    pub laboratory: Option<String>,
    /// The hand test that the scenario names, or why there is none.
    pub hand_test: Option<Result<&'a HandTestRecord, &'a str>>,
}

/// Returns why the vehicle may not be armed, if so.
#[must_use]
pub fn refusal(scenario: &Scenario, now: &Situation<'_>) -> Option<String> {
    let Some(phases) = &scenario.flight else {
        return Some("the scenario has no phases (`[flight]`), the vehicle flies from the start".to_owned());
    };
    end_of_arming(now)
        .or_else(|| too_late(phases.shortest_time(), now.time_left?))
        .or_else(|| Some(format!("`{}` does not fly", now.missing?)))
        .or_else(|| Some(format!("the kill switch is lost: {}", now.kill_switch?)))
        .or_else(|| now.laboratory.clone())
        .or_else(|| untested(scenario, now.hand_test))
        .or_else(|| unfit_state(scenario, now))
}

/// Returns why arming can have no effect, if so: the request would be used up at once.
fn end_of_arming(now: &Situation<'_>) -> Option<String> {
    if now.operator.killed {
        return Some("a kill stopped the motors for the rest of the run; start another run".to_owned());
    }
    if now.operator.land || now.shutdown != Shutdown::None {
        return Some(
            "a landing was requested, which holds until the end of the run; start another run".to_owned(),
        );
    }
    let phase = now.phase?;
    if phase != FlightPhase::Disarmed {
        let phase = phase.name();
        return Some(format!("the vehicle is armed already, in the phase `{phase}`"));
    }
    let frame = now.frame?;
    let limit = || limit_in_words(frame.limit);
    match frame.action {
        RcFrame::ACTION_KILL => Some(format!(
            "{}, and a kill stopped the motors for the rest of the run; start another run",
            limit()
        )),
        RcFrame::ACTION_LAND => Some(format!(
            "{}, and the demand to land lasts until the motors have rested for {GROUNDED_AFTER} s",
            limit()
        )),
        _ => None,
    }
}

/// Returns why the hand test that a scenario names will not permit to arm, if so: reads its file.
#[must_use]
pub fn without_hand_test(scenario: &Scenario) -> Option<String> {
    let file = scenario.flight.as_ref()?.hand_test.as_deref()?;
    let read = HandTestRecord::read(Path::new(file));
    untested(scenario, Some(read.as_ref().map_err(String::as_str)))
}

/// Returns why the hand test does not permit to arm, if so.
fn untested(scenario: &Scenario, hand_test: Option<Result<&HandTestRecord, &str>>) -> Option<String> {
    let file = scenario.flight.as_ref()?.hand_test.as_deref()?;
    let Some((_, cameras)) = scenario.capture_system() else {
        return Some("`flight.hand_test` is stated, and the cameras are simulated: leave it out".to_owned());
    };
    let because = match hand_test {
        None => format!("there is no hand test at `{file}`"),
        Some(Err(reason)) => format!("there is no hand test: {reason}"),
        Some(Ok(record)) => record.refusal(cameras)?,
    };
    Some(format!(
        "{because}; repeat it with `gerono lab check`, propellers off"
    ))
}

fn too_late(needed: f64, left: f64) -> Option<String> {
    (left < needed).then(|| {
        format!(
            "the flight ends in {:.0} s, its `duration`, and to take off and land takes {needed:.0} s; start another run, \
             with a longer `duration` if need be",
            left.max(0.0)
        )
    })
}

/// Returns why the vehicle may not take off from where it is, if so.
fn unfit_state(scenario: &Scenario, now: &Situation<'_>) -> Option<String> {
    let Some(state) = now.state else {
        return Some("no state of the vehicle was received yet".to_owned());
    };
    let envelope = scenario.envelope.as_ref();
    let fence = envelope.and_then(|envelope| envelope.r#box.as_ref());
    let outside = fence.map_or(0.0, |fence| fence.distance_outside(&state.position_world));
    if state.tracked.is_set() && outside > 0.0 {
        return Some(format!(
            "the vehicle stands {outside:.2} m outside of `envelope.box`: carry it back, or state a larger box"
        ));
    }
    let off = scenario.flight.as_ref()?.off_the_ground(state.position_world[2]);
    if let Some([distance, limit]) = off.filter(|_| state.tracked.is_set()) {
        return Some(format!(
            "the vehicle is {distance:.2} m above or below `flight.ground`, and {limit} m are permitted: put it on the ground, or \
             correct the origin of the cameras"
        ));
    }
    if let Some(reason) = off_the_place(scenario, state) {
        return Some(reason);
    }
    let age_ns = |stamp_ns| now.elapsed_ns.saturating_sub(stamp_ns);
    let state_age_ns = age_ns(state.header.stamp_ns);
    let frame = now.frame.map(|frame| (frame, age_ns(frame.header.stamp_ns)));
    let limits = ReadyLimits {
        state_age_ns: nanoseconds(STALE),
        // The path generator, which is closer to the radio link, checks the frame's age itself.
        frame_age_ns: u64::MAX,
        ..scenario.ready_limits()?
    };
    let (sigma, largest) = (state.position_sigma, scenario.flight.as_ref()?.position_sigma_max);
    Some(
        match NotReady::find(&limits, Some((state, state_age_ns)), frame)? {
            NotReady::State => format!("the vehicle's state is {:.1} s old", seconds(state_age_ns)),
            NotReady::Sight if scenario.navigation.is_some() => {
                let [what, poses] = match scenario.fuses_poses() {
                    Some(true) => [
                        "neither fixes nor poses have",
                        "; or poses contradict the fixes or the heading: compare `[datum]` with the axes of the cameras",
                    ],
                    _ => ["fixes have not", ""],
                };
                let baseline = match scenario.baseline() {
                    Some(_) => {
                        "; or no baseline has been fused beside the field, or they show different headings: compare `gerono gnss probe` \
                         with `navigation.baseline` and a compass, and let the field come in gauss"
                    }
                    None => "",
                };
                format!(
                    "the position is not known: {what} been fused for `navigation.healthy_for` without a break (fixes that come and \
                     are refused for 7 s belong to another `[datum]` or height), or inertial samples are missing{poses}{baseline}"
                )
            }
            NotReady::Sight => "the cameras do not see the vehicle".to_owned(),
            NotReady::Estimate => format!(
                "the estimator has not converged: the position is known to {sigma:.3} m, {largest} m are needed"
            ),
            NotReady::Level => not_level_in_words(tilt(&state.world_from_body), limits.tilt),
            NotReady::Motion => {
                let speed = state.velocity_world().norm();
                format!("the vehicle moves at {speed:.1} m/s: let it stand")
            }
            NotReady::Transmitter => "the transmitter lacks an input".to_owned(),
            NotReady::Demand => "the transmitter demands a landing or a kill".to_owned(),
        },
    )
}

/// Returns why the frame that real receivers measure in is not that of the scenario, if so: by another datum the vehicle would fly to a
/// path that is far away, or below the ground.
fn off_the_place(scenario: &Scenario, state: &VehicleState) -> Option<String> {
    scenario.real_receivers()?;
    if !state.tracked.is_set() {
        return None;
    }
    let kind = scenario
        .sensors
        .as_ref()
        .and_then(|sensors| sensors.gnss.least_accurate());
    let kind = kind.unwrap_or(FixKind::SinglePoint);
    let [_, height_deviation, _] = scenario.navigation.as_ref()?.errors()[kind as usize].deviations();
    let [across_limit, up_limit] = OFF_THE_PLACE;
    let up_limit = up_limit + DEVIATIONS * height_deviation;
    let stated = scenario.vehicle.initial.position;
    let [x, y, z] = std::array::from_fn(|axis| state.position_world[axis] - stated[axis]);
    let across = (x * x + y * y).sqrt();
    if across <= across_limit && z.abs() <= up_limit {
        return None;
    }
    let side = if z > 0.0 { "below" } else { "above" };
    let by = match scenario.fuses_poses() {
        Some(true) => "poses and fixes",
        _ => "the fixes",
    };
    Some(format!(
        "by {by} the vehicle is {across:.1} m beside and {:.1} m {side} `vehicle.initial.position`, and {across_limit} m and \
         {up_limit:.1} m are permitted: correct `[datum]` (`height` is above the ellipsoid, not above the sea), carry the vehicle to \
         its place, or state `vehicle.initial.position`",
        z.abs()
    ))
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use zerocopy::FromZeros;

    use super::*;

    fn scenario() -> Scenario {
        let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../scenarios/takeoff_and_land.toml");
        scenario_file::load(&file, &[], None).unwrap()
    }

    /// A vehicle that stands level and is seen.
    fn standing() -> (VehicleState, RcFrame) {
        let mut state = VehicleState::new_zeroed();
        state.tracked = true.into();
        for axis in [0, 4, 8] {
            state.world_from_body[axis] = 1.0;
        }
        let mut frame = RcFrame::new_zeroed();
        frame.inputs_fresh = true.into();
        (state, frame)
    }

    fn on_the_ground<'a>(state: &'a VehicleState, frame: &'a RcFrame) -> Situation<'a> {
        Situation {
            operator: Operator::default(),
            shutdown: Shutdown::None,
            time_left: None,
            elapsed_ns: 0,
            phase: Some(FlightPhase::Disarmed),
            frame: Some(frame),
            state: Some(state),
            missing: None,
            kill_switch: None,
            laboratory: None,
            hand_test: None,
        }
    }

    #[test]
    fn a_vehicle_that_stands_level_and_is_seen_may_be_armed() {
        let (state, frame) = standing();
        assert_eq!(refusal(&scenario(), &on_the_ground(&state, &frame)), None);
    }

    fn laboratory() -> Scenario {
        let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../scenarios/laboratory.toml");
        scenario_file::load(&file, &["flight.hand_test='hand.json'".to_owned()], None).unwrap()
    }

    fn tested(scenario: &Scenario) -> HandTestRecord {
        let (_, cameras) = scenario.capture_system().unwrap();
        HandTestRecord {
            hand_test_passed: true,
            date: "2026-11-28 10:00:00 UTC".to_owned(),
            scenario: "laboratory".to_owned(),
            motion_capture: cameras.clone(),
            rest: hand_test::record::RestRecord::default(),
            steps: Vec::new(),
            causes: Vec::new(),
        }
    }

    #[test]
    fn without_a_hand_test_that_this_body_has_passed_nothing_is_armed() {
        let scenario = laboratory();
        let (state, frame) = standing();
        let refused = |hand_test: Option<Result<&HandTestRecord, &str>>| {
            let now = Situation {
                hand_test,
                ..on_the_ground(&state, &frame)
            };
            refusal(&scenario, &now)
        };
        assert_eq!(refused(Some(Ok(&tested(&scenario)))), None);
        type Spoil = fn(&mut HandTestRecord);
        let spoilt: [(Spoil, &str); 6] = [
            (
                |test| test.motion_capture.object = "other".to_owned(),
                "the body `other`, not with",
            ),
            (
                |test| test.motion_capture.server = "192.168.10.2".to_owned(),
                "other cameras",
            ),
            (|test| test.motion_capture.port = Some(4000), "other cameras"),
            (
                |test| test.motion_capture.body_from_markers = Some(scenario::FrameTransform::default()),
                "was changed since",
            ),
            (
                |test| {
                    test.hand_test_passed = false;
                    test.causes.push("roll and pitch are exchanged".to_owned());
                },
                "found: roll and pitch are exchanged",
            ),
            (|test| test.hand_test_passed = false, "a step was wrong"),
        ];
        for (spoil, words) in spoilt {
            let mut test = tested(&scenario);
            spoil(&mut test);
            let refusal = refused(Some(Ok(&test))).expect(words);
            assert!(
                refusal.contains(words) && refusal.contains("gerono lab check"),
                "{refusal}"
            );
        }
        for (missing, words) in [(None, "/scenarios/hand.json`"), (Some(Err("gone")), "gone")] {
            let refusal = refused(missing).unwrap();
            assert!(refusal.contains(words), "{refusal}");
        }
    }

    #[test]
    fn a_vehicle_off_the_stated_ground_is_not_armed() {
        let mut scenario = scenario();
        let flight = scenario.flight.as_mut().unwrap();
        (flight.ground, flight.ground_tolerance) = (Some(-0.05), Some(0.03));
        let (mut state, frame) = standing();
        for (z, is_on_it) in [
            (-0.05, true),
            (-0.07, true),
            (0.0, false),
            (-0.3, false),
            (f64::NAN, false),
        ] {
            state.position_world[2] = z;
            let found = refusal(&scenario, &on_the_ground(&state, &frame));
            assert_eq!(found.is_none(), is_on_it, "{z}: {found:?}");
            assert!(found.is_none_or(|found| found.contains("`flight.ground`")));
        }
    }

    #[test]
    fn a_vehicle_that_real_receivers_see_elsewhere_is_not_armed() {
        let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../scenarios/laboratory_outdoor.toml");
        let scenario = scenario_file::load(&file, &[], None).unwrap();
        let simulated = scenario_file::load(&file, &["receivers.sources=[]".to_owned()], None).unwrap();
        let (mut state, frame) = standing();
        for (position, words) in [
            ([0.3, 0.2, 0.0], None),
            ([6.0, 6.0, -3.0], None),
            // Above the sea instead of above the ellipsoid.
            (
                [0.3, 0.2, 45.0],
                Some("0.0 m beside and 45.0 m below `vehicle.initial.position`, and 10 m and 3.0 m"),
            ),
            ([0.3, 0.2, -4.0], Some("4.0 m above")),
            ([3000.3, 4000.2, 0.0], Some("5000.0 m beside")),
            ([f64::NAN, 0.0, 0.0], Some("NaN m beside")),
        ] {
            state.position_world = position;
            let found = refusal(&scenario, &on_the_ground(&state, &frame));
            let is_named = |words: &str| {
                let found = found.as_ref().expect(words);
                found.contains(words) && found.contains("correct `[datum]` (`height` is above the ellipsoid")
            };
            assert!(words.map_or(found.is_none(), is_named), "{position:?}: {found:?}");
            assert_eq!(refusal(&simulated, &on_the_ground(&state, &frame)), None);
        }
    }

    #[test]
    fn each_obstacle_is_named() {
        type Obstacle = fn(&mut Situation<'_>);
        let obstacles: [(Obstacle, &str); 9] = [
            (|now| now.operator.killed = true, "a kill stopped"),
            (|now| now.operator.land = true, "a landing was requested"),
            (|now| now.shutdown = Shutdown::Land, "a landing was requested"),
            (|now| now.phase = Some(FlightPhase::TakeOff), "armed already"),
            (|now| now.time_left = Some(1.0), "the flight ends in 1 s"),
            (|now| now.missing = Some(ServiceId::Plant), "`plant` does not fly"),
            (|now| now.kill_switch = Some("unplugged"), "unplugged"),
            (|now| now.laboratory = Some("no camera".to_owned()), "no camera"),
            (|now| now.state = None, "no state"),
        ];
        let (state, frame) = standing();
        for (obstruct, words) in obstacles {
            let mut now = on_the_ground(&state, &frame);
            obstruct(&mut now);
            let refusal = refusal(&scenario(), &now).expect(words);
            assert!(refusal.contains(words), "{refusal}");
        }
    }

    #[test]
    fn each_unfit_state_is_named() {
        type Unfit = fn(&mut VehicleState, &mut RcFrame);
        let unfit: [(Unfit, &str); 8] = [
            (
                |_, frame| frame.action = RcFrame::ACTION_KILL,
                "a kill stopped the motors",
            ),
            (
                |_, frame| frame.action = RcFrame::ACTION_LAND,
                "the demand to land",
            ),
            (
                |state, _| state.position_world[0] = 7.0,
                "5.00 m outside of `envelope.box`",
            ),
            (|state, _| state.tracked = false.into(), "do not see"),
            (|state, _| state.position_sigma = 1.0, "not converged"),
            (|state, _| state.world_from_body[8] = 0.7, "tilted by 45.6°"),
            (|state, _| state.velocity_body[0] = 1.0, "moves at 1.0 m/s"),
            (
                |_, frame| frame.inputs_fresh = false.into(),
                "the transmitter lacks an input",
            ),
        ];
        for (make_unfit, words) in unfit {
            let (mut state, mut frame) = standing();
            make_unfit(&mut state, &mut frame);
            let refusal = refusal(&scenario(), &on_the_ground(&state, &frame)).expect(words);
            assert!(refusal.contains(words), "{refusal}");
        }
        let (state, frame) = standing();
        let mut late = on_the_ground(&state, &frame);
        late.elapsed_ns = 200_000_000;
        assert_eq!(
            refusal(&scenario(), &late).as_deref(),
            Some("the vehicle's state is 0.2 s old")
        );
    }
}
