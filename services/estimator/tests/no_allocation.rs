//! A step of the estimator allocates nothing.

#[path = "../../../tests/common/allocations.rs"]
mod allocations;

use estimator::EstimatorService;
use shared_types::Now;
use shared_types::samples::{MocapPose, VehicleState};
use shared_types::service::{ErasedService, InputView, OutputSlot};
use zerocopy::{FromZeros, IntoBytes};

#[test]
fn a_step_of_the_estimator_does_not_allocate() {
    let scenario = toml::from_str(
        "duration = 1.0\n\
         vehicle = { mass = 0.2, inertia = [6.5e-4, 6.5e-4, 13.0e-4] }\n\
         path.curve.hover.position = [0.0, 0.0, -1.0]",
    );
    let mut service = EstimatorService::new(&scenario.unwrap()).unwrap();
    let seen = MocapPose {
        tracked: true.into(),
        velocities_measured: true.into(),
        ..MocapPose::new_zeroed()
    };
    let mut state = VehicleState::new_zeroed();
    let mut saved = vec![0; service.state_size()];
    let mut times_tracked = 0;
    let count = allocations::allocations_during(|| {
        for tick in 0..100 {
            let now = Now {
                tick,
                time_ns: tick * 1_000_000,
                elapsed_ns: tick.min(1) * 1_000_000,
            };
            let pose = InputView {
                bytes: (tick % 2 == 0).then_some(seen.as_bytes()),
                fresh: true,
            };
            let mut outputs = [OutputSlot {
                bytes: Some(state.as_mut_bytes()),
            }];
            ErasedService::step(&mut service, &now, &[pose, InputView::default()], &mut outputs);
            ErasedService::save(&service, &mut saved);
            ErasedService::restore(&mut service, &saved);
            times_tracked += u32::from(state.tracked.is_set());
        }
    });
    assert_eq!((count, times_tracked), (0, 50));
}
