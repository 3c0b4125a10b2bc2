//! Baseline of a flight: the nominal loop with the estimate that the scenario chooses.

use nalgebra::Vector3;
use scenario::{GRAVITY, LawKind, Scenario};

use super::Memory;
use super::baseline::{Baseline, Motion};
use super::geometric_pid::GeometricPid;
use super::immersion_mass::ImmersionMass;
use super::indi::Indi;
use super::l1::L1;
use super::nf_constant::NfConstant;
use super::nominal::{Command, Nominal};
use super::px4::Px4;
use super::{Law, LawOutput, Moment, Telemetry};
use crate::rate_controller::RateController;
use crate::signals::{Acting, EstimateRates, Measured, Reference};

/// The baseline of a flight.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BaselineLaw {
    nominal: Nominal,
    /// Mass that it starts with, kg.
    prior_mass: f64,
    /// Time between two steps, s.
    step: f64,
    learner: Learner,
}

/// Time since the step before beyond which steps were left out, in steps: the attitude in between is unknown.
const LEFT_OUT: f64 = 1.5;

#[derive(Clone, Copy, Debug, PartialEq)]
enum Learner {
    GeometricPid(GeometricPid),
    L1(L1),
    Indi(Indi),
    NfConstant(NfConstant),
    Px4(Px4),
    ImmersionMass(ImmersionMass),
    /// It learns nothing.
    Nothing(Nothing),
}

/// A baseline that learns nothing: the nominal loop alone.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Nothing;

impl Baseline for Nothing {
    fn learn(&mut self, _seen: &Motion, _elapsed: f64) {}

    fn compensation(&self) -> Vector3<f64> {
        Vector3::zeros()
    }

    fn save(&self, _memory: &mut Memory) {}

    fn restore(&mut self, _memory: &Memory) {}
}

impl BaselineLaw {
    /// Makes the baseline of a checked scenario: for laws without a learner of their own, the nominal loop alone.
    #[must_use]
    pub fn new(scenario: &Scenario) -> Self {
        let stated = scenario.controller.baseline.clone().unwrap_or_default();
        let prior_mass = scenario.controller.initial.mass;
        let learner = match scenario.controller.law {
            LawKind::Adaptive | LawKind::ImmersionInertia | LawKind::Nmpc => Learner::Nothing(Nothing),
            LawKind::GeometricPid => Learner::GeometricPid(GeometricPid::new(&stated)),
            LawKind::L1 => Learner::L1(L1::new(&stated)),
            LawKind::Indi => Learner::Indi(Indi::default()),
            LawKind::NfConstant => Learner::NfConstant(NfConstant::new(&stated)),
            LawKind::Px4 => Learner::Px4(Px4::new(&stated, prior_mass)),
            LawKind::ImmersionMass => {
                let bounds = &scenario.controller.bounds;
                Learner::ImmersionMass(ImmersionMass::new(stated.immersion_gain, prior_mass, bounds))
            }
        };
        let nominal = match learner {
            Learner::Px4(_) => Px4::nominal(&stated),
            _ => Nominal {
                position_gain: Vector3::repeat(stated.position_gain),
                velocity_gain: Vector3::repeat(stated.velocity_gain),
                attitude_gain: stated.attitude_gain,
                error_limit: stated.error_limit.unwrap_or(f64::INFINITY),
            },
        };
        Self {
            nominal,
            prior_mass,
            step: scenario.controller_step(),
            learner,
        }
    }

    /// Learns, if the motion teaches, and returns the command of the coming hold.
    pub fn command(&mut self, moment: &Moment<'_>, rate_controller: &mut RateController) -> LawOutput {
        let Moment {
            measured,
            acting,
            reference,
            elapsed,
            ..
        } = moment;
        let force = self.evaluate(measured, reference, &Vector3::zeros());
        let learns = moment.teaches && rate_controller.is_telling(force.thrust, acting);
        if !learns || *elapsed > LEFT_OUT * self.step {
            self.learner_mut().rest();
        }
        if learns {
            let seen = self.seen(measured, acting, reference);
            let before = *self;
            self.learner_mut().learn(&seen, *elapsed);
            if !self.learner().is_finite() {
                *self = before;
            }
        }
        let output = rate_controller.fly(self, moment);
        output.told(self.telemetry(&output.law))
    }

    /// Returns thrust (N) and angular velocity (in {B}, rad/s) of the nominal loop at a moment, with what is recorded of it.
    #[must_use]
    pub fn wanted(&self, measured: &Measured, reference: &Reference) -> (f64, Vector3<f64>, Telemetry) {
        let command = self.evaluate(measured, reference, &Vector3::zeros());
        (command.thrust, command.omega, self.telemetry(&command))
    }

    /// Returns the motion that a state shows.
    #[must_use]
    pub fn seen(&self, measured: &Measured, acting: &Acting, reference: &Reference) -> Motion {
        let axis = measured.world_from_body.column(2);
        let modelled = Vector3::z() * GRAVITY - axis * (acting.thrust / self.prior_mass);
        Motion {
            tracking: self.nominal.tracking(measured, reference),
            velocity_world: measured.velocity_world(),
            modelled_acceleration: modelled,
            residual: acting.acceleration_world - modelled,
            thrust_axis_world: axis.into(),
            thrust: acting.thrust,
        }
    }

    /// Returns the part that learns.
    #[must_use]
    pub fn learner(&self) -> &dyn Baseline {
        match &self.learner {
            Learner::GeometricPid(law) => law,
            Learner::L1(law) => law,
            Learner::Indi(law) => law,
            Learner::NfConstant(law) => law,
            Learner::Px4(law) => law,
            Learner::ImmersionMass(law) => law,
            Learner::Nothing(law) => law,
        }
    }

    /// Returns the part that learns, to let it learn or to restore it.
    pub fn learner_mut(&mut self) -> &mut dyn Baseline {
        match &mut self.learner {
            Learner::GeometricPid(law) => law,
            Learner::L1(law) => law,
            Learner::Indi(law) => law,
            Learner::NfConstant(law) => law,
            Learner::Px4(law) => law,
            Learner::ImmersionMass(law) => law,
            Learner::Nothing(law) => law,
        }
    }

    /// Returns the estimate of the mass, kg.
    #[must_use]
    pub fn mass(&self) -> f64 {
        self.learner().mass().unwrap_or(self.prior_mass)
    }
}

impl Law for BaselineLaw {
    type Evaluation = Command;

    fn evaluate(&self, vehicle: &Measured, reference: &Reference, push: &Vector3<f64>) -> Command {
        let compensation = self.learner().compensation();
        self.nominal
            .command(vehicle, reference, self.mass(), &compensation, push)
    }

    fn thrust(&self, evaluation: &Command) -> f64 {
        evaluation.thrust
    }

    fn turn(&self, omega: &mut Vector3<f64>, evaluation: &Command, _h: f64) {
        (omega.x, omega.y) = (evaluation.omega.x, evaluation.omega.y);
    }

    fn acceleration(&self, vehicle: &Measured, _reference: &Reference, thrust: f64) -> Vector3<f64> {
        Vector3::z() * GRAVITY - vehicle.world_from_body.column(2) * (thrust / self.mass())
    }

    fn telemetry(&self, evaluation: &Command) -> Telemetry {
        let Command { tracking, omega, .. } = evaluation;
        let slowness = self.nominal.velocity_gain.map(|gain| 2.0 / gain);
        let z2 = tracking.velocity_error
            + self
                .nominal
                .position_gain
                .component_mul(&slowness)
                .component_mul(&tracking.position_error);
        Telemetry {
            z2,
            z3: Vector3::zeros(),
            zeta: evaluation.force,
            omega_desired: *omega,
            rates: EstimateRates::ZERO,
        }
    }
}
