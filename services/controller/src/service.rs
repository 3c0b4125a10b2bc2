//! The controller as a service: at each step the law, and between steps its estimators.
//!
//! The estimators η̂, b̂ and ŵ step by the explicit Euler method: the estimates of a step are those of the
//! previous step plus the elapsed time times that step's rates, and the law uses them as they are then.
//!
//! Commands are thrust and torque, or with `controller.rates` thrust and body rates ([`crate::commander`]).
//!
//! When it cannot or should not do so:
//! * without a state or without a reference the law has nothing to say: the command is no thrust and no
//!   torque or rates, the errors are zero, and the estimates rest. The ideal schedule has no such step;
//! * while the state does not rest on a measurement of the body (`tracked` is not set) the law commands on what
//!   the estimator believes, but the estimates rest: there is nothing to learn from a prediction;
//! * with body rates the estimates also rest while the link cannot carry the thrust that the law asks for, and
//!   while the vehicle's thrust could not carry the lightest vehicle: it is not airborne.

use nalgebra::Vector3;
use shared_types::samples::{ControlAdaptation, ControlCommand, ControlErrors, PathReference, VehicleState};
use shared_types::scenario::Scenario;
use shared_types::wiring::{ControllerInputs, ControllerOutputs};
use shared_types::{Now, Service, ServiceId, rotation, sample::Flag};

use zerocopy::FromZeros;

use crate::commander::{Commander, Memory};
use crate::law::{Evaluation, evaluate};
use crate::observer::{MassObserver, Sight};
use crate::parameters::Parameters;
use crate::regressor::ParameterVector;
use crate::signals::{Acting, EstimateRates, Estimates, Measured, Reference};

shared_types::sample! {
    /// The estimators after a step, and where they are going.
    pub struct ControllerState {
        /// η̂, 1/kg.
        pub eta_hat: f64,
        /// b̂ in {I}, m/s².
        pub disturbance_hat_world: [f64; 3],
        /// ŵ: Diag(J), η Diag(J), J1 b, J2 b, J3 b.
        pub w_hat: [f64; 15],
        /// dη̂/dt, 1/(kg s).
        pub eta_hat_rate: f64,
        /// db̂/dt in {I}, m/s³.
        pub disturbance_hat_rate_world: [f64; 3],
        /// dŵ/dt.
        pub w_hat_rate: [f64; 15],
        /// The artificial ω; zero with commands of torque.
        pub artificial_omega: [f64; 3],
        /// Integral term of the yaw law, rad/s; zero with commands of torque.
        pub yaw_integral: f64,
        /// θ̄ of the mass observer, 1/kg; zero without one.
        pub observer_theta: f64,
        /// What it saw last: velocity in {I}, m/s.
        pub observer_velocity_world: [f64; 3],
        /// What it saw last: thrust axis in {I}.
        pub observer_thrust_axis_world: [f64; 3],
        /// What it saw last: thrust, N.
        pub observer_thrust: f64,
        /// Whether it saw anything.
        pub observer_has_seen: Flag,
        /// Explicit padding.
        pub pad0: [u8; 7],
    }
}

/// The adaptive control law as a service of the flight.
#[derive(Clone, Debug)]
pub struct ControllerService {
    parameters: Parameters,
    estimates: Estimates,
    rates: EstimateRates,
    /// Makes commands of body rates; `None` commands torque.
    commander: Option<Commander>,
    observer: Option<MassObserver>,
}

impl ControllerService {
    /// The controller of a scenario that has been checked, with its initial estimates.
    #[must_use]
    pub fn new(scenario: &Scenario) -> Self {
        let controller = &scenario.controller;
        Self {
            parameters: Parameters::from(controller),
            estimates: Estimates::from(&controller.initial),
            rates: EstimateRates::ZERO,
            commander: controller
                .rates
                .as_ref()
                .map(|rates| Commander::new(scenario, rates)),
            observer: controller
                .observer_gain
                .map(|gain| MassObserver::new(gain, controller.initial.mass)),
        }
    }

    /// The law's command; the law, and whether its rates may act.
    #[inline]
    fn command(
        &mut self,
        state: &VehicleState,
        reference: &PathReference,
        elapsed: f64,
        command: &mut ControlCommand,
    ) -> (Evaluation, bool) {
        let mut measured = Measured::from(state);
        let target = Reference::from(reference);
        let tracked = state.tracked.is_set();
        let Some(commander) = &mut self.commander else {
            measured.position_world += self.parameters.offset(&measured.world_from_body);
            let law = evaluate(&self.parameters, &measured, &target, &self.estimates);
            command.thrust = law.thrust;
            command.torque_body = law.torque.into();
            self.observe(state, law.thrust, elapsed);
            return (law, tracked);
        };
        let output = commander.command(
            &self.parameters,
            &measured,
            &Acting::from(state),
            &target,
            &self.estimates,
            reference.yaw,
        );
        command.thrust = output.thrust;
        command.rates_body = output.rates_body.into();
        self.observe(state, output.limited_thrust, elapsed);
        (output.law, tracked && output.is_telling)
    }

    /// Lets the observer see the state and the thrust (N) that is commanded on it.
    #[inline]
    fn observe(&mut self, state: &VehicleState, thrust: f64, elapsed: f64) {
        let Some(observer) = &mut self.observer else {
            return;
        };
        if state.tracked.is_set() && elapsed > 0.0 {
            let world_from_body = rotation::from_row_major(&state.world_from_body);
            let now = Sight {
                velocity_world: world_from_body * Vector3::from(state.velocity_body),
                thrust_axis_world: world_from_body.column(2).into(),
                thrust,
            };
            observer.step(now, elapsed);
        } else {
            observer.interrupt();
        }
    }
}

impl Service for ControllerService {
    const ID: ServiceId = ServiceId::Controller;
    type Inputs<'a> = ControllerInputs<'a>;
    type Outputs<'a> = ControllerOutputs<'a>;
    type State = ControllerState;

    #[inline]
    fn step(&mut self, now: &Now, inputs: &ControllerInputs<'_>, outputs: &mut ControllerOutputs<'_>) {
        self.estimates = self.estimates.advanced(&self.rates, now.elapsed());
        self.rates = EstimateRates::ZERO;
        if let Some(adaptation) = outputs.adaptation.due() {
            write_adaptation(adaptation, &self.parameters, &self.estimates);
            adaptation.observer_mass_estimate = self.observer.map_or(0.0, |observer| 1.0 / observer.theta);
        }
        let mut command = ControlCommand::new_zeroed();
        command.mode = match self.commander {
            Some(_) => ControlCommand::MODE_RATES,
            None => ControlCommand::MODE_TORQUE,
        };
        let mut learns = false;
        if let (Some(state), Some(reference)) = (inputs.state.newest(), inputs.reference.newest()) {
            let law;
            (law, learns) = self.command(state, reference, now.elapsed(), &mut command);
            if learns {
                self.rates = law.rates;
            }
            if let Some(errors) = outputs.errors.due() {
                write_errors(errors, &law);
                errors.z1 =
                    (Vector3::from(state.position_world) - Vector3::from(reference.position_world)).into();
            }
        }
        if let Some(adaptation) = outputs.adaptation.due() {
            adaptation.resting = (!learns).into();
        }
        if let Some(due) = outputs.command.due() {
            command.header = due.header;
            *due = command;
        }
    }

    fn save(&self) -> ControllerState {
        let Self { estimates, rates, .. } = self;
        let memory = self.commander.map_or(Memory::NONE, |commander| commander.memory);
        let seen = self.observer.and_then(|observer| observer.previous);
        let sight = seen.unwrap_or(Sight::NOTHING);
        ControllerState {
            eta_hat: estimates.eta,
            disturbance_hat_world: estimates.disturbance_world.into(),
            w_hat: estimates.w.into(),
            eta_hat_rate: rates.eta,
            disturbance_hat_rate_world: rates.disturbance_world.into(),
            w_hat_rate: rates.w.into(),
            artificial_omega: memory.artificial_omega.into(),
            yaw_integral: memory.yaw_integral,
            observer_theta: self.observer.map_or(0.0, |observer| observer.theta),
            observer_velocity_world: sight.velocity_world.into(),
            observer_thrust_axis_world: sight.thrust_axis_world.into(),
            observer_thrust: sight.thrust,
            observer_has_seen: seen.is_some().into(),
            pad0: [0; 7],
        }
    }

    fn restore(&mut self, state: &ControllerState) {
        self.estimates = Estimates {
            eta: state.eta_hat,
            disturbance_world: Vector3::from(state.disturbance_hat_world),
            w: ParameterVector::from(state.w_hat),
        };
        self.rates = EstimateRates {
            eta: state.eta_hat_rate,
            disturbance_world: Vector3::from(state.disturbance_hat_rate_world),
            w: ParameterVector::from(state.w_hat_rate),
        };
        if let Some(commander) = &mut self.commander {
            commander.memory = Memory {
                artificial_omega: state.artificial_omega.into(),
                yaw_integral: state.yaw_integral,
            };
        }
        if let Some(observer) = &mut self.observer {
            observer.theta = state.observer_theta;
            observer.previous = state.observer_has_seen.is_set().then(|| Sight {
                velocity_world: state.observer_velocity_world.into(),
                thrust_axis_world: state.observer_thrust_axis_world.into(),
                thrust: state.observer_thrust,
            });
        }
    }
}

#[inline]
fn write_adaptation(adaptation: &mut ControlAdaptation, parameters: &Parameters, estimates: &Estimates) {
    let eta_projected = parameters.eta_projection.value(estimates.eta);
    let disturbance_projected = estimates
        .disturbance_world
        .map(|b| parameters.disturbance_projection.value(b));
    adaptation.eta_hat = estimates.eta;
    adaptation.eta_projected = eta_projected;
    adaptation.mass_estimate = 1.0 / eta_projected;
    adaptation.disturbance_hat_world = estimates.disturbance_world.into();
    adaptation.disturbance_projected_world = disturbance_projected.into();
    adaptation.w_hat = estimates.w.into();
}

#[inline]
fn write_errors(errors: &mut ControlErrors, evaluation: &Evaluation) {
    errors.z1 = evaluation.z1.into();
    errors.z2 = evaluation.z2.into();
    errors.z3 = evaluation.z3.into();
    errors.z4 = evaluation.z4;
    errors.zeta = evaluation.zeta.into();
    errors.omega_desired = evaluation.omega_desired.into();
}
