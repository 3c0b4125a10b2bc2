//! Estimator as hosts see it: captures, their absence, restarts.

use estimator::EstimatorService;
use proptest::prelude::*;
use scenario::Scenario;
use shared_types::Now;
use shared_types::samples::{MocapPose, VehicleState};
use shared_types::service::{ErasedService, InputView};
use zerocopy::{FromZeros, IntoBytes};

fn service() -> EstimatorService {
    let scenario: Scenario = toml::from_str(
        "duration = 1.0\n\
         vehicle = { mass = 0.2, inertia = [6.5e-4, 6.5e-4, 13.0e-4] }\n\
         path.curve.hover.position = [0.0, 0.0, -1.0]",
    )
    .unwrap();
    EstimatorService::new(&scenario).unwrap()
}

/// A capture of ideal cameras, distinguished from others by its members.
fn capture(position: [f64; 3]) -> MocapPose {
    let [x, y, z] = position;
    MocapPose {
        capture_time_ns: 7_000_000,
        position_world: position,
        world_from_body: [0.0, -1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0],
        velocity_body: [y, z, x],
        angular_velocity_body: [z, x, y],
        tracked: true.into(),
        velocities_measured: true.into(),
        ..MocapPose::new_zeroed()
    }
}

fn step(service: &mut EstimatorService, pose: Option<&MocapPose>) -> VehicleState {
    let mut state = VehicleState::new_zeroed();
    step_into(service, pose, Some(state.as_mut_bytes()));
    state
}

fn step_into(service: &mut EstimatorService, pose: Option<&MocapPose>, state: Option<&mut [u8]>) {
    let now = Now {
        tick: 9,
        time_ns: 9_000_000,
        elapsed_ns: 1_000_000,
        operator: shared_types::Operator::FLYING,
    };
    let pose = InputView {
        bytes: pose.map(IntoBytes::as_bytes),
        fresh: pose.is_some(),
    };
    let mut outputs = crate::indoors::outputs(state);
    ErasedService::step(
        service,
        &now,
        &crate::indoors::inputs(pose, InputView::default()),
        &mut outputs,
    );
}

fn saved(service: &EstimatorService) -> Vec<u8> {
    let mut state = vec![0; service.state_size()];
    ErasedService::save(service, &mut state);
    state
}

/// Returns the part of a state that is kept while the body is not seen.
fn untracked(state: VehicleState) -> VehicleState {
    VehicleState {
        tracked: false.into(),
        ..state
    }
}

fn positions() -> impl Strategy<Value = [f64; 3]> {
    [-50.0..50.0, -50.0..50.0, -50.0..50.0]
}

#[test]
fn before_the_first_capture_the_state_is_level_at_rest_and_not_tracked() {
    let state = step(&mut service(), None);
    assert_eq!(
        state,
        VehicleState {
            world_from_body: [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
            ..VehicleState::new_zeroed()
        }
    );
}

proptest! {
    #[test]
    fn an_ideal_capture_is_passed_on_with_its_own_time(position in positions()) {
        let pose = capture(position);
        let state = step(&mut service(), Some(&pose));
        prop_assert_eq!(state, VehicleState {
            state_time_ns: pose.capture_time_ns,
            position_world: pose.position_world,
            world_from_body: pose.world_from_body,
            velocity_body: pose.velocity_body,
            angular_velocity_body: pose.angular_velocity_body,
            position_sigma: 0.0,
            tracked: true.into(),
            ..VehicleState::new_zeroed()
        });
    }

    #[test]
    fn while_the_body_is_not_seen_the_last_state_is_kept_as_not_tracked(position in positions()) {
        let mut service = service();
        let seen = step(&mut service, Some(&capture(position)));
        prop_assert_eq!(step(&mut service, Some(&MocapPose::new_zeroed())), untracked(seen));
        prop_assert_eq!(step(&mut service, None), untracked(seen));
        prop_assert_eq!(step(&mut service, Some(&capture(position))), seen);
    }

    #[test]
    fn a_capture_without_velocities_is_no_measurement_of_the_state(position in positions()) {
        let pose = MocapPose { velocities_measured: false.into(), ..capture(position) };
        let mut service = service();
        let nothing = step(&mut service, None);
        prop_assert_eq!(step(&mut service, Some(&pose)), nothing);
    }

    #[test]
    fn a_capture_counts_also_when_no_state_is_due(position in positions()) {
        let mut service = service();
        step_into(&mut service, Some(&capture(position)), None);
        prop_assert_eq!(step(&mut service, None).position_world, position);
    }

    #[test]
    fn a_restored_estimator_continues_with_the_same_bytes(
        positions in proptest::collection::vec(proptest::option::of(positions()), 1..20), restart in 0..20usize,
    ) {
        let mut steady = service();
        let mut restarted = service();
        for (index, position) in positions.into_iter().enumerate() {
            let pose = position.map(capture);
            let expected = step(&mut steady, pose.as_ref());
            let got = step(&mut restarted, pose.as_ref());
            prop_assert_eq!(got.as_bytes(), expected.as_bytes());
            if index == restart {
                let state = saved(&restarted);
                restarted = service();
                ErasedService::restore(&mut restarted, &state);
                prop_assert_eq!(saved(&restarted), state);
            }
        }
    }
}
