//! Losses of sight, gaps of the steps and cold starts: where the reference goes on, and what is taken for the ground.

use path_generator::PathGeneratorService;
use path_generator::phases::{LEFT_BEHIND, PhasesMemory, STRAYED};
use scenario::Flight;
use shared_types::path_stop::{BRAKE, BRAKE_AFTER};
use shared_types::samples::{PathReference, RcFrame};
use shared_types::service::{Now, Service};

use crate::flight::{TICK_NS, paper_path, step_in_phases, vehicle};
use crate::flown_path::*;

#[test]
fn while_the_vehicle_is_unknown_everything_stands_still_without_a_touch_down() {
    let mut flown = FlownPath::eight();
    flown.until(ARMED, PathReference::PHASE_TAKE_OFF);
    flown.for_seconds(ARMED, 2.0);
    flown.vehicle.tracked = false.into();
    flown.for_seconds(ARMED, BRAKE + 0.1);
    let stood = flown.step(ARMED);
    assert_eq!((stood.gamma_dot, stood.gamma_ddot), (0.0, 0.0));
    assert_eq!(flown.step(ARMED).position_world, stood.position_world);
    flown.vehicle.tracked = true.into();
    flown.until(ARMED, PathReference::PHASE_FLY);
    flown.until(TO_LAND, PathReference::PHASE_LAND);
    flown.for_seconds(TO_LAND, Flight::default().transition_time + 1.5);
    flown.vehicle.tracked = false.into();
    (flown.frame.thrust, flown.lifts) = (0.0, false);
    flown.for_seconds(TO_LAND, 3.0);
    assert_eq!(flown.reference.phase, PathReference::PHASE_LAND);
}

#[test]
fn a_loss_of_sight_brings_the_reference_to_rest_without_a_jump_wherever_it_is() {
    for is_known in [true, false] {
        for place in ["rise", "transit", "path", "landing"] {
            let mut flown = FlownPath::eight();
            flown.until(ARMED, PathReference::PHASE_TAKE_OFF);
            flown.for_seconds(ARMED, if place == "transit" { 2.7 } else { 1.0 });
            if matches!(place, "path" | "landing") {
                flown.until(ARMED, PathReference::PHASE_FLY);
                flown.for_seconds(ARMED, 4.0);
            }
            let operator = if place == "landing" { TO_LAND } else { ARMED };
            flown.for_seconds(operator, 0.3);
            assert!(
                speed(&flown.reference) > 0.2,
                "{place}: {}",
                speed(&flown.reference)
            );
            (flown.vehicle.coasting, flown.vehicle.tracked) = (is_known.into(), is_known.into());
            let mut before = flown.reference;
            for _ in 0..((BRAKE_AFTER + BRAKE) / H) as u64 + 10 {
                let now = flown.step(operator);
                let jump = distance(motion(&now)[1], motion(&before)[1]);
                assert!(jump < 6.0 * H, "{place}: by {jump} m/s at {}", now.header.tick);
                before = now;
            }
            let way = Service::save(&flown.generator).phases.way;
            assert_eq!(way == PhasesMemory::WAY_DESCENT, place == "landing");
            assert!(speed(&before) < 1e-3, "{place}: {}", speed(&before));
            // And on, once it is seen.
            (flown.vehicle.coasting, flown.vehicle.tracked) = (false.into(), true.into());
            let mut fastest: f64 = 0.0;
            for _ in 0..3000 {
                let now = flown.step(operator);
                let jump = distance(motion(&now)[1], motion(&before)[1]);
                assert!(jump < 6.0 * H, "{place}: by {jump} m/s at {}", now.header.tick);
                fastest = fastest.max(speed(&now));
                before = now;
            }
            assert!(fastest > 0.2, "{place}: {fastest}");
        }
    }
}

#[test]
fn after_any_loss_of_sight_the_path_goes_on_from_rest_and_never_moves_backwards() {
    // The vehicle is seen again before, at and after the end of the stop, and steps are 1 ms and 22 ms apart.
    for ticks in [1, 22] {
        let step = |flown: &mut FlownPath| {
            flown.tick += ticks - 1;
            flown.step_after(ticks, ARMED)
        };
        for unseen in (110..1_300).step_by(70) {
            let mut flown = FlownPath::eight();
            flown.until(ARMED, PathReference::PHASE_FLY);
            flown.for_seconds(ARMED, 3.0);
            let mut slowest = f64::INFINITY;
            for since in (0..4_000).step_by(ticks as usize) {
                flown.vehicle.coasting = (since < unseen).into();
                let reference = step(&mut flown);
                slowest = slowest.min(reference.gamma_dot);
                assert!(
                    reference.gamma_dot >= 0.0,
                    "unseen for {unseen} ms, {since} ms after its begin: {}",
                    reference.gamma_dot
                );
            }
            assert_eq!(slowest, 0.0, "unseen for {unseen} ms");
            assert!(flown.reference.gamma_dot > 0.5, "unseen for {unseen} ms");
        }
    }
}

#[test]
fn a_gap_during_a_stop_does_not_turn_the_path_back() {
    // The stop has its largest deceleration when the steps pause.
    for gap in (100..160).step_by(5) {
        for stopping_for in [250, 350, 450] {
            let mut flown = FlownPath::that_coasts(0.5);
            flown.until(ARMED, PathReference::PHASE_FLY);
            flown.for_seconds(ARMED, 3.0);
            flown.vehicle.coasting = true.into();
            flown.for_seconds(ARMED, BRAKE_AFTER + 1e-3 * f64::from(stopping_for));
            flown.tick += gap;
            let mut now = flown.step_after(gap + 1, ARMED);
            for _ in 0..1_000 {
                assert!(
                    now.gamma_dot >= 0.0,
                    "{gap} ms, {stopping_for} ms after the begin of the stop: {}",
                    now.gamma_dot
                );
                now = flown.step(ARMED);
            }
            assert_eq!(now.gamma_dot, 0.0);
        }
    }
}

/// The first step after the gap does not see the vehicle, which a gust has moved meanwhile.
#[test]
fn a_look_that_is_due_after_a_gap_waits_until_the_vehicle_is_seen() {
    for blind in [0, 1, 50] {
        let mut flown = FlownPath::that_coasts(0.1);
        flown.until(ARMED, PathReference::PHASE_FLY);
        flown.for_seconds(ARMED, 3.0);
        flown.lifts = false;
        flown.vehicle.position_world[0] += 2.0 * STRAYED;
        flown.vehicle.coasting = (blind > 0).into();
        flown.tick += 120;
        let mut now = flown.step_after(121, ARMED);
        for _ in 1..blind {
            now = flown.step(ARMED);
        }
        if blind > 0 {
            assert_eq!(now.phase, PathReference::PHASE_FLY);
            flown.vehicle.coasting = false.into();
            now = flown.step(ARMED);
        }
        assert_eq!(now.cause, PathReference::CAUSE_STRAYED, "{blind} steps");
        assert_eq!(now.phase, PathReference::PHASE_TAKE_OFF);
    }
}

/// The landing is demanded at the step in which the vehicle is found.
#[test]
fn a_vehicle_that_is_found_elsewhere_when_it_is_to_land_comes_down_from_where_it_is() {
    for phase in [PathReference::PHASE_TAKE_OFF, PathReference::PHASE_FLY] {
        let mut flown = FlownPath::eight();
        flown.until(ARMED, phase);
        flown.for_seconds(ARMED, 1.5);
        flown.lifts = false;
        flown.vehicle.coasting = true.into();
        flown.for_seconds(ARMED, 2.0);
        flown.vehicle.coasting = false.into();
        flown.vehicle.position_world[0] += 2.0 * STRAYED;
        let found = flown.vehicle.position_world;
        let reference = flown.step(TO_LAND);
        assert_eq!(reference.phase, PathReference::PHASE_LAND);
        assert_eq!(reference.cause, PathReference::CAUSE_OPERATOR_LANDS);
        assert!(distance(reference.position_world, found) < 1e-9, "{reference:?}");
    }
}

/// Something keeps the vehicle from following, or its controller from the reference.
#[test]
fn a_landing_does_not_leave_a_vehicle_behind_in_the_air() {
    let mut flown = held_up_in_the_descent();
    assert!(flown.vehicle.position_world[2] < PLACE[2] - STRAYED);
    let mut farthest: f64 = 0.0;
    for _ in 0..10_000 {
        flown.frame.thrust = 1.7;
        let reference = flown.step(TO_LAND);
        flown.frame.thrust = 1.7;
        assert_eq!(reference.phase, PathReference::PHASE_LAND);
        farthest = farthest.max(distance(reference.position_world, flown.vehicle.position_world));
    }
    assert!(farthest > 0.4 && farthest <= LEFT_BEHIND + 1e-3, "{farthest}");
}

/// Its controller has landed it meanwhile.
#[test]
fn a_path_generator_that_is_back_finds_the_vehicle_on_the_ground_and_disarms_it() {
    for (gap, moves, phase) in [
        (10_000, 0.0, PathReference::PHASE_DISARMED),
        (10_000, 0.5, PathReference::PHASE_LAND),
        (10, 0.0, PathReference::PHASE_FLY),
    ] {
        let mut flown = FlownPath::that_coasts(0.5);
        flown.until(ARMED, PathReference::PHASE_FLY);
        flown.for_seconds(ARMED, 3.0);
        flown.lifts = false;
        flown.vehicle.position_world[2] = PLACE[2];
        flown.vehicle.velocity_body = [moves, 0.0, 0.0];
        flown.tick += gap;
        let reference = flown.step_after(gap + 1, ARMED);
        assert_eq!(reference.phase, phase, "{gap} ms, {moves} m/s");
    }
}

#[test]
fn a_descent_that_a_gap_has_stopped_goes_on_without_sight() {
    let mut flown = FlownPath::that_coasts(0.5);
    flown.until(ARMED, PathReference::PHASE_FLY);
    flown.until(TO_LAND, PathReference::PHASE_LAND);
    flown.for_seconds(TO_LAND, Flight::default().transition_time + 0.5);
    assert_eq!(
        Service::save(&flown.generator).phases.way,
        PhasesMemory::WAY_DESCENT
    );
    flown.vehicle.coasting = true.into();
    flown.tick += 300;
    let before = flown.step_after(301, TO_LAND).position_world[2];
    flown.for_seconds(TO_LAND, BRAKE + Flight::default().transition_time + 1.0);
    assert!(flown.reference.position_world[2] > before + 0.2);
}

/// A vehicle that has stopped to sink although its descent goes on.
fn held_up_in_the_descent() -> FlownPath {
    let mut flown = FlownPath::eight();
    flown.until(ARMED, PathReference::PHASE_FLY);
    flown.until(TO_LAND, PathReference::PHASE_LAND);
    flown.for_seconds(TO_LAND, Flight::default().transition_time + 1.5);
    flown.lifts = false;
    flown.vehicle.velocity_body = [0.0; 3];
    flown
}

#[test]
fn a_vehicle_that_a_gust_holds_up_has_not_touched_down_while_it_is_carried_by_its_thrust() {
    let mut flown = held_up_in_the_descent();
    for _ in 0..2000 {
        flown.frame.thrust = 1.7;
        assert_eq!(flown.step(TO_LAND).phase, PathReference::PHASE_LAND);
        flown.frame.thrust = 1.7;
    }
}

#[test]
fn one_dip_of_the_thrust_after_a_gap_of_the_steps_is_no_touch_down() {
    let mut flown = held_up_in_the_descent();
    flown.frame.thrust = 0.5;
    flown.tick += 1000;
    assert_eq!(flown.step_after(1000, TO_LAND).phase, PathReference::PHASE_LAND);
    flown.frame.thrust = 1.7;
    assert_eq!(flown.step(TO_LAND).phase, PathReference::PHASE_LAND);
}

#[test]
fn a_cold_start_in_the_air_leads_the_vehicle_from_its_place_to_the_path() {
    for land in [false, true] {
        let mut flown = FlownPath::eight();
        flown.until(ARMED, PathReference::PHASE_FLY);
        flown.for_seconds(ARMED, 4.0);
        let place = flown.vehicle.position_world;
        flown.generator = PathGeneratorService::new(&flown.scenario).unwrap();
        let reference = flown.step(if land { TO_LAND } else { ARMED });
        assert_eq!(reference.phase, PathReference::PHASE_TAKE_OFF);
        assert!(reference.airborne.is_set());
        assert_eq!(reference.position_world, place);
        if land {
            flown.until(TO_LAND, PathReference::PHASE_DISARMED);
        } else {
            flown.until(ARMED, PathReference::PHASE_FLY);
        }
    }
}

/// Seen again at rest, a vehicle has come down only where it was armed, and after a time in which it can have come down.
#[test]
fn only_on_the_ground_where_it_was_armed_is_a_vehicle_disarmed_that_is_seen_again() {
    for (knows_ground, above, sigma, unseen, phase) in [
        (true, 0.0, 0.0, 600, PathReference::PHASE_DISARMED),
        (true, 0.03, 0.0, 600, PathReference::PHASE_DISARMED),
        // By satellites alone: it may be in the air.
        (true, 0.0, 0.5, 600, PathReference::PHASE_TAKE_OFF),
        (true, 0.0, 0.0, 300, PathReference::PHASE_LAND),
        (true, -0.3, 0.0, 600, PathReference::PHASE_TAKE_OFF),
        (true, 0.3, 0.0, 600, PathReference::PHASE_TAKE_OFF),
        (false, 0.0, 0.0, 600, PathReference::PHASE_TAKE_OFF),
        (false, -0.5, 0.0, 600, PathReference::PHASE_TAKE_OFF),
    ] {
        let mut flown = FlownPath::eight();
        flown.until(ARMED, PathReference::PHASE_FLY);
        flown.for_seconds(ARMED, 4.0);
        if !knows_ground {
            flown.generator = PathGeneratorService::new(&flown.scenario).unwrap();
            flown.until(ARMED, PathReference::PHASE_FLY);
        }
        flown.lifts = false;
        flown.vehicle.coasting = true.into();
        for _ in 0..unseen {
            flown.step(ARMED);
        }
        let [x, y, _] = flown.vehicle.position_world;
        flown.vehicle = vehicle([x, y, PLACE[2] - above], [0.0; 3]);
        flown.vehicle.position_sigma = sigma;
        let found = flown.step(ARMED).phase;
        assert_eq!(
            found, phase,
            "{above} m above, ± {sigma} m, unseen for {unseen} ms, ground known: {knows_ground}"
        );
    }
}

/// Its stand, on which it was armed, is higher than the floor.
#[test]
fn a_vehicle_that_comes_down_beside_its_stand_is_not_disarmed_at_the_height_of_the_stand() {
    let Flight { landing_speed, .. } = Flight::default();
    for (share, phase) in [
        (1.0, PathReference::PHASE_LAND),
        (0.7, PathReference::PHASE_LAND),
        (0.1, PathReference::PHASE_DISARMED),
    ] {
        let mut flown = FlownPath::eight();
        flown.until(ARMED, PathReference::PHASE_FLY);
        flown.until(TO_LAND, PathReference::PHASE_LAND);
        flown.for_seconds(TO_LAND, Flight::default().transition_time + 0.5);
        flown.lifts = false;
        flown.vehicle.coasting = true.into();
        flown.for_seconds(TO_LAND, 0.12);
        let [x, y, _] = flown.vehicle.position_world;
        flown.vehicle = vehicle([x, y, PLACE[2]], [0.0, 0.0, share * landing_speed]);
        assert_eq!(flown.step(TO_LAND).phase, phase, "at {share} of the speed");
    }
}

#[test]
fn a_cold_start_on_the_ground_or_with_old_frames_is_not_taken_for_flight() {
    for (failsafe, thrust, age) in [(true, 0.0, 0), (false, 0.1, 0), (false, 2.0, 200)] {
        let mut generator = PathGeneratorService::new(&phased(paper_path())).unwrap();
        let tick = 5000;
        let now = Now {
            tick,
            time_ns: tick * TICK_NS,
            elapsed_ns: 0,
            operator: ARMED,
        };
        let mut frame = RcFrame {
            failsafe: failsafe.into(),
            thrust,
            ..idle_frame()
        };
        frame.header.stamp_ns = (tick - age) * TICK_NS;
        let reference = step_in_phases(&mut generator, &now, Some(&at_rest_on_the_ground()), Some(&frame));
        assert!(reference.phase < PathReference::PHASE_TAKE_OFF);
    }
}
