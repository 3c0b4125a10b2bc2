//! Nonlinear model predictive control, with the lags of thrust and rates in its model.
//!
//! The model has eleven states: p, V, the tilt, ωxy and T. Its inputs are the commanded ωx, ωy and T, one for each of
//! the coming [`STEPS`] steps; ωz is the yaw law's. The measured residual acceleration d pushes it all
//! the way, so that a constant disturbance leaves no offset. A command is one pass of Gauss–Newton from the plan of the
//! hold before, shifted by the time since: a linearisation along the plan, a Riccati recursion backwards, and the model
//! forwards again with the inputs within their limits. The work is the same at every step.
//!
//! The tilt is an error about the plan, R = R̄ exp(S(θ)) with θ = (θx, θy, 0), so that no attitude is special.

use nalgebra::{Matrix3, Matrix3x2, SMatrix, SVector, Vector2, Vector3};
use scenario::{GRAVITY, Scenario};
use shared_types::rotation;
use shared_types::sample::layout_hash;
use vehicle_model::lag::Lag;

use super::flight_law::{FlightLaw, LawState};
use super::{LawOutput, Moment, Telemetry};
use crate::rate_controller::RateController;
use crate::signals::{Commanded, Measured, Reference, VehicleEstimate};

/// Number of steps that are planned.
pub const STEPS: usize = 25;
/// Length of a step where commands are held for less, s.
const LEAST_STEP: f64 = 0.02;
/// Weight of the velocity error, that of the position error being [`POSITION_WEIGHT`].
const VELOCITY_WEIGHT: f64 = 5.0;
const POSITION_WEIGHT: f64 = 1000.0;
/// Weight of T less the thrust that carries the vehicle along the path.
const THRUST_WEIGHT: f64 = 1.0;
/// Largest position error that it acts on unless the scenario states one, m: from farther away one pass of Gauss–Newton
/// tips the vehicle over.
const NEAR: f64 = 0.03;
/// Factor on the weights at the last step.
const TERMINAL: f64 = 5.0;

const STATES: usize = 11;
const INPUTS: usize = 3;
type Error = SVector<f64, STATES>;
type StateMatrix = SMatrix<f64, STATES, STATES>;
type InputMatrix = SMatrix<f64, STATES, INPUTS>;
type Gain = SMatrix<f64, INPUTS, STATES>;

/// Indices of the states in an error.
const P: usize = 0;
const V: usize = 3;
const TILT: usize = 6;
const RATE: usize = 8;
const THRUST: usize = 10;

/// Controller with its plan.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Nmpc {
    model: Model,
    /// Weight of the commanded rates.
    rate_weight: f64,
    /// Largest ‖p − pd‖ that it acts on, m.
    error_limit: f64,
    /// Length of a step, s.
    step: f64,
    /// Inputs of the coming steps: ωx, ωy (rad/s) and T (N).
    plan: [Vector3<f64>; STEPS],
    /// d in {I}, m/s².
    residual: Vector3<f64>,
    rate_controller: RateController,
}

shared_types::sample! {
    /// Plan, and residual acceleration.
    pub struct NmpcState {
        /// Inputs of the coming steps.
        pub plan: [PlannedInput; STEPS],
        /// d in {I}, m/s².
        pub residual_world: [f64; 3],
    }

    /// Input of a step.
    pub struct PlannedInput {
        /// ωx and ωy, rad/s, and T, N.
        pub components: [f64; 3],
    }
}

/// Model of the vehicle.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Model {
    mass: f64,
    thrust_lag: Lag,
    rate_lag: Lag,
    /// Smallest and largest inputs.
    limits: [Vector3<f64>; 2],
}

/// State of the model.
#[derive(Clone, Copy, Debug)]
struct Predicted {
    position: Vector3<f64>,
    velocity: Vector3<f64>,
    world_from_body: Matrix3<f64>,
    omega: Vector2<f64>,
    thrust: f64,
}

/// A step of the model, with its derivatives.
struct Advance {
    state: Predicted,
    by_state: StateMatrix,
    by_input: InputMatrix,
}

/// Disturbances of the model: an acceleration, and the turn about the third axis.
#[derive(Clone, Copy)]
struct Push {
    residual: Vector3<f64>,
    yaw_rate: f64,
}

impl Model {
    /// Steps by `h` seconds under an input.
    fn advance(&self, from: &Predicted, input: &Vector3<f64>, push: &Push, h: f64) -> Predicted {
        let rates = input.xy();
        let omega = self.rate_lag.mean(from.omega, rates, h);
        let turn = Vector3::new(omega.x, omega.y, push.yaw_rate) * h;
        let middle = from.world_from_body * rotation::exp(&(turn * 0.5));
        let thrust = self.thrust_lag.mean(from.thrust, input.z, h);
        let acceleration = Vector3::z() * GRAVITY - middle.column(2) * (thrust / self.mass) + push.residual;
        Predicted {
            position: from.position + from.velocity * h + acceleration * (0.5 * h * h),
            velocity: from.velocity + acceleration * h,
            world_from_body: from.world_from_body * rotation::exp(&turn),
            omega: self.rate_lag.end(from.omega, rates, h),
            thrust: self.thrust_lag.end(from.thrust, input.z, h),
        }
    }

    /// Steps by `h` seconds, with the derivatives of the end by the errors of the start and by the input; the turn about
    /// the third axis is left out of them.
    fn linearized(&self, from: &Predicted, input: &Vector3<f64>, push: &Push, h: f64) -> Advance {
        // A value that lags begins with weight 1: what is left of that at the end, and in the mean.
        let left = |lag: &Lag| [lag.end(1.0, 0.0, h), lag.mean(1.0, 0.0, h)];
        let ([rate_left, rate_mean], [thrust_left, thrust_mean]) =
            (left(&self.rate_lag), left(&self.thrust_lag));
        let omega = self.rate_lag.mean(from.omega, input.xy(), h);
        let turn = Vector3::new(omega.x, omega.y, push.yaw_rate) * (0.5 * h);
        let middle = from.world_from_body * rotation::exp(&turn);
        let thrust = self.thrust_lag.mean(from.thrust, input.z, h);
        // dn = R (θy, −θx, 0).
        let tilted = Matrix3x2::from_columns(&[-middle.column(1), middle.column(0).into_owned()]);
        let by_tilt = tilted * (-thrust / self.mass);
        let by_thrust: Vector3<f64> = middle.column(2) * (-1.0 / self.mass);
        let by_rate = by_tilt * (0.5 * h);

        let mut by_state = StateMatrix::identity();
        let mut by_input = InputMatrix::zeros();
        by_state.fixed_view_mut::<3, 3>(P, V).fill_diagonal(h);
        by_state
            .fixed_view_mut::<2, 2>(TILT, RATE)
            .fill_diagonal(rate_mean * h);
        by_state
            .fixed_view_mut::<2, 2>(RATE, RATE)
            .fill_diagonal(rate_left);
        by_state[(THRUST, THRUST)] = thrust_left;
        by_input
            .fixed_view_mut::<2, 2>(TILT, 0)
            .fill_diagonal((1.0 - rate_mean) * h);
        by_input
            .fixed_view_mut::<2, 2>(RATE, 0)
            .fill_diagonal(1.0 - rate_left);
        by_input[(THRUST, 2)] = 1.0 - thrust_left;
        for (row, way) in [(P, 0.5 * h * h), (V, h)] {
            by_state
                .fixed_view_mut::<3, 2>(row, TILT)
                .copy_from(&(by_tilt * way));
            by_state
                .fixed_view_mut::<3, 2>(row, RATE)
                .copy_from(&(by_rate * (rate_mean * way)));
            by_state
                .fixed_view_mut::<3, 1>(row, THRUST)
                .copy_from(&(by_thrust * (thrust_mean * way)));
            by_input
                .fixed_view_mut::<3, 2>(row, 0)
                .copy_from(&(by_rate * ((1.0 - rate_mean) * way)));
            by_input
                .fixed_view_mut::<3, 1>(row, 2)
                .copy_from(&(by_thrust * ((1.0 - thrust_mean) * way)));
        }
        Advance {
            state: self.advance(from, input, push, h),
            by_state,
            by_input,
        }
    }
}

impl Predicted {
    /// Returns this less another, as an error about the other.
    fn error_about(&self, other: &Self) -> Error {
        let turned = other.world_from_body.tr_mul(&self.world_from_body);
        let tilt = Vector2::new(turned.m32 - turned.m23, turned.m13 - turned.m31) * 0.5;
        let mut error = Error::zeros();
        error
            .fixed_rows_mut::<3>(P)
            .copy_from(&(self.position - other.position));
        error
            .fixed_rows_mut::<3>(V)
            .copy_from(&(self.velocity - other.velocity));
        error.fixed_rows_mut::<2>(TILT).copy_from(&tilt);
        error
            .fixed_rows_mut::<2>(RATE)
            .copy_from(&(self.omega - other.omega));
        error[THRUST] = self.thrust - other.thrust;
        error
    }
}

impl Nmpc {
    /// Makes the controller of a scenario that commands body rates.
    #[must_use]
    pub fn new(scenario: &Scenario) -> Self {
        let stated = scenario.controller.baseline.clone().unwrap_or_default();
        let model = scenario.model.clone().unwrap_or_default();
        let ([least, largest], rates) = crate::rate_controller::link_limits(scenario);
        let mass = scenario.controller.initial.mass;
        Self {
            model: Model {
                mass,
                thrust_lag: Lag::new(model.thrust_lag),
                rate_lag: Lag::new(model.rate_lag),
                limits: [
                    Vector3::new(-rates[0], -rates[1], least),
                    Vector3::new(rates[0], rates[1], largest),
                ],
            },
            rate_weight: stated.nmpc_rate_weight,
            error_limit: stated.error_limit.unwrap_or(NEAR),
            step: scenario.command_hold().max(LEAST_STEP),
            plan: [Vector3::new(0.0, 0.0, mass * GRAVITY); STEPS],
            residual: Vector3::zeros(),
            rate_controller: RateController::new(scenario),
        }
    }

    /// Moves the plan on by `elapsed` seconds; its last input stays.
    fn shift(&mut self, elapsed: f64) {
        let steps = elapsed / self.step;
        // The input that begins within the last of these steps, and the share of that step.
        let whole = (libm::ceil(steps) - 1.0).clamp(0.0, STEPS as f64);
        let share = steps - whole;
        let planned = self.plan;
        let at = |index: usize| planned[index.min(STEPS - 1)];
        for (index, input) in self.plan.iter_mut().enumerate() {
            let index = index + whole as usize;
            *input = at(index) + (at(index + 1) - at(index)) * share;
        }
    }

    /// Returns the plan after one pass of Gauss–Newton.
    fn planned(&self, start: &Predicted, reference: &Reference, push: &Push) -> [Vector3<f64>; STEPS] {
        let h = self.step;
        let error = start.position - reference.position_world;
        let beyond = (1.0 - self.error_limit / error.norm()).max(0.0);
        // A reference that is too far away comes nearer.
        let nearer = if beyond > 0.0 {
            error * beyond
        } else {
            Vector3::zeros()
        };

        let mut states = [*start; STEPS + 1];
        let mut by_state = [StateMatrix::zeros(); STEPS];
        let mut by_input = [InputMatrix::zeros(); STEPS];
        let mut wanted = [Wanted::of(reference, &nearer, self, push); STEPS + 1];
        let mut ahead = *reference;
        for index in 0..STEPS {
            let step = self.model.linearized(&states[index], &self.plan[index], push, h);
            states[index + 1] = step.state;
            (by_state[index], by_input[index]) = (step.by_state, step.by_input);
            ahead = ahead.ahead(h);
            wanted[index + 1] = Wanted::of(&ahead, &nearer, self, push);
        }

        let input_weight = Vector3::new(self.rate_weight, self.rate_weight, THRUST_WEIGHT);
        let mut slope = wanted[STEPS].slope(&states[STEPS]) * TERMINAL;
        let mut curvature = StateMatrix::from_diagonal(&(weights() * TERMINAL));
        let mut open_loop = [Vector3::zeros(); STEPS];
        let mut gains = [Gain::zeros(); STEPS];
        for index in (0..STEPS).rev() {
            let (a, b) = (&by_state[index], &by_input[index]);
            let away = self.plan[index] - Vector3::z() * wanted[index].thrust;
            let through = b.tr_mul(&curvature);
            let of_input = b.tr_mul(&slope) + input_weight.component_mul(&away);
            let inputs = through * b + Matrix3::from_diagonal(&input_weight);
            // Positive weights of the inputs make it invertible.
            let Some(inverse) = inputs.try_inverse() else {
                return self.plan;
            };
            let mixed = through * a;
            open_loop[index] = -(inverse * of_input);
            gains[index] = -(inverse * mixed);
            slope = a.tr_mul(&slope) + mixed.tr_mul(&open_loop[index]);
            let next = a.tr_mul(&(curvature * a)) + mixed.tr_mul(&gains[index]);
            curvature = (next + next.transpose()) * 0.5;
            if index > 0 {
                slope += wanted[index].slope(&states[index]);
                curvature += StateMatrix::from_diagonal(&weights());
            }
        }

        let mut plan = self.plan;
        let mut state = *start;
        for index in 0..STEPS {
            let change = open_loop[index] + gains[index] * state.error_about(&states[index]);
            let [least, largest] = &self.model.limits;
            plan[index] = (self.plan[index] + change).sup(least).inf(largest);
            state = self.model.advance(&state, &plan[index], push, h);
        }
        plan
    }

    fn telemetry(&self, measured: &Measured, reference: &Reference) -> Telemetry {
        let velocity = measured.velocity_world();
        Telemetry {
            z2: velocity - reference.velocity_world(),
            z3: Vector3::zeros(),
            zeta: Vector3::z() * (self.plan[0].z / self.model.mass),
            omega_desired: Vector3::new(self.plan[0].x, self.plan[0].y, 0.0),
        }
    }
}

impl FlightLaw for Nmpc {
    fn command(&mut self, moment: &Moment<'_>) -> LawOutput {
        let (measured, acting) = (&moment.measured, &moment.acting);
        let is_airborne = self.rate_controller.is_airborne(acting);
        if moment.may_adapt && is_airborne {
            let axis = measured.world_from_body.column(2);
            let modelled = Vector3::z() * GRAVITY - axis * (acting.thrust / self.model.mass);
            self.residual = acting.acceleration_world - modelled;
        }
        let yaw_rate = self.rate_controller.yaw_rate(moment);
        let start = Predicted {
            position: measured.position_world,
            velocity: measured.velocity_world(),
            world_from_body: measured.world_from_body,
            omega: measured.angular_velocity_body.xy(),
            thrust: acting.thrust,
        };
        self.shift(moment.elapsed);
        let push = Push {
            residual: self.residual,
            yaw_rate,
        };
        let planned = self.planned(&start, moment.reference, &push);
        if planned.iter().flatten().all(|number| number.is_finite()) {
            self.plan = planned;
        }
        let [x, y, thrust] = self.plan[0].into();
        LawOutput {
            command: Commanded {
                thrust,
                rates_body: [x, y, yaw_rate],
                ..Commanded::NOTHING
            },
            limited_thrust: thrust,
            telemetry: self.telemetry(measured, moment.reference),
            is_feasible: is_airborne,
        }
    }

    fn skip(&mut self, elapsed: f64) {
        self.shift(elapsed);
    }

    /// Plans a hover.
    fn pause(&mut self) {
        self.plan = [Vector3::new(0.0, 0.0, self.model.mass * GRAVITY); STEPS];
        self.rate_controller.reset();
    }

    fn estimate(&self) -> Option<VehicleEstimate> {
        Some(VehicleEstimate {
            eta: 1.0 / self.model.mass,
            disturbance_world: self.residual,
        })
    }

    fn save(&self) -> LawState {
        let record = NmpcState {
            plan: self.plan.map(|input| PlannedInput {
                components: input.into(),
            }),
            residual_world: self.residual.into(),
        };
        LawState::new(&record, Some(&self.rate_controller))
    }

    fn restore(&mut self, state: &LawState) {
        let NmpcState { plan, residual_world } = state.read();
        self.plan = plan.map(|input| input.components.into());
        self.residual = residual_world.into();
        self.rate_controller.state = state.rate_controller;
    }

    fn record_layout(&self) -> String {
        layout_hash::<NmpcState>()
    }
}

/// Motion that is wanted at a step.
#[derive(Clone, Copy)]
struct Wanted {
    position: Vector3<f64>,
    velocity: Vector3<f64>,
    /// T that carries the vehicle along, N.
    thrust: f64,
}

impl Wanted {
    fn of(reference: &Reference, nearer: &Vector3<f64>, law: &Nmpc, push: &Push) -> Self {
        let force = Vector3::z() * GRAVITY + push.residual - reference.acceleration_world();
        Self {
            position: reference.position_world + nearer,
            velocity: reference.velocity_world(),
            thrust: law.model.mass * force.norm(),
        }
    }

    /// Derivative of the cost of a state.
    fn slope(&self, state: &Predicted) -> Error {
        let mut slope = Error::zeros();
        let (position, velocity) = (state.position - self.position, state.velocity - self.velocity);
        slope
            .fixed_rows_mut::<3>(P)
            .copy_from(&(position * POSITION_WEIGHT));
        slope
            .fixed_rows_mut::<3>(V)
            .copy_from(&(velocity * VELOCITY_WEIGHT));
        slope
    }
}

/// Weights of a state's errors.
fn weights() -> Error {
    let mut weights = Error::zeros();
    weights.fixed_rows_mut::<3>(P).fill(POSITION_WEIGHT);
    weights.fixed_rows_mut::<3>(V).fill(VELOCITY_WEIGHT);
    weights
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    const PUSH: Push = Push {
        residual: Vector3::new(0.3, -0.4, 0.2),
        yaw_rate: 0.0,
    };
    const H: f64 = 0.022;

    fn law() -> Nmpc {
        let text = r#"{"duration": 1, "vehicle": {"mass": 0.2, "inertia": [6.5e-4, 6.5e-4, 13e-4]},
            "path": {"curve": {"tilted_eight": {}}}, "controller": {"law": "nmpc", "rates": {}}}"#;
        Nmpc::new(&serde_json::from_str(text).unwrap())
    }

    /// A state some way from a hover; where it turns, the derivatives leave the turn of the error out.
    fn state(numbers: [f64; 9], omega: Vector2<f64>) -> Predicted {
        let [px, py, pz, vx, vy, vz, roll, pitch, thrust] = numbers;
        Predicted {
            position: Vector3::new(px, py, pz),
            velocity: Vector3::new(vx, vy, vz),
            world_from_body: rotation::from_roll_pitch_yaw([roll, pitch, 0.4]),
            omega,
            thrust: 2.0 + thrust,
        }
    }

    /// The state with an error added.
    fn moved(state: &Predicted, error: &Error) -> Predicted {
        let tilt = Vector3::new(error[TILT], error[TILT + 1], 0.0);
        Predicted {
            position: state.position + error.fixed_rows::<3>(P),
            velocity: state.velocity + error.fixed_rows::<3>(V),
            world_from_body: state.world_from_body * rotation::exp(&tilt),
            omega: state.omega + error.fixed_rows::<2>(RATE),
            thrust: state.thrust + error[THRUST],
        }
    }

    proptest! {
        #[test]
        fn the_derivatives_of_a_step_are_those_of_the_model(
            numbers in prop::array::uniform9(-0.8..0.8f64), thrust in 0.5..5.0f64,
        ) {
            let (model, from) = (law().model, state(numbers, Vector2::zeros()));
            let input = Vector3::new(0.0, 0.0, thrust);
            let step = model.linearized(&from, &input, &PUSH, H);
            let difference = 1e-6;
            for column in 0..STATES {
                let mut error = Error::zeros();
                error[column] = difference;
                let ends = [error, -error].map(|error| model.advance(&moved(&from, &error), &input, &PUSH, H));
                let rate = ends[0].error_about(&ends[1]) / (2.0 * difference);
                let defect = (rate - step.by_state.column(column)).norm();
                prop_assert!(defect < 1e-7, "state {}: {}", column, defect);
            }
            for column in 0..INPUTS {
                let mut change = Vector3::zeros();
                change[column] = difference;
                let ends = [change, -change].map(|change| model.advance(&from, &(input + change), &PUSH, H));
                let rate = ends[0].error_about(&ends[1]) / (2.0 * difference);
                let defect = (rate - step.by_input.column(column)).norm();
                prop_assert!(defect < 1e-7, "input {}: {}", column, defect);
            }
        }

        #[test]
        fn a_plan_keeps_the_limits_and_is_finite_from_any_state(
            numbers in prop::array::uniform9(-30.0..30.0f64), omega in prop::array::uniform2(-19.0..19.0f64),
        ) {
            let mut law = law();
            law.model.limits = [Vector3::new(-19.0, -19.0, 0.0), Vector3::new(19.0, 19.0, 5.5)];
            let plan = law.planned(&state(numbers, omega.into()), &hovering(), &PUSH);
            for input in plan {
                prop_assert!(input.iter().all(|number| number.is_finite()));
                let [least, largest] = law.model.limits;
                prop_assert!(input == input.sup(&least).inf(&largest));
            }
        }
    }

    #[test]
    fn a_plan_moves_on_by_the_time_that_has_passed() {
        let ramp = |index: f64| Vector3::new(index, -2.0 * index, 1.0 + index);
        let last = (STEPS - 1) as f64;
        for (steps, first) in [
            (0.0, 0.0),
            (0.25, 0.25),
            (1.0, 1.0),
            (6.0, 6.0),
            (6.5, 6.5),
            (1e4, last),
        ] {
            let mut law = law();
            law.plan = std::array::from_fn(|index| ramp(index as f64));
            law.shift(steps * law.step);
            for (index, input) in law.plan.iter().enumerate() {
                let expected = ramp((first + index as f64).min(last));
                assert!((input - expected).norm() < 1e-12, "{steps}, {index}: {input}");
            }
        }
    }

    fn hovering() -> Reference {
        let zero = Vector3::zeros();
        Reference {
            gamma: 0.0,
            gamma_dot: 0.0,
            gamma_ddot: 0.0,
            gamma_dot_desired: 0.0,
            gamma_dddot_constant: 0.0,
            gamma_dddot_slope: 0.0,
            position_world: zero,
            derivative1_world: zero,
            derivative2_world: zero,
            derivative3_world: zero,
        }
    }

    /// Cost of a plan by its definition.
    fn cost(law: &Nmpc, start: &Predicted, plan: &[Vector3<f64>; STEPS]) -> f64 {
        let wanted = Wanted::of(&hovering(), &Vector3::zeros(), law, &PUSH);
        let mut state = *start;
        plan.iter().enumerate().fold(0.0, |cost, (index, input)| {
            state = law.model.advance(&state, input, &PUSH, law.step);
            let factor = if index + 1 == STEPS { TERMINAL } else { 1.0 };
            let errors = POSITION_WEIGHT * state.position.norm_squared()
                + VELOCITY_WEIGHT * state.velocity.norm_squared();
            let inputs = law.rate_weight * input.xy().norm_squared()
                + THRUST_WEIGHT * (input.z - wanted.thrust) * (input.z - wanted.thrust);
            cost + factor * errors + inputs
        })
    }

    #[test]
    fn passes_converge_to_a_plan_from_which_every_small_step_costs_more() {
        let mut law = law();
        let start = state(
            [4e-3, -3e-3, 5e-3, 0.01, 0.0, -0.01, 5e-3, -3e-3, 0.01],
            Vector2::new(0.02, -0.01),
        );
        for _ in 0..20 {
            law.plan = law.planned(&start, &hovering(), &PUSH);
        }
        let least = cost(&law, &start, &law.plan);
        for index in 0..STEPS {
            for input in 0..INPUTS {
                for change in [-0.05, 0.05] {
                    let mut other = law.plan;
                    other[index][input] += change;
                    let more = cost(&law, &start, &other);
                    assert!(more > least, "{index}.{input}: {more} of {least}");
                }
            }
        }
    }
}
