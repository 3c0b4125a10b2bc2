//! Control supervisor: commands on a state and a reference, by the law or, if the state is too old, by a failsafe
//! stage.

use nalgebra::Vector3;
use scenario::Scenario;
use shared_types::sample::Field;
use shared_types::samples::{ControlCommand, ControlErrors, PathReference, VehicleState};
use shared_types::{Now, ServiceId, Topic, rotation};
use zerocopy::FromZeros;

use crate::bumpless_transfer::Transfer;
use crate::command_history::CommandHistory;
use crate::dead_reckoning::{ModelEstimate, Reckoned};
use crate::failsafe::FailsafeStage;
use crate::phase::ControlMode;
use crate::safety::Safety;
use control_law::adaptive::parameters::Parameters;
use control_law::law::flight_law::FlightLaw;
use control_law::law::{self, LawOutput, Moment};
use control_law::observer::{MassObserver, ObserverSample};
use control_law::rate_controller::{RateController, RateControllerState};
use control_law::signals::Commanded;
use control_law::signals::{Acting, EstimateRates, Estimates, Measured, Reference};

/// Supervisor that makes commands of states and references.
#[derive(Clone, Debug)]
pub struct ControlSupervisor {
    /// Gains and bounds.
    pub parameters: Parameters,
    /// η̂, b̂ and ŵ.
    pub estimates: Estimates,
    /// The law, with its own state.
    pub law: FlightLaw,
    /// Controller of body rates; `None` commands torque.
    pub rate_controller: Option<RateController>,
    /// Mass observer that runs in parallel; its output is recorded, not used.
    pub observer: Option<MassObserver>,
    /// Policy for old states; `None` uses every state, however old.
    pub safety: Option<Safety>,
    /// The commands that the vehicle has followed; none without a policy.
    pub commands: CommandHistory,
    /// The last command that was published.
    pub last: Option<Commanded>,
    /// The stage of the last step.
    pub stage: FailsafeStage,
    /// Time between two steps, s.
    step: f64,
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
    /// `true` if the estimates may learn from the motion: the vehicle is airborne.
    pub teaches: bool,
}

/// Telemetry of the law.
#[derive(Debug)]
pub struct Telemetry<'a> {
    /// Errors of the law, if they are wanted; all zero while the controller is not active.
    pub errors: Option<&'a mut ControlErrors>,
    /// Rates of the estimates; zero where they must not act.
    pub rates: &'a mut EstimateRates,
}

/// Result of a step.
#[derive(Clone, Copy, Debug)]
pub struct ControlOutput {
    /// The command.
    pub command: Commanded,
    /// `true` if the estimates learn from the motion.
    pub learns: bool,
    /// `true` if the law gave numbers that are not finite.
    pub is_nonsense: bool,
    /// Thrust that will act on a measured state, N; `None` if the estimates cannot learn from the motion.
    thrust: Option<f64>,
}

impl ControlOutput {
    /// Output of a command that is not the law's.
    fn without_law(command: Commanded) -> Self {
        Self {
            command,
            learns: false,
            is_nonsense: false,
            thrust: None,
        }
    }
}

impl ControlSupervisor {
    /// Makes the supervisor of a checked scenario, with its initial estimates.
    #[must_use]
    pub fn new(scenario: &Scenario) -> Self {
        let controller = &scenario.controller;
        let safety = scenario.safety_of(Topic::VehicleState, ServiceId::Controller);
        Self {
            parameters: Parameters::from(scenario),
            estimates: Estimates::from(&controller.initial),
            law: FlightLaw::new(scenario),
            rate_controller: controller
                .rates
                .as_ref()
                .map(|rates| RateController::new(scenario, rates)),
            observer: controller
                .observer_gain
                .map(|gain| MassObserver::new(gain, controller.initial.mass)),
            safety: safety.map(|safety| Safety::new(scenario, safety)),
            commands: CommandHistory::new_zeroed(),
            last: None,
            stage: FailsafeStage::Nominal,
            step: scenario.controller_step(),
        }
    }

    /// Returns the command of a step.
    #[inline]
    pub fn fly(
        &mut self,
        now: &Now,
        input: &ControlInput<'_>,
        mut telemetry: Telemetry<'_>,
    ) -> ControlOutput {
        let mut flown = if self.safety.is_some() {
            self.command_by_age(now, input, &mut telemetry)
        } else {
            self.stage = FailsafeStage::Nominal;
            self.command_by_law(now, input.state, input, &mut telemetry)
        };
        if !input.teaches {
            (flown.learns, flown.thrust) = (false, None);
        }
        if !flown.learns {
            *telemetry.rates = EstimateRates::ZERO;
            self.law.unlearn();
        }
        if let Some((mass, disturbance_world)) = self.law.estimates() {
            self.estimates.eta = 1.0 / mass;
            self.estimates.disturbance_world = disturbance_world;
        }
        self.observe(input.state, flown.thrust, now.elapsed());
        flown
    }

    /// Commands nothing, and makes a cold start with the next flight: only the estimates are kept.
    pub fn stand_by(&mut self, mode: ControlMode) {
        self.stage = if mode == ControlMode::Stop {
            FailsafeStage::Failsafe
        } else {
            FailsafeStage::Nominal
        };
        self.last = None;
        if let Some(rate_controller) = &mut self.rate_controller {
            rate_controller.memory = RateControllerState::NONE;
        }
        self.law.rest();
        if let Some(observer) = &mut self.observer {
            observer.interrupt();
        }
        self.commands = CommandHistory::new_zeroed();
        if let Some(safety) = &mut self.safety {
            (safety.reckoned, safety.transfer, safety.unseen_ns) = (Reckoned::NOTHING, Transfer::NONE, 0);
        }
    }

    /// Returns the command by the age of the state.
    fn command_by_age(
        &mut self,
        now: &Now,
        input: &ControlInput<'_>,
        telemetry: &mut Telemetry<'_>,
    ) -> ControlOutput {
        let before = self.stage;
        let Some(mut safety) = self.safety else {
            return self.command_by_law(now, input.state, input, telemetry);
        };
        let ControlInput { state, age_ns, .. } = *input;
        let estimate = ModelEstimate::new(&self.parameters, &self.estimates);
        let last = self.last;
        safety.reckon(now, input, last.as_ref(), &estimate, &mut self.commands);
        self.stage = safety.stage(now, input, last.as_ref());
        if self.stage != FailsafeStage::Nominal {
            safety.transfer = Transfer::NONE;
            let command = safety.command(self.stage, last.as_ref(), &estimate);
            self.safety = Some(safety);
            self.law.skip(now.elapsed());
            return ControlOutput::without_law(command);
        }
        let state = safety.state_for_law(state, age_ns, &estimate);
        if before != FailsafeStage::Nominal
            && let Some(rate_controller) = &mut self.rate_controller
        {
            rate_controller.memory.artificial_omega = state.angular_velocity_body.into();
        }
        let mut flown = self.command_by_law(now, &state, input, telemetry);
        if !flown.is_nonsense {
            flown.command = safety.pass_over(now, before, last.as_ref(), &flown.command);
            if safety.transfer.is_under_way() {
                (flown.learns, flown.thrust) = (false, None);
            }
        }
        self.safety = Some(safety);
        flown
    }

    /// Returns the law's command and telemetry; if they are not finite, the last command.
    #[inline]
    fn command_by_law(
        &mut self,
        now: &Now,
        state: &VehicleState,
        input: &ControlInput<'_>,
        telemetry: &mut Telemetry<'_>,
    ) -> ControlOutput {
        let flown = self.evaluate_law(now, state, input, telemetry);
        let errors = telemetry.errors.as_deref();
        // The rates of the estimates are checked when they act.
        if flown.command.is_finite() & errors.is_none_or(Field::is_finite) {
            return flown;
        }
        self.hold(telemetry)
    }

    #[cold]
    fn hold(&mut self, telemetry: &mut Telemetry<'_>) -> ControlOutput {
        if let Some(errors) = &mut telemetry.errors {
            **errors = ControlErrors {
                header: errors.header,
                ..ControlErrors::new_zeroed()
            };
        }
        if let Some(rate_controller) = &mut self.rate_controller {
            rate_controller.memory.artificial_omega = Vector3::zeros();
        }
        self.stage = FailsafeStage::Hold;
        ControlOutput {
            is_nonsense: true,
            ..ControlOutput::without_law(self.last.unwrap_or(Commanded::NOTHING))
        }
    }

    #[inline]
    fn evaluate_law(
        &mut self,
        now: &Now,
        state: &VehicleState,
        input: &ControlInput<'_>,
        telemetry: &mut Telemetry<'_>,
    ) -> ControlOutput {
        let target = &input.target;
        let tracked = state.tracked.is_set();
        let is_transferred = self.safety.is_some_and(|safety| safety.transfer.is_under_way());
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
            teaches: tracked && input.teaches && !is_transferred,
        };
        let (parameters, estimates) = (&self.parameters, &self.estimates);
        let LawOutput {
            command,
            limited_thrust,
            telemetry: told,
            is_telling,
        } = self
            .law
            .command(parameters, estimates, &moment, self.rate_controller.as_mut());
        let z1 = Vector3::from(state.position_world) - target.position_world;
        telemetry.tell(&told, &z1, target);
        ControlOutput {
            command,
            learns: tracked && is_telling,
            is_nonsense: false,
            thrust: tracked.then_some(limited_thrust),
        }
    }

    /// Returns the mode of this step's commands.
    #[must_use]
    pub fn mode(&self) -> u32 {
        match (self.stage, &self.rate_controller) {
            (FailsafeStage::Failsafe, _) => ControlCommand::MODE_FAILSAFE,
            (_, Some(_)) => ControlCommand::MODE_RATES,
            (_, None) => ControlCommand::MODE_TORQUE,
        }
    }

    /// Steps the observer with the state and the thrust (N) that is commanded on it; `None` if it cannot learn from it.
    #[inline]
    fn observe(&mut self, state: &VehicleState, thrust: Option<f64>, elapsed: f64) {
        let Some(observer) = &mut self.observer else {
            return;
        };
        if let Some(thrust) = thrust.filter(|_| elapsed > 0.0) {
            let world_from_body = rotation::from_row_major(&state.world_from_body);
            let now = ObserverSample {
                velocity_world: state.velocity_world(),
                thrust_axis_world: world_from_body.column(2).into(),
                thrust,
            };
            observer.step(now, elapsed);
        } else {
            observer.interrupt();
        }
    }
}

impl Telemetry<'_> {
    /// Records the law's values; z1 is without the offset by which the law may be shifted.
    #[inline]
    fn tell(&mut self, law: &law::Telemetry, z1: &Vector3<f64>, reference: &Reference) {
        *self.rates = law.rates;
        if let Some(errors) = &mut self.errors {
            errors.z1 = (*z1).into();
            errors.z2 = law.z2.into();
            errors.z3 = law.z3.into();
            errors.z4 = reference.gamma_dot - reference.gamma_dot_desired; // (22)
            errors.zeta = law.zeta.into();
            errors.omega_desired = law.omega_desired.into();
        }
    }
}
