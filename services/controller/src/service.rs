//! Controller as a service: the law and the supervisor around it, at each step.
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

use scenario::Scenario;
use shared_types::input_validator::{GateState, StateGateState, StateValidator};
use shared_types::samples::PathReference;
use shared_types::wiring::{ControllerInputs, ControllerOutputs};
use shared_types::{Gains, Now, Service, ServiceId, Topic};
use zerocopy::FromZeros;

use crate::control_supervisor::{ControlInput, ControlSupervisor, SupervisorState};
use crate::lone_landing::{LandingState, LoneLanding};
use crate::phase::{ControlMode, ControlModes};
use crate::references::References;
use control_law::signals::Commanded;

shared_types::sample! {
    /// State of the controller after a step.
    pub struct ControllerState {
        /// State of the supervisor, with that of the law.
        pub supervisor: SupervisorState,
        /// State of the input validator of states.
        pub states: StateGateState,
        /// The last good reference; all zero before the first.
        pub reference: PathReference,
        /// State of the input validator of references.
        pub references: GateState,
        /// Progress of a landing without a path generator.
        pub landing: LandingState,
    }
}

/// Control law as a service of the flight.
#[derive(Debug)]
pub struct ControllerService {
    supervisor: ControlSupervisor,
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
    /// Makes the controller of a checked scenario.
    #[must_use]
    pub fn new(scenario: &Scenario) -> Self {
        let safety = scenario.safety_of(Topic::VehicleState, ServiceId::Controller);
        Self {
            supervisor: ControlSupervisor::new(scenario),
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
            // A function of the tick, so that a restarted process has the same gains.
            let gains = *self.gains_at(now.tick);
            self.supervisor.law.set_gains(&gains);
        }
        let Self {
            supervisor,
            states,
            references,
            lone_landing,
            modes,
            ..
        } = self;
        supervisor.law.advance(now.elapsed());
        if let Some(adaptation) = outputs.adaptation.due() {
            supervisor.write_adaptation(adaptation);
        }
        let is_new = states.look(now, &inputs.state);
        references.update(now, &inputs.reference);
        let mut command = Commanded::NOTHING;
        let (mut adapts, mut is_finite) = (false, true);
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
            let may_adapt = mode == ControlMode::Fly && alone.is_none();
            if let Some(landing) = alone {
                target = landing.reference(&target);
                if state.tracked.is_set() {
                    let thrust = supervisor.last.map_or(0.0, |last| last.thrust);
                    let mass = supervisor.model().mass;
                    landing.detect_ground(now.elapsed(), state, &target, thrust, mass);
                }
            }
            let input = ControlInput {
                state,
                is_new,
                age_ns: states.age_ns(now).unwrap_or(0),
                reference,
                target,
                may_adapt,
            };
            let flown = supervisor.fly(now, &input, outputs.errors.due());
            command = flown.command;
            (adapts, is_finite) = (flown.adapts, flown.is_finite);
            if outputs.command.due().is_some() {
                supervisor.last = Some(command);
            }
        }
        if !is_finite {
            states.refuse();
        }
        if let Some(adaptation) = outputs.adaptation.due() {
            adaptation.resting = (!adapts).into();
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
        self.supervisor.law.set_gains(gains.unwrap_or(&self.gains));
    }

    fn save(&self) -> ControllerState {
        let (references, reference) = self.references.save();
        ControllerState {
            supervisor: self.supervisor.save(),
            states: self.states.save(),
            reference,
            references,
            landing: self
                .lone_landing
                .map_or_else(LandingState::new_zeroed, |landing| landing.state),
        }
    }

    fn restore(&mut self, state: &ControllerState) {
        self.supervisor.restore(&state.supervisor);
        self.states.restore(&state.states);
        self.references.restore(&state.references, &state.reference);
        if let Some(landing) = &mut self.lone_landing {
            landing.state = state.landing;
        }
    }
}
