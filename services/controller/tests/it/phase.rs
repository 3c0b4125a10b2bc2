//! Controller in the phases of a flight.

use crate::support::Published;
use controller::ControllerService;
use scenario::Scenario;
use shared_types::samples::{ControlCommand, PathReference, VehicleState};
use shared_types::service::InputView;
use zerocopy::{FromZeros, IntoBytes};

fn service(flight: &str) -> ControllerService {
    let text = format!(
        r#"{{
            {flight}
            "duration": 1,
            "vehicle": {{"mass": 0.2, "inertia": [6.5e-4, 6.5e-4, 13e-4]}},
            "path": {{"curve": {{"tilted_eight": {{}}}}}}
        }}"#
    );
    let scenario: Scenario = serde_json::from_str(&text).unwrap();
    ControllerService::new(&scenario)
}

fn phased() -> ControllerService {
    service(r#""flight": {"arm_at": 0},"#)
}

fn reference(phase: u8, airborne: bool) -> PathReference {
    PathReference {
        position_world: [0.1, 0.2, -1.2],
        phase,
        airborne: airborne.into(),
        ..PathReference::new_zeroed()
    }
}

fn step(service: &mut ControllerService, tick: u64, reference: Option<&PathReference>) -> Published {
    let state = VehicleState {
        position_world: [0.3, 0.2, -0.9],
        world_from_body: [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
        tracked: true.into(),
        ..VehicleState::new_zeroed()
    };
    let inputs = [Some(state.as_bytes()), reference.map(IntoBytes::as_bytes)];
    crate::support::step(
        service,
        tick,
        inputs.map(|bytes| InputView { bytes, fresh: true }),
    )
}

/// Makes twenty steps in one phase. Returns the last of them and the change of η̂.
fn flown(service: &mut ControllerService, from: u64, reference: &PathReference) -> (Published, f64) {
    let steps: Vec<_> = (from..from + 20)
        .map(|tick| step(service, tick, Some(reference)))
        .collect();
    let [first, last] = [steps[0], steps[19]];
    (last, (last.adaptation.eta_hat - first.adaptation.eta_hat).abs())
}

fn is_silent(command: &ControlCommand) -> bool {
    (command.thrust, command.torque_body, command.rates_body) == (0.0, [0.0; 3], [0.0; 3])
}

#[test]
fn disarmed_it_commands_failsafe_and_freezes_the_estimates() {
    let mut service = phased();
    let without_reference = step(&mut service, 0, None);
    assert_eq!(without_reference.command.mode, ControlCommand::MODE_FAILSAFE);
    let (last, change) = flown(&mut service, 1, &reference(PathReference::PHASE_DISARMED, false));
    assert_eq!(last.command.mode, ControlCommand::MODE_FAILSAFE);
    assert!(is_silent(&last.command) && last.adaptation.resting.is_set());
    assert_eq!((last.errors.zeta, change), ([0.0; 3], 0.0));
}

#[test]
fn armed_the_motors_idle() {
    let (last, change) = flown(&mut phased(), 0, &reference(PathReference::PHASE_ARMED, false));
    assert_eq!(last.command.mode, ControlCommand::MODE_TORQUE);
    assert!(is_silent(&last.command) && last.adaptation.resting.is_set());
    assert_eq!(change, 0.0);
}

#[test]
fn the_law_commands_from_take_off_to_landing_and_adapts_only_in_the_air() {
    for phase in [
        PathReference::PHASE_TAKE_OFF,
        PathReference::PHASE_FLY,
        PathReference::PHASE_LAND,
    ] {
        for airborne in [false, true] {
            let (last, change) = flown(&mut phased(), 0, &reference(phase, airborne));
            assert!(last.command.thrust > 0.5, "{phase}");
            assert_eq!(last.command.mode, ControlCommand::MODE_TORQUE);
            assert_eq!(
                (last.adaptation.resting.is_set(), change > 0.0),
                (!airborne, airborne),
                "{phase}"
            );
        }
    }
}

#[test]
fn a_flight_without_phases_does_not_ask_for_them() {
    let (last, change) = flown(
        &mut service(""),
        0,
        &reference(PathReference::PHASE_DISARMED, false),
    );
    assert!(last.command.thrust > 0.5 && change > 0.0);
}

#[test]
fn estimates_are_kept_from_flight_to_flight() {
    let mut service = phased();
    let (last, _) = flown(&mut service, 0, &reference(PathReference::PHASE_FLY, true));
    let (disarmed, _) = flown(&mut service, 20, &reference(PathReference::PHASE_DISARMED, false));
    assert!(disarmed.adaptation.eta_hat != step(&mut phased(), 0, None).adaptation.eta_hat);
    assert!((disarmed.adaptation.eta_hat - last.adaptation.eta_hat).abs() < 0.1);
}
