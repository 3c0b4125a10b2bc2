//! A step of the estimator allocates nothing.

use crate::allocations;
use estimator::EstimatorService;
use shared_types::Now;
use shared_types::samples::{MocapPose, RcFrame, VehicleState};
use shared_types::service::{ErasedService, InputView};
use zerocopy::{FromZeros, IntoBytes};

const IDEAL: &str = "
    duration = 1.0
    vehicle = { mass = 0.2, inertia = [6.5e-4, 6.5e-4, 13.0e-4] }
    path.curve.hover.position = [0.0, 0.0, -1.0]
";

/// Returns the number of tracked states and of allocations in a hundred steps, each with its save and restore, in which
/// a capture arrives at every second tick and a frame at every fourth.
fn tracked_and_allocations(scenario: &str) -> (u32, u64) {
    let mut service = EstimatorService::new(&toml::from_str(scenario).unwrap()).unwrap();
    let mut seen = MocapPose {
        world_from_body: [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
        tracked: true.into(),
        velocities_measured: true.into(),
        ..MocapPose::new_zeroed()
    };
    let mut sent = RcFrame::new_zeroed();
    let mut state = VehicleState::new_zeroed();
    let mut saved = vec![0; service.state_size()];
    let mut times_tracked = 0;
    let count = allocations::allocations_during(|| {
        for tick in 0..100 {
            let now = Now {
                tick,
                time_ns: tick * 1_000_000,
                elapsed_ns: tick.min(1) * 1_000_000,
                operator: shared_types::Operator::FLYING,
            };
            seen.capture_time_ns = now.time_ns;
            seen.tracked = (tick % 2 == 0).into();
            sent.header.stamp_ns = now.time_ns;
            let pose = InputView {
                bytes: Some(seen.as_bytes()),
                fresh: true,
            };
            let frame = InputView {
                bytes: (tick % 4 == 3).then_some(sent.as_bytes()),
                fresh: true,
            };
            let mut outputs = crate::indoors::outputs(Some(state.as_mut_bytes()));
            ErasedService::step(
                &mut service,
                &now,
                &crate::indoors::inputs(pose, frame),
                &mut outputs,
            );
            ErasedService::save(&service, &mut saved);
            ErasedService::restore(&mut service, &saved);
            times_tracked += u32::from(state.tracked.is_set());
        }
    });
    (times_tracked, count)
}

#[test]
fn a_step_with_ideal_cameras_does_not_allocate() {
    assert_eq!(tracked_and_allocations(IDEAL), (50, 0));
}

#[test]
fn a_step_with_a_filter_does_not_allocate() {
    assert_eq!(
        tracked_and_allocations(&format!("{IDEAL}\nestimator.kalman = {{}}")),
        (100, 0)
    );
}
