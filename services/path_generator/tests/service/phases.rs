//! Flights from the ground to the path and back: phases in their order, references without jumps.

use path_generator::PathGeneratorService;
use path_generator::phases::{LIFTED, PATIENCE, PhasesMemory, STANDING};
use scenario::{Curve, Flight, Path, PathMode, Scenario, TiltedEight};
use shared_types::flight_phase::NotReady;
use shared_types::path_stop::{BRAKE, BRAKE_AFTER};
use shared_types::samples::{PathReference, RcFrame, VehicleState};
use shared_types::service::{Now, Operator, Service};
use zerocopy::FromZeros;

use crate::allocations::allocations_during;
use crate::flight::{TICK_NS, paper_path, scenario, step_in_phases, vehicle};
use crate::restart::restarted;

const H: f64 = 1e-3;
/// Place of the vehicle at the start, away from the begin of the path.
const PLACE: [f64; 3] = [0.5, 0.4, 0.1];
const ARMED: Operator = Operator::FLYING;
const DISARMED: Operator = Operator {
    armed: false,
    ..ARMED
};
const TO_LAND: Operator = Operator { land: true, ..ARMED };
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
/// A second request to arm.
const ARMED_AGAIN: Operator = Operator {
    arm_count: 2,
    ..ARMED
};

fn phased(path: Path) -> Scenario {
    Scenario {
        flight: Some(Flight::default()),
        ..scenario(path)
    }
}

/// Path generator with a vehicle that follows its reference exactly, except on the ground.
struct FlownPath {
    scenario: Scenario,
    generator: PathGeneratorService,
    tick: u64,
    vehicle: VehicleState,
    frame: RcFrame,
    reference: PathReference,
    /// `true` if the motors can lift it.
    lifts: bool,
    phases: Vec<u8>,
}

fn at_rest_on_the_ground() -> VehicleState {
    vehicle(PLACE, [0.0; 3])
}

fn idle_frame() -> RcFrame {
    RcFrame {
        inputs_fresh: true.into(),
        failsafe: true.into(),
        ..RcFrame::new_zeroed()
    }
}

impl FlownPath {
    fn new(path: Path) -> Self {
        let scenario = phased(path);
        Self {
            generator: PathGeneratorService::new(&scenario).unwrap(),
            scenario,
            tick: 0,
            vehicle: at_rest_on_the_ground(),
            frame: idle_frame(),
            reference: PathReference::new_zeroed(),
            lifts: true,
            phases: Vec::new(),
        }
    }

    fn eight() -> Self {
        Self::new(paper_path())
    }

    /// Makes one tick; the path generator is killed and restarted before it.
    fn step(&mut self, operator: Operator) -> PathReference {
        self.step_after(self.tick.min(1), operator)
    }

    /// Makes one tick, so many after the one before it.
    fn step_after(&mut self, ticks: u64, operator: Operator) -> PathReference {
        self.generator = restarted(
            &self.generator,
            PathGeneratorService::new(&self.scenario).unwrap(),
        );
        let now = Now {
            tick: self.tick,
            time_ns: self.tick * TICK_NS,
            elapsed_ns: ticks * TICK_NS,
            operator,
        };
        for header in [&mut self.vehicle.header, &mut self.frame.header] {
            (header.seq, header.stamp_ns) = (self.tick, now.time_ns);
        }
        let (state, frame) = (self.vehicle, self.frame);
        self.reference = step_in_phases(&mut self.generator, &now, Some(&state), Some(&frame));
        self.tick += 1;
        if self.phases.last() != Some(&self.reference.phase) {
            self.phases.push(self.reference.phase);
        }
        self.follow();
        self.reference
    }

    /// Moves the vehicle to its reference; on the ground it stands, and the law commands less thrust the deeper the
    /// reference is.
    fn follow(&mut self) {
        let reference = &self.reference;
        let is_led = reference.phase >= PathReference::PHASE_TAKE_OFF;
        let mut position = reference.position_world;
        let depth = position[2] - PLACE[2];
        self.frame.thrust = match (is_led, depth > 0.0) {
            (false, _) => 0.0,
            (true, false) => 2.0,
            (true, true) => 2.0 / (1.0 + 10.0 * depth),
        };
        self.frame.failsafe = (reference.phase == PathReference::PHASE_DISARMED).into();
        position[2] = position[2].min(PLACE[2]);
        if is_led && self.lifts {
            let [.., rise] = motion(reference)[1];
            self.vehicle.position_world = position;
            self.vehicle.velocity_body = [0.0, 0.0, if depth < 0.0 { rise } else { 0.0 }];
        }
    }

    fn until(&mut self, operator: Operator, phase: u8) {
        for _ in 0..60_000 {
            if self.step(operator).phase == phase {
                return;
            }
        }
        panic!("phase {phase} never comes: {:?}", self.phases);
    }

    fn for_seconds(&mut self, operator: Operator, seconds: f64) {
        for _ in 0..(seconds / H) as u64 {
            self.step(operator);
        }
    }

    fn gamma(&self) -> f64 {
        Service::save(&self.generator).motion.gamma
    }
}

/// Position, velocity and acceleration of a reference in {I}.
fn motion(reference: &PathReference) -> [[f64; 3]; 3] {
    let (rate, change) = (reference.gamma_dot, reference.gamma_ddot);
    let [first, second] = [reference.derivative1_world, reference.derivative2_world];
    [
        reference.position_world,
        first.map(|d| d * rate),
        std::array::from_fn(|axis| second[axis] * rate * rate + first[axis] * change),
    ]
}

fn speed(reference: &PathReference) -> f64 {
    distance(motion(reference)[1], [0.0; 3])
}

fn distance(a: [f64; 3], b: [f64; 3]) -> f64 {
    a.iter()
        .zip(b)
        .map(|(a, b)| (a - b) * (a - b))
        .sum::<f64>()
        .sqrt()
}

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
    assert!((flown.tick - from) as f64 * H > PATIENCE);
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
    for (knows_ground, above, unseen, phase) in [
        (true, 0.0, 600, PathReference::PHASE_DISARMED),
        (true, 0.03, 600, PathReference::PHASE_DISARMED),
        (true, 0.0, 300, PathReference::PHASE_LAND),
        (true, -0.3, 600, PathReference::PHASE_TAKE_OFF),
        (true, 0.3, 600, PathReference::PHASE_TAKE_OFF),
        (false, 0.0, 600, PathReference::PHASE_TAKE_OFF),
        (false, -0.5, 600, PathReference::PHASE_TAKE_OFF),
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
        let found = flown.step(ARMED).phase;
        assert_eq!(
            found, phase,
            "{above} m above, unseen for {unseen} ms, ground known: {knows_ground}"
        );
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
