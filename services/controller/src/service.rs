//! The controller as a service: at each step the law, and between steps its estimators.
//!
//! The estimators η̂, b̂ and ŵ step by the explicit Euler method: the estimates of a step are those of the
//! previous step plus the elapsed time times that step's rates, and the law uses them as they are then.
//!
//! When it cannot or should not do so:
//! * without a state or without a reference the law has nothing to say: the command is no thrust and no
//!   torque, the errors are zero, and the estimates rest. The ideal schedule has no such step;
//! * while the state does not rest on a measurement of the body (`tracked` is not set) the law commands on what
//!   the estimator believes, but the estimates rest: there is nothing to learn from a prediction.

use nalgebra::Vector3;
use shared_types::samples::{ControlAdaptation, ControlCommand, ControlErrors};
use shared_types::scenario::Scenario;
use shared_types::wiring::{ControllerInputs, ControllerOutputs};
use shared_types::{Now, Service, ServiceId};

use crate::law::{Evaluation, evaluate};
use crate::parameters::Parameters;
use crate::regressor::ParameterVector;
use crate::signals::{EstimateRates, Estimates, Measured, Reference};

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
    }
}

/// The adaptive control law as a service of the flight.
#[derive(Clone, Debug)]
pub struct ControllerService {
    parameters: Parameters,
    estimates: Estimates,
    rates: EstimateRates,
}

impl ControllerService {
    /// The controller of a scenario, with its initial estimates.
    #[must_use]
    pub fn new(scenario: &Scenario) -> Self {
        Self {
            parameters: Parameters::from(&scenario.controller),
            estimates: Estimates::from(&scenario.controller.initial),
            rates: EstimateRates::ZERO,
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
        }
        if let Some(command) = outputs.command.due() {
            command.mode = ControlCommand::MODE_TORQUE;
        }
        let (Some(state), Some(reference)) = (inputs.state.newest(), inputs.reference.newest()) else {
            return;
        };
        let (measured, reference) = (Measured::from(state), Reference::from(reference));
        let evaluation = evaluate(&self.parameters, &measured, &reference, &self.estimates);
        if state.tracked.is_set() {
            self.rates = evaluation.rates;
        }
        if let Some(command) = outputs.command.due() {
            command.thrust = evaluation.thrust;
            command.torque_body = evaluation.torque.into();
        }
        if let Some(errors) = outputs.errors.due() {
            write_errors(errors, &evaluation);
        }
    }

    fn save(&self) -> ControllerState {
        let Self { estimates, rates, .. } = self;
        ControllerState {
            eta_hat: estimates.eta,
            disturbance_hat_world: estimates.disturbance_world.into(),
            w_hat: estimates.w.into(),
            eta_hat_rate: rates.eta,
            disturbance_hat_rate_world: rates.disturbance_world.into(),
            w_hat_rate: rates.w.into(),
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
