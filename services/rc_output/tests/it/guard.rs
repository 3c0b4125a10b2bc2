//! Frames that the transmitter must never send: before the arming, after a kill, and beyond the envelope.

use proptest::prelude::*;
use rc_output::RcOutputService;
use scenario::Scenario;
use shared_types::Header;
use shared_types::flight_phase::GROUNDED_AFTER;
use shared_types::sample::Field;
use shared_types::samples::{ControlCommand, RcFrame, VehicleState};
use shared_types::service::{ErasedService, InputView, OutputSlot};
use shared_types::{Now, Operator};
use zerocopy::{FromZeros, IntoBytes};

const TICK_NS: u64 = 1_000_000;
const FLIGHT: &str = "[flight]\narm_at = 0.0";
const ARMED: Operator = Operator::FLYING;
const DISARMED: Operator = Operator {
    armed: false,
    ..ARMED
};
const ARMED_AGAIN: Operator = Operator {
    arm_count: 2,
    ..ARMED
};
const KILLED: Operator = Operator {
    killed: true,
    ..ARMED
};

fn scenario(sections: &str) -> Scenario {
    let head = "duration = 9.0\n\
                vehicle = { mass = 0.2, inertia = [6.5e-4, 6.5e-4, 13.0e-4] }\n\
                path.curve.hover.position = [0.0, 0.0, -1.0]\n";
    let scenario: Scenario = toml::from_str(&(head.to_owned() + sections)).unwrap();
    assert_eq!(scenario.problems(), []);
    scenario
}

/// All limits, with one action.
fn envelope(action: &str) -> String {
    format!(
        "{FLIGHT}\n[envelope]\nafter = 0.02\nland_within = 1.0\n\
         box = {{ min = [-1.0, -1.0, -2.0], max = [1.0, 1.0, 1.0], margin = 0.5, action = \"{action}\" }}\n\
         tilt = {{ max = 0.8, action = \"{action}\" }}\n\
         speed = {{ max = 2.0, action = \"{action}\" }}\n\
         estimate = {{ position_sigma = 0.05, action = \"{action}\" }}\n\
         thrust = {{ max = 4.0, action = \"{action}\" }}\n\
         torque = {{ max = [0.1, 0.1, 0.05], action = \"{action}\" }}\n"
    )
}

fn command(thrust: f64) -> ControlCommand {
    ControlCommand {
        thrust,
        torque_body: [0.01, -0.01, 0.0],
        mode: ControlCommand::MODE_TORQUE,
        ..ControlCommand::new_zeroed()
    }
}

fn failsafe_command() -> ControlCommand {
    ControlCommand {
        mode: ControlCommand::MODE_FAILSAFE,
        ..ControlCommand::new_zeroed()
    }
}

/// Level, at rest, in the middle of the box.
fn state() -> VehicleState {
    VehicleState {
        world_from_body: [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
        tracked: true.into(),
        ..VehicleState::new_zeroed()
    }
}

/// Transmitter with the time that has passed. It is killed and restarted before each step.
struct Transmitter {
    scenario: Scenario,
    service: RcOutputService,
    tick: u64,
}

impl Transmitter {
    fn new(sections: &str) -> Self {
        let scenario = scenario(sections);
        Self {
            service: RcOutputService::new(&scenario),
            scenario,
            tick: 0,
        }
    }

    /// Header of a sample that is published at this tick.
    fn header(&self) -> Header {
        Header {
            tick: self.tick,
            seq: self.tick,
            stamp_ns: self.tick * TICK_NS,
        }
    }

    /// One step on samples that are published at this tick.
    fn step(&mut self, operator: Operator, command: &ControlCommand, state: &VehicleState) -> RcFrame {
        let (mut command, mut state) = (*command, *state);
        (command.header, state.header) = (self.header(), self.header());
        self.step_on(operator, Some(&command), Some(&state))
    }

    /// One step on samples as they are.
    fn step_on(
        &mut self,
        operator: Operator,
        command: Option<&ControlCommand>,
        state: Option<&VehicleState>,
    ) -> RcFrame {
        self.service = crate::restart::restarted(&self.service, RcOutputService::new(&self.scenario));
        let now = Now {
            tick: self.tick,
            time_ns: self.tick * TICK_NS,
            elapsed_ns: TICK_NS,
            operator,
        };
        let mut frame = RcFrame::new_zeroed();
        let view = |bytes| InputView { bytes, fresh: true };
        let inputs = [
            view(command.map(IntoBytes::as_bytes)),
            view(state.map(IntoBytes::as_bytes)),
        ];
        let mut outputs = [OutputSlot {
            bytes: Some(frame.as_mut_bytes()),
        }];
        ErasedService::step(&mut self.service, &now, &inputs, &mut outputs);
        self.tick += 1;
        frame
    }

    fn steps(&mut self, count: u64, command: &ControlCommand, state: &VehicleState) -> RcFrame {
        self.steps_of(ARMED, count, command, state)
    }

    fn steps_of(
        &mut self,
        operator: Operator,
        count: u64,
        command: &ControlCommand,
        state: &VehicleState,
    ) -> RcFrame {
        let frames = (0..count).map(|_| self.step(operator, command, state));
        frames.last().unwrap()
    }
}

fn rests(frame: &RcFrame) -> bool {
    frame.failsafe.is_set()
        && frame.stage == RcFrame::STAGE_FAILSAFE
        && (frame.thrust, frame.torque_body, frame.rates_body) == (0.0, [0.0; 3], [0.0; 3])
}

#[test]
fn only_failsafe_frames_are_sent_before_the_arming_and_when_it_is_taken_back() {
    for sections in ["", FLIGHT, &envelope("warn")] {
        let mut transmitter = Transmitter::new(sections);
        for _ in 0..50 {
            assert!(rests(&transmitter.step(
                Operator::default(),
                &command(2.0),
                &state()
            )));
        }
        assert_eq!(transmitter.step(ARMED, &command(2.0), &state()).thrust, 2.0);
        assert!(rests(&transmitter.step(DISARMED, &command(2.0), &state())));
    }
}

#[test]
fn after_the_arming_and_after_a_cold_start_frames_wait_for_recent_inputs() {
    for sections in [FLIGHT, &envelope("warn")] {
        let mut transmitter = Transmitter::new(sections);
        // Samples from long ago, when no transmitter was there to send them.
        let (old_command, old_state) = (command(2.0), state());
        transmitter.tick = 500;
        for _ in 0..50 {
            let frame = transmitter.step_on(ARMED, Some(&old_command), Some(&old_state));
            assert!(rests(&frame) && !frame.inputs_fresh.is_set());
        }
        assert!(rests(&transmitter.step_on(ARMED, None, None)));
        let frame = transmitter.step(ARMED, &command(2.0), &state());
        assert!(!rests(&frame) && frame.inputs_fresh.is_set());
    }
    // With an envelope the state is one of them.
    let mut blind = Transmitter::new(&envelope("warn"));
    let untracked = VehicleState {
        tracked: false.into(),
        ..state()
    };
    assert!(rests(&blind.steps(50, &command(2.0), &untracked)));
}

#[test]
fn a_kill_is_for_ever() {
    for sections in ["", FLIGHT, &envelope("warn")] {
        let mut transmitter = Transmitter::new(sections);
        assert!(!rests(&transmitter.step(ARMED, &command(2.0), &state())));
        let frame = transmitter.step(KILLED, &command(2.0), &state());
        assert!(rests(&frame));
        assert_eq!(
            (frame.limit, frame.action),
            (RcFrame::LIMIT_NONE, RcFrame::ACTION_KILL)
        );
        for operator in [ARMED, DISARMED, ARMED, KILLED, ARMED] {
            assert!(rests(&transmitter.step(operator, &command(2.0), &state())));
        }
    }
}

#[test]
fn the_operators_kill_survives_a_cold_start_of_the_transmitter() {
    let mut transmitter = Transmitter::new(FLIGHT);
    transmitter.step(KILLED, &command(2.0), &state());
    transmitter.service = RcOutputService::new(&transmitter.scenario);
    assert!(rests(&transmitter.step(KILLED, &command(2.0), &state())));
}

/// Commands and states that exceed each limit, and no other.
fn excesses() -> [(u8, ControlCommand, VehicleState); 8] {
    let tilted = libm::sincos(0.9);
    let with_state = |change: fn(&mut VehicleState)| {
        let mut state = state();
        change(&mut state);
        state
    };
    let tilt = VehicleState {
        world_from_body: [1.0, 0.0, 0.0, 0.0, tilted.1, -tilted.0, 0.0, tilted.0, tilted.1],
        ..state()
    };
    let torque = ControlCommand {
        torque_body: [0.0, 0.0, -0.06],
        ..command(2.0)
    };
    [
        (
            RcFrame::LIMIT_BOX,
            command(2.0),
            with_state(|state| state.position_world[1] = -1.2),
        ),
        (RcFrame::LIMIT_TILT, command(2.0), tilt),
        (
            RcFrame::LIMIT_SPEED,
            command(2.0),
            with_state(|state| state.velocity_body = [1.5, 0.0, -1.5]),
        ),
        (
            RcFrame::LIMIT_ESTIMATE,
            command(2.0),
            with_state(|state| state.position_sigma = 0.06),
        ),
        (
            RcFrame::LIMIT_ESTIMATE,
            command(2.0),
            with_state(|state| state.tracked = false.into()),
        ),
        (
            RcFrame::LIMIT_ESTIMATE,
            command(2.0),
            with_state(|state| state.velocity_body[0] = f64::NAN),
        ),
        (RcFrame::LIMIT_THRUST, command(4.1), state()),
        (RcFrame::LIMIT_TORQUE, torque, state()),
    ]
}

#[test]
fn every_limit_takes_its_action_after_the_stated_time_and_not_before() {
    for (action, code) in [
        ("warn", RcFrame::ACTION_WARN),
        ("land", RcFrame::ACTION_LAND),
        ("kill", RcFrame::ACTION_KILL),
    ] {
        for (limit, command, state) in excesses() {
            let mut transmitter = Transmitter::new(&envelope(action));
            let calm = transmitter.steps(5, &self::command(2.0), &self::state());
            assert_eq!(
                (calm.limit, calm.action),
                (RcFrame::LIMIT_NONE, RcFrame::ACTION_NONE)
            );
            // A state that is not a number has an effect when the one before it has become old.
            let is_none = state.velocity_body[0].is_nan();
            let patience = if is_none { 100 } else { 0 };
            let brief = transmitter.steps(20, &command, &state);
            assert_eq!(brief.action, RcFrame::ACTION_NONE, "{action} {limit}");
            let acting = transmitter.steps(1 + patience, &command, &state);
            assert_eq!((acting.limit, acting.action), (limit, code));
            assert_eq!(rests(&acting), code == RcFrame::ACTION_KILL);
            // A warning ends with its reason; the others do not.
            let after = transmitter.steps(2, &self::command(2.0), &self::state());
            let lasts = code != RcFrame::ACTION_WARN;
            let expected = if lasts {
                (limit, code)
            } else {
                (RcFrame::LIMIT_NONE, RcFrame::ACTION_NONE)
            };
            assert_eq!((after.limit, after.action), expected);
        }
    }
}

#[test]
fn an_excess_with_breaks_does_not_count() {
    let mut transmitter = Transmitter::new(&envelope("kill"));
    for _ in 0..20 {
        for (_, command, state) in excesses()
            .into_iter()
            .filter(|(.., state)| !state.velocity_body[0].is_nan())
        {
            assert_eq!(
                transmitter.steps(19, &command, &state).action,
                RcFrame::ACTION_NONE
            );
            transmitter.steps(1, &self::command(2.0), &self::state());
        }
    }
}

#[test]
fn of_several_excesses_the_gravest_action_counts() {
    let sections = envelope("warn").replace(
        "speed = { max = 2.0, action = \"warn\"",
        "speed = { max = 2.0, action = \"kill\"",
    );
    let mut transmitter = Transmitter::new(&sections);
    let far_and_fast = VehicleState {
        position_world: [9.0, 0.0, 0.0],
        velocity_body: [3.0, 0.0, 0.0],
        ..state()
    };
    let frame = transmitter.steps(30, &command(9.0), &far_and_fast);
    assert_eq!(
        (frame.limit, frame.action),
        (RcFrame::LIMIT_SPEED, RcFrame::ACTION_KILL)
    );
}

#[test]
fn a_demand_to_land_lasts_until_the_vehicle_rests() {
    let mut transmitter = Transmitter::new(&envelope("land"));
    let outside = VehicleState {
        position_world: [1.1, 0.0, 0.0],
        ..state()
    };
    transmitter.steps(30, &command(2.0), &outside);
    assert_eq!(
        transmitter.steps(500, &command(2.0), &state()).action,
        RcFrame::ACTION_LAND
    );
    let rest = (GROUNDED_AFTER * 1e3) as u64;
    let landing = transmitter.steps(rest, &failsafe_command(), &state());
    assert_eq!(
        (landing.limit, landing.action, rests(&landing)),
        (RcFrame::LIMIT_BOX, RcFrame::ACTION_LAND, true)
    );
    let landed = transmitter.steps(1, &failsafe_command(), &state());
    assert_eq!(
        (landed.limit, landed.action, rests(&landed)),
        (RcFrame::LIMIT_NONE, RcFrame::ACTION_NONE, true)
    );
}

#[test]
fn a_vehicle_that_has_landed_as_demanded_is_not_killed_for_the_time_it_rests() {
    let mut transmitter = Transmitter::new(&envelope("land"));
    let outside = VehicleState {
        position_world: [1.1, 0.0, 0.0],
        ..state()
    };
    transmitter.steps(900, &command(2.0), &outside);
    let landed = transmitter.steps(1000, &failsafe_command(), &outside);
    assert_eq!(landed.action, RcFrame::ACTION_LAND, "past its time to land");
    let moved_again = transmitter.steps(1, &command(2.0), &outside);
    assert_eq!(
        (moved_again.limit, moved_again.action),
        (RcFrame::LIMIT_LANDING_TIME, RcFrame::ACTION_KILL)
    );
}

/// All outputs of a controller: none, stop, motion in every mode, invalid ones.
fn hostile_commands() -> impl Strategy<Value = Option<ControlCommand>> {
    let mode = prop_oneof![
        Just(ControlCommand::MODE_FAILSAFE),
        Just(ControlCommand::MODE_TORQUE),
        Just(ControlCommand::MODE_RATES),
        any::<u32>(),
    ];
    let thrust = prop_oneof![Just(0.0), Just(4.0), 0.0..10.0f64, Just(f64::NAN)];
    prop::option::weighted(
        0.9,
        (mode, thrust).prop_map(|(mode, thrust)| ControlCommand {
            mode,
            ..command(thrust)
        }),
    )
}

/// Patterns of up to 12 steps that a controller repeats, with a first command that moves the vehicle.
fn hostile_patterns() -> impl Strategy<Value = Vec<Option<ControlCommand>>> {
    prop::collection::vec(hostile_commands(), 1..12)
}

/// A fault of the vehicle's state.
fn excess_of_state(kind: usize) -> (u8, VehicleState) {
    let (limit, _, state) = excesses()[kind];
    (limit, state)
}

proptest! {
    #[test]
    fn for_any_commands_limits_of_the_state_act_in_their_time(
        pattern in hostile_patterns(), kind in 0..3usize, land in any::<bool>(),
    ) {
        let action = if land { "land" } else { "kill" };
        let mut transmitter = Transmitter::new(&envelope(action));
        transmitter.steps(5, &command(2.0), &state());
        let (limit, bad) = excess_of_state(kind);
        let mut commands = pattern.iter().cycle();
        for step in 0..200 {
            let frame = match commands.next().unwrap() {
                Some(command) => transmitter.step(ARMED, command, &bad),
                None => {
                    let state = VehicleState { header: transmitter.header(), ..bad };
                    transmitter.step_on(ARMED, None, Some(&state))
                }
            };
            if step < 20 {
                prop_assert!(frame.action <= RcFrame::ACTION_WARN);
            } else if land {
                prop_assert!(frame.action >= RcFrame::ACTION_LAND, "step {}", step);
            } else {
                prop_assert_eq!((frame.limit, frame.action), (limit, RcFrame::ACTION_KILL), "step {}", step);
                prop_assert!(rests(&frame));
            }
        }
    }

}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(32))]

    #[test]
    fn for_any_commands_the_vehicle_does_not_leave_the_box_upwards(pattern in hostile_patterns()) {
        // A point mass below its rotor, which follows the frames at once.
        let (mass, gravity, dt) = (0.2, 9.81, TICK_NS as f64 * 1e-9);
        let [mut z, mut velocity] = [0.0f64, 0.0];
        let mut transmitter = Transmitter::new(&envelope("kill"));
        let mut fastest_climb = 0.0f64;
        let commands = pattern.iter().cycle();
        for command in commands.take(6000) {
            let seen = VehicleState {
                header: transmitter.header(),
                position_world: [0.0, 0.0, z],
                velocity_body: [0.0, 0.0, velocity],
                ..state()
            };
            let command = command.map(|command| ControlCommand { header: seen.header, ..command });
            let frame = transmitter.step_on(ARMED, command.as_ref(), Some(&seen));
            velocity += (gravity - frame.thrust / mass) * dt;
            z += velocity * dt;
            if z >= 0.0 {
                (z, velocity) = (0.0, velocity.min(0.0));
            }
            fastest_climb = fastest_climb.max(-velocity);
        }
        // The speed is limited to 2 m/s, and the box ends at 2 m; both act after 0.02 s at the largest acceleration.
        let acceleration = 4.0 / mass - gravity;
        let fastest = 2.0 + acceleration * 0.022;
        prop_assert!(fastest_climb <= fastest, "{} m/s", fastest_climb);
    }
}

#[test]
fn a_vehicle_that_does_not_come_down_in_time_or_goes_on_leaving_is_killed() {
    let outside = |x: f64| VehicleState {
        position_world: [x, 0.0, 0.0],
        ..state()
    };
    let mut slow = Transmitter::new(&envelope("land"));
    slow.steps(30, &command(2.0), &outside(1.1));
    assert_eq!(
        slow.steps(980, &command(2.0), &outside(1.1)).action,
        RcFrame::ACTION_LAND
    );
    let killed = slow.steps(30, &command(2.0), &outside(1.1));
    assert_eq!(
        (killed.limit, killed.action, rests(&killed)),
        (RcFrame::LIMIT_LANDING_TIME, RcFrame::ACTION_KILL, true)
    );

    let mut leaving = Transmitter::new(&envelope("land"));
    leaving.steps(30, &command(2.0), &outside(1.4));
    let killed = leaving.step(ARMED, &command(2.0), &outside(1.6));
    assert_eq!(
        (killed.limit, killed.action),
        (RcFrame::LIMIT_BOX, RcFrame::ACTION_KILL)
    );
    // A limit without a landing does not kill.
    let mut warned = Transmitter::new(&envelope("warn"));
    assert_eq!(
        warned.steps(2000, &command(2.0), &outside(9.0)).action,
        RcFrame::ACTION_WARN
    );
}

#[test]
fn limits_are_not_checked_before_the_vehicle_moves_and_after_it_has_rested() {
    let mut transmitter = Transmitter::new(&envelope("kill"));
    let outside = VehicleState {
        position_world: [9.0, 0.0, 0.0],
        ..state()
    };
    assert_eq!(
        transmitter.steps(500, &failsafe_command(), &outside).action,
        RcFrame::ACTION_NONE
    );
    let rest = (GROUNDED_AFTER * 1e3) as u64;
    transmitter.steps(5, &command(2.0), &state());
    transmitter.steps(1 + rest, &failsafe_command(), &state());
    assert_eq!(
        transmitter.steps(500, &failsafe_command(), &outside).action,
        RcFrame::ACTION_NONE
    );
    transmitter.steps_of(ARMED_AGAIN, 21, &command(2.0), &outside);
    assert_eq!(
        transmitter
            .steps_of(ARMED_AGAIN, 1, &failsafe_command(), &state())
            .action,
        RcFrame::ACTION_KILL
    );
}

#[test]
fn an_arming_lapses_once_the_motors_have_rested() {
    let rest = (GROUNDED_AFTER * 1e3) as u64;
    for sections in [FLIGHT, &envelope("warn")] {
        for flown_for in [0, 300] {
            let mut transmitter = Transmitter::new(sections);
            if flown_for > 0 {
                transmitter.steps(flown_for, &command(2.0), &state());
            }
            transmitter.steps(rest, &failsafe_command(), &state());
            assert!(!rests(&transmitter.step(ARMED, &command(2.0), &state())));
            transmitter.steps(rest + 1, &failsafe_command(), &state());
            // Whatever the controller commands.
            assert!(rests(&transmitter.steps(5000, &command(2.0), &state())));
            assert!(!rests(&transmitter.step(ARMED_AGAIN, &command(2.0), &state())));
        }
    }
    // Without phases the flight is armed from its first tick to its last.
    let mut transmitter = Transmitter::new("");
    transmitter.steps(3 * rest, &failsafe_command(), &state());
    assert!(!rests(&transmitter.step(ARMED, &command(2.0), &state())));
}

#[test]
fn a_new_arming_has_all_of_its_time() {
    let rest = (GROUNDED_AFTER * 1e3) as u64;
    let mut transmitter = Transmitter::new(FLIGHT);
    transmitter.steps(rest - 1, &failsafe_command(), &state());
    transmitter.steps_of(ARMED_AGAIN, rest, &failsafe_command(), &state());
    assert!(!rests(&transmitter.step(ARMED_AGAIN, &command(2.0), &state())));
}

#[test]
fn a_limit_of_rates_cuts_them_on_the_radio_link() {
    let scenario: Scenario = toml::from_str(
        "duration = 9.0\n\
         vehicle = { mass = 0.2, inertia = [6.5e-4, 6.5e-4, 13.0e-4] }\n\
         path.curve.hover.position = [0.0, 0.0, -1.0]\n\
         rc_output = {}\n\
         envelope = { rates = { max = [2.0, 3.0, 1.0], action = \"kill\" } }",
    )
    .unwrap();
    let mut transmitter = Transmitter {
        service: RcOutputService::new(&scenario),
        scenario,
        tick: 0,
    };
    let spin = ControlCommand {
        rates_body: [-9.0, 2.9, 7.0],
        mode: ControlCommand::MODE_RATES,
        ..command(2.0)
    };
    let frame = transmitter.step(ARMED, &spin, &state());
    let step = 2.0 * 19.0 / 2047.0;
    for (sent, most) in frame.rates_body.iter().zip([-2.0, 2.9, 1.0]) {
        assert!((sent - most).abs() < step, "{sent} for {most}");
    }
    assert!(frame.saturated.is_set());
    assert!(rests(&transmitter.steps(60, &spin, &state())));
}

fn numbers() -> impl Strategy<Value = f64> {
    prop_oneof![
        -10.0..10.0f64,
        any::<f64>(),
        Just(f64::NAN),
        Just(f64::INFINITY),
        Just(f64::NEG_INFINITY),
        Just(f64::MAX),
    ]
}

proptest! {
    #[test]
    fn for_any_commands_the_sent_frames_are_within_the_limits(
        thrust in numbers(), torque_body in [numbers(), numbers(), numbers()], rates_body in [numbers(), numbers(), numbers()],
        mode in prop_oneof![0..4u32, any::<u32>()], position in [numbers(), numbers(), numbers()],
    ) {
        let mut transmitter = Transmitter::new(&envelope("warn"));
        transmitter.steps(3, &command(2.0), &state());
        let wild = ControlCommand { thrust, torque_body, rates_body, mode, ..ControlCommand::new_zeroed() };
        let somewhere = VehicleState { position_world: position, ..state() };
        for _ in 0..3 {
            let frame = transmitter.step(ARMED, &wild, &somewhere);
            prop_assert!(frame.is_finite());
            prop_assert!((0.0..=4.0).contains(&frame.thrust), "{}", frame.thrust);
            for (torque, most) in frame.torque_body.iter().zip([0.1, 0.1, 0.05]) {
                prop_assert!(torque.abs() <= most, "{}", torque);
            }
        }
    }
}
