//! The step function of the plant.
//!
//! `truth(k)` is the state at time k·h. Over [(k−1)·h, k·h) the newest frame received by tick k acts, thrust
//! and torque held, on the body that is in force from tick k−1. A change at tick k is published in `truth(k)`
//! and acts from k·h on.

use nalgebra::Vector3;
use shared_types::rotation::{from_roll_pitch_yaw, from_row_major, to_row_major};
use shared_types::samples::VehicleTruth;
use shared_types::scenario::{InitialState, Scenario};
use shared_types::wiring::{PlantInputs, PlantOutputs};
use shared_types::{Now, Service, ServiceId};

use crate::actuators::Actuators;
use crate::cameras;
use crate::changes::Changes;
use crate::integrator::advanced;
use crate::rigid_body::{Body, Motion, Wrench};

shared_types::sample! {
    /// Everything that the plant's next step depends on besides its inputs.
    pub struct PlantState {
        /// p, position in {I}, m.
        pub position_world: [f64; 3],
        /// R, body to inertial, row-major.
        pub world_from_body: [f64; 9],
        /// Rv, linear velocity in {I}, m/s.
        pub velocity_world: [f64; 3],
        /// ω, angular velocity in {B}, rad/s.
        pub angular_velocity_body: [f64; 3],
    }
}

/// The simulated vehicle as a service.
#[derive(Clone, Debug)]
pub struct PlantService {
    /// h, base tick, s.
    tick: f64,
    changes: Changes,
    actuators: Actuators,
    motion: Motion,
}

impl PlantService {
    /// The plant of a scenario that has been checked, in its initial state.
    #[must_use]
    pub fn new(scenario: &Scenario) -> Self {
        Self {
            tick: scenario.schedule.tick,
            changes: Changes::new(scenario),
            actuators: Actuators::Ideal,
            motion: initial_motion(&scenario.vehicle.initial),
        }
    }

    /// Moves from the previous step to `now`, tick by tick, so that a change acts at exactly its tick and the
    /// integration error does not depend on how often the plant steps.
    fn advance(&mut self, now: &Now, wrench: &Wrench) {
        let ticks = libm::round(now.elapsed() / self.tick).max(1.0);
        let h = now.elapsed() / ticks;
        for ticks_left in (1..=whole(ticks)).rev() {
            let body = self.changes.at(now.tick.saturating_sub(ticks_left));
            self.motion = advanced(&self.motion, h, |motion| body.motion_rate(motion, wrench));
        }
    }
}

impl Service for PlantService {
    const ID: ServiceId = ServiceId::Plant;
    type Inputs<'a> = PlantInputs<'a>;
    type Outputs<'a> = PlantOutputs<'a>;
    type State = PlantState;

    /// The first step publishes the initial state as it is: nothing has acted yet.
    fn step(&mut self, now: &Now, inputs: &PlantInputs<'_>, outputs: &mut PlantOutputs<'_>) {
        let mut acted = Wrench::default();
        if now.elapsed_ns > 0 {
            acted = self.actuators.wrench(inputs.frame.newest());
            self.advance(now, &acted);
        }
        if let Some(truth) = outputs.truth.due() {
            write_truth(&self.motion, &acted, self.changes.at(now.tick), truth);
        }
        if let Some(pose) = outputs.pose.due() {
            cameras::capture(&self.motion, now, pose);
        }
    }

    fn save(&self) -> PlantState {
        PlantState {
            position_world: self.motion.position_world.into(),
            world_from_body: to_row_major(&self.motion.world_from_body),
            velocity_world: self.motion.velocity_world.into(),
            angular_velocity_body: self.motion.angular_velocity_body.into(),
        }
    }

    fn restore(&mut self, state: &PlantState) {
        self.motion = Motion {
            position_world: state.position_world.into(),
            world_from_body: from_row_major(&state.world_from_body),
            velocity_world: state.velocity_world.into(),
            angular_velocity_body: state.angular_velocity_body.into(),
        };
    }
}

fn initial_motion(initial: &InitialState) -> Motion {
    let world_from_body = from_roll_pitch_yaw(initial.roll_pitch_yaw);
    Motion {
        position_world: initial.position.into(),
        world_from_body,
        velocity_world: world_from_body * Vector3::from(initial.velocity_body),
        angular_velocity_body: initial.angular_velocity_body.into(),
    }
}

/// `acted` until now, `body` from now on.
fn write_truth(motion: &Motion, acted: &Wrench, body: &Body, truth: &mut VehicleTruth) {
    truth.position_world = motion.position_world.into();
    truth.world_from_body = to_row_major(&motion.world_from_body);
    truth.velocity_body = motion.velocity_body().into();
    truth.angular_velocity_body = motion.angular_velocity_body.into();
    truth.thrust = acted.thrust;
    truth.torque_body = acted.torque_body.into();
    truth.mass = body.mass;
    truth.inertia = body.inertia.into();
    truth.disturbance_world = body.disturbance_world.into();
}

#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "a rounded ratio of times, at least 1"
)]
fn whole(ticks: f64) -> u64 {
    ticks as u64
}
