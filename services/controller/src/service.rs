//! Controller as a service: the law at each step, and its estimators between steps.
//!
//! The estimators η̂, b̂ and ŵ step by the explicit Euler method: the estimates of a step are those of the previous
//! step plus the elapsed time times that step's rates, and the law uses them.
//!
//! Commands are thrust and torque, or with `controller.rates` thrust and body rates ([`control_law::rate_controller`]).
//!
//! Failure policy:
//! * an impossible state or reference is refused and counted, and the last good one stays in use;
//! * with a policy for the age of the state the stage goes from nominal over hold, level and descend to failsafe, and
//!   back without a jump ([`crate::safety`]); with one for the reference an old path stands still
//!   ([`crate::references`]). The estimates are frozen meanwhile, on predicted states, and during the transfer back;
//! * if valid inputs lead to a command that is not finite, the last command is repeated; estimates that would not be
//!   finite are frozen;
//! * without a state or a reference the controller is not active: the command is no thrust and no torque or rates, the
//!   errors are zero, and the estimates are frozen. The ideal schedule has no such step;
//! * while the state rests on no measurement of the body (`tracked` is not set) the law commands on the estimator's
//!   prediction, but the estimates are frozen: a prediction carries no new information;
//! * in a flight with phases it commands nothing but failsafe while it is disarmed ([`crate::phase`]), and the
//!   estimates are frozen while the vehicle is not airborne;
//! * with body rates the estimates are also frozen while the link cannot carry the thrust of the law, and while the
//!   thrust could not carry the lightest vehicle: it is not airborne.

use nalgebra::Vector3;
use scenario::Scenario;
use shared_types::input_validator::{GateState, StateGateState, StateValidator};
use shared_types::sample::Flag;
use shared_types::samples::{ControlAdaptation, PathReference};
use shared_types::wiring::{ControllerInputs, ControllerOutputs};
use shared_types::{Gains, Now, Service, ServiceId, Topic};

use crate::bumpless_transfer::Transfer;
use crate::command_history::CommandHistory;
use crate::control_supervisor::{ControlInput, ControlSupervisor, Telemetry};
use crate::dead_reckoning::{ModelEstimate, Reckoned};
use crate::failsafe::FailsafeStage;
use crate::lone_landing::LoneLanding;
use crate::phase::{ControlMode, ControlModes};
use crate::references::References;
use control_law::adaptive::parameter_vector::ParameterVector;
use control_law::adaptive::parameters::Parameters;
use control_law::law::MEMORY;
use control_law::observer::ObserverSample;
use control_law::rate_controller::RateControllerState;
use control_law::signals::Commanded;
use control_law::signals::{EstimateRates, Estimates};

shared_types::sample! {
    /// State of the controller after a step, with the rates of the estimates.
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
        /// State of the law beside its estimates.
        pub law: [f64; MEMORY],
        /// θ̄ of the mass observer, 1/kg; zero without one.
        pub observer_theta: f64,
        /// Last sample of the observer: velocity in {I}, m/s.
        pub observer_velocity_world: [f64; 3],
        /// Last sample of the observer: thrust axis in {I}.
        pub observer_thrust_axis_world: [f64; 3],
        /// Last sample of the observer: thrust, N.
        pub observer_thrust: f64,
        /// State of the input validator of states.
        pub states: StateGateState,
        /// The last good reference; all zero before the first.
        pub reference: PathReference,
        /// State of the input validator of references.
        pub references: GateState,
        /// The last command that was published; all zero before the first.
        pub last: Commanded,
        /// Time for which it has been landing without a path generator, s.
        pub lands_alone_for: f64,
        /// Time for which it has stood on the ground then, s.
        pub standing_for: f64,
        /// The predicted vehicle; as at the start without a policy.
        pub reckoned: Reckoned,
        /// The commands that it has followed; none without a policy.
        pub commands: CommandHistory,
        /// The transfer back to the law.
        pub transfer: Transfer,
        /// Time for which the cameras have not seen the vehicle, ns; 0 without a policy.
        pub unseen_ns: u64,
        /// `true` if the observer has a last sample.
        pub observer_has_seen: Flag,
        /// `true` if there was a last command.
        pub has_last: Flag,
        /// The stage of the last step.
        pub stage: u8,
        /// Explicit padding.
        pub pad0: [u8; 5],
    }
}

/// Adaptive control law as a service of the flight.
#[derive(Clone, Debug)]
pub struct ControllerService {
    supervisor: ControlSupervisor,
    /// Rates of the estimates since the last step.
    rates: EstimateRates,
    states: StateValidator,
    references: References,
    /// The landing without a path generator, in a flight with phases.
    lone_landing: Option<LoneLanding>,
    modes: ControlModes,
    /// Gains of the scenario.
    gains: Gains,
    /// Planned changes of them, each with the tick from which it holds.
    planned: Vec<(u64, Gains)>,
    /// Gains that were changed in flight without a plan: they hold in place of all others.
    tuned: Option<Gains>,
}

impl ControllerService {
    /// Makes the controller of a checked scenario, with its initial estimates.
    #[must_use]
    pub fn new(scenario: &Scenario) -> Self {
        let safety = scenario.safety_of(Topic::VehicleState, ServiceId::Controller);
        Self {
            supervisor: ControlSupervisor::new(scenario),
            rates: EstimateRates::ZERO,
            states: StateValidator::new(safety.map(scenario::InputSafety::policy)),
            references: References::new(scenario),
            lone_landing: LoneLanding::new(scenario),
            modes: ControlModes::new(scenario),
            gains: scenario.gains(),
            planned: scenario.planned_gains(),
            tuned: None,
        }
    }

    /// Returns the gains at a tick without those that were changed in flight.
    fn gains_at(&self, tick: u64) -> &Gains {
        let begun = self.planned.partition_point(|(from, _)| *from <= tick);
        self.planned[..begun]
            .last()
            .map_or(&self.gains, |(_, gains)| gains)
    }
}

impl Service for ControllerService {
    const ID: ServiceId = ServiceId::Controller;
    type Inputs<'a> = ControllerInputs<'a>;
    type Outputs<'a> = ControllerOutputs<'a>;
    type State = ControllerState;

    #[inline]
    fn step(&mut self, now: &Now, inputs: &ControllerInputs<'_>, outputs: &mut ControllerOutputs<'_>) {
        if !self.planned.is_empty() && self.tuned.is_none() {
            // A function of the tick: a process that replaces a dead one has the same gains.
            let gains = *self.gains_at(now.tick);
            self.supervisor.parameters = self.supervisor.parameters.with_gains(&gains);
        }
        let Self {
            supervisor,
            rates,
            states,
            references,
            lone_landing,
            modes,
            ..
        } = self;
        let advanced = supervisor.estimates.advanced(rates, now.elapsed());
        if advanced.is_finite() {
            supervisor.estimates = advanced;
        }
        *rates = EstimateRates::ZERO;
        supervisor.law.advance(now.elapsed());
        if let Some(adaptation) = outputs.adaptation.due() {
            write_adaptation(adaptation, &supervisor.parameters, &supervisor.estimates);
            adaptation.observer_mass_estimate =
                supervisor.observer.map_or(0.0, |observer| 1.0 / observer.theta);
        }
        let is_new = states.look(now, &inputs.state);
        references.update(now, &inputs.reference);
        let mut command = Commanded::NOTHING;
        let (mut learns, mut is_nonsense) = (false, false);
        let mut mode = modes.mode(references.held());
        let is_abandoned = references.are_abandoned(now);
        if let Some(landing) = lone_landing {
            landing.advance(now.elapsed(), is_abandoned);
            if landing.has_landed() {
                mode = ControlMode::Stop;
            }
        }
        if matches!(mode, ControlMode::Stop | ControlMode::Idle) {
            supervisor.stand_by(mode);
        } else if let (Some(state), Some(reference)) = (states.held(), references.held()) {
            let mut target = references.target(now, reference);
            let alone = lone_landing.as_mut().filter(|_| is_abandoned);
            let teaches = mode == ControlMode::Fly && alone.is_none();
            if let Some(landing) = alone {
                target = landing.reference(&target);
                if state.tracked.is_set() {
                    let thrust = supervisor.last.map_or(0.0, |last| last.thrust);
                    let mass = ModelEstimate::new(&supervisor.parameters, &supervisor.estimates).mass;
                    landing.detect_ground(now.elapsed(), state, &target, thrust, mass);
                }
            }
            let input = ControlInput {
                state,
                is_new,
                age_ns: states.age_ns(now).unwrap_or(0),
                reference,
                target,
                teaches,
            };
            let telemetry = Telemetry {
                errors: outputs.errors.due(),
                rates,
            };
            let flown = supervisor.fly(now, &input, telemetry);
            command = flown.command;
            (learns, is_nonsense) = (flown.learns, flown.is_nonsense);
            if outputs.command.due().is_some() {
                supervisor.last = Some(command);
            }
        }
        if is_nonsense {
            states.refuse();
        }
        if let Some(adaptation) = outputs.adaptation.due() {
            adaptation.resting = (!learns).into();
            adaptation.inputs_refused = states.refused().saturating_add(references.refused());
            adaptation.stage = supervisor.stage.code();
        }
        if let Some(due) = outputs.command.due() {
            due.thrust = command.thrust;
            due.torque_body = command.torque_body;
            due.rates_body = command.rates_body;
            due.mode = supervisor.mode();
        }
    }

    fn tune(&mut self, gains: Option<&Gains>) {
        self.tuned = gains.copied();
        let parameters = &mut self.supervisor.parameters;
        *parameters = parameters.with_gains(gains.unwrap_or(&self.gains));
    }

    fn save(&self) -> ControllerState {
        let Self {
            supervisor, rates, ..
        } = self;
        let ControlSupervisor { estimates, .. } = supervisor;
        let memory = supervisor
            .rate_controller
            .map_or(RateControllerState::NONE, |rate_controller| {
                rate_controller.memory
            });
        let seen = supervisor.observer.and_then(|observer| observer.previous);
        let sight = seen.unwrap_or(ObserverSample::NOTHING);
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
            law: supervisor.law.memory(),
            observer_theta: supervisor.observer.map_or(0.0, |observer| observer.theta),
            observer_velocity_world: sight.velocity_world.into(),
            observer_thrust_axis_world: sight.thrust_axis_world.into(),
            observer_thrust: sight.thrust,
            states: self.states.save(),
            reference,
            references,
            last: supervisor.last.unwrap_or(Commanded::NOTHING),
            lands_alone_for: self.lone_landing.map_or(0.0, |landing| landing.under_way_for),
            standing_for: self.lone_landing.map_or(0.0, |landing| landing.standing_for),
            reckoned: supervisor
                .safety
                .map_or(Reckoned::NOTHING, |safety| safety.reckoned),
            commands: supervisor.commands,
            transfer: supervisor.safety.map_or(Transfer::NONE, |safety| safety.transfer),
            unseen_ns: supervisor.safety.map_or(0, |safety| safety.unseen_ns),
            observer_has_seen: seen.is_some().into(),
            has_last: supervisor.last.is_some().into(),
            stage: supervisor.stage.code(),
            pad0: [0; 5],
        }
    }

    fn restore(&mut self, state: &ControllerState) {
        let supervisor = &mut self.supervisor;
        supervisor.estimates = Estimates {
            eta: state.eta_hat,
            disturbance_world: Vector3::from(state.disturbance_hat_world),
            w: ParameterVector::from(state.w_hat),
        };
        self.rates = EstimateRates {
            eta: state.eta_hat_rate,
            disturbance_world: Vector3::from(state.disturbance_hat_rate_world),
            w: ParameterVector::from(state.w_hat_rate),
        };
        supervisor.law.restore(&state.law);
        self.states.restore(&state.states);
        self.references.restore(&state.references, &state.reference);
        if let Some(landing) = &mut self.lone_landing {
            (landing.under_way_for, landing.standing_for) = (state.lands_alone_for, state.standing_for);
        }
        supervisor.commands = state.commands;
        supervisor.last = state.has_last.is_set().then_some(state.last);
        supervisor.stage = FailsafeStage::from_code(state.stage);
        if let Some(safety) = &mut supervisor.safety {
            (safety.reckoned, safety.transfer) = (state.reckoned, state.transfer);
            safety.unseen_ns = state.unseen_ns;
        }
        if let Some(rate_controller) = &mut supervisor.rate_controller {
            rate_controller.memory = RateControllerState {
                artificial_omega: state.artificial_omega.into(),
                yaw_integral: state.yaw_integral,
            };
        }
        if let Some(observer) = &mut supervisor.observer {
            observer.theta = state.observer_theta;
            observer.previous = state.observer_has_seen.is_set().then(|| ObserverSample {
                velocity_world: state.observer_velocity_world.into(),
                thrust_axis_world: state.observer_thrust_axis_world.into(),
                thrust: state.observer_thrust,
            });
        }
    }
}

#[inline]
fn write_adaptation(adaptation: &mut ControlAdaptation, parameters: &Parameters, estimates: &Estimates) {
    let projected = estimates.projected(parameters);
    adaptation.eta_hat = estimates.eta;
    adaptation.eta_projected = projected.eta;
    adaptation.mass_estimate = 1.0 / projected.eta;
    adaptation.disturbance_hat_world = estimates.disturbance_world.into();
    adaptation.disturbance_projected_world = projected.disturbance_world.into();
    adaptation.w_hat = estimates.w.into();
}
