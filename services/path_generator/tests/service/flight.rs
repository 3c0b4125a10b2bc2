//! A path generator in flight, stepped as a host would step it.

use path_generator::PathGeneratorService;
use scenario::{Curve, Path, Scenario, TiltedEight, Vehicle};
use shared_types::samples::{PathReference, RcFrame, VehicleState};
use shared_types::service::{ErasedService, InputView, Now, OutputSlot};
use zerocopy::{FromZeros, IntoBytes};

pub(crate) const TICK_NS: u64 = 1_000_000;

/// The paper's path with its timing law; nothing else in a scenario concerns the path generator.
pub(crate) fn paper_path() -> Path {
    Path::new(Curve::TiltedEight(TiltedEight::default()))
}

pub(crate) fn scenario(path: Path) -> Scenario {
    Scenario::new(60.0, Vehicle::new(0.2, [6.5e-4, 6.5e-4, 13.0e-4]), path)
}

pub(crate) fn generator(path: Path) -> PathGeneratorService {
    PathGeneratorService::new(&scenario(path)).expect("the path can be flown")
}

/// A level vehicle, seen at a place with a velocity, both in {I}.
pub(crate) fn vehicle(position_world: [f64; 3], velocity_world: [f64; 3]) -> VehicleState {
    VehicleState {
        position_world,
        velocity_body: velocity_world,
        world_from_body: [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
        tracked: true.into(),
        ..VehicleState::new_zeroed()
    }
}

/// One step at a base tick, `elapsed_ticks` after the one before.
pub(crate) fn step(
    generator: &mut PathGeneratorService,
    tick: u64,
    elapsed_ticks: u64,
    state: Option<&VehicleState>,
) -> PathReference {
    let input = InputView {
        bytes: state.map(IntoBytes::as_bytes),
        fresh: true,
    };
    step_on(generator, tick, elapsed_ticks, input)
}

/// One step at a base tick, the next after the one before, with a state that has been there before.
pub(crate) fn step_on_old(
    generator: &mut PathGeneratorService,
    tick: u64,
    state: &VehicleState,
) -> PathReference {
    let input = InputView {
        bytes: Some(state.as_bytes()),
        fresh: false,
    };
    step_on(generator, tick, 1, input)
}

fn step_on(
    generator: &mut PathGeneratorService,
    tick: u64,
    elapsed_ticks: u64,
    input: InputView<'_>,
) -> PathReference {
    let mut reference = PathReference::new_zeroed();
    let now = Now {
        tick,
        time_ns: tick * TICK_NS,
        elapsed_ns: elapsed_ticks * TICK_NS,
        operator: shared_types::Operator::FLYING,
    };
    let output = OutputSlot {
        bytes: Some(reference.as_mut_bytes()),
    };
    ErasedService::step(generator, &now, &[input, InputView::default()], &mut [output]);
    reference
}

/// Makes one step at a given time, with a state and a frame, both fresh, and a request of the operator.
pub(crate) fn step_in_phases(
    generator: &mut PathGeneratorService,
    now: &Now,
    state: Option<&VehicleState>,
    frame: Option<&RcFrame>,
) -> PathReference {
    let mut reference = PathReference::new_zeroed();
    let view = |bytes| InputView { bytes, fresh: true };
    let inputs = [
        view(state.map(IntoBytes::as_bytes)),
        view(frame.map(IntoBytes::as_bytes)),
    ];
    let output = OutputSlot {
        bytes: Some(reference.as_mut_bytes()),
    };
    ErasedService::step(generator, now, &inputs, &mut [output]);
    reference
}

/// One step at a base tick, the next after the one before.
pub(crate) fn step_at(
    generator: &mut PathGeneratorService,
    tick: u64,
    state: Option<&VehicleState>,
) -> PathReference {
    step(generator, tick, tick.min(1), state)
}
