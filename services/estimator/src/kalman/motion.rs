//! Nominal state and its motion, without noise.

use nalgebra::{Matrix3, Vector3};
use scenario::{GRAVITY, Model};
use shared_types::rotation::{exp, skew};
use vehicle_model::integrator::travelled;
use vehicle_model::lag::Lag;
use vehicle_model::rigid_body;

use super::attitude::right_jacobian;
use super::commands::{Command, CommandHistory, Stretch};
use super::error_state::Transition;

/// Minimum thrust that may lift the vehicle, as a share of the weight: the mass is not exact.
const LIFTING: f64 = 0.5;

/// Estimated motion of the vehicle: the mean of the filter.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NominalState {
    /// p, position of the centre of mass in {I}, m.
    pub position_world: Vector3<f64>,
    /// v, linear velocity of the centre of mass in {I}, m/s.
    pub velocity_world: Vector3<f64>,
    /// R, body to inertial.
    pub world_from_body: Matrix3<f64>,
    /// ω_bias, difference between the body rates and those of the frames, in {B}, rad/s.
    pub rate_bias_body: Vector3<f64>,
    /// d, disturbance as an acceleration in {I}, m/s².
    pub disturbance_world: Vector3<f64>,
    /// r, tracked point seen from the centre of mass, in {B}, m.
    pub marker_offset_body: Vector3<f64>,
    /// Thrust and body rates that follow from the frames, assumed exact.
    pub actuation: Actuation,
}

/// Thrust and body rates that follow from the frames.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Actuation {
    /// T̂, N.
    pub thrust: f64,
    /// ω̂ in {B}, rad/s.
    pub rates_body: Vector3<f64>,
}

impl NominalState {
    /// Returns p + R r, the position of the tracked point in {I}, m.
    #[must_use]
    pub fn tracked_point(&self) -> Vector3<f64> {
        self.position_world + self.world_from_body * self.marker_offset_body
    }
}

impl Actuation {
    /// Returns thrust and rates that have settled on a command.
    #[must_use]
    pub fn settled(command: &Command) -> Self {
        Self {
            thrust: command.thrust,
            rates_body: command.rates_body.into(),
        }
    }
}

#[derive(Clone, Copy, Debug)]
pub struct VehicleModel {
    /// m, kg.
    mass: f64,
    thrust: Lag,
    rates: Lag,
}

impl VehicleModel {
    /// Returns the model of a scenario.
    #[must_use]
    pub fn new(model: &Model) -> Self {
        Self {
            mass: model.mass,
            thrust: Lag::new(model.thrust_lag),
            rates: Lag::new(model.rate_lag),
        }
    }

    /// Returns thrust and rates after they have followed `command` for `h`, s.
    #[must_use]
    pub fn actuated(&self, actuation: &Actuation, command: &Command, h: f64) -> Actuation {
        let target = Actuation::settled(command);
        Actuation {
            thrust: self.thrust.end(actuation.thrust, target.thrust, h),
            rates_body: self.rates.end(actuation.rates_body, target.rates_body, h),
        }
    }

    /// Returns whether a standing vehicle stays on the ground with this thrust. `pull` (m/s²) is the minimum downward
    /// acceleration by gravity and disturbance; 0 if unknown, before the first flight.
    #[must_use]
    pub fn is_held(&self, actuation: &Actuation, pull: f64) -> bool {
        actuation.thrust < self.mass * pull.max(LIFTING * GRAVITY)
    }

    /// Returns the state after free flight from one time to another, ns, under the commands in effect until then.
    #[must_use]
    pub fn flown(
        &self,
        state: &NominalState,
        history: &CommandHistory,
        from_ns: u64,
        to_ns: u64,
    ) -> NominalState {
        let mut flown = *state;
        for Stretch { command, steps, h } in history.stretches(from_ns, to_ns) {
            for _ in 0..steps {
                (flown, _) = self.stepped(&flown, &command, h);
            }
        }
        flown
    }

    /// Returns v̇ = g e3 − (T/m) R e3 + d in {I}, m/s².
    #[must_use]
    pub fn acceleration(&self, state: &NominalState) -> Vector3<f64> {
        let specific_thrust = state.actuation.thrust / self.mass;
        acceleration(&state.world_from_body, specific_thrust, &state.disturbance_world)
    }

    /// Steps by `h` (s) under `command` by the mid-point rule. Returns the state and the transition of an error.
    ///
    /// Thrust and rates enter by their exact means over the step. The transition is the derivative of the step
    /// itself, to second order in the angle that the body turns by.
    #[must_use]
    pub fn stepped(&self, state: &NominalState, command: &Command, h: f64) -> (NominalState, Transition) {
        let target = Actuation::settled(command);
        let start = &state.actuation;

        let phi = (self.rates.mean(start.rates_body, target.rates_body, h) + state.rate_bias_body) * h;
        let half_turn = exp(&(phi * 0.5));
        let world_from_middle = state.world_from_body * half_turn;
        let turn = half_turn * half_turn;

        // v̇ = g e3 − (T/m) R e3 + d at the middle of the step.
        let specific_thrust = self.thrust.mean(start.thrust, target.thrust, h) / self.mass;
        let acceleration = acceleration(&world_from_middle, specific_thrust, &state.disturbance_world);
        let (position_world, velocity_world) =
            travelled(&state.position_world, &state.velocity_world, &acceleration, h);

        let nominal = NominalState {
            position_world,
            velocity_world,
            world_from_body: state.world_from_body * turn,
            actuation: self.actuated(start, command, h),
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

/// Returns g e3 − (T/m) R e3 + d for a thrust per mass T/m, m/s²; gravity is added last.
fn acceleration(
    world_from_body: &Matrix3<f64>,
    specific_thrust: f64,
    disturbance_world: &Vector3<f64>,
) -> Vector3<f64> {
    let mut acceleration = rigid_body::acceleration(world_from_body, specific_thrust, disturbance_world);
    acceleration.z += GRAVITY;
    acceleration
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kalman::error_state::{
        ATTITUDE, Covariance, DISTURBANCE, ERRORS, ErrorVector, MARKER_OFFSET, POSITION, RATE_BIAS, VELOCITY,
    };
    use proptest::prelude::*;
    use shared_types::rotation::log;

    fn vector(bound: f64) -> impl Strategy<Value = Vector3<f64>> {
        [-bound..bound, -bound..bound, -bound..bound].prop_map(Vector3::from)
    }

    fn nominal() -> impl Strategy<Value = NominalState> {
        (
            vector(1.0),
            vector(2.0),
            vector(3.0),
            vector(0.3),
            vector(2.0),
            0.0..4.0,
            vector(1.5),
            vector(0.1),
        )
            .prop_map(
                |(
                    position_world,
                    velocity_world,
                    theta,
                    rate_bias_body,
                    disturbance_world,
                    thrust,
                    rates_body,
                    marker_offset_body,
                )| {
                    NominalState {
                        position_world,
                        velocity_world,
                        world_from_body: exp(&theta),
                        rate_bias_body,
                        disturbance_world,
                        marker_offset_body,
                        actuation: Actuation { thrust, rates_body },
                    }
                },
            )
    }

    fn command() -> impl Strategy<Value = Command> {
        (0.0..4.0, vector(1.5)).prop_map(|(thrust, rates)| Command {
            acts_from_ns: 0,
            thrust,
            rates_body: rates.into(),
        })
    }

    fn parts(error: &ErrorVector) -> [Vector3<f64>; 6] {
        [
            POSITION,
            VELOCITY,
            ATTITUDE,
            RATE_BIAS,
            DISTURBANCE,
            MARKER_OFFSET,
        ]
        .map(|row| error.fixed_rows::<3>(row).into())
    }

    fn moved(state: &NominalState, error: &ErrorVector) -> NominalState {
        let [position, velocity, theta, rate_bias, disturbance, marker_offset] = parts(error);
        NominalState {
            position_world: state.position_world + position,
            velocity_world: state.velocity_world + velocity,
            world_from_body: state.world_from_body * exp(&theta),
            rate_bias_body: state.rate_bias_body + rate_bias,
            disturbance_world: state.disturbance_world + disturbance,
            marker_offset_body: state.marker_offset_body + marker_offset,
            ..*state
        }
    }

    fn difference(to: &NominalState, from: &NominalState) -> ErrorVector {
        let mut error = ErrorVector::zeros();
        for (row, part) in [
            (POSITION, to.position_world - from.position_world),
            (VELOCITY, to.velocity_world - from.velocity_world),
            (
                ATTITUDE,
                log(&(from.world_from_body.transpose() * to.world_from_body)),
            ),
            (RATE_BIAS, to.rate_bias_body - from.rate_bias_body),
            (DISTURBANCE, to.disturbance_world - from.disturbance_world),
            (MARKER_OFFSET, to.marker_offset_body - from.marker_offset_body),
        ] {
            error.fixed_rows_mut::<3>(row).copy_from(&part);
        }
        error
    }

    proptest! {
        // Steps ten times as long as those of the filter at a tenth of its body rates: the same turn, but the
        // smallest blocks of the transition stand out of the differences' rounding.
        #[test]
        fn the_transition_is_the_derivative_of_the_step(state in nominal(), command in command(), h in 0.005..0.02f64) {
            let model = VehicleModel::new(&Model::default());
            let (end, transition) = model.stepped(&state, &command, h);
            let phi = transition.times(&Covariance::identity());
            let size = 1e-5;
            for column in 0..ERRORS {
                let mut error = ErrorVector::zeros();
                error[column] = size;
                let (above, _) = model.stepped(&moved(&state, &error), &command, h);
                let (below, _) = model.stepped(&moved(&state, &-error), &command, h);
                let derivative = (difference(&above, &end) - difference(&below, &end)) / (2.0 * size);
                let wrong_by = (derivative - phi.column(column)).amax();
                prop_assert!(wrong_by < 1e-7, "column {column}: {wrong_by:e}");
            }
        }

        #[test]
        fn in_free_fall_a_step_is_the_parabola(state in nominal(), h in 1e-4..0.02f64) {
            let state = NominalState { actuation: Actuation { thrust: 0.0, ..state.actuation }, ..state };
            let rest = Command { acts_from_ns: 0, thrust: 0.0, rates_body: [0.0; 3] };
            let (end, _) = VehicleModel::new(&Model::default()).stepped(&state, &rest, h);
            let acceleration = state.disturbance_world + Vector3::new(0.0, 0.0, GRAVITY);
            let position = state.position_world + state.velocity_world * h + acceleration * (0.5 * h * h);
            prop_assert!((end.position_world - position).norm() < 1e-15);
            prop_assert!((end.velocity_world - state.velocity_world - acceleration * h).norm() < 1e-15);
        }
    }
}
