//! A controller in Rust: PID with commands of thrust and body rates. README.md says how it is built and flown.

use nalgebra::{Matrix3, Vector3};
use plugin::{Plugin, Setup};
use shared_types::samples::ControlCommand;
use shared_types::service::BuildError;
use shared_types::wiring::{ControllerInputs, ControllerOutputs};
use shared_types::{GRAVITY, Now, Service, ServiceId};

shared_types::sample! {
    /// State between two steps.
    pub struct PidState {
        /// Integral of the position error, m s.
        pub integral: [f64; 3],
    }
}

/// The controller: gains kp (1/s²), kv (1/s), ki (1/s³), kr (1/s), the mass (kg), and what it integrates.
#[derive(Clone, Debug)]
pub struct Pid([f64; 5], Vector3<f64>);

impl Plugin for Pid {
    fn create(setup: &Setup<'_>) -> Result<Self, BuildError> {
        let defaults = [
            ("kp", 16.0),
            ("kv", 8.0),
            ("ki", 8.0),
            ("kr", 20.0),
            ("mass", 0.2),
        ];
        Ok(Self(
            defaults.map(|(name, default)| setup.parameter(name, default)),
            Vector3::zeros(),
        ))
    }
}

impl Service for Pid {
    const ID: ServiceId = ServiceId::Controller;
    type Inputs<'a> = ControllerInputs<'a>;
    type Outputs<'a> = ControllerOutputs<'a>;
    type State = PidState;

    fn step(&mut self, now: &Now, inputs: &ControllerInputs<'_>, outputs: &mut ControllerOutputs<'_>) {
        let Some(command) = outputs.command.due() else {
            return;
        };
        command.mode = ControlCommand::MODE_FAILSAFE;
        let (Some(state), Some(path)) = (inputs.state.newest(), inputs.reference.newest()) else {
            return;
        };
        let [kp, kv, ki, kr, mass] = self.0;
        let world_from_body = Matrix3::from_row_slice(&state.world_from_body);
        let [d1, d2] = [path.derivative1_world, path.derivative2_world].map(Vector3::from);
        let error = Vector3::from(state.position_world) - Vector3::from(path.position_world);
        self.1 += error * now.elapsed();
        let velocity_error = world_from_body * Vector3::from(state.velocity_body) - d1 * path.gamma_dot;
        let ahead = d2 * path.gamma_dot * path.gamma_dot + d1 * path.gamma_ddot;
        let acceleration = ahead - error * kp - velocity_error * kv - self.1 * ki;
        let force = world_from_body.tr_mul(&(Vector3::z() * GRAVITY - acceleration)) * mass; // T e3 should be this, in {B}
        let yaw = libm::atan2(world_from_body[(1, 0)], world_from_body[(0, 0)]) - path.yaw;
        (command.thrust, command.mode) = (force.z.max(0.0), ControlCommand::MODE_RATES);
        let turn = force / force.norm() * kr;
        command.rates_body = [-turn.y, turn.x, -2.0 * libm::sin(yaw)];
    }

    fn save(&self) -> PidState {
        PidState {
            integral: self.1.into(),
        }
    }

    fn restore(&mut self, state: &PidState) {
        self.1 = state.integral.into();
    }
}

plugin::export!(Pid);
