//! The controller as a service: at each step the law, and between steps its estimators.
//!
//! The estimators η̂, b̂ and ŵ step by the explicit Euler method: the estimates of a step are those of the
//! previous step plus the elapsed time times that step's rates, and the law uses them as they are then.
//!
//! Commands are thrust and torque, or with `controller.rates` thrust and body rates ([`crate::commander`]).
//!
//! When it cannot or should not do so:
//! * a state or reference that cannot be true is refused and counted, and the last good one stays in its place;
//! * with a policy for the age of the state it goes from the law over holding, levelling and descending to failsafe,
//!   and back without a jump ([`crate::safety`]); with one for the reference an old path stands still
//!   ([`crate::references`]). The estimates rest meanwhile, on reckoned states, and on the way back;
//! * where numbers that passed as those of a flight make the law say some that are not finite, the last command is
//!   repeated; estimates that would not be finite rest;
//! * without a state or without a reference the law has nothing to say: the command is no thrust and no
//!   torque or rates, the errors are zero, and the estimates rest. The ideal schedule has no such step;
//! * while the state does not rest on a measurement of the body (`tracked` is not set) the law commands on what
//!   the estimator believes, but the estimates rest: there is nothing to learn from a prediction;
//! * with body rates the estimates also rest while the link cannot carry the thrust that the law asks for, and
//!   while the vehicle's thrust could not carry the lightest vehicle: it is not airborne.

use nalgebra::Vector3;
use shared_types::gate::{GateState, StateGate, StateGateState};
use shared_types::sample::{Field, Flag};
use shared_types::samples::{ControlAdaptation, ControlCommand, ControlErrors, PathReference, VehicleState};
use shared_types::scenario::Scenario;
use shared_types::wiring::{ControllerInputs, ControllerOutputs};
use shared_types::{Now, Service, ServiceId, Topic, rotation};

use zerocopy::FromZeros;

use crate::commander::{Commander, Memory};
use crate::fallback::Stage;
use crate::law::{Evaluation, evaluate};
use crate::observer::{MassObserver, Sight};
use crate::parameters::Parameters;
use crate::reckoning::{Believed, Commanded, Reckoned};
use crate::references::References;
use crate::regressor::ParameterVector;
use crate::safety::Safety;
use crate::signals::{Acting, EstimateRates, Estimates, Measured};
use crate::transfer::Transfer;

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
        /// What is remembered of the states.
        pub states: StateGateState,
        /// The last good reference; all zero before the first.
        pub reference: PathReference,
        /// What is remembered of the references.
        pub references: GateState,
        /// The last command that was published; all zero before the first.
        pub last: Commanded,
        /// The vehicle as reckoned; as at the start without a policy.
        pub reckoned: Reckoned,
        /// The way back to the law.
        pub transfer: Transfer,
        /// Whether the observer saw anything.
        pub observer_has_seen: Flag,
        /// Whether there was a last command.
        pub has_last: Flag,
        /// The stage of the last step.
        pub stage: u8,
        /// Explicit padding.
        pub pad0: [u8; 5],
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
    states: StateGate,
    references: References,
    /// What is done about old states; `None` flies by them however old they are.
    safety: Option<Safety>,
    /// The last command that was published.
    last: Option<Commanded>,
    /// The stage of the last step.
    stage: Stage,
}

/// What the law says in a step.
struct Said {
    command: Commanded,
    errors: ControlErrors,
    rates: EstimateRates,
    /// Whether the rates may act.
    learns: bool,
    /// The thrust that will act on a state that was measured, N; `None` if the motion then teaches nothing.
    thrust: Option<f64>,
}

impl ControllerService {
    /// The controller of a scenario that has been checked, with its initial estimates.
    #[must_use]
    pub fn new(scenario: &Scenario) -> Self {
        let controller = &scenario.controller;
        let safety = scenario.safety_of(Topic::VehicleState, ServiceId::Controller);
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
            states: StateGate::new(safety),
            references: References::new(scenario),
            safety: safety.map(|safety| Safety::new(scenario, safety)),
            last: None,
            stage: Stage::Law,
        }
    }

    /// What is commanded on the last good state and reference, and what the law says to it if it is asked; `is_new`
    /// if the state is of this step.
    #[inline]
    fn fly(
        &mut self,
        now: &Now,
        state: &VehicleState,
        is_new: bool,
        reference: &PathReference,
    ) -> (Commanded, Option<Said>) {
        let before = self.stage;
        let Some(mut safety) = self.safety else {
            return self.fly_by_law(now, state, reference);
        };
        let believed = Believed::new(&self.parameters, &self.estimates);
        let age_ns = self.states.age_ns(now).unwrap_or(0);
        let last = self.last.as_ref();
        safety.reckon(now, state, is_new, age_ns, last, &believed);
        self.stage = safety.stage(age_ns, last);
        if self.stage != Stage::Law {
            safety.transfer = Transfer::NONE;
            let command = safety.command(self.stage, last, &believed);
            self.safety = Some(safety);
            return (command, None);
        }
        let state = safety.state_for_law(state, age_ns, &believed);
        if before != Stage::Law
            && let Some(commander) = &mut self.commander
        {
            commander.memory.artificial_omega = state.angular_velocity_body.into();
        }
        let (law, mut said) = self.fly_by_law(now, &state, reference);
        let mut command = law;
        if let Some(said) = &mut said {
            command = safety.pass_over(now, before, self.last.as_ref(), &law);
            if safety.transfer.is_under_way() {
                (said.learns, said.thrust) = (false, None);
            }
        }
        self.safety = Some(safety);
        (command, said)
    }

    /// The law's command, and all else that it says; if that are no finite numbers, the last command.
    #[inline]
    fn fly_by_law(
        &mut self,
        now: &Now,
        state: &VehicleState,
        reference: &PathReference,
    ) -> (Commanded, Option<Said>) {
        let said = self.ask_law(now, state, reference);
        if said.is_sound() {
            return (said.command, Some(said));
        }
        self.states.refuse();
        if let Some(commander) = &mut self.commander {
            commander.memory.artificial_omega = Vector3::zeros();
        }
        self.stage = Stage::Hold;
        (self.last.unwrap_or(Commanded::NOTHING), None)
    }

    #[inline]
    fn ask_law(&mut self, now: &Now, state: &VehicleState, reference: &PathReference) -> Said {
        let mut measured = Measured::from(state);
        let target = self.references.target(now, reference);
        let tracked = state.tracked.is_set();
        let z1 = Vector3::from(state.position_world) - target.position_world;
        let Some(commander) = &mut self.commander else {
            measured.position_world += self.parameters.offset(&measured.world_from_body);
            let law = evaluate(&self.parameters, &measured, &target, &self.estimates);
            let command = Commanded {
                thrust: law.thrust,
                torque_body: law.torque.into(),
                ..Commanded::NOTHING
            };
            return Said::new(command, &law, &z1, tracked, tracked.then_some(law.thrust));
        };
        let output = commander.command(
            &self.parameters,
            &measured,
            &Acting::from(state),
            &target,
            &self.estimates,
            reference.yaw,
        );
        let command = Commanded {
            thrust: output.thrust,
            rates_body: output.rates_body.into(),
            ..Commanded::NOTHING
        };
        let thrust = tracked.then_some(output.limited_thrust);
        Said::new(command, &output.law, &z1, tracked && output.is_telling, thrust)
    }

    /// The mode of the commands of this step.
    fn mode(&self) -> u32 {
        match (self.stage, &self.commander) {
            (Stage::Failsafe, _) => ControlCommand::MODE_FAILSAFE,
            (_, Some(_)) => ControlCommand::MODE_RATES,
            (_, None) => ControlCommand::MODE_TORQUE,
        }
    }

    /// Lets the observer see the state and the thrust (N) that is commanded on it; `None` if it cannot learn from it.
    #[inline]
    fn observe(&mut self, state: &VehicleState, thrust: Option<f64>, elapsed: f64) {
        let Some(observer) = &mut self.observer else {
            return;
        };
        if let Some(thrust) = thrust.filter(|_| elapsed > 0.0) {
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

impl Said {
    #[inline]
    fn new(
        command: Commanded,
        law: &Evaluation,
        z1: &Vector3<f64>,
        learns: bool,
        thrust: Option<f64>,
    ) -> Self {
        let mut errors = ControlErrors::new_zeroed();
        write_errors(&mut errors, law);
        errors.z1 = (*z1).into();
        Self {
            command,
            errors,
            rates: law.rates,
            learns,
            thrust,
        }
    }

    /// Whether all that it says are finite numbers.
    #[inline]
    fn is_sound(&self) -> bool {
        self.command.is_finite() && self.errors.is_finite() && self.rates.is_finite()
    }
}

impl Service for ControllerService {
    const ID: ServiceId = ServiceId::Controller;
    type Inputs<'a> = ControllerInputs<'a>;
    type Outputs<'a> = ControllerOutputs<'a>;
    type State = ControllerState;

    #[inline]
    fn step(&mut self, now: &Now, inputs: &ControllerInputs<'_>, outputs: &mut ControllerOutputs<'_>) {
        let advanced = self.estimates.advanced(&self.rates, now.elapsed());
        if advanced.is_finite() {
            self.estimates = advanced;
        }
        self.rates = EstimateRates::ZERO;
        if let Some(adaptation) = outputs.adaptation.due() {
            write_adaptation(adaptation, &self.parameters, &self.estimates);
            adaptation.observer_mass_estimate = self.observer.map_or(0.0, |observer| 1.0 / observer.theta);
        }
        let is_new = self.states.look(now, &inputs.state);
        self.references.look(now, &inputs.reference);
        let mut command = Commanded::NOTHING;
        let mut learns = false;
        if let (Some(&state), Some(&reference)) = (
            self.states.held(&inputs.state),
            self.references.held(&inputs.reference),
        ) {
            self.stage = if self.safety.is_some() {
                self.stage
            } else {
                Stage::Law
            };
            let said;
            (command, said) = self.fly(now, &state, is_new, &reference);
            learns = said.as_ref().is_some_and(|said| said.learns);
            self.observe(&state, said.as_ref().and_then(|said| said.thrust), now.elapsed());
            if let Some(said) = said {
                if learns {
                    self.rates = said.rates;
                }
                if let Some(errors) = outputs.errors.due() {
                    *errors = ControlErrors {
                        header: errors.header,
                        ..said.errors
                    };
                }
            }
            if outputs.command.due().is_some() {
                self.last = Some(command);
            }
        }
        if let Some(adaptation) = outputs.adaptation.due() {
            adaptation.resting = (!learns).into();
            adaptation.inputs_refused = self.states.refused().saturating_add(self.references.refused());
            adaptation.stage = self.stage.code();
        }
        if let Some(due) = outputs.command.due() {
            due.thrust = command.thrust;
            due.torque_body = command.torque_body;
            due.rates_body = command.rates_body;
            due.mode = self.mode();
        }
    }

    fn save(&self) -> ControllerState {
        let Self { estimates, rates, .. } = self;
        let memory = self.commander.map_or(Memory::NONE, |commander| commander.memory);
        let seen = self.observer.and_then(|observer| observer.previous);
        let sight = seen.unwrap_or(Sight::NOTHING);
        let (references, reference) = self.references.save();
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
            states: self.states.save(),
            reference,
            references,
            last: self.last.unwrap_or(Commanded::NOTHING),
            reckoned: self.safety.map_or(Reckoned::NOTHING, |safety| safety.reckoned),
            transfer: self.safety.map_or(Transfer::NONE, |safety| safety.transfer),
            observer_has_seen: seen.is_some().into(),
            has_last: self.last.is_some().into(),
            stage: self.stage.code(),
            pad0: [0; 5],
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
        self.states.restore(&state.states);
        self.references.restore(&state.references, &state.reference);
        self.last = state.has_last.is_set().then_some(state.last);
        self.stage = Stage::from_code(state.stage);
        if let Some(safety) = &mut self.safety {
            (safety.reckoned, safety.transfer) = (state.reckoned, state.transfer);
        }
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
