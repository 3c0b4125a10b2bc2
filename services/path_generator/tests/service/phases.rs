//! Flights from the ground to the path and back: phases in their order, references without jumps.

use path_generator::PathGeneratorService;
use path_generator::phases::{ARRIVAL_TIMEOUT, LIFTED, OFF_THE_GROUND, YAW_TEST};
use scenario::{Curve, Flight, Path, PathMode, TiltedEight};
use shared_types::flight_phase::{NotReady, STANDING};
use shared_types::samples::{PathReference, RcFrame};
use shared_types::service::{Now, Operator, Service};

use crate::allocations::allocations_during;
use crate::flight::{TICK_NS, paper_path, step_in_phases};
use crate::flown_path::*;

/// Attitude of a vehicle that lies tilted by 62° about x, row-major.
const TILTED: [f64; 9] = [
    1.0,
    0.0,
    0.0,
    0.0,
    0.469_471_562_785_890_8,
    -0.882_947_592_858_927,
    0.0,
    0.882_947_592_858_927,
    0.469_471_562_785_890_8,
];

/// Flies a whole flight and asserts that each reference continues the motion of the one before.
fn assert_smooth_flight(mut flown: FlownPath) -> Vec<u8> {
    flown.until(ARMED, PathReference::PHASE_TAKE_OFF);
    let mut before = flown.reference;
    let land_at = flown.tick + 16_000;
    while flown.reference.phase != PathReference::PHASE_DISARMED {
        let operator = if flown.tick < land_at { ARMED } else { TO_LAND };
        let now = flown.step(operator);
        if now.phase == PathReference::PHASE_DISARMED {
            break;
        }
        let ([p, v, a], [p0, v0, a0]) = (motion(&now), motion(&before));
        let moved: [f64; 3] = std::array::from_fn(|axis| p0[axis] + H * v0[axis]);
        assert!(
            distance(p, moved) < 3.0 * H * H,
            "position at {}",
            now.header.tick
        );
        assert!(
            distance(v, v0) < 2.5 * H,
            "velocity from {v0:?} to {v:?} in phase {}",
            now.phase
        );
        assert!(
            distance(a, a0) < 12.0 * H,
            "acceleration from {a0:?} to {a:?} in phase {}",
            now.phase
        );
        before = now;
    }
    flown.for_seconds(TO_LAND, 2.0);
    flown.phases
}

#[test]
fn a_flight_passes_through_all_phases_and_its_references_have_no_jump_up_to_the_acceleration() {
    let all = [
        PathReference::PHASE_ARMED,
        PathReference::PHASE_TAKE_OFF,
        PathReference::PHASE_FLY,
        PathReference::PHASE_LAND,
        PathReference::PHASE_DISARMED,
    ];
    assert_eq!(assert_smooth_flight(FlownPath::eight()), all);
    let tracking = Path {
        mode: PathMode::TrajectoryTracking,
        ..paper_path()
    };
    assert_eq!(assert_smooth_flight(FlownPath::new(tracking)), all);
}

#[test]
fn a_yaw_test_turns_the_reference_once_the_vehicle_is_off_the_ground_and_back() {
    let mut flown = FlownPath::eight();
    let path_yaw = flown.scenario.path.yaw;
    flown.scenario.flight.as_mut().unwrap().yaw_test = Some(0.2);
    flown.lifts = false;
    flown.until(ARMED, PathReference::PHASE_TAKE_OFF);
    // Its mass is larger than believed, and it stands for a while; a vehicle on its legs does not turn.
    for _ in 0..1500 {
        assert_eq!(flown.step(ARMED).yaw, path_yaw);
    }
    flown.lifts = true;
    let mut turned_for = 0.0;
    while flown.reference.phase != PathReference::PHASE_FLY {
        let is_off = flown.vehicle.position_world[2] < PLACE[2] - OFF_THE_GROUND;
        let now = flown.step(ARMED);
        let turns = now.yaw == path_yaw + 0.2;
        assert!(turns || now.yaw == path_yaw, "{}", now.yaw);
        assert_eq!(turns, is_off && turned_for < YAW_TEST - 0.5 * H);
        turned_for += if turns { H } else { 0.0 };
    }
    assert!((turned_for - YAW_TEST).abs() < 1.5 * H, "{turned_for}");
}

#[test]
fn gamma_stands_still_until_the_vehicle_is_at_the_path_and_after_it_has_left_it() {
    let mut flown = FlownPath::new(Path {
        initial_gamma: 0.7,
        initial_gamma_dot: 0.5,
        curve: Curve::TiltedEight(TiltedEight::default()),
        ..paper_path()
    });
    while flown.step(ARMED).phase != PathReference::PHASE_FLY {
        assert_eq!(flown.gamma(), 0.7);
    }
    flown.for_seconds(ARMED, 5.0);
    assert!(flown.gamma() > 3.0);
    flown.until(TO_LAND, PathReference::PHASE_LAND);
    flown.for_seconds(TO_LAND, Flight::default().transition_time + 0.01);
    let stopped = flown.gamma();
    flown.until(TO_LAND, PathReference::PHASE_DISARMED);
    assert_eq!(flown.gamma(), stopped);
}

#[test]
fn the_vehicle_counts_as_airborne_from_lift_off_to_touch_down_only() {
    let mut flown = FlownPath::eight();
    let lifted = |flown: &FlownPath| flown.vehicle.position_world[2] < PLACE[2] - LIFTED;
    while flown.reference.phase != PathReference::PHASE_FLY {
        let was_lifted = lifted(&flown);
        assert_eq!(
            flown.step(ARMED).airborne.is_set(),
            was_lifted,
            "tick {}",
            flown.tick
        );
    }
    let mut stands_for = 0.0;
    while flown.reference.phase != PathReference::PHASE_DISARMED {
        let stands = flown.vehicle.position_world[2] >= PLACE[2];
        let is_airborne = flown.step(TO_LAND).airborne.is_set();
        assert!(is_airborne || stands);
        stands_for += if is_airborne { 0.0 } else { H };
    }
    assert!((stands_for - STANDING).abs() < 2.0 * H, "{stands_for}");
    assert!(!flown.reference.airborne.is_set());
}

#[test]
fn nothing_arms_while_anything_is_not_ready() {
    type Spoil = fn(&mut FlownPath);
    let spoilers: [(&str, Spoil, NotReady); 10] = [
        (
            "not tracked",
            |flown| flown.vehicle.tracked = false.into(),
            NotReady::Sight,
        ),
        (
            "coasting",
            |flown| flown.vehicle.coasting = true.into(),
            NotReady::Sight,
        ),
        (
            "not converged",
            |flown| flown.vehicle.position_sigma = 0.021,
            NotReady::Estimate,
        ),
        (
            "it lies on its side",
            |flown| flown.vehicle.world_from_body = TILTED,
            NotReady::Level,
        ),
        (
            "it falls",
            |flown| flown.vehicle.velocity_body = [0.0, 0.0, 0.6],
            NotReady::Motion,
        ),
        (
            "the transmitter lacks an input",
            |flown| flown.frame.inputs_fresh = false.into(),
            NotReady::Transmitter,
        ),
        (
            "it demands to land",
            |flown| flown.frame.action = RcFrame::ACTION_LAND,
            NotReady::Demand,
        ),
        (
            "it has killed",
            |flown| flown.frame.action = RcFrame::ACTION_KILL,
            NotReady::Demand,
        ),
        (
            "frames are none of a link",
            |flown| flown.frame.mode = 9,
            NotReady::Transmitter,
        ),
        (
            "frames hold no numbers",
            |flown| flown.frame.thrust = f64::NAN,
            NotReady::Transmitter,
        ),
    ];
    for (words, spoil, not_ready) in spoilers {
        let mut flown = FlownPath::eight();
        for _ in 0..3000 {
            spoil(&mut flown);
            assert_eq!(flown.step(ARMED).phase, PathReference::PHASE_DISARMED, "{words}");
        }
        if !matches!(flown.frame.action, RcFrame::ACTION_LAND | RcFrame::ACTION_KILL) {
            assert_eq!(flown.reference.cause, not_ready.cause(), "{words}");
        }
        let mut flown = FlownPath::eight();
        flown.until(ARMED, PathReference::PHASE_ARMED);
        // An unreadable frame counts as none: the last good one is recent for a tenth of a second.
        for _ in 0..200 {
            spoil(&mut flown);
            flown.step(ARMED);
        }
        assert_eq!(
            flown.reference.phase,
            PathReference::PHASE_DISARMED,
            "{words}, when armed"
        );
    }
    for operator in [
        DISARMED,
        TO_LAND,
        Operator {
            killed: true,
            ..ARMED
        },
    ] {
        let mut flown = FlownPath::eight();
        flown.for_seconds(operator, 2.0);
        assert_eq!(flown.phases, [PathReference::PHASE_DISARMED], "{operator:?}");
    }
}

#[test]
fn without_frames_or_with_old_ones_nothing_arms() {
    for frame in [None, Some(idle_frame())] {
        let scenario = phased(paper_path());
        let mut generator = PathGeneratorService::new(&scenario).unwrap();
        for tick in 200..2000 {
            let now = Now {
                tick,
                time_ns: tick * TICK_NS,
                elapsed_ns: TICK_NS,
                operator: ARMED,
            };
            let mut state = at_rest_on_the_ground();
            state.header.stamp_ns = now.time_ns;
            let reference = step_in_phases(&mut generator, &now, Some(&state), frame.as_ref());
            assert_eq!(reference.phase, PathReference::PHASE_DISARMED);
        }
    }
}

#[test]
fn a_take_off_that_does_not_lift_off_is_given_up_and_needs_a_new_arming() {
    let mut flown = FlownPath::eight();
    flown.lifts = false;
    flown.until(ARMED, PathReference::PHASE_TAKE_OFF);
    let from = flown.tick;
    flown.until(ARMED, PathReference::PHASE_DISARMED);
    assert!((flown.tick - from) as f64 * H > ARRIVAL_TIMEOUT);
    flown.for_seconds(ARMED, 3.0);
    assert_eq!(flown.reference.phase, PathReference::PHASE_DISARMED);
    assert_eq!(flown.reference.cause, PathReference::CAUSE_OVERDUE);
    flown.until(ARMED_AGAIN, PathReference::PHASE_ARMED);
}

#[test]
fn once_armed_has_been_left_nothing_arms_without_a_new_request() {
    let mut flown = FlownPath::eight();
    flown.until(ARMED, PathReference::PHASE_ARMED);
    flown.vehicle.tracked = false.into();
    flown.for_seconds(ARMED, 0.3);
    assert_eq!(
        (flown.reference.phase, flown.reference.cause),
        (
            PathReference::PHASE_DISARMED,
            PathReference::CAUSE_NOT_READY_SIGHT
        )
    );
    flown.vehicle.tracked = true.into();
    flown.for_seconds(ARMED, 20.0);
    assert_eq!(
        flown.phases,
        [PathReference::PHASE_ARMED, PathReference::PHASE_DISARMED]
    );
    flown.until(ARMED_AGAIN, PathReference::PHASE_TAKE_OFF);
}

#[test]
fn a_request_to_arm_waits_half_a_second_for_readiness_and_lapses_then() {
    for (blind_ticks, expected) in [
        (499, PathReference::PHASE_ARMED),
        (501, PathReference::PHASE_DISARMED),
    ] {
        let mut flown = FlownPath::eight();
        flown.for_seconds(Operator::default(), 1.0);
        flown.vehicle.tracked = false.into();
        flown.for_seconds(ARMED, f64::from(blind_ticks) * H + 0.1 * H);
        flown.vehicle.tracked = true.into();
        flown.step(ARMED);
        assert_eq!(flown.reference.phase, expected, "{blind_ticks}");
        let lapsed = expected == PathReference::PHASE_DISARMED;
        assert_eq!(
            flown.reference.cause == PathReference::CAUSE_NOT_READY_SIGHT,
            lapsed
        );
        if lapsed {
            flown.for_seconds(ARMED, 5.0);
            assert_eq!(flown.phases, [PathReference::PHASE_DISARMED]);
            flown.until(ARMED_AGAIN, PathReference::PHASE_ARMED);
        }
    }
}

#[test]
fn a_request_to_arm_made_in_the_air_does_not_arm_after_the_landing() {
    for made_in in [
        PathReference::PHASE_ARMED,
        PathReference::PHASE_TAKE_OFF,
        PathReference::PHASE_FLY,
        PathReference::PHASE_LAND,
    ] {
        let mut flown = FlownPath::eight();
        let mut operator = ARMED;
        for phase in PathReference::PHASE_ARMED..=PathReference::PHASE_LAND {
            operator.land = phase == PathReference::PHASE_LAND;
            flown.until(operator, phase);
            if phase == made_in {
                operator.arm_count = 2;
                flown.step(operator);
            }
        }
        flown.until(operator, PathReference::PHASE_DISARMED);
        assert_eq!(flown.reference.cause, PathReference::CAUSE_TOUCHED_DOWN);
        operator.land = false;
        flown.for_seconds(operator, 3.0);
        assert_eq!(
            flown.reference.phase,
            PathReference::PHASE_DISARMED,
            "made in {made_in}"
        );
    }
}

#[test]
fn a_path_generator_that_has_lost_its_state_takes_no_earlier_request_to_arm() {
    let mut flown = FlownPath::eight();
    flown.for_seconds(Operator::default(), 1.0);
    flown.generator = PathGeneratorService::new(&flown.scenario).unwrap();
    flown.for_seconds(ARMED, 5.0);
    assert_eq!(flown.phases, [PathReference::PHASE_DISARMED]);
    flown.until(ARMED_AGAIN, PathReference::PHASE_TAKE_OFF);
}

#[test]
fn the_reference_states_which_of_several_conditions_has_disarmed_or_landed() {
    let killed = Operator {
        killed: true,
        ..ARMED
    };
    let disarmed_and_killed = Operator {
        armed: false,
        ..killed
    };
    let box_kill = (RcFrame::ACTION_KILL, RcFrame::LIMIT_BOX);
    let box_land = (RcFrame::ACTION_LAND, RcFrame::LIMIT_BOX);
    let none = (RcFrame::ACTION_NONE, RcFrame::LIMIT_NONE);
    let silent_kill = (RcFrame::ACTION_KILL, RcFrame::LIMIT_NONE);
    for (operator, (action, limit), cause) in [
        (killed, none, PathReference::CAUSE_OPERATOR_KILLS),
        (ARMED, silent_kill, PathReference::CAUSE_OPERATOR_KILLS),
        (killed, silent_kill, PathReference::CAUSE_OPERATOR_KILLS),
        (disarmed_and_killed, none, PathReference::CAUSE_OPERATOR_KILLS),
        (DISARMED, none, PathReference::CAUSE_OPERATOR_DISARMS),
        (DISARMED, box_land, PathReference::CAUSE_OPERATOR_DISARMS),
        (
            killed,
            box_kill,
            PathReference::CAUSE_ENVELOPE_KILLS + RcFrame::LIMIT_BOX,
        ),
        (TO_LAND, none, PathReference::CAUSE_OPERATOR_LANDS),
        (TO_LAND, box_land, PathReference::CAUSE_OPERATOR_LANDS),
        (
            ARMED,
            box_land,
            PathReference::CAUSE_ENVELOPE_LANDS + RcFrame::LIMIT_BOX,
        ),
    ] {
        let mut flown = FlownPath::eight();
        flown.until(ARMED, PathReference::PHASE_FLY);
        assert_eq!(flown.reference.cause, PathReference::CAUSE_NONE);
        (flown.frame.action, flown.frame.limit) = (action, limit);
        assert_eq!(flown.step(operator).cause, cause, "{operator:?} {action} {limit}");
    }
}

#[test]
fn a_kill_at_the_step_of_the_touch_down_is_a_kill() {
    let mut flown = FlownPath::eight();
    flown.until(ARMED, PathReference::PHASE_FLY);
    flown.until(TO_LAND, PathReference::PHASE_LAND);
    while flown.reference.airborne.is_set() {
        flown.step(TO_LAND);
    }
    // One step before the touch-down is complete.
    flown.for_seconds(TO_LAND, STANDING - 2.5 * H);
    assert_eq!(flown.reference.phase, PathReference::PHASE_LAND);
    let mut undisturbed = flown.step(TO_LAND);
    while undisturbed.phase == PathReference::PHASE_LAND {
        let memory = Service::save(&flown.generator);
        let mut killed = PathGeneratorService::new(&flown.scenario).unwrap();
        Service::restore(&mut killed, &memory);
        std::mem::swap(&mut flown.generator, &mut killed);
        let (tick, vehicle, frame) = (flown.tick, flown.vehicle, flown.frame);
        let at_the_kill = flown.step(Operator {
            killed: true,
            ..TO_LAND
        });
        assert_eq!(at_the_kill.cause, PathReference::CAUSE_OPERATOR_KILLS);
        flown.generator = killed;
        (flown.tick, flown.vehicle, flown.frame) = (tick, vehicle, frame);
        undisturbed = flown.step(TO_LAND);
    }
    assert_eq!(undisturbed.cause, PathReference::CAUSE_TOUCHED_DOWN);
}

#[test]
fn a_landing_begins_anywhere_without_a_jump_and_on_the_ground_it_disarms() {
    // Before lift-off, on the way up, on the way to the path.
    for (after, expected) in [
        (0.05, PathReference::PHASE_DISARMED),
        (2.2, PathReference::PHASE_LAND),
        (6.5, PathReference::PHASE_LAND),
    ] {
        let mut flown = FlownPath::eight();
        flown.until(ARMED, PathReference::PHASE_TAKE_OFF);
        flown.for_seconds(ARMED, after);
        assert_eq!(flown.reference.phase, PathReference::PHASE_TAKE_OFF);
        let [_, before, _] = motion(&flown.reference);
        let reference = flown.step(TO_LAND);
        assert_eq!(reference.phase, expected, "{after} s");
        if expected == PathReference::PHASE_LAND {
            assert!(distance(motion(&reference)[1], before) < 2.0 * H);
            flown.until(TO_LAND, PathReference::PHASE_DISARMED);
        }
    }
}

#[test]
fn the_transmitters_demand_lands_and_its_kill_disarms() {
    let mut flown = FlownPath::eight();
    flown.until(ARMED, PathReference::PHASE_FLY);
    flown.frame.action = RcFrame::ACTION_LAND;
    assert_eq!(flown.step(ARMED).phase, PathReference::PHASE_LAND);
    // The demand is withdrawn; the landing is not.
    flown.frame.action = RcFrame::ACTION_NONE;
    flown.until(ARMED, PathReference::PHASE_DISARMED);
    flown.for_seconds(ARMED, 3.0);
    assert_eq!(flown.reference.phase, PathReference::PHASE_DISARMED);

    let mut killed = FlownPath::eight();
    killed.until(ARMED, PathReference::PHASE_FLY);
    killed.frame.action = RcFrame::ACTION_KILL;
    assert_eq!(killed.step(ARMED).phase, PathReference::PHASE_DISARMED);
}

#[test]
fn a_kill_or_a_disarming_disarms_from_every_phase() {
    for phase in [
        PathReference::PHASE_ARMED,
        PathReference::PHASE_TAKE_OFF,
        PathReference::PHASE_FLY,
    ] {
        for operator in [
            DISARMED,
            Operator {
                killed: true,
                ..ARMED
            },
        ] {
            let mut flown = FlownPath::eight();
            flown.until(ARMED, phase);
            assert_eq!(flown.step(operator).phase, PathReference::PHASE_DISARMED);
        }
    }
}

#[test]
fn a_step_in_any_phase_allocates_nothing() {
    let mut flown = FlownPath::eight();
    let scenario = flown.scenario.clone();
    let mut generator = PathGeneratorService::new(&scenario).unwrap();
    let count = allocations_during(|| {
        for tick in 0..30_000 {
            let operator = if tick < 15_000 { ARMED } else { TO_LAND };
            let now = Now {
                tick,
                time_ns: tick * TICK_NS,
                elapsed_ns: tick.min(1) * TICK_NS,
                operator,
            };
            for header in [&mut flown.vehicle.header, &mut flown.frame.header] {
                (header.seq, header.stamp_ns) = (tick, now.time_ns);
            }
            flown.reference = step_in_phases(&mut generator, &now, Some(&flown.vehicle), Some(&flown.frame));
            flown.follow();
        }
    });
    assert_eq!((count, flown.reference.phase), (0, PathReference::PHASE_DISARMED));
}
