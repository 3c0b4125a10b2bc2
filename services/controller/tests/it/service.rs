//! Controller as a service: estimators between the steps, no command without inputs, restarts, and no allocation.

use crate::{allocations, restart, support};
use control_law::adaptive::parameter_vector::ParameterVector;
use control_law::{Estimates, Evaluation, Measured, Parameters, Reference, evaluate};
use controller::ControllerService;
use nalgebra::Vector3;
use scenario::{Controller, ControllerChange, Scenario};
use serde_json::Value;
use shared_types::samples::{ControlAdaptation, ControlCommand, ControlErrors, PathReference, VehicleState};
use shared_types::service::{ErasedService, InputView};
use shared_types::{Gains, Service, rotation};
use zerocopy::{FromZeros, IntoBytes};

use support::Published;

fn scenario() -> Scenario {
    serde_json::from_str(
        r#"{
            "duration": 1,
            "vehicle": {"mass": 0.2, "inertia": [6.5e-4, 6.5e-4, 13e-4]},
            "path": {"curve": {"tilted_eight": {}}}
        }"#,
    )
    .unwrap()
}

/// A state that changes with the tick, in the zone where every term of the law is active.
fn state(tick: u64) -> VehicleState {
    let phase = 0.01 * f64::from(u32::try_from(tick).unwrap());
    let mut state = VehicleState::new_zeroed();
    state.position_world = [0.6, -0.5 + 0.1 * libm::sin(phase), -0.9];
    state.world_from_body = rotation::to_row_major(&rotation::from_roll_pitch_yaw([
        0.2 * libm::cos(phase),
        -0.1,
        0.4,
    ]));
    state.velocity_body = [0.3, 0.4 * libm::sin(3.0 * phase), -0.2];
    state.angular_velocity_body = [0.5, -0.7, 0.1 + phase];
    state.tracked = true.into();
    state
}

fn reference() -> PathReference {
    let mut reference = PathReference::new_zeroed();
    reference.gamma_dot = 0.7;
    reference.gamma_ddot = -0.3;
    reference.gamma_dot_desired = 0.4;
    reference.gamma_dddot_constant = 0.5;
    reference.gamma_dddot_slope = -1.8;
    reference.position_world = [0.1, 0.2, -1.2];
    reference.derivative1_world = [0.7, 0.7, 0.1];
    reference.derivative2_world = [-0.3, -0.1, 0.2];
    reference.derivative3_world = [-0.9, -0.2, 0.1];
    reference
}

/// One step on fresh samples.
fn step(
    service: &mut ControllerService,
    tick: u64,
    state: Option<&VehicleState>,
    reference: Option<&PathReference>,
) -> Published {
    let inputs = [state.map(IntoBytes::as_bytes), reference.map(IntoBytes::as_bytes)];
    support::step(
        service,
        tick,
        inputs.map(|bytes| InputView { bytes, fresh: true }),
    )
}

fn step_with_both(service: &mut ControllerService, tick: u64) -> Published {
    step(service, tick, Some(&state(tick)), Some(&reference()))
}

fn law(tick: u64, estimates: &Estimates) -> Evaluation {
    evaluate(
        &Parameters::from(&scenario()),
        &Measured::from(&state(tick)),
        &Reference::from(&reference()),
        estimates,
    )
}

fn estimates_in(adaptation: &ControlAdaptation) -> Estimates {
    Estimates {
        eta: adaptation.eta_hat,
        disturbance_world: Vector3::from(adaptation.disturbance_hat_world),
        w: ParameterVector::from(adaptation.w_hat),
    }
}

#[test]
fn a_step_publishes_the_law_at_the_estimates_of_the_tick() {
    let mut service = ControllerService::new(&scenario());
    for tick in 0..20 {
        let Published {
            command,
            adaptation,
            errors,
        } = step_with_both(&mut service, tick);
        let law = law(tick, &estimates_in(&adaptation));
        assert_eq!(command.mode, ControlCommand::MODE_TORQUE);
        assert_eq!(command.thrust, law.thrust);
        assert_eq!(Vector3::from(command.torque_body), law.torque);
        assert_eq!(Vector3::from(errors.z1), law.z1);
        assert_eq!(Vector3::from(errors.z2), law.z2);
        assert_eq!(Vector3::from(errors.z3), law.z3);
        assert_eq!(errors.z4, 0.7 - 0.4);
        assert_eq!(Vector3::from(errors.zeta), law.zeta);
        assert_eq!(Vector3::from(errors.omega_desired), law.omega_desired);
    }
}

#[test]
fn the_estimates_begin_with_the_scenario_and_advance_by_the_previous_rates() {
    let mut service = ControllerService::new(&scenario());
    let mut expected = Estimates::from(&Controller::default().initial);
    for tick in 0..20 {
        let adaptation = step_with_both(&mut service, tick).adaptation;
        assert_eq!(estimates_in(&adaptation), expected, "tick {tick}");
        expected = expected.advanced(&law(tick, &expected).rates, 1e-3);
    }
    assert_ne!(expected, Estimates::from(&Controller::default().initial));
}

#[test]
fn the_telemetry_holds_the_projected_estimates_and_the_mass_they_mean() {
    let mut scenario = scenario();
    scenario.controller.initial.mass = 0.05; // η̂ = 20 is above 1/mmin = 10
    scenario.controller.initial.disturbance = [0.5, -4.0, 9.0];
    let mut service = ControllerService::new(&scenario);
    let adaptation = step_with_both(&mut service, 0).adaptation;
    assert_eq!(adaptation.eta_hat, 20.0);
    assert!((adaptation.eta_projected - 10.01).abs() < 1e-12);
    assert!((adaptation.mass_estimate - 1.0 / 10.01).abs() < 1e-12);
    assert_eq!(adaptation.disturbance_hat_world, [0.5, -4.0, 9.0]);
    for (projected, wanted) in adaptation
        .disturbance_projected_world
        .iter()
        .zip([0.5, -3.1, 3.1])
    {
        assert!((projected - wanted).abs() < 1e-4, "{projected} for {wanted}");
    }
}

#[test]
fn a_step_without_state_or_reference_commands_nothing_and_freezes_the_estimates() {
    let (some_state, some_reference) = (state(2), reference());
    for (state, reference) in [
        (None, None),
        (Some(&some_state), None),
        (None, Some(&some_reference)),
    ] {
        let mut service = ControllerService::new(&scenario());
        step(&mut service, 0, state, reference);
        let silent = step(&mut service, 1, state, reference);
        assert_eq!(silent.command, ControlCommand::new_zeroed());
        assert_eq!(silent.errors, ControlErrors::new_zeroed());
        let next = step_with_both(&mut service, 2);
        assert!(silent.adaptation.resting.is_set() && !next.adaptation.resting.is_set());
        assert_eq!(estimates_in(&next.adaptation), estimates_in(&silent.adaptation));
        let later = step_with_both(&mut service, 3).adaptation;
        assert_ne!(estimates_in(&later), estimates_in(&next.adaptation));
    }
}

#[test]
fn a_restarted_controller_commands_on_the_held_samples_until_it_receives_others() {
    let mut service = ControllerService::new(&scenario());
    let seen = step_with_both(&mut service, 0);
    let mut restarted = restart::restarted(&service, ControllerService::new(&scenario()));
    let blind = step(&mut restarted, 1, None, None);
    // The estimates have gone on meanwhile.
    let difference = (blind.command.thrust - seen.command.thrust).abs();
    assert!(seen.command.thrust > 1.0 && difference < 0.01 * seen.command.thrust);
}

#[test]
fn on_a_predicted_state_the_law_commands_but_does_not_adapt() {
    let mut service = ControllerService::new(&scenario());
    let mut predicted = state(0);
    predicted.tracked = false.into();
    let first = step(&mut service, 0, Some(&predicted), Some(&reference()));
    assert_eq!(
        first.command.thrust,
        law(0, &estimates_in(&first.adaptation)).thrust
    );
    let second = step_with_both(&mut service, 1);
    assert_eq!(estimates_in(&second.adaptation), estimates_in(&first.adaptation));
    assert!(first.adaptation.resting.is_set());
}

#[test]
fn a_restored_service_continues_with_equal_bytes() {
    let mut original = ControllerService::new(&scenario());
    for tick in 0..50 {
        step_with_both(&mut original, tick);
    }
    let mut saved = vec![0; ErasedService::state_size(&original)];
    ErasedService::save(&original, &mut saved);

    // Another start, so that state which is not restored shows.
    let mut other = scenario();
    other.controller.initial.mass = 0.4;
    let mut restarted = ControllerService::new(&other);
    step_with_both(&mut restarted, 7);
    ErasedService::restore(&mut restarted, &saved);
    assert_eq!(Service::save(&restarted), Service::save(&original));
    for tick in 50..100 {
        let (from_original, from_restarted) = (
            step_with_both(&mut original, tick),
            step_with_both(&mut restarted, tick),
        );
        assert_eq!(
            from_original.command.as_bytes(),
            from_restarted.command.as_bytes()
        );
        assert_eq!(
            from_original.adaptation.as_bytes(),
            from_restarted.adaptation.as_bytes()
        );
        assert_eq!(from_original.errors.as_bytes(), from_restarted.errors.as_bytes());
    }
}

#[test]
fn steps_saves_and_restores_do_not_allocate() {
    let mut with_policy = scenario();
    let policy =
        serde_json::from_str(r#"{"max_age": 0.001, "level": 0.02, "descend": 0.03, "jump": 0.1}"#).unwrap();
    with_policy
        .safety
        .insert("vehicle/state -> controller".to_owned(), policy);
    for scenario in [scenario(), with_policy] {
        let mut service = ControllerService::new(&scenario);
        let mut saved = vec![0; ErasedService::state_size(&service)];
        let count = allocations::allocations_during(|| {
            for tick in 0..100 {
                step_with_both(&mut service, tick);
                step(&mut service, tick, None, None);
                ErasedService::save(&service, &mut saved);
                ErasedService::restore(&mut service, &saved);
            }
        });
        assert_eq!(count, 0);
    }
}

/// Steps on the same inputs as all of these tests, from a tick on.
fn flown(service: &mut ControllerService, ticks: std::ops::Range<u64>) -> Vec<Published> {
    let reference = reference();
    let step = |tick| {
        let state = state(tick);
        let inputs = [state.as_bytes(), reference.as_bytes()].map(|bytes| InputView {
            bytes: Some(bytes),
            fresh: true,
        });
        support::step(service, tick, inputs)
    };
    ticks.map(step).collect()
}

#[test]
fn gains_that_change_in_flight_act_from_the_next_step_on_and_are_no_part_of_the_state() {
    let stated = scenario();
    let other = Scenario {
        controller: Controller {
            k1: 3.0,
            lambda_mass: 0.7,
            lambda_disturbance: [2.0, 1.0, 3.0],
            prediction_gain: Some(0.1),
            ..stated.controller.clone()
        },
        ..stated.clone()
    };
    let mut tuned = ControllerService::new(&stated);
    flown(&mut tuned, 0..10);
    let state = Service::save(&tuned);
    Service::tune(&mut tuned, Some(&other.gains()));
    assert_eq!(Service::save(&tuned).as_bytes(), state.as_bytes());
    let mut expected = ControllerService::new(&other);
    Service::restore(&mut expected, &state);
    let as_tuned = flown(&mut tuned, 10..20);
    assert_eq!(as_tuned, flown(&mut expected, 10..20));
    // Another process takes over, and receives the gains; then they are those of the scenario again.
    let mut successor = ControllerService::new(&stated);
    Service::restore(&mut successor, &state);
    Service::tune(&mut successor, Some(&other.gains()));
    assert_eq!(flown(&mut successor, 10..20), as_tuned);
    Service::restore(&mut successor, &state);
    Service::tune(&mut successor, None);
    let mut untouched = ControllerService::new(&stated);
    Service::restore(&mut untouched, &state);
    let as_stated = flown(&mut successor, 10..20);
    assert_eq!(as_stated, flown(&mut untouched, 10..20));
    assert_ne!(as_stated, as_tuned);
}

/// Gains that this flight does not use: without commands of body rates there is no prediction error.
const UNUSED: [&str; 1] = ["prediction_gain"];

#[test]
fn each_gain_that_changes_in_flight_is_one_that_the_law_uses() {
    let stated = scenario();
    let with_gains = |gains: &Gains| {
        let mut service = ControllerService::new(&stated);
        Service::tune(&mut service, Some(gains));
        flown(&mut service, 0..10)
    };
    let as_stated = with_gains(&stated.gains());
    for &name in Gains::NAMES {
        let mut gains = serde_json::to_value(stated.gains()).unwrap();
        let changed = |number: &Value| Value::from(1.1 * number.as_f64().unwrap() + 1e-3);
        gains[name] = match &gains[name] {
            Value::Array(numbers) => numbers.iter().map(changed).collect(),
            number => changed(number),
        };
        let is_used = with_gains(&serde_json::from_value(gains).unwrap()) != as_stated;
        assert_eq!(is_used, !UNUSED.contains(&name), "{name}");
    }
}

#[test]
fn a_planned_change_of_gains_is_a_function_of_the_tick() {
    let stated = scenario();
    let mut planned = stated.clone();
    planned.controller.change = vec![
        ControllerChange {
            at: 0.005,
            k1: Some(3.0),
            ..ControllerChange::default()
        },
        ControllerChange {
            at: 0.012,
            k2: Some(5.0),
            ..ControllerChange::default()
        },
    ];
    assert_eq!(planned.problems(), []);
    let changes = planned.planned_gains();
    assert_eq!(changes.iter().map(|(tick, _)| *tick).collect::<Vec<_>>(), [5, 12]);
    let mut by_plan = ControllerService::new(&planned);
    let mut by_hand = ControllerService::new(&stated);
    let mut expected = flown(&mut by_hand, 0..5);
    for (ticks, (_, gains)) in [5..12, 12..20].into_iter().zip(&changes) {
        Service::tune(&mut by_hand, Some(gains));
        expected.extend(flown(&mut by_hand, ticks));
    }
    assert_eq!(flown(&mut by_plan, 0..20), expected);
}
