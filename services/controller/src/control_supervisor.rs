//! Control supervisor: commands on a state and a reference, by the law or, if the state is too old, by a failsafe
//! stage.

use nalgebra::Vector3;
use scenario::Scenario;
use shared_types::sample::{Field, Flag};
use shared_types::samples::{ControlAdaptation, ControlCommand, ControlErrors, PathReference, VehicleState};
use shared_types::{Now, ServiceId, Topic, rotation};
use zerocopy::FromZeros;

use crate::bumpless_transfer::Transfer;
use crate::command_history::CommandHistory;
use crate::dead_reckoning::ModelEstimate;
use crate::failsafe::FailsafeStage;
use crate::phase::ControlMode;
use crate::safety::{Safety, SafetyState};
use control_law::adaptive::parameters::Projections;
use control_law::law::flight_law::{FlightLaw, LawState};
use control_law::law::{LawOutput, Moment, registry};
use control_law::observer::{MassObserver, ObserverSample, ObserverState};
use control_law::signals::{Acting, Commanded, Estimates, Measured, Reference, VehicleEstimate};

/// Supervisor that makes commands of states and references.
#[derive(Debug)]
pub struct ControlSupervisor {
    /// The law, with its own gains and state.
    pub law: Box<dyn FlightLaw>,
    /// The last command that was published.
    pub last: Option<Commanded>,
    /// The stage of the last step.
    pub stage: FailsafeStage,
    /// Initial estimates, which hold until the law has commanded or was skipped, or for a law without estimates.
    initial: Estimates,
    has_flown: bool,
    projections: Projections,
    /// Mass observer that runs in parallel; its output is recorded, not used.
    observer: Option<MassObserver>,
    /// Policy for old states; `None` uses every state, however old.
    safety: Option<Safety>,
    /// The commands that the vehicle has followed; none without a policy.
    commands: CommandHistory,
    /// Mode of the law's commands.
    law_mode: u32,
    /// Time between two steps, s.
    step: f64,
}

shared_types::sample! {
    /// State of the supervisor after a step.
    pub struct SupervisorState {
        /// State of the law.
        pub law: LawState,
        /// State of the mass observer; zero without one.
        pub observer: ObserverState,
        /// State of the policy; as at the start without one.
        pub safety: SafetyState,
        /// The commands that the vehicle has followed; none without a policy.
        pub commands: CommandHistory,
        /// The last command that was published; all zero before the first.
        pub last: Commanded,
        /// `true` if there was a last command.
        pub has_last: Flag,
        /// `true` once the law has commanded or was skipped.
        pub has_flown: Flag,
        /// The stage of the last step.
        pub stage: u8,
        /// Explicit padding.
        pub pad0: [u8; 5],
    }
}

/// Inputs of a step.
#[derive(Clone, Copy, Debug)]
pub struct ControlInput<'a> {
    /// The last good state.
    pub state: &'a VehicleState,
    /// `true` if the state is new in this step.
    pub is_new: bool,
    /// Time since it was published, ns.
    pub age_ns: u64,
    /// The last good reference.
    pub reference: &'a PathReference,
    /// The reference for the law.
    pub target: Reference,
    /// `true` if the estimates may adapt to the motion: the vehicle is airborne.
    pub may_adapt: bool,
}

/// Result of a step.
#[derive(Clone, Copy, Debug)]
pub struct ControlOutput {
    /// The command.
    pub command: Commanded,
    /// `true` if the estimates adapt to the motion.
    pub adapts: bool,
    /// `true` if the law gave finite numbers, or none.
    pub is_finite: bool,
    /// Thrust that will act on a measured state, N; `None` if the observer cannot use the motion.
    thrust: Option<f64>,
}

impl ControlOutput {
    /// Returns the output of a command that is not the law's.
    fn without_law(command: Commanded) -> Self {
        Self {
            command,
            adapts: false,
            is_finite: true,
            thrust: None,
        }
    }
}

impl ControlSupervisor {
    /// Makes the supervisor of a checked scenario, with its law.
    #[must_use]
    pub fn new(scenario: &Scenario) -> Self {
        let controller = &scenario.controller;
        let safety = scenario.safety_of(Topic::VehicleState, ServiceId::Controller);
        Self {
            law: registry::flight_law(scenario),
            last: None,
            stage: FailsafeStage::Nominal,
            initial: Estimates::from(&controller.initial),
            has_flown: false,
            projections: Projections::from(&controller.bounds),
            observer: controller
                .observer_gain
                .map(|gain| MassObserver::new(gain, controller.initial.mass)),
            safety: safety.map(|safety| Safety::new(scenario, safety)),
            commands: CommandHistory::new_zeroed(),
            law_mode: match controller.rates {
                Some(_) => ControlCommand::MODE_RATES,
                None => ControlCommand::MODE_TORQUE,
            },
            step: scenario.controller_step(),
        }
    }

    /// Returns the estimates of η and b before projection.
    #[inline]
    fn estimate(&self) -> VehicleEstimate {
        let estimate = if self.has_flown { self.law.estimate() } else { None };
        estimate.unwrap_or_else(|| self.initial.vehicle())
    }

    /// Returns the estimated effect of thrust and gravity on the vehicle.
    #[must_use]
    pub fn model(&self) -> ModelEstimate {
        ModelEstimate::from(&self.projections.of(&self.estimate()))
    }

    /// Writes the telemetry of the estimates.
    #[inline]
    pub fn write_adaptation(&self, adaptation: &mut ControlAdaptation) {
        let estimate = self.estimate();
        let projected = self.projections.of(&estimate);
        adaptation.eta_hat = estimate.eta;
        adaptation.eta_projected = projected.eta;
        adaptation.mass_estimate = 1.0 / projected.eta;
        adaptation.disturbance_hat_world = estimate.disturbance_world.into();
        adaptation.disturbance_projected_world = projected.disturbance_world.into();
        adaptation.w_hat = self.initial.w.into();
        self.law.write_adaptation(adaptation);
        adaptation.observer_mass_estimate = self.observer.as_ref().map_or(0.0, MassObserver::mass);
    }

    /// Returns the command of a step. Writes the errors of the law, if they are due; zero while it does not command.
    #[inline]
    pub fn fly(
        &mut self,
        now: &Now,
        input: &ControlInput<'_>,
        mut errors: Option<&mut ControlErrors>,
    ) -> ControlOutput {
        let mut flown = if let Some(safety) = self.safety {
            self.command_by_age(safety, now, input, &mut errors)
        } else {
            self.stage = FailsafeStage::Nominal;
            self.command_by_law(now, input.state, input, &mut errors)
        };
        if !input.may_adapt {
            (flown.adapts, flown.thrust) = (false, None);
        }
        if !flown.adapts {
            self.law.discard();
        }
        self.has_flown = true;
        self.observe(input.state, flown.thrust, now.elapsed());
        flown
    }

    /// Commands nothing, and makes a cold start with the next flight: only the estimates stay.
    pub fn stand_by(&mut self, mode: ControlMode) {
        self.stage = if mode == ControlMode::Stop {
            FailsafeStage::Failsafe
        } else {
            FailsafeStage::Nominal
        };
        self.last = None;
        self.law.pause();
        if let Some(observer) = &mut self.observer {
            observer.state.interrupt();
        }
        self.commands = CommandHistory::new_zeroed();
        if let Some(safety) = &mut self.safety {
            safety.state = SafetyState::INITIAL;
        }
    }

    /// Returns the command by the age of the state.
    fn command_by_age(
        &mut self,
        mut safety: Safety,
        now: &Now,
        input: &ControlInput<'_>,
        errors: &mut Option<&mut ControlErrors>,
    ) -> ControlOutput {
        let before = self.stage;
        let ControlInput { state, age_ns, .. } = *input;
        let model = self.model();
        let last = self.last;
        safety.reckon(now, input, last.as_ref(), &model, &mut self.commands);
        self.stage = safety.stage(now, input, last.as_ref());
        if self.stage != FailsafeStage::Nominal {
            safety.state.transfer = Transfer::NONE;
            let command = safety.command(self.stage, last.as_ref(), &model);
            self.safety = Some(safety);
            self.law.skip(now.elapsed());
            return ControlOutput::without_law(command);
        }
        let state = safety.state_for_law(state, age_ns, &model);
        if before != FailsafeStage::Nominal {
            self.law.resume(state.angular_velocity_body.into());
        }
        let mut flown = self.command_by_law(now, &state, input, errors);
        if flown.is_finite {
            flown.command = safety.pass_over(now, before, last.as_ref(), &flown.command);
            if safety.state.transfer.is_under_way() {
                (flown.adapts, flown.thrust) = (false, None);
            }
        }
        self.safety = Some(safety);
        flown
    }

    /// Returns the law's command; if it or its errors are not finite, the last command.
    #[inline]
    fn command_by_law(
        &mut self,
        now: &Now,
        state: &VehicleState,
        input: &ControlInput<'_>,
        errors: &mut Option<&mut ControlErrors>,
    ) -> ControlOutput {
        let flown = self.evaluate_law(now, state, input, errors);
        // The rates of the estimates are checked when they act.
        if flown.command.is_finite() & errors.as_deref().is_none_or(Field::is_finite) {
            return flown;
        }
        self.hold(errors)
    }

    #[cold]
    fn hold(&mut self, errors: &mut Option<&mut ControlErrors>) -> ControlOutput {
        if let Some(errors) = errors {
            **errors = ControlErrors {
                header: errors.header,
                ..ControlErrors::new_zeroed()
            };
        }
        self.law.resume(Vector3::zeros());
        self.stage = FailsafeStage::Hold;
        ControlOutput {
            is_finite: false,
            ..ControlOutput::without_law(self.last.unwrap_or(Commanded::NOTHING))
        }
    }

    #[inline]
    fn evaluate_law(
        &mut self,
        now: &Now,
        state: &VehicleState,
        input: &ControlInput<'_>,
        errors: &mut Option<&mut ControlErrors>,
    ) -> ControlOutput {
        let target = &input.target;
        let tracked = state.tracked.is_set();
        let is_transferred = self
            .safety
            .as_ref()
            .is_some_and(|safety| safety.state.transfer.is_under_way());
        let moment = Moment {
            measured: Measured::from(state),
            acting: Acting::from(state),
            reference: target,
            yaw: input.reference.yaw,
            elapsed: if now.elapsed_ns == 0 {
                self.step
            } else {
                now.elapsed()
            },
            may_adapt: tracked && input.may_adapt && !is_transferred,
        };
        let LawOutput {
            command,
            limited_thrust,
            telemetry,
            is_feasible,
        } = self.law.command(&moment);
        if let Some(errors) = errors {
            // z1 is without the offset by which the law may be shifted.
            let z1 = Vector3::from(state.position_world) - target.position_world;
            errors.z1 = z1.into();
            errors.z2 = telemetry.z2.into();
            errors.z3 = telemetry.z3.into();
            errors.z4 = target.gamma_dot - target.gamma_dot_desired; // (22)
            errors.zeta = telemetry.zeta.into();
            errors.omega_desired = telemetry.omega_desired.into();
        }
        ControlOutput {
            command,
            adapts: tracked && is_feasible,
            is_finite: true,
            thrust: tracked.then_some(limited_thrust),
        }
    }

    /// Returns the mode of this step's commands.
    #[must_use]
    pub fn mode(&self) -> u32 {
        match self.stage {
            FailsafeStage::Failsafe => ControlCommand::MODE_FAILSAFE,
            _ => self.law_mode,
        }
    }

    /// Steps the observer with the state and the thrust (N) that is commanded on it; `None` if it cannot use the motion.
    #[inline]
    fn observe(&mut self, state: &VehicleState, thrust: Option<f64>, elapsed: f64) {
        let Some(observer) = &mut self.observer else {
            return;
        };
        if let Some(thrust) = thrust.filter(|_| elapsed > 0.0) {
            let world_from_body = rotation::from_row_major(&state.world_from_body);
            let now = ObserverSample {
                velocity_world: state.velocity_world().into(),
                thrust_axis_world: world_from_body.column(2).into(),
                thrust,
            };
            observer.step(&now, elapsed);
        } else {
            observer.state.interrupt();
        }
    }

    /// Returns the state after the last step.
    #[must_use]
    pub fn save(&self) -> SupervisorState {
        SupervisorState {
            law: self.law.save(),
            observer: self
                .observer
                .map_or_else(ObserverState::new_zeroed, |observer| observer.state),
            safety: self
                .safety
                .as_ref()
                .map_or(SafetyState::INITIAL, |safety| safety.state),
            commands: self.commands,
            last: self.last.unwrap_or(Commanded::NOTHING),
            has_last: self.last.is_some().into(),
            has_flown: self.has_flown.into(),
            stage: self.stage.code(),
            pad0: [0; 5],
        }
    }

    /// Restores a saved state.
    pub fn restore(&mut self, state: &SupervisorState) {
        self.law.restore(&state.law);
        if let Some(observer) = &mut self.observer {
            observer.state = state.observer;
        }
        if let Some(safety) = &mut self.safety {
            safety.state = state.safety;
        }
        self.commands = state.commands;
        self.last = state.has_last.is_set().then_some(state.last);
        self.has_flown = state.has_flown.is_set();
        self.stage = FailsafeStage::from_code(state.stage);
    }
}
