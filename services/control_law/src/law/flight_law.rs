//! Law of a flight, as the scenario chooses it: all that the supervisor knows of laws.

use nalgebra::Vector3;
use scenario::{LawKind, Scenario};

use super::baseline_law::BaselineLaw;
use super::immersion_inertia::ImmersionInertia;
use super::nmpc::Nmpc;
use super::{LawOutput, Memory, Moment, Telemetry};
use crate::adaptive::evaluation::evaluate_composite;
use crate::adaptive::harmonics::Harmonics;
use crate::adaptive::parameters::Parameters;
use crate::adaptive::repeating::Repeating;
use crate::rate_controller::RateController;
use crate::signals::Commanded;
use crate::signals::{Estimates, Reference};

/// The law of a flight with its state; η̂, b̂ and ŵ are the supervisor's.
#[derive(Clone, Debug)]
pub enum FlightLaw {
    /// The paper's law, with what repeats with the path if the scenario states harmonics.
    Adaptive(Option<Box<Harmonics>>),
    /// A baseline with the nominal loop.
    Baseline(Box<BaselineLaw>),
    /// A baseline that commands torque.
    ImmersionInertia(Box<ImmersionInertia>),
    /// Model predictive control.
    Nmpc(Box<Nmpc>),
}

impl FlightLaw {
    /// Makes the law of a checked scenario.
    #[must_use]
    pub fn new(scenario: &Scenario) -> Self {
        match scenario.controller.law {
            LawKind::Adaptive => Self::Adaptive(Harmonics::of(scenario).map(Box::new)),
            LawKind::ImmersionInertia => {
                let outer = BaselineLaw::new(scenario);
                Self::ImmersionInertia(Box::new(ImmersionInertia::new(scenario, outer)))
            }
            LawKind::Nmpc => Self::Nmpc(Box::new(Nmpc::new(scenario))),
            _ => Self::Baseline(Box::new(BaselineLaw::new(scenario))),
        }
    }

    /// Returns the command at a moment: of torque, or with a rate controller of body rates.
    #[inline]
    pub fn command(
        &mut self,
        parameters: &Parameters,
        estimates: &Estimates,
        moment: &Moment<'_>,
        rate_controller: Option<&mut RateController>,
    ) -> LawOutput {
        match (self, rate_controller) {
            (Self::Adaptive(harmonics), Some(rate_controller)) => {
                let harmonics = harmonics.as_deref_mut();
                adaptive_rates(parameters, estimates, harmonics, moment, rate_controller)
            }
            (Self::Adaptive(harmonics), None) => {
                adaptive_torque(parameters, estimates, harmonics.as_deref_mut(), moment)
            }
            (Self::Baseline(law), Some(rate_controller)) => law.command(moment, rate_controller),
            (Self::Nmpc(law), Some(rate_controller)) => law.command(moment, rate_controller),
            (Self::ImmersionInertia(law), _) => law.command(moment),
            (Self::Baseline(_) | Self::Nmpc(_), None) => {
                unreachable!("the check refuses them without commands of body rates")
            }
        }
    }

    /// Lets estimates step over `elapsed` seconds by what the step before has taught.
    #[inline]
    pub fn advance(&mut self, elapsed: f64) {
        if let Self::Adaptive(Some(harmonics)) = self {
            harmonics.advance(elapsed);
        }
    }

    /// Drops what this step has taught: it was not the law's command that was flown.
    pub fn unlearn(&mut self) {
        if let Self::Adaptive(Some(harmonics)) = self {
            harmonics.unlearn();
        }
    }

    /// Passes a step, `elapsed` seconds after the one before, in which something else commands.
    pub fn skip(&mut self, elapsed: f64) {
        match self {
            Self::Nmpc(law) => law.shift(elapsed),
            _ => self.rest(),
        }
    }

    /// Prepares for a pause.
    pub fn rest(&mut self) {
        match self {
            Self::Adaptive(_) => self.unlearn(),
            Self::Baseline(law) => law.learner_mut().rest(),
            Self::ImmersionInertia(law) => law.rest(),
            Self::Nmpc(law) => law.rest(),
        }
    }

    /// Returns the estimates of a baseline: mass (kg) and disturbance (in {I}, m/s²).
    #[must_use]
    pub fn estimates(&self) -> Option<(f64, Vector3<f64>)> {
        match self {
            Self::Adaptive(_) | Self::ImmersionInertia(_) => None,
            Self::Baseline(law) => Some((law.mass(), law.learner().compensation())),
            Self::Nmpc(law) => Some((law.mass(), law.residual())),
        }
    }

    /// Returns the state.
    #[must_use]
    pub fn memory(&self) -> Memory {
        let mut memory = [0.0; super::MEMORY];
        match self {
            Self::Adaptive(None) => {}
            Self::Adaptive(Some(harmonics)) => harmonics.save(&mut memory),
            Self::Baseline(law) => law.learner().save(&mut memory),
            Self::ImmersionInertia(law) => law.save(&mut memory),
            Self::Nmpc(law) => law.save(&mut memory),
        }
        memory
    }

    /// Restores a saved state.
    pub fn restore(&mut self, memory: &Memory) {
        match self {
            Self::Adaptive(None) => {}
            Self::Adaptive(Some(harmonics)) => harmonics.restore(memory),
            Self::Baseline(law) => law.learner_mut().restore(memory),
            Self::ImmersionInertia(law) => law.restore(memory),
            Self::Nmpc(law) => law.restore(memory),
        }
    }
}

#[inline]
fn adaptive_rates(
    parameters: &Parameters,
    estimates: &Estimates,
    harmonics: Option<&mut Harmonics>,
    moment: &Moment<'_>,
    rate_controller: &mut RateController,
) -> LawOutput {
    let law = rate_controller.adaptive_law(parameters, estimates, harmonics.as_deref());
    let output = rate_controller.fly(&law, moment);
    if let Some(harmonics) = harmonics {
        harmonics.teach(&output.law, moment.reference.gamma);
    }
    output.told(Telemetry::from(&output.law))
}

#[inline]
fn adaptive_torque(
    parameters: &Parameters,
    estimates: &Estimates,
    harmonics: Option<&mut Harmonics>,
    moment: &Moment<'_>,
) -> LawOutput {
    let reference: &Reference = moment.reference;
    let mut measured = moment.measured;
    measured.position_world += parameters.offset(&measured.world_from_body);
    let repeating = harmonics.as_deref().map_or(Repeating::NOTHING, |harmonics| {
        harmonics.at(reference.gamma, reference.gamma_dot)
    });
    let error = Vector3::zeros();
    let law = evaluate_composite(parameters, &measured, reference, estimates, &repeating, &error);
    if let Some(harmonics) = harmonics {
        harmonics.teach(&law, reference.gamma);
    }
    LawOutput {
        command: Commanded {
            thrust: law.thrust,
            torque_body: law.torque.into(),
            ..Commanded::NOTHING
        },
        limited_thrust: law.thrust,
        telemetry: Telemetry::from(&law),
        is_telling: true,
    }
}
