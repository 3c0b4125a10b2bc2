//! The nominal state and how it moves: the model without its noise.

use nalgebra::{Matrix3, Vector3};
use shared_types::rotation::{exp, skew};
use shared_types::scenario::{GRAVITY, Model};

use super::attitude::right_jacobian;
use super::commands::Command;
use super::error_state::Transition;
use super::lag::Lag;

/// What the vehicle is believed to be doing: the mean of the filter.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Nominal {
    /// p, position in {I}, m.
    pub position_world: Vector3<f64>,
    /// v, linear velocity in {I}, m/s.
    pub velocity_world: Vector3<f64>,
    /// R, body to inertial.
    pub world_from_body: Matrix3<f64>,
    /// ω_bias, by which the body rates differ from what the frames make them, in {B}, rad/s.
    pub rate_bias_body: Vector3<f64>,
    /// d, disturbance as an acceleration in {I}, m/s².
    pub disturbance_world: Vector3<f64>,
    /// What the frames make of thrust and body rates; known without error.
    pub actuation: Actuation,
}

/// Thrust and body rates as the frames make them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Actuation {
    /// T̂, N.
    pub thrust: f64,
    /// ω̂ in {B}, rad/s.
    pub rates_body: Vector3<f64>,
}

impl Actuation {
    /// Thrust and rates that have settled on a command.
    #[must_use]
    pub fn settled(command: &Command) -> Self {
        Self {
            thrust: command.thrust,
            rates_body: command.rates_body.into(),
        }
    }
}

/// What is believed of the vehicle.
#[derive(Clone, Copy, Debug)]
pub struct VehicleModel {
    /// m, kg.
    mass: f64,
    thrust: Lag,
    rates: Lag,
}

impl VehicleModel {
    /// What a scenario says is believed.
    #[must_use]
    pub fn new(model: &Model) -> Self {
        Self {
            mass: model.mass,
            thrust: Lag {
                time_constant: model.thrust_lag,
            },
            rates: Lag {
                time_constant: model.rate_lag,
            },
        }
    }

    /// Thrust and rates after they have followed `command` for `h`, s.
    #[must_use]
    pub fn actuated(&self, actuation: &Actuation, command: &Command, h: f64) -> Actuation {
        let target = Actuation::settled(command);
        Actuation {
            thrust: self.thrust.over(h).end(actuation.thrust, target.thrust),
            rates_body: self.rates.over(h).end(actuation.rates_body, target.rates_body),
        }
    }

    /// A step of `h` (s) under `command` by the mid-point rule, and how an error is carried through it.
    ///
    /// Thrust and rates enter by their exact means over the step. The transition is the derivative of the step
    /// itself, to second order in the angle that the body turns by.
    #[must_use]
    pub fn stepped(&self, state: &Nominal, command: &Command, h: f64) -> (Nominal, Transition) {
        let target = Actuation::settled(command);
        let start = &state.actuation;
        let (thrust, rates) = (self.thrust.over(h), self.rates.over(h));

        let phi = (rates.mean(start.rates_body, target.rates_body) + state.rate_bias_body) * h;
        let half_turn = exp(&(phi * 0.5));
        let world_from_middle = state.world_from_body * half_turn;
        let turn = half_turn * half_turn;

        // v̇ = g e3 − (T/m) R e3 + d at the middle of the step.
        let specific_thrust = thrust.mean(start.thrust, target.thrust) / self.mass;
        let mut acceleration = world_from_middle.column(2) * -specific_thrust + state.disturbance_world;
        acceleration.z += GRAVITY;
        let velocity = state.velocity_world + acceleration * h;

        let nominal = Nominal {
            position_world: state.position_world + (state.velocity_world + velocity) * (0.5 * h),
            velocity_world: velocity,
            world_from_body: state.world_from_body * turn,
            actuation: Actuation {
                thrust: thrust.end(start.thrust, target.thrust),
                rates_body: rates.end(start.rates_body, target.rates_body),
            },
            ..*state
        };

        // ∂v̇ = −(T/m) R_middle S(ε) e3 = (T/m) R_middle S(e3) ε, ε the rotation of the middle that an error of
        // attitude or of rates makes.
        let tilting = world_from_middle * skew(&Vector3::z()) * (specific_thrust * h);
        let transition = Transition {
            h,
            velocity_from_attitude: tilting * half_turn.transpose(),
            velocity_from_rate_bias: tilting * right_jacobian(&(phi * 0.5)) * (0.5 * h),
            attitude_from_attitude: turn.transpose(),
            attitude_from_rate_bias: right_jacobian(&phi) * h,
        };
        (nominal, transition)
    }
}
