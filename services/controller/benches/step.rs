//! Duration of the law and of a step of its service: the budget of a step is 300 ns.

use std::hint::black_box;

use control_law::{Estimates, Measured, Parameters, Reference, evaluate};
use controller::ControllerService;
use divan::Bencher;
use scenario::Scenario;
use shared_types::samples::{ControlAdaptation, ControlCommand, ControlErrors, PathReference, VehicleState};
use shared_types::service::{ErasedService, InputView, OutputSlot};
use shared_types::{Now, rotation};
use zerocopy::{FromZeros, IntoBytes};

fn main() {
    divan::main();
}

/// A vehicle in the zone where the path slows down for it: every term of the law is active.
fn state() -> VehicleState {
    let mut state = VehicleState::new_zeroed();
    state.position_world = [0.6, -0.5, -0.9];
    state.world_from_body = rotation::to_row_major(&rotation::from_roll_pitch_yaw([0.2, -0.1, 0.4]));
    state.velocity_body = [0.3, 0.4, -0.2];
    state.angular_velocity_body = [0.5, -0.7, 0.1];
    state.tracked = true.into();
    state
}

fn reference() -> PathReference {
    let mut reference = PathReference::new_zeroed();
    reference.gamma_dot = 0.7;
    reference.gamma_ddot = -0.3;
    reference.gamma_dddot_constant = 0.5;
    reference.gamma_dddot_slope = -1.8;
    reference.position_world = [0.1, 0.2, -1.2];
    reference.derivative1_world = [0.7, 0.7, 0.1];
    reference.derivative2_world = [-0.3, -0.1, 0.2];
    reference.derivative3_world = [-0.9, -0.2, 0.1];
    reference
}

#[divan::bench]
fn law(bencher: Bencher<'_, '_>) {
    let scenario = scenario();
    let parameters = Parameters::from(&scenario);
    let estimates = Estimates::from(&scenario.controller.initial);
    let (measured, reference) = (Measured::from(&state()), Reference::from(&reference()));
    bencher.bench_local(|| {
        evaluate(
            black_box(&parameters),
            black_box(&measured),
            black_box(&reference),
            black_box(&estimates),
        )
    });
}

#[divan::bench]
fn service_step(bencher: Bencher<'_, '_>) {
    let mut service = ControllerService::new(&scenario());
    let (state, reference) = (state(), reference());
    let mut command = ControlCommand::new_zeroed();
    let mut adaptation = ControlAdaptation::new_zeroed();
    let mut errors = ControlErrors::new_zeroed();
    let now = Now {
        tick: 1,
        time_ns: 1_000_000,
        elapsed_ns: 1,
        operator: shared_types::Operator::FLYING,
    };
    bencher.bench_local(|| {
        let view = |bytes| InputView {
            bytes: Some(bytes),
            fresh: true,
        };
        let inputs = [
            view(black_box(state.as_bytes())),
            view(black_box(reference.as_bytes())),
        ];
        let mut outputs = [
            Some(command.as_mut_bytes()),
            Some(adaptation.as_mut_bytes()),
            Some(errors.as_mut_bytes()),
            None,
        ]
        .map(|bytes| OutputSlot { bytes });
        service.step(black_box(&now), &inputs, &mut outputs);
        black_box(outputs);
    });
}

fn scenario() -> Scenario {
    serde_json::from_str(
        r#"{
            "duration": 1,
            "vehicle": {"mass": 0.2, "inertia": [6.5e-4, 6.5e-4, 13e-4]},
            "path": {"curve": {"tilted_eight": {}}}
        }"#,
    )
    .expect("this scenario is complete")
}
