//! The step function of the estimator.

use shared_types::samples::VehicleState;
use shared_types::scenario::Scenario;
use shared_types::wiring::{EstimatorInputs, EstimatorOutputs};
use shared_types::{Now, Service, ServiceId};

use crate::source::Source;

shared_types::sample! {
    /// The last state that rested on a measurement.
    pub struct EstimatorState {
        /// The time that it speaks of, ns since the start of the flight.
        pub state_time_ns: u64,
        /// p, position in {I}, m.
        pub position_world: [f64; 3],
        /// R, body to inertial, row-major.
        pub world_from_body: [f64; 9],
        /// v, linear velocity in {B}, m/s.
        pub velocity_body: [f64; 3],
        /// ω, angular velocity in {B}, rad/s.
        pub angular_velocity_body: [f64; 3],
        /// Standard deviation of the position, the largest axis, m.
        pub position_sigma: f64,
    }
}

/// Level at the origin and at rest: a state that consumers can compute with until there is a measurement.
const UNMEASURED: EstimatorState = EstimatorState {
    state_time_ns: 0,
    position_world: [0.0; 3],
    world_from_body: [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
    velocity_body: [0.0; 3],
    angular_velocity_body: [0.0; 3],
    position_sigma: 0.0,
};

/// The estimator as a service.
#[derive(Clone, Debug)]
pub struct EstimatorService {
    source: Source,
    last: EstimatorState,
}

impl EstimatorService {
    /// The estimator of a scenario that has been checked; every scenario has ideal cameras.
    #[must_use]
    pub fn new(_scenario: &Scenario) -> Self {
        Self {
            source: Source::IdealCapture,
            last: UNMEASURED,
        }
    }
}

impl Service for EstimatorService {
    const ID: ServiceId = ServiceId::Estimator;
    type Inputs<'a> = EstimatorInputs<'a>;
    type Outputs<'a> = EstimatorOutputs<'a>;
    type State = EstimatorState;

    /// While there is no usable capture the last state is published again, as not tracked; until the first one
    /// that is a level attitude at the origin, at rest.
    fn step(&mut self, _now: &Now, inputs: &EstimatorInputs<'_>, outputs: &mut EstimatorOutputs<'_>) {
        let measured = self.source.state(inputs.pose.newest());
        if let Some(measured) = measured {
            self.last = measured;
        }
        if let Some(state) = outputs.state.due() {
            write_state(&self.last, measured.is_some(), state);
        }
    }

    fn save(&self) -> EstimatorState {
        self.last
    }

    fn restore(&mut self, state: &EstimatorState) {
        self.last = *state;
    }
}

fn write_state(last: &EstimatorState, tracked: bool, state: &mut VehicleState) {
    state.state_time_ns = last.state_time_ns;
    state.position_world = last.position_world;
    state.world_from_body = last.world_from_body;
    state.velocity_body = last.velocity_body;
    state.angular_velocity_body = last.angular_velocity_body;
    state.position_sigma = last.position_sigma;
    state.tracked = tracked.into();
}
