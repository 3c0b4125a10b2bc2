//! What is commanded on a state and a reference: by the law, or while the state is too old by something safer.

use nalgebra::Vector3;
use shared_types::sample::Field;
use shared_types::samples::{ControlCommand, ControlErrors, PathReference, VehicleState};
use shared_types::scenario::Scenario;
use shared_types::{Now, ServiceId, Topic, rotation};
use zerocopy::FromZeros;

use crate::commander::Commander;
use crate::fallback::Stage;
use crate::law::{Evaluation, evaluate};
use crate::observer::{MassObserver, Sight};
use crate::parameters::Parameters;
use crate::reckoning::{Believed, Commanded};
use crate::safety::Safety;
use crate::signals::{Acting, EstimateRates, Estimates, Measured, Reference};
use crate::transfer::Transfer;

/// Makes commands of states and references.
#[derive(Clone, Debug)]
pub struct Pilot {
    /// Gains and bounds.
    pub parameters: Parameters,
    /// η̂, b̂ and ŵ.
    pub estimates: Estimates,
    /// Makes commands of body rates; `None` commands torque.
    pub commander: Option<Commander>,
    /// Estimates the mass in another way, unheard.
    pub observer: Option<MassObserver>,
    /// What is done about old states; `None` flies by them however old they are.
    pub safety: Option<Safety>,
    /// The last command that was published.
    pub last: Option<Commanded>,
    /// The stage of the last step.
    pub stage: Stage,
}

/// What is flown by.
#[derive(Clone, Copy, Debug)]
pub struct Course<'a> {
    /// The last good state.
    pub state: &'a VehicleState,
    /// Whether it came in this step.
    pub is_new: bool,
    /// Time since it was published, ns.
    pub age_ns: u64,
    /// The last good reference.
    pub reference: &'a PathReference,
    /// The reference for the law.
    pub target: Reference,
}

/// What the law says in a step.
#[derive(Clone, Copy, Debug)]
pub struct Said {
    command: Commanded,
    /// Errors of the law.
    pub errors: ControlErrors,
    /// Rates of the estimates.
    pub rates: EstimateRates,
    /// Whether the rates may act.
    pub learns: bool,
    /// The thrust that will act on a state that was measured, N; `None` if the motion then teaches nothing.
    thrust: Option<f64>,
}

/// What is commanded.
#[derive(Clone, Copy, Debug)]
pub struct Flown {
    /// The command.
    pub command: Commanded,
    /// What the law says, if it was asked and made sense.
    pub said: Option<Said>,
    /// Whether the law was asked and made no sense.
    pub is_nonsense: bool,
}

impl Pilot {
    /// The pilot of a scenario that has been checked, with its initial estimates.
    #[must_use]
    pub fn new(scenario: &Scenario) -> Self {
        let controller = &scenario.controller;
        let safety = scenario.safety_of(Topic::VehicleState, ServiceId::Controller);
        Self {
            parameters: Parameters::from(controller),
            estimates: Estimates::from(&controller.initial),
            commander: controller
                .rates
                .as_ref()
                .map(|rates| Commander::new(scenario, rates)),
            observer: controller
                .observer_gain
                .map(|gain| MassObserver::new(gain, controller.initial.mass)),
            safety: safety.map(|safety| Safety::new(scenario, safety)),
            last: None,
            stage: Stage::Law,
        }
    }

    /// What is commanded.
    #[inline]
    pub fn fly(&mut self, now: &Now, course: &Course<'_>) -> Flown {
        let flown = if self.safety.is_some() {
            self.fly_by_age(now, course)
        } else {
            self.stage = Stage::Law;
            self.fly_by_law(course.state, course)
        };
        let thrust = flown.said.as_ref().and_then(|said| said.thrust);
        self.observe(course.state, thrust, now.elapsed());
        flown
    }

    /// What is commanded by the age of the state.
    fn fly_by_age(&mut self, now: &Now, course: &Course<'_>) -> Flown {
        let before = self.stage;
        let Some(mut safety) = self.safety else {
            return self.fly_by_law(course.state, course);
        };
        let Course {
            state,
            is_new,
            age_ns,
            ..
        } = *course;
        let believed = Believed::new(&self.parameters, &self.estimates);
        let last = self.last;
        safety.reckon(now, state, is_new, age_ns, last.as_ref(), &believed);
        self.stage = safety.stage(age_ns, last.as_ref());
        if self.stage != Stage::Law {
            safety.transfer = Transfer::NONE;
            let command = safety.command(self.stage, last.as_ref(), &believed);
            self.safety = Some(safety);
            return Flown {
                command,
                said: None,
                is_nonsense: false,
            };
        }
        let state = safety.state_for_law(state, age_ns, &believed);
        if before != Stage::Law
            && let Some(commander) = &mut self.commander
        {
            commander.memory.artificial_omega = state.angular_velocity_body.into();
        }
        let mut flown = self.fly_by_law(&state, course);
        if let Some(said) = &mut flown.said {
            flown.command = safety.pass_over(now, before, last.as_ref(), &said.command);
            if safety.transfer.is_under_way() {
                (said.learns, said.thrust) = (false, None);
            }
        }
        self.safety = Some(safety);
        flown
    }

    /// The law's command, and all else that it says; if that are no finite numbers, the last command.
    #[inline]
    fn fly_by_law(&mut self, state: &VehicleState, course: &Course<'_>) -> Flown {
        let said = self.ask_law(state, course);
        if said.is_sound() {
            return Flown {
                command: said.command,
                said: Some(said),
                is_nonsense: false,
            };
        }
        if let Some(commander) = &mut self.commander {
            commander.memory.artificial_omega = Vector3::zeros();
        }
        self.stage = Stage::Hold;
        Flown {
            command: self.last.unwrap_or(Commanded::NOTHING),
            said: None,
            is_nonsense: true,
        }
    }

    #[inline]
    fn ask_law(&mut self, state: &VehicleState, course: &Course<'_>) -> Said {
        let Course {
            reference, target, ..
        } = course;
        let mut measured = Measured::from(state);
        let tracked = state.tracked.is_set();
        let z1 = Vector3::from(state.position_world) - target.position_world;
        let Some(commander) = &mut self.commander else {
            measured.position_world += self.parameters.offset(&measured.world_from_body);
            let law = evaluate(&self.parameters, &measured, target, &self.estimates);
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
            target,
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
    #[must_use]
    pub fn mode(&self) -> u32 {
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

    /// Whether all that it says is finite; of the rates that is seen when they act.
    #[inline]
    fn is_sound(&self) -> bool {
        self.command.is_finite() & self.errors.is_finite()
    }
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
