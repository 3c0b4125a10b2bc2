//! When a vehicle is lost, by what is known of it.

use super::*;
use proptest::prelude::*;
use run_log::test_flight::scenario;
use scenario::Flight;
use shared_types::rotation::{from_roll_pitch_yaw, to_row_major};
use zerocopy::FromZeros;

/// The moment of a step of 10 ms each.
fn moment(step: u64, distance: Option<f64>, phase: FlightPhase) -> Moment {
    let mut moment = Moment::hovering(step * 10_000_000, distance, phase);
    moment.vehicle.tick = step;
    moment
}

/// The loss of a vehicle with such distances from its path (m), a step of 10 ms each.
fn loss_of(limits: Option<Judge>, distances: &[f64]) -> Option<Loss> {
    let flown = Scenario {
        judge: limits,
        ..scenario(0.01, 10.0)
    };
    let mut watch = LossWatch::new(&flown, StateSource::Truth);
    for (&distance, step) in distances.iter().zip(0..) {
        watch.observe(&moment(step, Some(distance), FlightPhase::Fly));
    }
    watch.loss().cloned()
}

fn tilted_by(tilt: f64) -> Moment {
    let mut tilted = moment(0, Some(0.0), FlightPhase::Fly);
    tilted.vehicle.world_from_body = to_row_major(&from_roll_pitch_yaw([tilt, 0.0, 0.3]));
    tilted
}

#[test]
fn a_vehicle_that_leaves_its_path_is_lost_once_with_time_value_and_limit() {
    let loss = loss_of(None, &[1.2, 0.5, 4.9, 5.1, 168.0, 0.0]).unwrap();
    assert_eq!(loss.reason, Reason::LeftPath);
    assert_eq!((loss.time, loss.value, loss.limit), (0.03, Some(5.1), Some(5.0)));
    assert_eq!(loss.to_string(), "5.10 m from the path, more than 5.00 m");
    assert_eq!(loss_of(None, &[1.2, 5.0, 0.0]), None);
}

#[test]
fn a_vehicle_that_starts_far_away_has_twice_that_distance_until_it_has_arrived() {
    assert_eq!(loss_of(None, &[51.4, 60.0, 102.0, 30.0, 4.9, 5.1, 2.5]), None);
    assert_eq!(loss_of(None, &[3.0, 5.9, 2.5]), None);
    let loss = loss_of(None, &[51.4, 103.0]).unwrap();
    assert_eq!(loss.limit, Some(102.8));
    let after_arrival = loss_of(None, &[51.4, 2.4, 5.1]).unwrap();
    assert_eq!(after_arrival.limit, Some(5.0));
}

#[test]
fn the_scenario_says_what_is_too_far() {
    let near = Judge {
        distance_max: 0.5,
        ..Judge::default()
    };
    assert_eq!(loss_of(Some(near), &[0.2, 0.6]).unwrap().limit, Some(0.5));
}

#[test]
fn a_vehicle_tips_over_once_it_has_been_upright_near_its_path_and_never_with_a_limit_of_pi() {
    let watch = |limits: Option<Judge>, tilts: &[f64]| {
        let flown = Scenario {
            judge: limits,
            ..scenario(0.01, 10.0)
        };
        let mut watch = LossWatch::new(&flown, StateSource::Truth);
        tilts.iter().for_each(|&tilt| watch.observe(&tilted_by(tilt)));
        watch.loss().cloned()
    };
    let loss = watch(None, &[0.1, 1.6, 0.1]).unwrap();
    assert_eq!(loss.reason, Reason::TippedOver);
    assert_eq!(loss.to_string(), "tipped over by 92°, more than 90°");
    assert_eq!(watch(None, &[3.1, 2.0, 1.5]), None, "it starts upside down");
    assert_eq!(watch(None, &[3.1, 1.5, 2.0]).unwrap().reason, Reason::TippedOver);
    let mut far = LossWatch::new(&scenario(0.01, 10.0), StateSource::Truth);
    for tilt in [0.1, 1.6] {
        far.observe(&Moment {
            distance: Some(0.6),
            ..tilted_by(tilt)
        });
    }
    assert_eq!(far.loss(), None, "it is on its way");
    let acrobat = Judge {
        tilt_max: std::f64::consts::PI,
        ..Judge::default()
    };
    assert_eq!(watch(Some(acrobat), &[0.0, 1.6, std::f64::consts::PI]), None);
}

#[test]
fn a_vehicle_whose_place_is_no_number_is_lost() {
    let mut watch = LossWatch::new(&scenario(0.01, 10.0), StateSource::Truth);
    let mut nowhere = moment(7, None, FlightPhase::Fly);
    nowhere.vehicle.position_world[1] = f64::NAN;
    watch.observe(&nowhere);
    let loss = watch.loss().unwrap();
    assert_eq!(
        (loss.reason, loss.time, loss.value),
        (Reason::NotFinite, 0.07, None)
    );
}

/// A vehicle that rises to 1 m and comes down at such a speed in a phase.
fn touching(phase: FlightPhase, speed: f64, source: StateSource) -> Option<Loss> {
    let mut flown = scenario(0.01, 10.0);
    flown.flight = Some(Flight::default());
    let mut watch = LossWatch::new(&flown, source);
    for (step, height) in [0.0, 1.0, 0.01, 0.0].into_iter().enumerate() {
        let mut here = moment(step as u64, None, phase);
        here.vehicle.position_world[2] = -height;
        here.vehicle.velocity_body[2] = if height > 0.0 { speed } else { 0.0 };
        watch.observe(&here);
    }
    watch.loss().cloned()
}

#[test]
fn the_ground_is_touched_softly_in_a_landing_and_not_at_all_in_flight() {
    assert_eq!(touching(FlightPhase::Land, 0.5, StateSource::Truth), None);
    let hard = touching(FlightPhase::Land, 1.4, StateSource::Truth).unwrap();
    assert_eq!((hard.reason, hard.limit), (Reason::HitGround, Some(1.3)));
    assert_eq!(
        hard.to_string(),
        "hit the ground at 1.40 m/s, faster than 1.30 m/s"
    );
    let killed = touching(FlightPhase::Disarmed, 4.0, StateSource::Truth).unwrap();
    assert_eq!(killed.reason, Reason::HitGround);
    let soft = touching(FlightPhase::Fly, 0.1, StateSource::Truth).unwrap();
    assert_eq!(soft.to_string(), "touched the ground in flight, at 0.10 m/s");
    assert_eq!(
        touching(FlightPhase::Fly, 4.0, StateSource::Estimate),
        None,
        "nobody knows the ground"
    );
}

/// A path generator that does not see the vehicle leaves it in the air, in the phase before.
#[test]
fn a_vehicle_that_comes_down_unseen_is_judged_by_its_speed_and_its_motors_may_stop_then() {
    for (speed, lost) in [(0.9, None), (1.4, Some(Reason::HitGround))] {
        let mut flown = scenario(0.01, 10.0);
        flown.flight = Some(Flight::default());
        let mut watch = LossWatch::new(&flown, StateSource::Truth);
        for (step, height) in [0.0, 1.0, 0.01, 0.0].into_iter().enumerate() {
            let mut here = moment(step as u64, None, FlightPhase::Fly);
            here.vehicle.position_world[2] = -height;
            here.vehicle.velocity_body[2] = if height > 0.0 { speed } else { 0.0 };
            let mut unseen = reference(PathReference::PHASE_FLY, PathReference::CAUSE_NONE, true);
            unseen.vehicle_known = (step < 2).into();
            watch.observe_reference(&unseen);
            watch.observe(&here);
        }
        (0..3000).for_each(|at| watch.observe_frame(&failsafe_frame(at, RcFrame::ACTION_NONE, 0)));
        assert_eq!(watch.loss().map(|loss| loss.reason), lost, "{speed} m/s");
    }
}

#[test]
fn a_flight_that_is_taken_over_just_above_the_ground_may_hit_it() {
    for (begins_in_the_air, lost) in [(true, true), (false, false)] {
        let mut flown = scenario(0.01, 10.0);
        flown.flight = Some(Flight::default());
        let mut watch = LossWatch::new(&flown, StateSource::Truth);
        let mut first = reference(PathReference::PHASE_LAND, 0, begins_in_the_air);
        first.header.tick = 3000;
        watch.observe_reference(&first);
        for (step, height) in [(0, 0.02), (1, 0.0)] {
            let mut moment = moment(step, Some(0.0), FlightPhase::Land);
            moment.vehicle.position_world[2] = -height;
            moment.vehicle.velocity_body = [0.0, 0.0, 5.0];
            watch.observe(&moment);
        }
        assert_eq!(watch.loss().is_some(), lost);
    }
}

#[test]
fn a_vehicle_that_stands_on_the_ground_does_not_touch_it() {
    let mut flown = scenario(0.01, 10.0);
    flown.flight = Some(Flight::default());
    let mut watch = LossWatch::new(&flown, StateSource::Truth);
    for step in 0..10 {
        let mut here = moment(step, None, FlightPhase::Fly);
        here.vehicle.position_world[2] = 0.0;
        watch.observe(&here);
    }
    assert_eq!(watch.loss(), None);
}

#[test]
fn what_is_only_estimated_says_so() {
    let mut watch = LossWatch::new(&scenario(0.01, 10.0), StateSource::Estimate);
    watch.observe(&moment(0, Some(1.0), FlightPhase::Fly));
    watch.observe(&moment(1, Some(7.0), FlightPhase::Fly));
    assert!(watch.loss().unwrap().to_string().ends_with("as estimated"));
}

proptest! {
    #[test]
    fn a_vehicle_within_the_limits_is_never_lost_and_one_beyond_always(
        distances in proptest::collection::vec(0.0..6.0f64, 1..100),
    ) {
        let arrived = distances.iter().position(|&distance| distance <= 2.5).unwrap_or(distances.len());
        let (before, after) = distances.split_at(arrived);
        let is_lost = before.iter().any(|&distance| distance > f64::max(5.0, 2.0 * distances[0]))
            || after.iter().any(|&distance| distance > 5.0);
        prop_assert_eq!(loss_of(None, &distances).is_some(), is_lost);
    }
}

/// A watch over an airborne vehicle whose position is estimated.
fn airborne() -> LossWatch {
    let mut watch = LossWatch::new(&scenario(0.01, 10.0), StateSource::Estimate);
    watch.observe_reference(&reference(PathReference::PHASE_FLY, 0, true));
    watch
}

#[test]
fn a_real_vehicle_that_is_seen_again_on_the_ground_has_landed_only_if_it_was_to_land() {
    let phased = Scenario {
        flight: Some(Flight::default()),
        ..scenario(0.01, 10.0)
    };
    for (source, phase, is_lost) in [
        (StateSource::Estimate, PathReference::PHASE_FLY, true),
        (StateSource::Estimate, PathReference::PHASE_TAKE_OFF, true),
        (StateSource::Estimate, PathReference::PHASE_LAND, false),
        (StateSource::Truth, PathReference::PHASE_FLY, false),
    ] {
        let mut watch = LossWatch::new(&phased, source);
        watch.observe_reference(&reference(phase, 0, true));
        let cause = PathReference::CAUSE_TOUCHED_DOWN;
        watch.observe_reference(&reference(PathReference::PHASE_DISARMED, cause, false));
        assert_eq!(watch.loss().is_some(), is_lost, "{phase}");
        if let Some(loss) = watch.loss() {
            assert_eq!(loss.to_string(), "it came down unseen, without a landing");
        }
    }
}

#[test]
fn a_real_vehicle_that_is_in_the_air_at_the_end_is_lost_by_it() {
    // The newest reference is of 3 s.
    let end = 3_500_000_000;
    assert!(
        airborne().loss_at_the_end(end).is_none(),
        "without phases nothing lands it"
    );
    let phased = Scenario {
        flight: Some(Flight::default()),
        ..scenario(0.01, 10.0)
    };
    for (source, is_airborne, is_known, reason) in [
        (StateSource::Estimate, true, true, Some(Reason::MotorsStopped)),
        (StateSource::Estimate, true, false, Some(Reason::Unseen)),
        (StateSource::Estimate, false, true, None),
        (StateSource::Truth, true, true, None),
    ] {
        let mut watch = LossWatch::new(&phased, source);
        let mut newest = reference(PathReference::PHASE_LAND, 0, is_airborne);
        newest.vehicle_known = is_known.into();
        watch.observe_reference(&newest);
        let end = if is_known { end } else { 9_000_000_000 };
        let loss = watch.loss_at_the_end(end);
        assert_eq!(loss.as_ref().map(|loss| loss.reason), reason);
        if let Some(loss) = loss {
            assert!(
                loss.to_string().ends_with("the flight ended") && loss.time == 1e-9 * end as f64,
                "{loss}"
            );
        }
    }
}

/// The link is lost at 3.2 s, and found again or not.
#[test]
fn a_vehicle_that_comes_down_without_a_radio_link_is_lost() {
    let event = |kind: u32, milliseconds: u64| {
        let mut event = RunEvent::new_zeroed();
        (event.kind, event.header.stamp_ns) = (kind, milliseconds * 1_000_000);
        event
    };
    for (found_at, down_at, reason) in [
        (u64::MAX, 4000, Some(Reason::LinkLost)),
        (u64::MAX, 9000, Some(Reason::LinkLost)),
        (4000, 5000, None),
        (5300, 6000, Some(Reason::LinkLost)),
    ] {
        let phased = Scenario {
            flight: Some(Flight::default()),
            ..scenario(0.01, 10.0)
        };
        let mut watch = LossWatch::new(&phased, StateSource::Estimate);
        for at in (3000..=10_000).step_by(20) {
            match at {
                3200 => watch.observe_event(&event(RunEvent::KIND_LINK_LOST, at)),
                at if at == found_at => watch.observe_event(&event(RunEvent::KIND_LINK_FOUND, at)),
                _ => {}
            }
            let is_down = at >= down_at;
            let phase = if is_down {
                PathReference::PHASE_DISARMED
            } else {
                PathReference::PHASE_LAND
            };
            let cause = if is_down {
                PathReference::CAUSE_TOUCHED_DOWN
            } else {
                0
            };
            let mut newest = reference(phase, cause, !is_down);
            newest.header.stamp_ns = at * 1_000_000;
            watch.observe_reference(&newest);
        }
        let loss = watch.loss();
        assert_eq!(loss.map(|loss| loss.reason), reason, "{found_at}, {down_at}");
        if let Some(loss) = loss {
            assert_eq!(loss.time, 3.2);
            assert!(
                loss.to_string().contains("no command reached the vehicle"),
                "{loss}"
            );
        }
    }
}

fn reference(phase: u8, cause: u8, airborne: bool) -> PathReference {
    let mut reference = PathReference::new_zeroed();
    reference.header.stamp_ns = 3_000_000_000;
    (reference.phase, reference.cause) = (phase, cause);
    reference.airborne = airborne.into();
    reference.vehicle_known = true.into();
    reference
}

fn failsafe_frame(milliseconds: u64, action: u8, limit: u8) -> RcFrame {
    let mut frame = RcFrame::new_zeroed();
    frame.header.stamp_ns = milliseconds * 1_000_000;
    frame.failsafe = true.into();
    (frame.action, frame.limit) = (action, limit);
    frame
}

#[test]
fn a_vehicle_whose_motors_are_stopped_in_the_air_is_lost_in_a_laboratory_too() {
    let kills = PathReference::CAUSE_ENVELOPE_KILLS + RcFrame::LIMIT_BOX;
    for cause in [
        PathReference::CAUSE_OPERATOR_KILLS,
        PathReference::CAUSE_OPERATOR_DISARMS,
        kills,
    ] {
        let mut watch = airborne();
        watch.observe_reference(&reference(PathReference::PHASE_DISARMED, cause, false));
        let loss = watch.loss().unwrap();
        assert_eq!(
            (loss.reason, loss.time, loss.stopped_by),
            (Reason::MotorsStopped, 3.0, cause)
        );
    }
    // Without phases the frames state it.
    let mut watch = airborne();
    watch.observe_frame(&failsafe_frame(500, RcFrame::ACTION_KILL, RcFrame::LIMIT_BOX));
    let loss = watch.loss().unwrap();
    assert_eq!((loss.time, loss.stopped_by), (0.5, kills));
}

/// The last failsafe stage stops the motors of a vehicle that has gone down without sight, and whose path generator still
/// takes for airborne. What is known of it later changes nothing.
#[test]
fn in_a_laboratory_nothing_says_where_an_unseen_vehicle_was_when_its_motors_were_stopped() {
    for (unknown_at, known_again, reason) in [
        (3000, false, Reason::Unseen),
        (3000, true, Reason::Unseen),
        (4500, false, Reason::MotorsStopped),
        (5500, false, Reason::MotorsStopped),
    ] {
        let mut watch = airborne();
        let mut seen = reference(PathReference::PHASE_FLY, 0, true);
        for at in (3000..=7000).step_by(20) {
            seen.header.stamp_ns = at * 1_000_000;
            seen.vehicle_known = (at < unknown_at || (known_again && at > 6000)).into();
            watch.observe_reference(&seen);
            if at >= 5000 {
                watch.observe_frame(&failsafe_frame(at, RcFrame::ACTION_NONE, RcFrame::LIMIT_NONE));
            }
        }
        let loss = watch.loss().unwrap();
        assert_eq!(
            (loss.reason, loss.time),
            (reason, 5.0),
            "unknown from {unknown_at} ms on"
        );
        let words = "the motors were stopped while the cameras did not show whether the vehicle was down: failsafe frames for 2 s";
        assert_eq!(loss.to_string() == words, reason == Reason::Unseen);
    }
}

#[test]
fn a_vehicle_that_is_disarmed_on_the_ground_is_not_lost() {
    let mut landed = airborne();
    landed.observe_reference(&reference(
        PathReference::PHASE_DISARMED,
        PathReference::CAUSE_TOUCHED_DOWN,
        false,
    ));
    landed.observe_frame(&failsafe_frame(500, RcFrame::ACTION_KILL, RcFrame::LIMIT_NONE));
    assert_eq!(landed.loss(), None);
    let mut standing = airborne();
    standing.observe_reference(&reference(PathReference::PHASE_LAND, 3, false));
    standing.observe_reference(&reference(
        PathReference::PHASE_DISARMED,
        PathReference::CAUSE_OPERATOR_KILLS,
        false,
    ));
    assert_eq!(standing.loss(), None);
}

#[test]
fn failsafe_frames_count_as_a_stop_once_they_have_lasted_for_a_fall() {
    let mut watch = airborne();
    let steps = |watch: &mut LossWatch, milliseconds: std::ops::RangeInclusive<u64>| {
        for at in milliseconds.step_by(20) {
            watch.observe_frame(&failsafe_frame(at, RcFrame::ACTION_NONE, RcFrame::LIMIT_NONE));
        }
    };
    steps(&mut watch, 0..=1980);
    watch.observe_frame(&RcFrame::new_zeroed());
    steps(&mut watch, 2000..=3980);
    assert_eq!(watch.loss(), None);
    steps(&mut watch, 4000..=4000);
    let loss = watch.loss().unwrap();
    assert_eq!((loss.reason, loss.time), (Reason::MotorsStopped, 2.0));
    assert_eq!(
        loss.to_string(),
        "the motors were stopped in the air: failsafe frames for 2 s"
    );
}
