//! Controller on states and references that are too old or impossible.

use controller::ControllerService;
use proptest::prelude::*;
use scenario::Scenario;
use shared_types::path_stop::{BRAKE, Stop};
use shared_types::rotation;
use shared_types::sample::Field;
use shared_types::samples::{ControlAdaptation, ControlCommand, PathReference, VehicleState};
use shared_types::service::InputView;
use zerocopy::{FromZeros, IntoBytes};

use crate::garbage::sample;
use crate::restart::restarted;
use crate::support::{Published, TICK_NS};

/// A policy with every stage, ages in s.
const POLICY: &str = r#""safety": {
    "vehicle/state -> controller": {
        "max_age": 0.02, "level": 0.05, "descend": 0.1, "failsafe": 0.3, "jump": 0.1, "recover": 0.04
    },
    "path/reference -> controller": {"max_age": 0.02}
},"#;

/// Scenario with commands of torque, or of body rates.
fn scenario(rates: bool, policy: &str) -> Scenario {
    let rig = if rates {
        r#""controller": {"rates": {}}, "model": {}, "rc_output": {}, "estimator": {"kalman": {}},"#
    } else {
        ""
    };
    serde_json::from_str(&format!(
        r#"{{
            "duration": 1, {policy} {rig}
            "vehicle": {{"mass": 0.2, "inertia": [6.5e-4, 6.5e-4, 13e-4]}},
            "path": {{"curve": {{"hover": {{"position": [0.0, 0.0, -1.0]}}}}}}
        }}"#
    ))
    .unwrap()
}

/// Body rates that are held for as long as the paper's radio holds them: the law is rolled out over many steps.
fn held_for_long(policy: &str) -> Scenario {
    let mut scenario = scenario(true, policy);
    for name in ["vehicle/state", "path_generator", "controller"] {
        scenario.schedule.period.insert(name.to_owned(), 0.022);
    }
    scenario
}

fn scenarios() -> [Scenario; 6] {
    [
        held_for_long(""),
        held_for_long(POLICY),
        scenario(false, ""),
        scenario(true, ""),
        scenario(false, POLICY),
        scenario(true, POLICY),
    ]
}

/// A vehicle that is slightly displaced and slowly swings.
fn state(tick: u64) -> VehicleState {
    let phase = 0.01 * tick as f64;
    let mut state = VehicleState::new_zeroed();
    (state.header.seq, state.header.stamp_ns) = (tick, tick * TICK_NS);
    state.state_time_ns = state.header.stamp_ns;
    state.position_world = [0.1, -0.05 + 0.01 * libm::sin(phase), -0.9];
    let attitude = rotation::from_roll_pitch_yaw([0.2 * libm::cos(phase), -0.1, 0.4]);
    state.world_from_body = rotation::to_row_major(&attitude);
    state.velocity_body = [0.1, 0.0, -0.1];
    state.angular_velocity_body = [-0.2 * libm::sin(phase), 0.0, 0.0];
    state.thrust = 1.9;
    state.tracked = true.into();
    state
}

fn reference(tick: u64) -> PathReference {
    let mut reference = PathReference::new_zeroed();
    (reference.header.seq, reference.header.stamp_ns) = (tick, tick * TICK_NS);
    reference.gamma = 1e-3 * tick as f64;
    (reference.gamma_dot, reference.gamma_dot_desired) = (1.0, 1.0);
    reference.position_world = [0.0, 0.0, -1.0];
    reference.derivative1_world = [0.3, 0.1, 0.0];
    reference.derivative2_world = [-0.3, -0.1, 0.2];
    reference.vehicle_known = true.into();
    reference
}

/// Makes one step on samples that are fresh in the tick of their publication.
fn step(
    service: &mut ControllerService,
    tick: u64,
    state: &VehicleState,
    reference: &PathReference,
) -> Published {
    let view = |bytes, stamp_ns| InputView {
        bytes: Some(bytes),
        fresh: stamp_ns == tick * TICK_NS,
    };
    let inputs = [
        view(state.as_bytes(), state.header.stamp_ns),
        view(reference.as_bytes(), reference.header.stamp_ns),
    ];
    crate::support::step(service, tick, inputs)
}

/// One controller that flies on, and one that is restarted before every step: their outputs must be equal.
struct Twins {
    scenario: Scenario,
    steady: ControllerService,
    restarted: ControllerService,
}

impl Twins {
    fn new(scenario: Scenario) -> Self {
        Self {
            steady: ControllerService::new(&scenario),
            restarted: ControllerService::new(&scenario),
            scenario,
        }
    }

    fn step(&mut self, tick: u64, state: &VehicleState, reference: &PathReference) -> Published {
        self.restarted = restarted(&self.restarted, ControllerService::new(&self.scenario));
        let again = step(&mut self.restarted, tick, state, reference);
        let published = step(&mut self.steady, tick, state, reference);
        assert_eq!(published.command.as_bytes(), again.command.as_bytes(), "{tick}");
        assert_eq!(
            published.adaptation.as_bytes(),
            again.adaptation.as_bytes(),
            "{tick}"
        );
        assert_eq!(published.errors.as_bytes(), again.errors.as_bytes(), "{tick}");
        published
    }
}

fn largest_difference(one: &ControlCommand, other: &ControlCommand) -> f64 {
    let pairs = one.torque_body.iter().zip(&other.torque_body);
    let pairs = pairs.chain(one.rates_body.iter().zip(&other.rates_body));
    pairs.fold((one.thrust - other.thrust).abs(), |most, (x, y)| {
        most.max((x - y).abs())
    })
}

#[test]
fn stages_begin_above_exactly_the_stated_ages_and_restart_in_any_changes_nothing() {
    for rates in [false, true] {
        let mut twins = Twins::new(scenario(rates, POLICY));
        let mut last = None;
        for tick in 0..=50 {
            last = Some(twins.step(tick, &state(tick), &reference(tick)));
        }
        for age in 1..400 {
            let tick = 50 + age;
            let published = twins.step(tick, &state(50), &reference(tick));
            let expected = match age {
                0..=20 => ControlAdaptation::STAGE_LAW,
                21..=50 => ControlAdaptation::STAGE_HOLD,
                51..=100 => ControlAdaptation::STAGE_LEVEL,
                101..=300 => ControlAdaptation::STAGE_DESCEND,
                _ => ControlAdaptation::STAGE_FAILSAFE,
            };
            assert_eq!(published.adaptation.stage, expected, "{age} ms");
            assert!(
                published.adaptation.resting.is_set(),
                "the estimates do not adapt without a measurement"
            );
            let is_failsafe = expected == ControlAdaptation::STAGE_FAILSAFE;
            assert_eq!(
                published.command.mode == ControlCommand::MODE_FAILSAFE,
                is_failsafe
            );
            assert_eq!(published.command.thrust == 0.0, is_failsafe);
            if expected == ControlAdaptation::STAGE_HOLD {
                let before: Published = last.unwrap();
                assert_eq!(largest_difference(&published.command, &before.command), 0.0);
                assert_eq!(published.errors.z2, [0.0; 3]);
            }
            last = Some(published);
        }
        let back = twins.step(450, &state(450), &reference(450));
        assert_eq!(back.adaptation.stage, ControlAdaptation::STAGE_LAW);
        assert!(
            back.command.thrust > 0.0,
            "the law takes over stopped motors at once"
        );
    }
}

#[test]
fn without_a_policy_no_state_and_no_reference_is_too_old() {
    for rates in [false, true] {
        let mut service = ControllerService::new(&scenario(rates, ""));
        let first = step(&mut service, 0, &state(0), &reference(0));
        let late = step(&mut service, 1_000_000, &state(0), &reference(0));
        assert_eq!(late.adaptation.stage, ControlAdaptation::STAGE_LAW);
        assert_eq!(late.errors.z1, first.errors.z1);
    }
}

/// From step to step commands differ by the law's change and a share of the transfer.
#[test]
fn the_law_returns_without_a_jump_from_every_stage_with_a_command() {
    for rates in [false, true] {
        for gone in [30, 70, 200] {
            let mut twins = Twins::new(scenario(rates, POLICY));
            let mut last = twins.step(0, &state(0), &reference(0));
            for tick in 1..50 + gone {
                let seen = if tick <= 50 { tick } else { 50 };
                last = twins.step(tick, &state(seen), &reference(tick));
            }
            assert_ne!(last.adaptation.stage, ControlAdaptation::STAGE_LAW);
            // The vehicle has moved meanwhile, by as much as is predicted.
            let moved = |tick| {
                let mut state = state(tick);
                state.position_world[1] += 0.05;
                state
            };
            let mut undisturbed = ControllerService::new(&scenario(rates, ""));
            let mut law = step(
                &mut undisturbed,
                49 + gone,
                &moved(49 + gone),
                &reference(49 + gone),
            )
            .command;
            let jump = largest_difference(&law, &last.command);
            let (mut largest, mut by_itself) = (0.0_f64, 0.0_f64);
            for tick in 50 + gone..50 + gone + 60 {
                let published = twins.step(tick, &moved(tick), &reference(tick));
                assert_eq!(published.adaptation.stage, ControlAdaptation::STAGE_LAW);
                let moves = largest_difference(&published.command, &last.command);
                assert!(
                    tick > 50 + gone || moves < 1e-9,
                    "the transfer begins with the last command: {moves}"
                );
                largest = largest.max(moves);
                let is_on_the_way = tick - (50 + gone) < 40;
                assert!(published.adaptation.resting.is_set() || !is_on_the_way);
                last = published;
                let before = law;
                law = step(&mut undisturbed, tick, &moved(tick), &reference(tick)).command;
                by_itself = by_itself.max(largest_difference(&law, &before));
            }
            assert!(jump > 0.01, "the commands of stage and law differ");
            assert!(
                largest < 0.1 * jump + by_itself,
                "{rates} {gone}: {largest} of {jump}, {by_itself}"
            );
        }
    }
}

#[test]
fn a_late_reference_is_continued_and_one_that_is_too_old_comes_to_rest() {
    let mut twins = Twins::new(scenario(false, POLICY));
    for tick in 0..=50 {
        twins.step(tick, &state(tick), &reference(tick));
    }
    for age in 1..800 {
        let published = twins.step(50 + age, &state(50 + age), &reference(50));
        assert_eq!(published.adaptation.stage, ControlAdaptation::STAGE_LAW);
        // γ̇ is 1; a policy of 20 ms is shorter than half of the stop.
        let stop = Stop::new([1.0, 0.0], BRAKE);
        let stopped_for = 1e-3 * age as f64;
        let way = stop.way(stopped_for);
        let [rate, acceleration, _] = stop.at(stopped_for);
        let mut carried = reference(50 + age);
        for axis in 0..3 {
            let [d1, d2] = [carried.derivative1_world[axis], carried.derivative2_world[axis]];
            carried.position_world[axis] += d1 * way + 0.5 * d2 * way * way;
            carried.derivative1_world[axis] += d2 * way;
        }
        (carried.gamma_dot, carried.gamma_dot_desired) = (rate, rate);
        carried.gamma_ddot = acceleration;
        let mut other = ControllerService::new(&scenario(false, ""));
        let expected = step(&mut other, 50 + age, &state(50 + age), &carried).errors;
        for axis in 0..3 {
            let apart = [
                published.errors.z1[axis] - expected.z1[axis],
                published.errors.z2[axis] - expected.z2[axis],
            ];
            assert!(
                apart.iter().all(|apart| apart.abs() < 1e-12),
                "{age} ms: {apart:?}"
            );
        }
    }
}

#[test]
fn impossible_inputs_are_counted_and_the_last_good_ones_stay() {
    for scenario in scenarios() {
        let mut twins = Twins::new(scenario);
        twins.step(0, &state(0), &reference(0));
        let mut no_state = state(1);
        no_state.velocity_body[2] = f64::NAN;
        let first = twins.step(1, &no_state, &reference(1));
        assert_eq!(first.adaptation.inputs_refused, 1);
        let mut no_reference = reference(2);
        no_reference.derivative3_world[0] = f64::INFINITY;
        let second = twins.step(2, &state(2), &no_reference);
        assert_eq!(second.adaptation.inputs_refused, 2);
        for published in [first, second] {
            assert_eq!(published.adaptation.stage, ControlAdaptation::STAGE_LAW);
            assert!(
                published.errors.z1.iter().all(|error| error.abs() < 0.2),
                "{:?}",
                published.errors
            );
        }
    }
}

/// Each number of this state is valid in a flight, but the law's products of them are not finite.
#[test]
fn the_last_command_is_held_while_the_law_is_not_finite() {
    let mut twins = Twins::new(held_for_long(""));
    let good = twins.step(0, &state(0), &reference(0));
    for tick in 1..5 {
        let mut wild = state(tick);
        wild.velocity_body = [9e8, -9e8, 9e8];
        wild.world_from_body = [9e8, 1e8, -3e8, 2e8, 7e8, 4e8, -5e8, 6e8, 8e8];
        let held = twins.step(tick, &wild, &reference(tick));
        assert_eq!(held.adaptation.stage, ControlAdaptation::STAGE_HOLD);
        assert_eq!(u64::from(held.adaptation.inputs_refused), tick);
        assert_eq!(largest_difference(&held.command, &good.command), 0.0);
        assert!(held.adaptation.resting.is_set());
    }
    let back = twins.step(5, &state(5), &reference(5));
    assert_eq!(back.adaptation.stage, ControlAdaptation::STAGE_LAW);
}

#[test]
fn with_a_policy_a_jump_is_refused_and_flown_over() {
    let mut twins = Twins::new(scenario(true, POLICY));
    for tick in 0..50 {
        twins.step(tick, &state(tick), &reference(tick));
    }
    let mut jumped = state(50);
    jumped.position_world[0] += 1.0;
    let published = twins.step(50, &jumped, &reference(50));
    assert_eq!(published.adaptation.inputs_refused, 1);
    assert!(published.errors.z1[0] < 0.2, "{:?}", published.errors.z1);
}

#[test]
fn a_controller_that_begins_in_the_middle_of_a_loss_levels_the_vehicle() {
    let mut service = ControllerService::new(&scenario(true, POLICY));
    let published = step(&mut service, 80, &state(50), &reference(80));
    assert_eq!(published.adaptation.stage, ControlAdaptation::STAGE_LEVEL);
    assert!((1.5..2.5).contains(&published.command.thrust));
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(128))]

    #[test]
    fn any_input_bits_give_finite_outputs_and_a_restart_changes_nothing(
        garbage in proptest::collection::vec(
            (proptest::collection::vec(any::<u8>(), 300), proptest::collection::vec(any::<bool>(), 29), 0..4u8, 1..40u64),
            1..30,
        ),
    ) {
        for scenario in scenarios() {
            let mut twins = Twins::new(scenario);
            let mut tick = 0;
            for (bits, keep, which, pause) in &garbage {
                tick += pause;
                let all = [true].repeat(keep.len());
                let keep_of = |bit: u8| if which & bit == 0 { &all } else { keep };
                let published = twins.step(
                    tick,
                    &sample(bits, &state(tick), keep_of(1)),
                    &sample(bits, &reference(tick), keep_of(2)),
                );
                prop_assert!(published.command.is_finite(), "{:?}", published);
                prop_assert!(published.adaptation.is_finite(), "{:?}", published);
                prop_assert!(published.errors.is_finite(), "{:?}", published);
            }
        }
    }
}

/// The vehicle may stand on the ground when states stop to come: nothing may lift it.
#[test]
fn on_the_straight_way_down_a_late_state_is_followed_by_the_descent_and_not_by_level() {
    let lands = |tick| PathReference {
        derivative1_world: [0.0, 0.0, 0.3],
        phase: PathReference::PHASE_LAND,
        ..reference(tick)
    };
    let patient = POLICY
        .replace("0.05", "0.2")
        .replace("\"descend\": 0.1", "\"descend\": 0.28");
    let mut twins = Twins::new(scenario(false, &patient));
    for tick in 0..=50 {
        twins.step(tick, &state(tick), &lands(tick));
    }
    let mut stages = Vec::new();
    for age in 1..290 {
        let stage = twins
            .step(50 + age, &state(50), &lands(50 + age))
            .adaptation
            .stage;
        if stages.last() != Some(&stage) {
            stages.push(stage);
        }
    }
    use ControlAdaptation as Stage;
    assert_eq!(
        stages,
        [Stage::STAGE_LAW, Stage::STAGE_HOLD, Stage::STAGE_DESCEND]
    );
}
